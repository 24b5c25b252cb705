"""Uniqueness of a result, against proofs of all solutions, enumeration and theorems."""

import json
import re
from pathlib import Path

from mpi4py import MPI

import cases.block
import cases.greco_block
import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import block, facets
from support.checks import solved_start

import ufl
from dolfinx import mesh

from dolfinx_contact import (
    ContactProblem,
    Coulomb,
    Frictionless,
    ParametricContact,
    Tresca,
    plot,
    records,
)
from dolfinx_contact.analysis import prove_counts, renard_criterion
from dolfinx_contact.continuation import Diagram, explore, find_solutions
from dolfinx_contact.explorer import explorer
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame
from dolfinx_contact.proofs import Certificate, check
from dolfinx_contact.proofs.check_proof import main as check_file

COMM = MPI.COMM_WORLD
ORACLE = json.loads((Path(__file__).parents[2] / "data" / "blocks.json").read_text())


def oracle_block(case):
    o = ORACLE[case]
    given = dict(dim=o["dim"], n=o["n"], friction=o["F"], young=o["E"], poisson=o["nu"])
    given |= dict(shift=o["top"][0], press=-o["top"][-1])
    return cases.block.problem(
        cases.block.arguments([f"--{k}={v}" for k, v in given.items()]), COMM
    )


def greco(n):
    return cases.greco_block.problem(cases.greco_block.arguments(["--n", str(n)]), COMM)


UNITS = [1e-9, 1.0, 1e9]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("unit", UNITS)
def test_uniqueness_accepts_round_off_of_a_body_at_rest(unit):
    problem = block(n=4, cell="quad", top=(0.0, 0.0), young=1000.0 * unit)
    problem.solve()
    problem.u.interpolate(lambda x: 1e-17 * np.stack([x[0] - x[1], x[0] * (1 - x[1])]))
    problem.u.x.array[problem.bcs[0].dof_indices()[0]] = 0.0
    assert "at a border of its statuses" in problem.uniqueness().reason


@pytest.mark.ranks(2)
@pytest.mark.parametrize("unit", UNITS)
def test_uniqueness_refuses_an_unsolved_state_beside_large_reactions(unit):
    """The load on the clamped face only causes reactions; the load on the side is smaller."""
    empty = block(n=4, cell="quad", top=(0.0, 0.0), young=1000.0 * unit)
    u, domain = empty.u, empty.V.mesh
    side, top = (facets(domain, axis, 1.0) for axis in (0, 1))
    faces = np.concatenate([side, top])
    values = np.repeat([1, 2], [len(side), len(top)]).astype(np.int32)
    order = np.argsort(faces)
    tags = mesh.meshtags(domain, 1, faces[order], values[order])
    ds = ufl.Measure("ds", domain, subdomain_data=tags)
    load = unit * (1e-4 * u[0] * ds(1) + u[1] * ds(2))
    problem = ContactProblem(empty.energy + load, u, empty.contacts, bcs=empty.bcs)
    with pytest.raises(ValueError, match="not a solution of the problem as it is now"):
        problem.uniqueness()
    problem.solve()
    assert problem.uniqueness().verdict == "proved"


