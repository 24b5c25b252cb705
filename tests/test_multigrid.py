"""The surface filter with multigrid against MUMPS, on every rank count, law and mesh."""

from mpi4py import MPI

import numpy as np
import pytest
from blocks import block, same_tables

from dolfinx import mesh

from dolfinx_contact import (
    Coulomb,
    Frictionless,
    HalfSpace,
    Sphere,
    Tresca,
)
from dolfinx_contact.materials import NeoHookean

COMM = MPI.COMM_WORLD
AMG = {"linear_solver": "amg"}
TIGHT = {**AMG, "snes_rtol": 1e-11, "ksp_rtol": 1e-11}


def one_node(domain):
    """The facets around one node of the bottom, of which the sphere touches the node alone."""
    return mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))


def corner(domain):
    return mesh.locate_entities_boundary(
        domain, 2, lambda x: np.isclose(x[2], 0.0) & (x[0] < 0.3) & (x[1] < 0.3)
    )


PROBLEMS = {
    "2D": dict(cell="tri", n=8),
    "2D quad, disc": dict(cell="quad", n=8, obstacle=Sphere((0.4, -3.0), 3.0)),
    "tet": dict(cell="tet", n=5),
    "hex": dict(cell="hex", n=5),
    "frictionless": dict(cell="hex", n=4, law=Frictionless()),
    "Tresca": dict(cell="tet", n=4, law=Tresca(3.0)),
    "strong friction": dict(cell="tet", n=4, law=Coulomb(2.0), top=(0.02, 0.005, -0.01)),
    "partial contact": dict(cell="hex", n=6, obstacle=Sphere((0.5, 0.5, -4.0), 4.0)),
    "tilted": dict(cell="tet", n=4, obstacle=HalfSpace((0, 0, 0), (0.02, 0.01, 1.0))),
    "sliding": dict(cell="hex", n=4, law=Coulomb(0.05), top=(0.2, 0.0, -0.01)),
    "no contact": dict(cell="tet", n=4, obstacle=HalfSpace((0, 0, -1.0), (0, 0, 1.0))),
    "one node": dict(
        cell="hex", n=4, obstacle=Sphere((0.5, 0.5, -0.1), 0.1), top=(0.001, 0.0, -0.01)
    ),
    "a rank without contact": dict(cell="hex", n=4, where=corner),
    "P2": dict(cell="tri", n=4, degree=2),
    "P2/P2": dict(cell="quad", n=4, degree=2, multiplier_degree=2),
    "P2 in 3D": dict(cell="tet", n=2, degree=2, top=(0.02, 0.005, -0.01)),
    "mixed": dict(cell="quad", n=6, method="mixed"),
    "neo-Hookean": dict(cell="quad", n=6, material=NeoHookean(600.0, 400.0), top=(0.1, -0.1)),
    "r forced": dict(cell="tet", n=4, r=1e5),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_same_as_direct(name):
    """Tight tolerances give the answer of MUMPS to 1e-8, the defaults to 1e-6."""
    options = PROBLEMS[name]
    direct = block(**options, options={"snes_rtol": 1e-11}).solve()
    for tolerances, accuracy in ((TIGHT, 1e-8), (AMG, 1e-6)):
        problem = block(**options, options=tolerances)
        result = problem.solve()
        assert problem.linear_solver.name == "amg"
        same(result.tables["contact"], direct.tables["contact"], accuracy)
        assert sum(a.krylov_iterations for a in result.attempts) > 0
        problem.destroy()


def same(a, b, accuracy):
    if np.abs(b.force).max() > 0:
        same_tables(a, b, accuracy)
    else:
        assert a.status == b.status
        assert np.abs(a.force).max() < 1e-20  # round-off of nothing, at a stiffness of 1000
        np.testing.assert_allclose(a.un, b.un, rtol=accuracy)
