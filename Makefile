# Each target sets its environment up on the way (docker/run); DEBIAN=sid takes the other suite.
RUN = docker/run
OUTPUT = output
# The shell takes it from its environment as it is, blanks and all.
export OUTPUT
# mpirun gives its ranks a terminal, so that pytest would colour what goes to a log.
PYTEST = python3 -m pytest --color=no --durations=40 --durations-min=1 tests
ATTACKS = python3 tests/attacks/run.py

.PHONY: help demo test test-long test-paraview attacks lint clean

help:
	@echo "make demo       all branches of a triangle on a floor, and a body dragged over one, on two"
	@echo "                ranks; pictures in OUTPUT=$$OUTPUT"
	@echo "make test       lint, types, and the tests on one, two and three ranks"
	@echo "make test-long  all tests in all cases, on one and two ranks, and test-paraview"
	@echo "make test-paraview  results opened in ParaView (an environment of its own, 3 GB more);"
	@echo "                pictures in OUTPUT=$$OUTPUT/paraview"
	@echo "make attacks    data for which an assumption may not hold: is every answer right, refused, or"
	@echo "                doubted in words? on one and two ranks"
	@echo "make lint       ruff and mypy alone"
	@echo "make clean      remove what demos, tests and tools wrote"

demo:
	$(RUN) mpirun -n 2 python3 demos/demo_linear_triangle.py --output "$$OUTPUT/linear_triangle"
	$(RUN) mpirun -n 2 python3 demos/demo_dragged_body.py --output "$$OUTPUT/dragged_body"

test: lint
	$(RUN) $(PYTEST) --numprocesses 2 --dist worksteal
	$(RUN) mpirun -n 2 $(PYTEST)
	$(RUN) mpirun -n 3 $(PYTEST)
	$(RUN) $(ATTACKS) --sample

attacks:
	$(RUN) $(ATTACKS)
	$(RUN) mpirun -n 2 $(ATTACKS)

test-long:
	$(RUN) $(PYTEST) --long --numprocesses 2 --dist worksteal
	$(RUN) mpirun -n 2 $(PYTEST) --long
	$(MAKE) test-paraview

test-paraview:
	rm -rf "$$OUTPUT/paraview"
	mkdir -p "$$OUTPUT/paraview"
	DOLFINX_CONTACT_RESULTS="$$OUTPUT/paraview" $(RUN) mpirun -n 2 $(PYTEST)/test_vtk.py --long -k for_paraview
	DOLFINX_CONTACT_PACKAGES=paraview $(RUN) xvfb-run -a python3 tests/in_paraview.py "$$OUTPUT/paraview"

lint:
	@$(RUN) sh -c 'for tool in ruff mypy pytest; do command -v $$tool >/dev/null || { \
	  echo "$$tool is missing here: python3 -m pip install -e .[test]" >&2; exit 1; }; done'
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	$(RUN) mypy dolfinx_contact

clean:
	rm -rf output build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