def all_solutions(problem):
    """Return all solutions with a proof of completeness."""
    system = ParametricContact(problem)
    found = find_solutions(system, [system.create_vector()], 0.0)
    system.destroy()
    return found


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    "make",
    [lambda: oracle_block("b2d_n8"), lambda: oracle_block("b2d_n16"), lambda: greco(32)],
    ids=["block 8", "block 16", "greco"],
)
@pytest.mark.verifies(
    "uniqueness",
    "certificates",
    reference="itself: a proof of all solutions",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_certificate_and_search_prove_the_same_only_solution(make):
    problem = make()
    problem.solve()
    x = problem.create_vector()
    problem.write(x)
    assert problem.uniqueness().verdict == "proved"
    found = all_solutions(problem)
    assert found.complete
    (one,) = found.found
    assert (one.x - x).norm() <= 1e-8 * x.norm()


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", ["b3d_n4", "b3d_n6"])
@pytest.mark.verifies(
    "uniqueness",
    "Renard's criterion",
    reference="theorem: Renard's criterion",
    aspects=(
        "3D",
        "proofs",
    ),
)
def test_certificate_in_space_agrees_with_renards_criterion(case):
    """The certificate of one point, which is proved with round-off, and the criterion agree."""
    problem = oracle_block(case)
    problem.solve()
    found = problem.uniqueness()
    assert (found.verdict, found.reason) == ("proved", "the certificate of one point")
    assert 3 < renard_criterion(problem).factor < 4


def test_uniqueness_is_not_proved_of_an_unstable_body_in_space():
    """On an anti-elastic bedding, where the criterion means nothing."""
    held = block(n=2, cell="hex")
    energy = LinearElastic.from_young(1000.0, 0.3).energy(held.u) - 500 * ufl.dot(held.u, held.u)
    problem = ContactProblem(energy * ufl.dx, held.u, held.contacts, bcs=held.bcs)
    problem.solve()
    found = problem.uniqueness()
    assert found.verdict == "not proved"
    assert "positive definite" in found.reason


@pytest.mark.ranks(2)
def test_summary_contains_the_verdict():
    problem = block(n=4)
    result = problem.solve()
    assert "unique" not in result.summary()
    assert result.summary(problem.uniqueness())["unique"] == "proved"


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("kind", "law", "exists", "unique", "words"),
    [
        ({}, Frictionless(), True, True, "least energy"),
        ({}, Tresca(2.0), True, True, "least energy"),
        ({}, Coulomb(0.0), True, True, "least energy"),
        ({"cell": "hex", "n": 2}, Tresca(2.0), True, True, "least energy"),
        ({"cell": "hex", "n": 2}, Coulomb(3.0), True, False, "every coefficient"),
        ({"method": "mixed"}, Coulomb(3.0), True, False, "every coefficient"),
        ({"method": "integral"}, Frictionless(), False, False, "node by node"),
        ({"material": NeoHookean(*lame(1e3, 0.3))}, Frictionless(), False, False, "not linear"),
    ],
)
@pytest.mark.verifies(
    "uniqueness",
    "Tresca",
    "Signorini",
    reference="theorem: a strictly convex energy has one least point",
    aspects=(
        "2D",
        "3D",
        "proofs",
    ),
)
def test_theorems_prove_uniqueness(kind, law, exists, unique, words):
    theory = block(law=law, **kind).theory()
    assert (theory.exists, theory.unique) == (exists, unique)
    assert words in theory.reason


@pytest.mark.parametrize("law", [Frictionless(), Tresca(2.0)])
@pytest.mark.verifies(
    "uniqueness",
    "Tresca",
    "Signorini",
    reference="theorem: a strictly convex energy has one least point",
    aspects=(
        "3D",
        "proofs",
    ),
)
def test_uniqueness_in_space_follows_from_a_convex_energy(law):
    """The certificate of one point does not hold there."""
    problem = block(n=2, cell="hex", law=law)
    problem.solve()
    found = problem.uniqueness()
    assert found.verdict == "proved"
    assert "least energy" in found.reason


@pytest.mark.ranks(2)
def test_uniqueness_works_at_a_point_of_a_branch():
    system = linear_triangle(4, 1.7)
    found = find_solutions(system, [system.create_vector()], 1.0)
    system.set_parameter(1.0)
    before = [f.x.array.copy() for f in system.problem.fields]
    for point in found.points(system):
        state = system.state_at(point)
        assert state.gamma == 1.0
        verdict = system.problem.uniqueness(state=state).verdict
        assert (verdict == "proved") == (len(found.found) == 1)
    for f, values in zip(system.problem.fields, before, strict=True):
        np.testing.assert_array_equal(f.x.array, values)


TOTAL = dict(sum_rn=records.total("rn"))


def explored(n, friction, unit=1.0):
    """The triangle, and its branches under -unit <= gamma <= unit."""
    system = linear_triangle(n, friction, load=(26.0 / unit, 7.5 / unit))
    x = solved_start(system, -unit)
    return system, explore(system, [(x, -unit)], gamma_range=(-unit, unit))


