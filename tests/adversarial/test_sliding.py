"""Assumption: sliding between bodies is small.

Opposing points, gaps and normals belong to the reference configuration. Where bodies move or rotate
far the answer is wrong. A warning must say so, and no proof may call the solution unique.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import move, normal_force, two_blocks
from support.checks import (
    assert_close,
    assert_warned,
    solved_start,
    verdict,
    warnings_in,
    warnings_of,
)

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact import (
    RCCM,
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
    NormalCompliance,
    ParametricContact,
    Tresca,
    materials,
    meshing,
)
from dolfinx_contact.analysis import contact_family, count_solutions, renard_criterion
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.evolution import NSCD, QuasiStatic

COMM = MPI.COMM_WORLD

NOT_SMALL = "(misfit|slip|turn) of 'contact'.* [0-9].*sliding='large'"


def pair_problem(both, law=None, *, stress=1.0, energy=None, swap=False, bcs=None):
    """Two blocks without transverse contraction."""
    steel = materials.LinearElastic.from_young(stress, 0.0)
    sides = (both.master, both.slave) if swap else (both.slave, both.master)
    pair = ContactPair(both.u, sides[0], master_facets=sides[1], law=law or Frictionless())
    energy = steel.energy(both.u) * ufl.dx if energy is None else energy
    return ContactProblem(energy, both.u, [pair], bcs=both.bcs if bcs is None else bcs)


def pressed(both, way, press=0.02, **options):
    """The top is moved by (way, -press)."""
    move(both.top, way, *[0.0] * (both.domain.geometry.dim - 2), -press)
    return pair_problem(both, **options)


def assert_doubted(caplog, problem, result):
    """Assert that a warning with a number is logged and kept, and that no proof is claimed."""
    assert_warned(caplog, NOT_SMALL)
    assert warnings_in(result)
    assert verdict(problem) != "proved"


def assert_silent(caplog, result=None):
    """Assert that nothing is said against a result."""
    assert not warnings_of(caplog)
    assert result is None or not warnings_in(result)


#: Bodies that end above nothing, or half above nothing: cells, kind, law, way and press.
LEAVING = {
    "no friction": ((2, 2), (4, 2), {}, None, 3.0, 0.02),
    "compliance": ((2, 1), (3, 1), {}, NormalCompliance(1.0), 2.0, 0.02),
    "shear of open points": ((2, 1), (3, 1), {}, Tresca(0.01), 2.0, -0.02),
    "bonds": ((2, 1), (3, 1), {}, RCCM(1.0, 1.0, 100.0, 0.0, 0.0), 2.0, -0.02),
}


@pytest.mark.parametrize("name", LEAVING)
def test_a_body_moved_off_the_edge_is_doubted(caplog, name):
    upper, lower, kind, law, way, press = LEAVING[name]
    problem = pressed(two_blocks(upper, lower, **kind), way, press, law=law)
    assert_doubted(caplog, problem, problem.solve())


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_units_do_not_hide_the_edge(caplog, unit):
    problem = pressed(two_blocks(unit=unit), 3 * unit, 0.02 * unit, stress=1 / unit)
    assert_doubted(caplog, problem, problem.solve())


@pytest.mark.sample
@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_a_small_way_is_right_and_nothing_is_said(caplog, unit):
    """2 % of a facet: two springs in a row."""
    result = pressed(two_blocks(unit=unit), 0.005 * unit, 0.0003 * unit).solve()
    assert_close(normal_force(result) / unit, 0.0003 / 1.5, 1e-4)
    assert_silent(caplog, result)


@pytest.mark.parametrize("way", [(100.0, -70.0), (0.0, 1e4)])
def test_bodies_carried_far_together_are_right_and_nothing_is_said(caplog, way):
    both = two_blocks()
    problem = pressed(both, 0.0, 0.0, law=Coulomb(0.5))
    move(both.top, way[0], way[1] - 0.02)
    move(both.foot, *way)
    result = problem.solve()
    assert_close(normal_force(result), 0.02 / 1.5)
    assert_silent(caplog, result)


@pytest.mark.parametrize(
    ("upper", "lower", "kind"),
    [
        ((2, 1), (3, 1), {}),
        ((2, 1), (3, 1), {"degree": 2}),
        ((1, 1, 1), (2, 1, 1), {"cell": "tet"}),
    ],
)
def test_a_lower_body_drawn_away_is_doubted(caplog, upper, lower, kind):
    """Nothing of the slave moves."""
    both = two_blocks(upper, lower, **kind)
    problem = pressed(both, 0.0)
    move(both.foot, -2.0, *[0.0] * (len(upper) - 1))
    assert_doubted(caplog, problem, problem.solve())


@pytest.mark.parametrize("degree", [1, 2])
def test_a_body_half_over_the_edge_is_doubted(caplog, degree):
    """The reference is a mesh of the upper block at its final position."""
    reference = two_blocks((4, 2), (4, 1), at=0.5, degree=degree)
    expected = normal_force(pressed(reference, 0.0).solve())
    assert 0.3 < expected / (0.02 / 1.5) < 0.9
    caplog.clear()
    problem = pressed(two_blocks((4, 2), (4, 1), degree=degree), 0.5)
    assert_doubted(caplog, problem, problem.solve())


def test_a_face_that_falls_off_beyond_a_kink_is_doubted(caplog):
    """The block is moved to where the lower face is 0.15 below it; there it was a plane."""
    both = two_blocks((2, 1), (12, 1), wide=(0.0, 3.0))
    x = both.domain.geometry.x
    on_top = (np.abs(x[:, 1]) < 1e-12) & (x[:, 0] > 1.0)
    x[on_top, 1] -= 0.3 * (x[on_top, 0] - 1.0)
    problem = pressed(both, 1.5)
    assert_doubted(caplog, problem, problem.solve())


def test_half_of_a_cracked_body_moved_off_the_other_is_doubted(caplog):
    domain = mesh.create_unit_square(COMM, 3, 2)
    cut = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    tags = mesh.meshtags(domain, 1, np.sort(cut), np.full(len(cut), 7, dtype=np.int32))
    body = meshing.crack(domain, [7], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    bcs = []
    for y, value in ((0.0, (0.0, 0.0)), (1.0, (1.2, -0.02))):
        face = mesh.locate_entities_boundary(body.mesh, 1, lambda x, y=y: np.isclose(x[1], y))
        dofs = fem.locate_dofs_topological(V, 1, face)
        bcs.append(fem.dirichletbc(np.array(value), dofs, V))
    steel = materials.LinearElastic.from_young(1.0, 0.0)
    pair = ContactPair(u, body, slave=7, master="7_opposite", law=Coulomb(0.1))
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=bcs)
    assert_doubted(caplog, problem, problem.solve())


def foot_centre(both):
    """Position along x of the resultant of the reactions at the foot."""
    energy = materials.LinearElastic.from_young(1.0, 0.0).energy(both.u) * ufl.dx
    forces = fem.assemble_vector(fem.form(ufl.derivative(energy, both.u)))
    forces.scatter_reverse(la.InsertMode.add)
    owned = both.V.dofmap.index_map.size_local
    x = both.V.tabulate_dof_coordinates()[:owned]
    r = np.where(np.isclose(x[:, 1], -0.5), forces.array.reshape(-1, 2)[:owned, 1], 0.0)
    total = both.domain.comm.allreduce(np.array([r @ x[:, 0], r.sum()]))
    return total[0] / total[1]


def on_one_wide_cell(way, at):
    both = two_blocks((2, 1), (1, 1), wide=(0.0, 10.0), at=at)
    problem = pressed(both, way)
    result = problem.solve()
    return problem, result, foot_centre(both)


def test_a_body_moved_along_one_wide_cell_is_doubted(caplog):
    """Four of its widths, less than half of the facet: the force stays, its place does not."""
    problem, result, found = on_one_wide_cell(4.0, 1.0)
    assert abs(found - on_one_wide_cell(0.0, 5.0)[2]) > 1.0
    assert_doubted(caplog, problem, result)


def test_a_small_way_along_one_wide_cell_is_right(caplog):
    _, result, found = on_one_wide_cell(0.001, 1.0)
    assert_close(found, on_one_wide_cell(0.0, 1.001)[2], 1e-2)
    assert_silent(caplog, result)


def test_a_small_master_moved_along_a_wide_slave_is_doubted(caplog):
    """The centre of pressure stays at 0.5 instead of going to 2.5."""
    both = two_blocks((4, 1), (16, 1), wide=(0.0, 4.0))
    problem = pressed(both, 2.0, swap=True)
    result = problem.solve()
    table = result.tables["contact"]
    assert np.sum(table.x[:, 0] * table.rn) / np.sum(table.rn) < 1.0
    assert_doubted(caplog, problem, result)


def on_soft_and_stiff(wide, way):
    """The lower block is soft up to its middle."""
    both = two_blocks((2, 2), (8, 2), wide=wide)
    x = ufl.SpatialCoordinate(both.domain)
    young = ufl.conditional(ufl.And(x[1] < 0, x[0] < sum(wide) / 2), 0.1, 10.0)
    energy = materials.LinearElastic.from_young(young, 0.0).energy(both.u) * ufl.dx
    problem = pressed(both, way, energy=energy)
    return problem, problem.solve()


def test_a_body_moved_from_a_soft_to_a_stiff_part_is_doubted(caplog):
    expected = normal_force(on_soft_and_stiff((-1.0, 1.0), 0.0)[1])
    problem, result = on_soft_and_stiff((0.0, 2.0), 1.0)
    assert abs(normal_force(result) - expected) > 1e-3 * expected
    assert_doubted(caplog, problem, result)


def turned(degrees, press):
    """Force on two StVenant-Kirchhoff blocks that are turned together, turned back."""
    both = two_blocks((1, 1), (1, 1))
    rubber = materials.StVenantKirchhoff(0.0, 0.5)
    problem = pair_problem(both, energy=rubber.energy(both.u) * ufl.dx)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def field(x):
        a, b = x[0], x[1] - press * (x[1] + 0.5) / 1.5
        return np.stack([c * a - s * b - x[0], s * a + c * b - x[1]])

    for function in (both.top, both.foot, both.u):
        function.interpolate(field)
    result = problem.solve()
    return problem, result, np.array([[c, s], [-s, c]]) @ result.resultants["contact"]


def test_blocks_turned_together_by_a_right_angle_are_doubted(caplog):
    problem, result, found = turned(90.0, 0.02)
    expected = turned(0.0, 0.02)[2]
    assert np.abs(found - expected).max() > 1e-3 * np.abs(expected).max()
    assert_doubted(caplog, problem, result)


def test_blocks_turned_together_by_half_a_degree_are_right(caplog):
    _, result, found = turned(0.5, 0.001)
    assert_close(found, turned(0.0, 0.001)[2], 0.02)
    assert_silent(caplog, result)


def twisted(degrees, press):
    """Remaining share of the force between two cubes after twisting one on the other."""
    both = two_blocks((2, 2, 1), (3, 3, 1), cell="hex")
    problem = pressed(both, 0.0)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def top(x):
        a, b = x[0] - 0.5, x[1] - 0.5
        return np.stack([c * a - s * b - a, s * a + c * b - b, -press + 0 * a])

    both.top.interpolate(top)
    result = problem.solve()
    return problem, result, normal_force(result) / (press / 1.5)


def test_a_cube_twisted_by_45_degrees_is_doubted(caplog):
    """An octagon of 0.83 of the face is carried."""
    problem, result, _ = twisted(45.0, 0.02)
    assert_doubted(caplog, problem, result)


def test_a_cube_twisted_by_a_fifth_of_a_degree_is_right(caplog):
    _, result, share = twisted(0.2, 0.0002)
    assert_close(share, 1.0, 1e-3)
    assert_silent(caplog, result)


@pytest.mark.parametrize("law", [Frictionless(), Coulomb(0.05)])
def test_no_theorem_proves_a_body_off_the_edge(caplog, law):
    problem = pressed(two_blocks((2, 1), (3, 1)), 2.0, law=law)
    for algorithm in ("newton", "gauss-seidel", "lemke"):
        caplog.clear()
        result = problem.solve(algorithm=algorithm)
        assert_doubted(caplog, problem, result)
    assert problem.uniqueness(proof_seconds=5.0).verdict != "proved"
    assert not renard_criterion(problem).unique


@pytest.mark.sample
def test_a_history_that_leaves_the_edge_in_small_steps_says_so_once(caplog):
    both = two_blocks((2, 1), (4, 1))
    problem = pressed(both, 0.0, 0.001, law=Coulomb(0.2))
    problem.solve()
    history = QuasiStatic(problem, lambda t: move(both.top, t, -0.001)).run(
        np.linspace(0.0, 1.2, 25)
    )
    names = [text.partition(":")[0] for text in warnings_of(caplog)]
    assert len(names) == len(set(names))
    assert_doubted(caplog, problem, history.steps[-1].result)


def test_a_history_of_a_small_way_is_right(caplog):
    both = two_blocks((2, 1), (4, 1))
    problem = pressed(both, 0.0, 0.001, law=Coulomb(0.2))
    problem.solve()
    history = QuasiStatic(problem, lambda t: move(both.top, t, -0.001)).run([0.0, 0.002, 0.004])
    assert_close(normal_force(history.steps[-1].result), 0.001 / 1.5, 0.02)
    assert_silent(caplog)


def test_a_body_that_slides_beyond_the_edge_in_a_motion_is_doubted(caplog):
    """After two widths the body should fall freely."""
    both = two_blocks((2, 1), (4, 1))
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    steel = materials.LinearElastic.from_young(100.0, 0.0)
    energy = steel.energy(both.u) * dx + 0.01 * both.u[1] * dx(1)
    problem = pair_problem(both, energy=energy, bcs=both.bcs[1:])
    velocity = fem.Function(both.V)
    velocity.interpolate(lambda x: np.stack([1.0 + 0 * x[0], 0 * x[0]]), cells0=both.parts.find(1))
    velocity.x.scatter_forward()
    NSCD(problem, 1.0, dt=0.2, velocity=velocity).run([0.0, 2.0])
    assert_warned(caplog, NOT_SMALL)


def drawn(friction):
    """A block drawn along by a stiff spring at its top, as gamma grows."""
    both = two_blocks((2, 1), (2, 1))
    gamma = fem.Constant(both.domain, 0.0)
    facets = mesh.locate_entities_boundary(both.domain, 1, lambda x: np.isclose(x[1], 1))
    tags = mesh.meshtags(both.domain, 1, np.sort(facets), np.ones(len(facets), dtype=np.int32))
    ds = ufl.Measure("ds", both.domain, subdomain_data=tags)(1)
    pull = both.u - ufl.as_vector((gamma, -0.02))
    steel = materials.LinearElastic.from_young(1.0, 0.0)
    energy = steel.energy(both.u) * ufl.dx + 50.0 * ufl.dot(pull, pull) * ds
    move(both.top, 0.0, -0.02)
    coefficient = fem.Constant(both.domain, friction)
    problem = pair_problem(both, Coulomb(coefficient), energy=energy, bcs=both.bcs[1:])
    return ParametricContact(problem, gamma), coefficient


def test_a_branch_beyond_the_edge_is_doubted_and_its_search_not_complete(caplog):
    system, _ = drawn(0.1)
    x = solved_start(system)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 2.0))
    assert_close(branch.points[-1].gamma, 2.0, 1e-9)
    assert_warned(caplog, NOT_SMALL)
    system.problem.write(x)
    assert not find_solutions(system, [x], 2.0).complete


@pytest.mark.parametrize(("ways", "proved"), [((1.5, 2.5), False), ((-0.04, 0.05), True)])
def test_a_chart_proves_nothing_beyond_the_edge(ways, proved):
    system, friction = drawn(0.1)
    family = contact_family(system, friction, mu_range=(0.05, 0.3))
    chart = count_solutions(family, mu_range=(0.05, 0.3), gamma_range=ways, cells=(2, 2), depth=0)
    assert chart.proved == proved
    assert proved or not any(cell.proved for cell in chart.cells)
