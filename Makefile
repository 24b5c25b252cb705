# Each target sets its environment up on the way (docker/run); DEBIAN=sid takes the other suite.
RUN = docker/run
OUTPUT = output
# The shell takes it from its environment as it is, blanks and all.
export OUTPUT
# A virtual environment where pip has installed DOLFINx, with an MPI of its own.
WHEEL = DEBIAN="$${DEBIAN:-trixie}" $(RUN) docker/wheel solver,pictures,records,gmsh,explorer,test
# Tests that run there (`make test-long`: all quick tests) and processes of those on one rank; `-rs`
# lists skipped tests with the reason.
WHEEL_TESTS = tests/records/test_manifest.py tests/physics/test_blocks.py \
	tests/physics/test_linear_triangle.py
WHEEL_PROCESSES = 0
# Sets of these tests for separate runs on two ranks: MPICH has 2048 communicators, and the meshes
# of earlier tests keep theirs on several ranks.
WHEEL_PARTS = '$(WHEEL_TESTS)'
WHEEL_PYTEST = python3 -m pytest --color=no -rs
# mpirun gives its ranks a terminal, so that pytest would colour what goes to a log.
PYTEST = python3 -m pytest --color=no --durations=40 --durations-min=1 tests
# Archives of a release are built where Debian packages are.
PACKAGES = DEBIAN=trixie DOLFINX_CONTACT_PACKAGES=debian $(RUN)
# The site is built in a small environment without DOLFINx, the same beside every DOLFINx.
DOCS = DEBIAN=trixie DOLFINX_CONTACT_PACKAGES=docs $(RUN)
# All pages anew: each has the titles of others in its margins.
SPHINX = python3 -m sphinx -q -W --keep-going -E -a -j auto

.PHONY: help demo test test-pip test-long test-paraview test-browser attacks mutants \
	packages docs docs-check docs-questions docs-links lint style types clean

help:
	@echo "make demo       all branches of a triangle on a floor, and a body dragged over one, on two"
	@echo "                ranks; pictures in OUTPUT=$$OUTPUT"
	@echo "make test       lint, types, quick tests serially, those marked ranks on two and three ranks,"
	@echo "                and test-pip"
	@echo "make test-pip   three test files where pip has installed DOLFINx, on one and two ranks"
	@echo "make test-long  all tests in all cases serially, those marked ranks in all cases on two and three"
	@echo "                ranks, the quick ones also where pip has installed DOLFINx, test-paraview and"
	@echo "                test-browser; about an hour"
	@echo "make test-paraview  results opened in ParaView (an environment of its own, 3 GB more);"
	@echo "                pictures in OUTPUT=$$OUTPUT/paraview"
	@echo "make test-browser   pages of records, and those of the site, opened in Chromium (an"
	@echo "                environment of its own, 1 GB more); pictures in OUTPUT=$$OUTPUT/browser"
	@echo "make attacks    all adversarial tests on one and two ranks: each ends in the right answer, an error"
	@echo "                or a warning with a number (make test runs a sample)"
	@echo "make mutants    a random sample of mutants of all layers: does a test fail? about an hour; verdicts"
	@echo "                in OUTPUT=$$OUTPUT/mutants"
	@echo "make docs       the site, in docs/_build/html: demos, recipes and tutorials are run, unless the"
	@echo "                cache has what they show"
	@echo "make docs-check the site without running anything; warnings and broken links are errors"
	@echo "make docs-questions what users ask, in the search of the site: is the page among the first three?"
	@echo "make docs-links addresses elsewhere that the site links to; this needs the network"
	@echo "make packages   sdist, wheel and Debian package in OUTPUT=$$OUTPUT/packages, checked and tried (an"
	@echo "                environment of its own, 3 GB more)"
	@echo "make lint       ruff and mypy alone"
	@echo "make clean      remove what demos, tests and tools wrote"

demo:
	DOLFINX_CONTACT_WHEEL=yes $(RUN) mpirun -n 2 python3 benchmarks/cases/linear_triangle.py --output "$$OUTPUT/linear_triangle"
	DOLFINX_CONTACT_WHEEL=yes $(RUN) mpirun -n 2 python3 benchmarks/cases/dragged_body.py --output "$$OUTPUT/dragged_body"