def test_checker_prints_forces_in_the_units_of_the_input(tmp_path, capsys):
    system, diagram = explored(2, 3.0)
    (count,) = prove_counts(system, diagram, gammas=[1.0])
    count.certificate.save(tmp_path / "proof.npz")
    assert check_file([str(tmp_path / "proof.npz")]) == 0
    states = map(system.state_at, count.solutions.found)
    tables = [system.problem.table("contact", state=state) for state in states]
    printed = re.findall(r"sum rt = (\S+) .*sum rn = (\S+) ", capsys.readouterr().out)
    sums = sorted((t.along(t.rt).sum(), t.rn.sum()) for t in tables)
    np.testing.assert_allclose(sorted((float(a), float(b)) for a, b in printed), sums, atol=1e-9)
    assert len(sums) == 3


@pytest.mark.verifies(
    "all solutions",
    "branches",
    "explorer",
    reference="enumeration: one solution under a load, three under the opposite one",
    aspects=("2D", "proofs", "branches"),
)
def test_uniqueness_distinguishes_one_solution_from_three(folder):
    system, diagram = explored(2, 3.0)
    before = float(system.constant.value)
    counts = prove_counts(system, diagram)
    assert float(system.constant.value) == before
    np.testing.assert_allclose([c.gamma for c in counts], [-1.0, -0.5, 0.5, 1.0])
    assert [c.number for c in counts] == [1, 1, 3, 3]
    assert counts.proved
    assert counts.followed
    assert counts.missed == 0
    assert all(c.unfound == () and len(set(c.branches)) == c.number for c in counts)
    assert sorted(word[0] for word in counts.counts[-1].statuses) == ["-", "k", "o"]
    assert "3 solutions, proved" in str(counts)
    journal = records.journal_of(system, diagram.branches, TOTAL)
    file = counts.save(folder / "counts")
    saved = json.loads(file.read_text())
    assert [row["count"] for row in saved["counts"]] == [1, 1, 3, 3]
    for row, c in zip(saved["counts"], counts, strict=True):
        proof = Certificate.load(file.parent / row["certificate"])
        assert proof.digest == row["digest"]
        found = check(proof)
        assert found.verdict == "complete"
        assert len(found.inside) + found.at_rest == c.number
    with pytest.raises(FileExistsError, match="overwrite"):
        counts.save(folder / "counts")
    figure = plot.draw_diagram(folder / "with.svg", journal, "sum_rn", proved=counts)
    picture = (folder / "with.svg").read_text()
    assert picture.count("<!-- 3, proved -->") == 2
    assert picture.count("<!-- 1, proved -->") == 2
    figure.draw_without_rendering()
    (legend,) = figure.subfigs[0].legends
    assert len(legend.get_texts()) >= len(diagram.branches)
    assert legend.get_window_extent().y1 < figure.axes[0].get_tightbbox().y0


@pytest.mark.ranks(2)
def test_page_contains_the_verdict(folder):
    system, diagram = explored(2, 3.0)
    counts = prove_counts(system, diagram, gammas=[0.5])
    journal = records.journal_of(system, diagram.branches, TOTAL)
    explorer(folder / "page.html", journal, counts=counts)
    text = re.sub(r"\s", "", (folder / "page.html").read_text())
    assert '"count":3,"proved":true' in text


@pytest.mark.verifies(
    "all solutions",
    "branches",
    reference="enumeration: a solution on a branch that was left out",
    aspects=("2D", "proofs", "branches"),
)
def test_a_solution_on_no_branch_is_counted_as_missed():
    """One branch of the three is left out: its solution is counted."""
    system, diagram = explored(2, 3.0)
    whole = prove_counts(system, diagram, gammas=[0.5])
    left = Diagram(edges=diagram.edges[:-1])
    counts = prove_counts(system, left, gammas=[0.5])
    assert not counts.followed
    assert counts.proved
    gone = len(diagram.edges) - 1
    assert counts.missed == sum(b == gone for c in whole for b in c.branches) == 1
    assert "1 on no branch" in str(counts)


@pytest.mark.ranks(2)
def test_uniqueness_is_decided_where_branches_meet():
    """Without load all branches begin in one solution, whose size is no scale."""
    system, diagram = explored(2, 3.0)
    (count,) = prove_counts(system, diagram, gammas=[0.0])
    assert count.number == 1
    assert count.proved
    assert count.unfound == ()
    assert count.branches[0] >= 0
