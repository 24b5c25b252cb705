"""A bulk with kinks is solved by Newton's method, and refused by branches and paths."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


class Plate:
    """A plate that is pressed on a floor, with a term of its energy."""

    def __init__(self, term, degree, cell):
        domain = mesh.create_unit_square(COMM, 3, 3, mesh.CellType[cell])
        V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
        self.u = fem.Function(V, name="u")
        held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        right = facets(domain, 0, 1.0)
        tags = mesh.meshtags(domain, 1, np.sort(right), np.full(len(right), 1, dtype=np.int32))
        self.side = ufl.Measure("ds", domain, subdomain_data=tags)(1)
        energy = LinearElastic.from_young(100.0, 0.3).energy(self.u) * ufl.dx + term(self)
        floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
        surface = ContactSurface(self.u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
        bcs = [fem.dirichletbc(np.array([0.0, -0.02]), held, V)]
        self.problem = ContactProblem(energy, self.u, [surface], bcs=bcs)


def pull(p):
    return -5 * p.u[0] * p.side


@pytest.mark.parametrize(
    ("sense", "degree", "cell"),
    [(1.0, 1, "triangle"), (1.0, 2, "quadrilateral"), (-1.0, 1, "triangle")],
)
@pytest.mark.verifies(
    "bulk with kinks", reference="itself: springs that act always, or never", aspects=("2D",)
)
@pytest.mark.refuses("bulk with kinks", aspects=("branches",))
def test_bulk_with_kinks_is_solved_and_not_followed(sense, degree, cell):
    """Springs that only pull back act always under one sense of the pull, never under the other."""

    def springs(p, stretch):
        return 50 * stretch**2.0 * p.side + sense * pull(p)

    def solved(term):
        p = Plate(term, degree, cell)
        result = p.problem.solve()
        assert degree == 2 or result.kkt_violation < 1e-9
        return p, p.u.x.array

    p, found = solved(lambda p: springs(p, ufl.max_value(p.u[0], 0)))
    _, expected = solved(lambda p: springs(p, p.u[0] if sense > 0 else 0 * p.u[0]))
    # An edge of degree 2 is pressed in beside the held corner, by a little.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 if degree == 1 else 1e-5)
    assert np.abs(found).max() > 0.01
    assert p.problem.uniqueness().verdict == "not proved"
    system = ParametricContact(p.problem)
    for use in (
        lambda: follow(system, system.create_vector(), 0.0, gamma_range=(0.0, 1.0)),
        lambda: ArcLength(system),
    ):
        with pytest.raises(ValueError, match=r"the bulk has kinks in u: max_value"):
            use()
