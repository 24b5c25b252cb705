"""Multigrid between bodies against MUMPS."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box
from support.mortars import sheared, solids
from support.mortars import stacked as unequal
from support.pairs import MATERIAL, cracked, displacement, held, stacked, tagged

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.continuation import follow
from dolfinx_contact.materials import NeoHookean
from dolfinx_contact.meshing import crack, join

COMM = MPI.COMM_WORLD
#: With levels on these small meshes too.
AMG = {"linear_solver": "amg", "amg_pc_gamg_coarse_eq_limit": 50}
TIGHT = {**AMG, "snes_rtol": 1e-11, "ksp_rtol": 1e-11}


def pressed(body, options, *, slave=3, master=2, friction=0.2, degree=1, material=MATERIAL, **more):
    """Lower end held, upper end pressed and drawn aside."""
    u = displacement(body.mesh, degree)
    dim = body.mesh.geometry.dim
    shift = np.zeros(dim)
    shift[0] = 0.02
    shift[-1] = -0.04
    pair = ContactPair(u, body, slave=slave, master=master, law=Coulomb(friction), **more)
    ends = [held(u, body.facet_tags, 1, np.zeros(dim)), held(u, body.facet_tags, 4, shift)]
    energy = material.energy(u) * ufl.dx
    return ContactProblem(energy, u, [pair], bcs=ends, petsc_options=options)


def held_by_contact(options):
    """The upper body lies on the lower one and on a wall aside, and a pressure acts on it."""
    both = stacked(2, "quad", 4)
    u = displacement(both.mesh)
    ds = ufl.Measure("ds", both.mesh, subdomain_data=both.facet_tags)
    pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(0.5))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(ufl.as_vector((5.0, -30.0)), u) * ds(4)
    bcs = [held(u, both.facet_tags, 1, (0.0, 0.0))]
    return ContactProblem(energy, u, [pair], bcs=bcs, petsc_options=options)


def between(options):
    """The lower body, between a floor and the upper one, is held by nothing else."""
    both = unequal(5, 4, (0.0, 1.0), (0.0, 1.0))
    u = displacement(both.mesh)
    pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(0.5))
    plane = HalfSpace((0.0, -1.0), (0.0, 1.0))
    floor = ContactSurface(u, both, tag=1, obstacle=plane, law=Coulomb(0.5), name="floor")
    top = held(u, both.facet_tags, 4, (0.001, -0.02))
    energy = MATERIAL.energy(u) * ufl.dx
    return ContactProblem(energy, u, [pair, floor], bcs=[top], petsc_options=options)


def clamped_slave(options):
    """Return a pair whose slave nodes are clamped and whose master nodes are free."""
    both = stacked(2, "quad", 4)
    u = displacement(both.mesh)
    V = u.function_space
    lower = mesh.locate_entities(both.mesh, 2, lambda x: x[1] < 1 + 1e-9)
    lower = np.intersect1d(lower, both.cell_tags.find(1)).astype(np.int32)
    still = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 2, lower), V)
    pair = ContactPair(u, both, slave=2, master=3, law=Coulomb(0.3))
    top = held(u, both.facet_tags, 4, (0.005, -0.02))
    energy = MATERIAL.energy(u) * ufl.dx
    return ContactProblem(energy, u, [pair], bcs=[still, top], petsc_options=options)


def on_a_crack(dim, cell, reach, options):
    domain, tags = cracked(dim, cell, reach)
    body = crack(domain, [5], facet_tags=tags)
    return pressed(body, options, slave=5, master="5_opposite")


def soft_on_stiff(options):
    """The finer mesh on a body a hundred times as stiff, and a rank without any contact."""
    a = box(COMM, 3, "tet")
    b = box(COMM, 4, "tet")
    b.geometry.x[:, 2] += 1.0
    tags = [tagged(a, t1=(2, 0.0), t2=(2, 1.0)), tagged(b, t3=(2, 1.0), t4=(2, 2.0))]
    both = join([a, b], facet_tags=tags)
    u = displacement(both.mesh)
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(0.3))
    ends = [held(u, both.facet_tags, t, v) for t, v in ((1, np.zeros(3)), (4, (0.01, 0, -0.04)))]
    energy = 100.0 * MATERIAL.energy(u) * dx(1) + MATERIAL.energy(u) * dx(2)
    return ContactProblem(energy, u, [pair], bcs=ends, petsc_options=options)


PROBLEMS = {
    "matching": lambda o: pressed(stacked(2, "quad", 6), o),
    "matching in space": lambda o: pressed(stacked(3, "hex", 3), o),
    "a gap": lambda o: pressed(stacked(2, "tri", 5, gap=0.02), o),
    "open": lambda o: pressed(stacked(2, "tri", 3, gap=0.2), o),
    "integral": lambda o: pressed(stacked(2, "tri", 4), o, degree=2),
    "common parts": lambda o: pressed(unequal(6, 9, (-0.3, 1.45), (0.0, 1.0), "tri"), o, degree=2),
    "mixed": lambda o: pressed(stacked(2, "quad", 5), o, method="mixed"),
    "mortar": lambda o: pressed(unequal(6, 9, (-0.3, 1.45), (0.0, 1.0)), o),
    "mortar, tilted": lambda o: pressed(solids(4, 3, (-0.3, 1.45), (0.0, 1.0), "tet"), o),
    "neo-Hookean": lambda o: pressed(stacked(2, "quad", 5), o, material=NeoHookean(600.0, 400.0)),
    "soft on stiff": soft_on_stiff,
    "held by contact": held_by_contact,
    "between": between,
    "clamped slave": clamped_slave,
    "crack": lambda o: on_a_crack(2, "quad", 0.5, o),
    "crack in space": lambda o: on_a_crack(3, "tet", 1.0, o),
}


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.verifies(
    "multigrid",
    reference="independent code: MUMPS for the linear systems",
    aspects=(
        "2D",
        "3D",
        "pairs",
        "multigrid",
    ),
)
@pytest.mark.verifies(
    "matching meshes",
    "mortar",
    "cracks",
    reference="itself: factorised",
    aspects=(
        "2D",
        "3D",
        "pairs",
        "multigrid",
    ),
)
@pytest.mark.verifies(
    "points in common",
    reference="itself: factorised",
    aspects=(
        "2D",
        "pairs",
        "multigrid",
    ),
)
def test_pairs_by_multigrid_have_the_solution_of_mumps(name):
    direct = PROBLEMS[name]({"snes_rtol": 1e-11}).solve()
    problem = PROBLEMS[name](TIGHT)
    result = problem.solve()
    assert problem.linear_solver.name == "amg"
    assert sum(a.krylov_iterations for a in result.attempts) > 0
    for surface, table in direct.tables.items():
        found = result.tables[surface]
        length = 0.04
        assert found.status == table.status
        np.testing.assert_allclose(found.x, table.x, atol=1e-9)
        np.testing.assert_allclose(found.un, table.un, rtol=0, atol=1e-8 * length)
        np.testing.assert_allclose(found.ut, table.ut, rtol=0, atol=1e-8 * length)
        scale = 1e-8 * np.abs(table.force).max() + 1e-18
        np.testing.assert_allclose(found.force, table.force, rtol=0, atol=scale)
    problem.destroy()


@pytest.mark.verifies(
    "Krylov branches",
    reference="independent code: MUMPS for the linear systems",
    aspects=(
        "2D",
        "pairs",
        "multigrid",
        "branches",
    ),
)
def test_a_branch_by_multigrid_has_the_events_of_mumps():
    branches = []
    for options in (AMG, {}):
        system, x = sheared(options)
        branches.append(follow(system, x, 0.0, gamma_range=(0.0, 1.0), route="steps"))
        assert branches[-1].reason == "gamma reached the end of its range"
    events = [[s.gamma for s in b.special if s.changes] for b in branches]
    assert len(events[0]) > 3
    np.testing.assert_allclose(*events, atol=1e-7)
    ends = [b.points[-1].y for b in branches]
    size = ends[0].norm()
    ends[0].axpy(-1.0, ends[1])
    assert ends[0].norm() < 1e-6 * size
