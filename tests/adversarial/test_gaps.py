"""Assumption: gaps, cracks and rigid bodies stay as they were built.

Cracks cross, gaps turn negative after the pair was made, and rigid pushers move, leave and come
back. Uniform states and springs have closed forms.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, floor, free_row, normal_force, one_point, two_blocks
from support.checks import assert_close

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
    RigidBody,
    materials,
    meshing,
)
from dolfinx_contact.evolution import NSCD

COMM = MPI.COMM_WORLD


def squeezed(arms):
    """A square compressed evenly from all sides, with closed cracks along some arms.

    Args:
        arms: axis, beginning and end of each crack through the middle.
    """
    e = 0.01
    domain = mesh.create_unit_square(COMM, 8, 8, mesh.CellType.quadrilateral)

    def facets_of(axis, begin, end):
        def on(x):
            along = (x[axis] > begin - 0.01) & (x[axis] < end + 0.01)
            return np.isclose(x[1 - axis], 0.5) & along

        return mesh.locate_entities(domain, 1, on)

    groups = [facets_of(*arm) for arm in arms]
    facets = np.concatenate(groups)
    numbers = list(range(1, len(groups) + 1))
    values = np.repeat(np.array(numbers, dtype=np.int32), [len(g) for g in groups])
    order = np.argsort(facets)
    tags = mesh.meshtags(domain, 1, facets[order], values[order])
    body = meshing.crack(domain, numbers, facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u, right = fem.Function(V), fem.Function(V)
    right.interpolate(lambda x: -e * x[:2])
    rim = fem.locate_dofs_geometrical(
        V, lambda x: np.isclose(np.abs(x[0] - 0.5), 0.5) | np.isclose(np.abs(x[1] - 0.5), 0.5)
    )
    pairs = [
        ContactPair(u, body, slave=t, master=f"{t}_opposite", law=Frictionless(), name=f"crack{t}")
        for t in numbers
    ]
    energy = materials.LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    result = ContactProblem(energy, u, pairs, bcs=[fem.dirichletbc(right, rim)]).solve()
    assert_close(u.x.array, right.x.array)
    for pair in pairs:
        table = result.tables[pair.name]
        pressure = table.pressure[table.letters != "d"]
        assert_close(pressure, np.full(len(pressure), 1000.0 * e / (1 + 0.3) / (1 - 0.6)))


def test_a_closed_crack_transmits_a_uniform_pressure():
    squeezed([(0, 0.25, 0.75)])


def overlapped():
    """Two blocks of height 1 with held ends: an overlap d is pressed by E d / 2."""
    both = two_blocks((2, 1), (2, 1), depth=1.0)
    gap = fem.Constant(both.domain, 0.0)
    pair = ContactPair(
        both.u,
        both.slave,
        master_facets=both.master,
        law=Frictionless(),
        gap=gap,
        interference=True,
    )
    energy = materials.LinearElastic.from_young(100.0, 0.0).energy(both.u) * ufl.dx
    return gap, ContactProblem(energy, both.u, [pair], bcs=both.bcs)


@pytest.mark.sample
def test_an_interference_follows_the_constant_of_its_gap():
    gap, problem = overlapped()
    for value in (0.1, -0.01, 0.0, -0.02, 0.01):
        gap.value = value
        assert_close(normal_force(problem.solve()), max(0.0, -50.0 * value))


def pusher_below(domain, about):
    height = fem.Constant(domain, 0.0)
    held = ["x", "rz"]
    return height, RigidBody(floor(), about=about, motion={"y": height}, held=held, name="pusher")


def test_a_bar_without_mass_on_a_pusher_is_in_equilibrium_at_each_time():
    """The force is E times the way of the pusher as long as it presses, and zero after."""
    body = block((1, 1))
    height, pusher = pusher_below(body.domain, (0.5, 0.0))
    problem = body.problem(Coulomb(0.3), body.elastic(100.0), obstacle=pusher)

    def load(t):
        height.value = 0.05 * np.sin(3 * t)

    motion = NSCD(problem, density=1e-8, dt=0.02, load=load, scheme="theta-euler", theta=1.0)
    history = motion.run([0.0, 1.2])
    assert len(history.steps) == 60
    for step in history.steps[::5]:
        force = step.result.resultants["contact"]
        assert_close(force, [0.0, max(5.0 * np.sin(3 * step.time), 0.0)], 1e-3)


def test_a_point_goes_with_the_pusher():
    body, energy = one_point([[2.0, 0.0], [0.0, 3.0]])
    height, pusher = pusher_below(body.domain, (0, 0))
    problem = body.problem(bulk=energy, obstacle=pusher, bcs=body.bcs[:1])

    def load(t):
        height.value = 0.1 * np.sin(t)

    history = NSCD(problem, density=1e-9, dt=0.05, load=load).run([0.0, 1.0, 3.0])
    assert len(history.steps) == 60
    for step in history.steps:
        table = step.result.tables["contact"]
        assert_close(table.un[free_row(table)], 0.0, 1e-9)
        way = step.result.rigid_bodies["pusher"].displacement[1]
        assert_close(way, 0.1 * np.sin(step.time), 1e-12)
