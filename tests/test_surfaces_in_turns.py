# SPDX-License-Identifier: LGPL-3.0-or-later
"""Problems that have one surface in turns: each finds what it found with the surface of its own."""

from mpi4py import MPI

import numpy as np
import pytest
from blocks import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, ParametricContact, Sphere
from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact.continuation import Observer, follow
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic, NeoHookean
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD


def same(found, expected):
    size = COMM.allreduce(np.abs(expected).max(initial=0.0), op=MPI.MAX)
    off = COMM.allreduce(np.abs(found - expected).max(initial=0.0), op=MPI.MAX)
    return off <= 1e-9 * size


def test_a_linear_body_beside_one_that_is_not():
    """On a curved obstacle sliding is small for the one and large for the other, by default."""
    first = block(obstacle=Sphere((0.3, -2.0), 2.0), law=Coulomb(0.2), top=(0.02, -0.05))
    first.solve()
    small = first.u.x.array.copy()
    energy = NeoHookean(400.0, 600.0).energy(first.u) * ufl.dx
    second = ContactProblem(energy, first.u, first.surfaces, bcs=first.bcs)
    first.solve()
    assert same(first.u.x.array, small)
    first.u.x.array[:] = 0.0
    second.solve()
    large = first.u.x.array.copy()
    assert second.surfaces[0].displaced is not None
    first.solve()
    assert same(first.u.x.array, small)
    second.solve()
    assert same(first.u.x.array, large)


def test_a_history_beside_a_body_that_is_not_linear():
    """It goes on with its own sliding; its memory is refused where sliding is another."""

    def history(*, beside):
        problem = block(obstacle=Sphere((0.3, -2.0), 2.0), law=Coulomb(0.2), top=(0.02, -0.05))
        u = problem.u
        moved = dirichlet_value(problem.bcs[0]).value
        whole = moved.copy()

        def load(t):
            moved[:] = t * whole

        def observer(_):
            if other is None:
                return
            with problem.restored(always=True), pytest.raises(ValueError, match="of another slid"):
                other.solve()

        load(0.5)
        problem.solve()
        other = None
        if beside:
            energy = NeoHookean(400.0, 600.0).energy(u) * ufl.dx
            other = ContactProblem(energy, u, problem.surfaces, bcs=problem.bcs)
        QuasiStatic(problem, load).run([0.5, 0.75, 1.0], observer=observer)
        return u.x.array

    assert same(history(beside=True), history(beside=False))


def test_a_branch_beside_a_body_that_is_not_linear():
    """Between its steps another problem slides on the same surface, in another way."""

    def branch(*, beside):
        given = block(obstacle=Sphere((0.3, -2.0), 2.0), law=Coulomb(0.2), top=(0.02, -0.05))
        u, surfaces = given.u, given.surfaces
        V = u.function_space
        gamma, moved = fem.Constant(V.mesh, 0.0), fem.Function(V)
        held = fem.dirichletbc(moved, given.bcs[0].dof_indices()[0] // 2)
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        problem = ContactProblem(energy, u, surfaces, bcs=[held])
        way = ufl.as_vector([0.05 * gamma, -0.02 - 0.06 * gamma])
        system = ParametricContact(problem, gamma, driven=[(moved, way)])
        energy = NeoHookean(400.0, 600.0).energy(u) * ufl.dx
        other = ContactProblem(energy, u, surfaces, bcs=given.bcs) if beside else None
        solved = []

        class Beside(Observer):
            def step(self, *_):
                if other is not None:
                    with problem.restored(always=True):
                        other.solve()
                    solved.append(other)

        system.set_parameter(0.0)
        problem.solve()
        x = system.create_vector()
        problem.write(x)
        found = follow(system, x, 0.0, gamma_range=(0.0, 1.0), observer=Beside())
        assert bool(solved) == beside
        return [p.gamma for p in found.points], found.points[-1].y.array_r

    gammas, last = branch(beside=True)
    expected, last_alone = branch(beside=False)
    np.testing.assert_allclose(gammas, expected, atol=1e-9)
    assert same(last, last_alone)


def two_blocks():
    """One on the other, whose nodes do not match; the load and Dirichlet data."""
    cell = mesh.CellType.quadrilateral
    upper = create_grid(COMM, (np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 4)), cell)
    lower = create_grid(COMM, (np.linspace(-0.25, 1.25, 5), np.linspace(-0.5, 0.0, 3)), cell)
    both = join([upper, lower])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    domain.topology.create_connectivity(1, 2)

    def line(y):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], y))

    to_cells = domain.topology.connectivity(1, 2)
    facets = line(0.0)
    above = np.isin(to_cells.array[to_cells.offsets[facets]], both.cell_tags.find(1))
    law = Coulomb(0.2)
    pair = ContactPair(u, facets[above], master_facets=facets[~above], law=law)
    bcs = [
        fem.dirichletbc(np.array(moved), fem.locate_dofs_topological(V, 1, line(y)), V)
        for moved, y in (((0.004, -0.01), 1.0), ((0.0, 0.0), -0.5))
    ]
    return LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx, u, pair, bcs


def test_other_nodes_held_on_faces_that_do_not_match():
    """Functions of held nodes are given away, by which a problem of before has no such points."""
    energy, u, pair, bcs = two_blocks()
    first = ContactProblem(energy, u, [pair], bcs=bcs)
    first.solve()
    expected = u.x.array.copy()
    again = ContactProblem(energy, u, [pair], bcs=bcs)
    first.solve()
    assert same(u.x.array, expected)
    held = fem.locate_dofs_geometrical(
        u.function_space, lambda x: (np.abs(x[1]) < 1e-9) & (x[0] < 0.3)
    )
    more = [*bcs, fem.dirichletbc(np.zeros(2), held, u.function_space)]
    other = ContactProblem(energy, u, [pair], bcs=more)
    for problem in (first, again, first):
        with pytest.raises(ValueError, match="another problem has been made with this surface"):
            problem.solve()
    other.solve()
    held_there = u.x.array.copy()
    ContactProblem(energy, u, [pair], bcs=more).solve()
    other.solve()
    assert same(u.x.array, held_there)


def test_the_augmentation_is_that_of_the_problem():
    """It occurs in the weak conditions of the integral method: a solution stays one of them."""
    first = block(method="integral", law=Coulomb(0.2))
    first.solve()
    x, b = first.create_vector(), first.create_vector()
    first.write(x)
    first.residual(x, b)
    before = b.norm()
    energy = LinearElastic.from_young(1000.0, 0.3).energy(first.u) * ufl.dx
    ContactProblem(energy, first.u, first.surfaces, bcs=first.bcs, r=1e7)
    first.residual(x, b)
    assert b.norm() == pytest.approx(before, abs=1e-12)
    x.destroy(), b.destroy()