# Two at a time, in this order: types and docs-check have a core each, and what is left at the end,
# the two ranks of test-pip, has both.
test: style
	$(MAKE) --jobs=2 --output-sync=target types docs-check test-pip
	$(RUN) $(PYTEST) --numprocesses 2 --dist worksteal
	$(RUN) mpirun -n 2 $(PYTEST)
	$(RUN) mpirun -n 3 $(PYTEST)

# Wheels are for x86_64 alone.
test-pip:
ifeq ($(shell uname -m),x86_64)
	$(WHEEL) $(WHEEL_PYTEST) $(WHEEL_TESTS) --numprocesses $(WHEEL_PROCESSES) --dist worksteal
	for part in $(WHEEL_PARTS); do $(WHEEL) mpiexec -n 2 $(WHEEL_PYTEST) $$part || exit; done
endif

mutants:
	$(RUN) python3 tests/mutants.py --output "$$OUTPUT/mutants"

packages:
	$(PACKAGES) packaging/check "$$OUTPUT/packages"

attacks:
	$(RUN) $(PYTEST)/adversarial --adversarial --numprocesses 2 --dist worksteal
	$(RUN) mpirun -n 2 $(PYTEST)/adversarial --adversarial

test-long:
	$(RUN) $(PYTEST) --long --numprocesses 2 --dist worksteal
	$(RUN) mpirun -n 2 $(PYTEST) --long
	$(RUN) mpirun -n 3 $(PYTEST) --long
	$(MAKE) test-pip WHEEL_TESTS=tests WHEEL_PROCESSES=2 \
		WHEEL_PARTS="'tests/adversarial tests/demos tests/errors tests/parallel' tests/physics \
		'tests/project tests/properties tests/test_golden.py' tests/unit tests/records"
	$(MAKE) test-paraview
	$(MAKE) test-browser

test-paraview:
	rm -rf "$$OUTPUT/paraview"
	mkdir -p "$$OUTPUT/paraview"
	DOLFINX_CONTACT_RESULTS="$$OUTPUT/paraview" $(RUN) mpirun -n 2 $(PYTEST)/unit/io/test_vtk.py --long -k for_paraview
	DOLFINX_CONTACT_PACKAGES=paraview $(RUN) xvfb-run -a -s "-noreset -screen 0 1280x1024x24" python3 tests/in_paraview.py "$$OUTPUT/paraview"

test-browser:
	rm -rf "$$OUTPUT/browser"
	mkdir -p "$$OUTPUT/browser"
	DOLFINX_CONTACT_RESULTS="$$OUTPUT/browser" $(RUN) $(PYTEST)/unit/explorer/test_explorer.py --long -k for_a_browser
	DOLFINX_CONTACT_PACKAGES=browser $(RUN) python3 tests/in_browser.py "$$OUTPUT/browser"
	$(MAKE) docs-questions
	DOLFINX_CONTACT_PACKAGES=browser $(RUN) python3 tests/site_in_browser.py docs/_build/check "$$OUTPUT/browser"

docs:
	$(RUN) python3 docs/run.py
	$(DOCS) $(SPHINX) -D scripts_shown=_build/run -d docs/_build/doctrees docs docs/_build/html
	$(DOCS) python3 docs/check_links.py docs/_build/html

docs-check:
	$(DOCS) $(SPHINX) -d docs/_build/check/.doctrees docs docs/_build/check
	$(DOCS) python3 docs/check_links.py docs/_build/check

docs-questions: docs-check
	$(DOCS) python3 docs/check_questions.py docs/_build/check

docs-links:
	$(DOCS) python3 -m sphinx -q -b linkcheck -d docs/_build/links/.doctrees docs docs/_build/links

lint: style types

style:
	@$(RUN) sh -c 'for tool in ruff mypy pytest; do command -v $$tool >/dev/null || { \
	  echo "$$tool is missing here: python3 -m pip install -e .[test]" >&2; exit 1; }; done'
	$(RUN) ruff check .
	$(RUN) ruff format --check .

types:
	$(RUN) mypy dolfinx_contact

clean:
	rm -rf output build dist docs/_build *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
