"""The table in the docstring of the laws agrees with the laws."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, same_tables

from dolfinx import fem

import dolfinx_contact.laws
from dolfinx_contact import (
    Coulomb,
    Frictionless,
    ParametricContact,
    Regularised,
    Tresca,
)
from dolfinx_contact.laws import FrictionLaw, Interface, Law
from dolfinx_contact.reduced.scope import can_condense

COMM = MPI.COMM_WORLD
NUMBERS = {"F": 0.3, "g": 3.0, "rho": 0.5, "C": 3e4, "m": 1.5, "eps": 1e-3, "K": 300.0, "w": 0.03}
NUMBERS |= {"t": 2.0, "a": 0.01, "b": 0.05, "k": 300.0, "eta": 30.0}
WITH_TIME = "k", "eta"  # of what relaxes, in the end
LINES = dolfinx_contact.laws.__doc__.splitlines()
ROWS = [[c.strip() for c in line.strip("|").split("|")] for line in LINES if line.startswith("| `")]
HEAD = next(line for line in LINES if line.startswith("| law"))
COLUMNS = [c.strip() for c in HEAD.strip("|").split("|")]


def law_of(text, **numbers):
    """The law of a row, with some of its numbers replaced."""
    names = {name: getattr(dolfinx_contact.laws, name) for name in dolfinx_contact.laws.__all__}
    return eval(text.strip("`"), {**names, **NUMBERS, "law": Coulomb(0.3), **numbers})


def problem_of(law, dim=2, **options):
    top = (0.02, *[0.0] * (dim - 2), -0.03)
    cell, n = ("quad", 4) if dim == 2 else ("hex", 2)
    return block(n=n, cell=cell, law=law, top=top, **options)


def pivots(problem):
    return can_condense(ParametricContact(problem))


def refused(action, *kinds):
    try:
        action()
    except kinds:
        return True
    return False


def test_every_law_is_in_the_table():
    named = {row[0].strip("`").partition("(")[0] for row in ROWS}
    known = {
        name
        for name in dolfinx_contact.laws.__all__
        if isinstance(kind := getattr(dolfinx_contact.laws, name), type)
        and issubclass(kind, Law)
        and kind not in (Law, FrictionLaw, Interface)
    }
    assert named == known
    assert COLUMNS == ["law", "needs", "pivoting", "proofs", "points"]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0].strip("`"))
def test_laws_support_the_features_of_the_table(row):
    text, _, pivoting, proofs, points = row
    law = law_of(text)
    problem = problem_of(law)
    result = problem.solve()
    known = result.tables["contact"]
    assert pivots(problem) == (pivoting == "2D")
    reason = problem.uniqueness().reason
    assert ("proofs are for the laws of Coulomb and Tresca" in reason) == (proofs == "no")
    assert refused(problem.reduced, ValueError) == (points == "no")

    def by_tresca():
        same_tables(problem_of(law).solve(algorithm="tresca").tables["contact"], known, 1e-7)

    assert refused(by_tresca, ValueError) == (points == "no")
    same_tables(problem_of(law, options={"linear_solver": "amg"}).solve().tables["contact"], known,
                1e-6)  # fmt: skip
    in_space = problem_of(law, dim=3)
    assert in_space.solve().kkt_violation < 1e-8
    assert not pivots(in_space)


def parameters():
    """Rows and the symbols in the law that may vary, and those that may not."""
    for row in ROWS:
        inside = row[0].strip("`").partition("(")[2]
        for symbol in NUMBERS:
            if symbol in [part.strip(" )") for part in inside.split(",")]:
                yield row[0], symbol, f"number {symbol}" not in row[1]


@pytest.mark.parametrize(("text", "symbol", "varies"), parameters())
def test_parameters_of_laws_vary_as_in_the_table(text, symbol, varies):
    """Parameters out of range are refused; numbers are not Constants; others may be gamma."""
    for bad in (-1.0, np.nan):
        assert refused(lambda bad=bad: problem_of(law_of(text, **{symbol: bad})), ValueError)
    domain = box(COMM, 4, "quad")
    gamma = fem.Constant(domain, NUMBERS[symbol])
    if not varies:
        with pytest.raises(ValueError, match=r"radius of|exponent of"):
            law_of(text, **{symbol: gamma})
        return
    problem = problem_of(law_of(text, **{symbol: gamma}), domain=domain)
    system = ParametricContact(problem, gamma)
    problem.solve()
    x = system.create_vector()
    c = system.create_vector()
    problem.write(x)
    at = NUMBERS[symbol]
    system.parameter_derivative(x, at, c, system.piece_at(x, at))
    assert (c.norm() > 0) == (symbol not in WITH_TIME)
    assert not can_condense(system)


def test_compliant_surfaces_pivot_with_frictionless_and_coulomb_laws():
    for law in (Frictionless(), Coulomb(0.3), Tresca(3.0), Regularised(Coulomb(0.3), 1e-3)):
        problem = problem_of(law_of("NormalCompliance(C, 1, law)", law=law))
        assert pivots(problem) == isinstance(law, Frictionless | Coulomb)
