"""What a record says of a problem that is not the one that was recorded."""

from mpi4py import MPI

import numpy as np
from blocks import block, box, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, Sphere
from dolfinx_contact.equations.given_data import numbers_of
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records.identity import difference, identity, other_data

COMM = MPI.COMM_WORLD


def test_what_has_changed_is_named():
    """A part of an obstacle, a Constant in a form."""
    square = box(COMM, 2, "tri")
    friction = fem.Function(fem.functionspace(square, ("Lagrange", 1)), name="rough")
    friction.x.array[:] = 0.3
    centre = fem.Constant(square, (0.5, -2.0))
    problem = block(domain=square, law=Coulomb(2.0 * friction), obstacle=Sphere(centre, 2.0))
    known = identity(problem)
    data = numbers_of(problem.equations)
    assert difference(known, identity(problem)) == ""
    assert other_data(problem, data, numbers_of(problem.equations)) is None
    centre.value[1] = -2.0 - 1e-7
    wanted = (
        ": the centre of Sphere of 'contact': (0.5, -2) was recorded, (0.5, -2.0000001) is given"
    )
    assert other_data(problem, data, numbers_of(problem.equations)) == wanted
    assert difference(known, identity(problem)) == "other materials, loads or friction" + wanted


def test_other_places_are_other_problems():
    """As many facets are loaded, as many components held, but not the same."""

    def known(loaded, held, comm=COMM):
        square = box(comm, 4, "quad")
        V = fem.functionspace(square, ("Lagrange", 1, (2,)))
        u = fem.Function(V)
        load = mesh.meshtags(square, 1, np.sort(facets(square, 0, loaded)), 1)
        ds = ufl.Measure("ds", square, subdomain_data=load)
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx - 2.0 * u[0] * ds(1)
        W = V.sub(held)
        bc = fem.dirichletbc(0.0, fem.locate_dofs_topological(W, 1, facets(square, 1, 1.0)), W)
        floor = HalfSpace((0, 0), (0, 1))
        surface = ContactSurface(u, facets(square, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
        return identity(ContactProblem(energy, u, [surface], bcs=[bc]))

    before = known(0.0, 1)
    assert difference(before, known(0.0, 1)) == ""
    # On any number of ranks.
    alone = COMM.bcast(known(0.0, 1, MPI.COMM_SELF) if COMM.rank == 0 else None)
    assert difference(alone, before) == ""
    assert difference(before, known(1.0, 1)) == "integrals over other cells or facets"
    assert difference(before, known(0.0, 0)) == "Dirichlet conditions at other places"
