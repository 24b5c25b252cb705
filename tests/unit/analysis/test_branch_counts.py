"""Counts along branches: what is proved, what is on no branch, what is written."""

import json
import re

import numpy as np
import pytest
from cases._triangle import linear_triangle

from dolfinx_contact import (
    plot,
    records,
)
from dolfinx_contact.analysis import prove_counts
from dolfinx_contact.analysis.branch_counts import default_gammas
from dolfinx_contact.continuation import Diagram, explore
from dolfinx_contact.explorer import explorer
from dolfinx_contact.proofs import Certificate, check

TOTAL = dict(sum_rn=records.total("rn"))


def explored(n, friction, unit=1.0):
    """The triangle, and its branches under -unit <= gamma <= unit."""
    system = linear_triangle(n, friction, load=(26.0 / unit, 7.5 / unit))
    system.set_parameter(-unit)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    return system, explore(system, [(x, -unit)], gamma_range=(-unit, unit))


@pytest.mark.verifies(
    "all solutions",
    "branches",
    "explorer",
    reference="enumeration: one solution under a load, three under the opposite one",
    aspects=("2D", "proofs", "branches"),
)
def test_one_solution_and_three(folder):
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
    if system.comm.rank:
        return
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
    plot.draw_diagram(folder / "with.svg", journal, "sum_rn", proved=counts)
    picture = (folder / "with.svg").read_text()
    assert picture.count("<!-- 3, proved -->") == 2
    assert picture.count("<!-- 1, proved -->") == 2


@pytest.mark.ranks(2)
def test_the_page(folder):
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
def test_what_is_on_no_branch():
    """One branch of the three is left out: its solution is named, on both ranks."""
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
def test_where_branches_meet():
    """Unloaded: all branches begin in the one solution, whose size is no measure of it."""
    system, diagram = explored(2, 3.0)
    (count,) = prove_counts(system, diagram, gammas=[0.0])
    assert count.number == 1
    assert count.proved
    assert count.unfound == ()
    assert count.branches[0] >= 0


@pytest.mark.ranks(2)
def test_middles_and_bad_input():
    system, diagram = explored(2, 3.0)
    every = default_gammas(diagram.branches, 20)
    assert every[0] == -1.0
    assert every[-1] == 1.0
    assert len(default_gammas(diagram.branches, 1)) == 3
    for wrong in (
        dict(gammas=[np.inf]),
        dict(gammas=[]),
        dict(gammas=3),
        dict(most=0),
        dict(proof_seconds=-1),
    ):
        with pytest.raises(ValueError, match="must be"):
            prove_counts(system, diagram, **wrong)
    with pytest.raises(ValueError, match="diagram"):
        prove_counts(system, None)
    with pytest.raises(ValueError, match="no branch"):
        prove_counts(system, Diagram())
