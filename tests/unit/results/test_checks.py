"""Indicators of doubtful states, meshes and obstacles, with their warnings."""

import logging

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import KINDS, block, box, facets
from support.bodies import two_blocks
from support.checks import solved_start
from support.own_laws import Orthotropic
from support.pairs import cracked, displacement, held, stacked

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    Frictionless,
    HalfSpace,
    LevelSet,
    ParametricContact,
    RigidBody,
    RigidSurface,
    Sphere,
)
from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.continuation import explore, follow
from dolfinx_contact.laws import status
from dolfinx_contact.materials import LinearElastic, StVenantKirchhoff
from dolfinx_contact.meshing import crack

COMM = MPI.COMM_WORLD


def said(caplog, words):
    """Warnings with these words: one on rank 0, none on other ranks. Their text on every rank."""
    found = [r.getMessage() for r in caplog.records if words in r.getMessage()]
    caplog.clear()
    numbers = COMM.allgather(len(found))
    assert numbers[0] <= 1
    assert not any(numbers[1:])
    return COMM.bcast(found[0] if found else "")


@pytest.fixture
def log(caplog):
    caplog.set_level(logging.WARNING)
    return caplog


# -- curved obstacles ----------------------------------------------------------------------------


@pytest.mark.parametrize("slide", [0.002, 0.2])
@pytest.mark.parametrize("method", ["nodal", "mixed"])
@pytest.mark.verifies(
    "misfit and det F",
    "spheres",
    reference="closed form: distances of displaced points to the disc",
    aspects=("2D",),
)
def test_sliding_on_a_disc_is_measured(method, slide, log):
    """The distance to the disc where the closed points are now, from the displacement alone."""
    centre = np.array([0.4, -3.0])
    radius = 3.0
    problem = block(
        n=6, cell="quad", obstacle=Sphere(centre, radius), top=(slide, -0.02), method=method
    )
    result = problem.solve()
    (s,) = problem.surfaces
    size = problem.equations.body_size
    n = s.points.number
    u = problem.u.x.array.reshape(-1, 2)[s.points.vertex_nodes][:n]
    x = s.positions[:n]
    closed = status.closed(problem.statuses[0])
    true = np.linalg.norm(x + u - centre, axis=1) - radius
    law = (
        np.linalg.norm(x - centre, axis=1)
        - radius
        - np.sum(u * s.points.vertex_normals[:n], axis=1)
    )
    worst = COMM.allreduce(float(np.max(np.abs(true - law)[closed], initial=0.0)), op=max)
    indicators = result.indicators.surfaces["contact"]
    assert result.misfit == indicators.misfit == result.summary()["misfit"]
    assert result.misfit == pytest.approx(worst, rel=1e-9)
    if method == "nodal":  # where the law has closed points on the disc
        hanging = COMM.allreduce(float(np.max(true[closed], initial=0.0)), op=max)
        assert result.misfit == pytest.approx(hanging, rel=1e-6)
    message = said(log, "misfit of 'contact'")
    if slide < 0.1:
        assert 0 < result.misfit < 1e-5 * size
        assert not message
        assert "misfit of 'contact'" not in result.warnings
    else:
        assert result.misfit > 1e-3 * size
        assert f"differs by {worst / indicators.facet:.2g} facet sizes" in message
        assert "use sliding='large'" in result.warnings["misfit of 'contact'"]


def test_open_points_in_the_obstacle_are_found(log):
    """Dragged over the bump of a level set, points that the law has open are inside it."""
    bump = LevelSet(lambda x: x[1] + 0.02 - 0.1 * ufl.exp(-(((x[0] - 1.6) / 0.2) ** 2)))
    result = block(n=4, cell="tri", law=Frictionless(), top=(0.6, 0.0), obstacle=bump).solve()
    assert result.counts["open"] == 5
    assert result.misfit == pytest.approx(0.08, rel=0.01)
    assert said(log, "misfit of 'contact'")


@pytest.mark.ranks(2)
def test_a_cylinder_between_contact_points_gives_a_warning(log):
    """It is half as deep in the facets as its radius, and no contact point touches it."""
    rod = Cylinder((0.25, 0.0, -0.05), (0.0, 1.0, 0.0), 0.1)
    problem = block(n=2, cell="hex", law=Frictionless(), top=(0.0, 0.0, 0.0), obstacle=rod)
    (found,) = problem.solve().indicators.surfaces.values()
    assert found.between_points == pytest.approx(0.5, rel=1e-9)
    assert said(log, "between_points of 'contact'")


def half(domain):
    """Facets of the left half of the bottom of a block."""
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0) & (x[0] < 0.51))


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "obstacle",
    [
        HalfSpace((0.0, 0.0), (0.0, 1.0)),
        Sphere((0.5, -300.0), 300.0),
        LevelSet(lambda x: x[1] + 1e-5 * ufl.sin(x[0])),
        RigidSurface([[-1.0, 0.0], [2.0, 0.0]], [[1, 0]]),
    ],
)
def test_a_forgotten_half_of_the_face_in_the_obstacle_gives_a_warning(obstacle, log):
    """A stiff block sinks by 1e-4: a small part of a facet, and most of the compression."""
    pressed = dict(n=8, cell="quad", young=2e11, top=(0.0, -1e-4), obstacle=obstacle)
    assert "beside of 'contact'" not in block(**pressed).solve().warnings
    result = block(where=half, **pressed).solve()
    assert result.indicators.surfaces["contact"].beside > 0.4
    assert "add its facets" in result.warnings["beside of 'contact'"]
    assert said(log, "beside of 'contact'")


def test_boundary_past_the_end_of_the_obstacle_gives_no_warning():
    """A body hangs over the edge of a plate."""
    plate = RigidSurface([[-1.0, 0.0], [0.5, 0.0]], [[1, 0]])
    assert block(n=8, cell="quad", where=half, obstacle=plate).solve().warnings == {}


# -- static law ----------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", [Coulomb(0.3), Frictionless()])
@pytest.mark.parametrize("sliding", ["small", "large"])
def test_static_law_gives_a_warning_where_the_contact_zone_grows(law, sliding, log):
    """On a disc, all points except the lowest one have an initial gap; steps give no warning."""
    disc = Sphere((0.5, -2.0), 2.0)
    problem = block(n=8, cell="quad", law=law, obstacle=disc, top=(0.0, -0.05), sliding=sliding)
    result = problem.solve()
    table = result.tables["contact"]
    g0 = np.hypot(table.x[:, 0] - 0.5, table.x[:, 1] + 2.0) - 2.0
    late = np.where(g0 > 0.01 * 0.05, table.bound, 0.0)
    found = result.indicators.surfaces["contact"].growth
    if isinstance(law, Frictionless):
        assert found == 0.0
    else:
        sums = COMM.allreduce(np.array([late.sum(), table.bound.sum()]))
        assert found == pytest.approx(sums[0] / sums[1], rel=1e-6)
        assert "QuasiStatic" in result.warnings["growth of 'contact'"]
        assert "QuasiStatic" not in str(result)
        assert str(result).endswith("warnings (1): growth of 'contact'")
    assert bool(said(log, "growth of 'contact'")) == isinstance(law, Coulomb)
    step = problem.step_from(problem.snapshot())
    assert "growth of 'contact'" not in step.solve().warnings


@pytest.mark.ranks(2, 3)
def test_growth_does_not_depend_on_the_way_into_contact():
    """A block lowered on a near and a distant disc, and a disc raised by a Constant."""
    disc = Sphere((0.5, -2.0), 2.0)
    expected = block(n=8, cell="quad", obstacle=disc, top=(0.0, -0.05)).solve()
    domain = box(COMM, 8, "quad")
    place = fem.Constant(domain, (0.5, -3.0))
    distant = Sphere(place, 2.0)
    lowered = block(domain=domain, obstacle=distant, top=(0.0, -1.05)).solve()
    problem = block(domain=domain, obstacle=distant, top=(0.0, 0.0))
    place.value[:] = (0.5, -1.95)
    raised = problem.solve()
    for result in (lowered, raised):
        found = result.indicators.surfaces["contact"].growth
        assert found == pytest.approx(expected.indicators.surfaces["contact"].growth, abs=0.1)
        assert "growth of 'contact'" in result.warnings


@pytest.mark.ranks(2, 3)
def test_growth_of_a_pair_in_large_sliding_is_that_in_small_sliding():
    """A straight block pressed on a rounded one."""
    found = []
    for sliding in ("small", "large"):
        both = stacked(2, "quad", 8, gap=0.01)
        x = both.mesh.geometry.x
        x[:, 1] -= np.where(x[:, 1] < 1.005, 0.1 * x[:, 1] * (x[:, 0] - 0.5) ** 2, 0.0)
        u = displacement(both.mesh)
        bcs = [held(u, both.facet_tags, 1, (0.0, 0.0)), held(u, both.facet_tags, 4, (0.0, -0.03))]
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(0.3), sliding=sliding)
        result = ContactProblem(energy, u, [pair], bcs=bcs).solve()
        found.append(result.indicators.surfaces["contact"].growth)
    assert found[0] > 0.5
    assert found[1] == pytest.approx(found[0], rel=0.1)


def test_levelled_floor_does_not_count_as_growth():
    """The floor was inclined when the problem was made."""
    domain = box(COMM, 4, "quad")
    normal = fem.Constant(domain, (0.3, 1.0))
    floor = HalfSpace((0.0, -0.1), normal)
    problem = block(domain=domain, obstacle=floor, top=(0.0, -0.11))
    normal.value[:] = (0.0, 1.0)
    result = problem.solve()
    assert result.tables["contact"].bound.sum() > 0.0
    assert result.indicators.surfaces["contact"].growth == 0.0


def test_points_that_close_together_do_not_count_as_growth():
    """A block is lowered onto a floor whose height varies by 1e-6 of the height of the block."""
    floor = LevelSet(lambda x: x[1] + 0.1 + 1e-6 * ufl.sin(7 * x[0]))
    result = block(n=4, cell="quad", obstacle=floor, top=(0.05, -0.2)).solve()
    assert result.tables["contact"].bound.sum() > 0.0
    assert result.indicators.surfaces["contact"].growth == 0.0


@pytest.mark.ranks(2)
def test_a_soft_part_elsewhere_does_not_hide_growth():
    """The soft upper half takes the approach, which is 160 times the largest initial gap."""
    domain = box(COMM, 8, "quad")
    young = fem.Function(fem.functionspace(domain, ("DG", 0)))
    young.interpolate(lambda x: np.where(x[1] < 0.5, 1000.0, 1.0))
    disc = Sphere((0.5, -200.0), 200.0)
    result = block(domain=domain, young=young, obstacle=disc, top=(0.0, -0.1)).solve()
    table = result.tables["contact"]
    share = table.bound[np.abs(table.x[:, 0] - 0.5) > 1e-9].sum() / table.bound.sum()
    assert result.indicators.surfaces["contact"].growth == pytest.approx(share)
    assert share > 0.5


@pytest.mark.ranks(2)
def test_a_branch_over_a_plane_gives_the_warning(log):
    """A curved face that a rising floor closes from its middle on."""
    domain = box(COMM, 8, "quad")
    x = domain.geometry.x
    x[:, 1] += 0.04 * (1.0 - x[:, 1]) * (x[:, 0] - 0.5) ** 2
    gamma = fem.Constant(domain, 0.0)
    floor = HalfSpace(ufl.as_vector((0.0, gamma)), (0.0, 1.0))
    problem = block(
        domain=domain,
        obstacle=floor,
        top=(0.0, 0.0),
        where=lambda domain: mesh.locate_entities_boundary(domain, 1, lambda x: x[1] < 0.02),
    )
    system = ParametricContact(problem, gamma)
    follow(system, system.create_vector(), 0.0, gamma_range=(0.0, 0.02))
    assert "use QuasiStatic" in said(log, "growth of 'contact': at gamma = ")


def test_branches_through_the_state_at_rest_give_no_warning(log):
    """At gamma = 0 all forces of the triangle are round-off."""
    system = linear_triangle(4, 3.0)
    start = solved_start(system, -1.0)
    explore(system, [(start, -1.0)], gamma_range=(-1.0, 1.0), observer=lambda step: None)
    assert not log.records


# -- det F ---------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "misfit and det F",
    reference="closed form: a homogeneous deformation",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_smallest_jacobian_is_measured(dim, cell, degree):
    """It is that of a homogeneous state, of one bad vertex, and NaN for one NaN."""
    problem = block(n=2, cell=cell, degree=degree)
    G = np.array([[0.3, -0.2, 0.1], [0.1, -0.4, 0.2], [0.0, 0.3, 0.2]])[:dim, :dim]
    problem.u.interpolate(lambda x: G @ x[:dim])
    value, place = smallest_jacobian(problem.V, problem.u.x.array)
    np.testing.assert_allclose(value, np.linalg.det(np.eye(dim) + G), rtol=1e-12)
    problem.u.x.array[:] = 0.0
    corner = fem.locate_dofs_geometrical(problem.V, lambda x: np.isclose(x, 1.0)[:dim].all(axis=0))
    problem.u.x.array.reshape(-1, dim)[corner] = -0.7
    value, place = smallest_jacobian(problem.V, problem.u.x.array)
    assert value < 0
    assert np.abs(place - 1.0).max() < 0.4
    assert len({(value, *place) for value, place in COMM.allgather((value, place))}) == 1
    problem.u.x.array.reshape(-1, dim)[corner] = np.nan
    value, place = smallest_jacobian(problem.V, problem.u.x.array)
    assert np.isnan(value)
    assert np.abs(place - 1.0).max() < 0.4


def test_only_the_corner_is_inverted():
    """A quadrilateral whose Gauss points are well: det F = 0 at 0.5, below that at its corner."""
    problem = block(n=2, cell="quad")
    corner = fem.locate_dofs_geometrical(problem.V, lambda x: (x[0] > 0.9) & (x[1] > 0.9))
    problem.u.x.array.reshape(-1, 2)[corner] = -0.55 / 2
    value, _ = smallest_jacobian(problem.V, problem.u.x.array)
    assert value == pytest.approx(-0.1, rel=1e-12)


def test_an_inverted_solution_is_said(log):
    """St Venant-Kirchhoff without lateral strain, pressed by 70 %, and through itself by 230 %."""
    soft = StVenantKirchhoff(0.0, 400.0)
    result = block(n=4, cell="tri", material=soft, top=(0.0, -0.7)).solve()
    assert result.min_det_F == pytest.approx(0.3, rel=1e-9)
    assert not said(log, "inside out")
    problem = block(n=4, cell="tri", material=soft, top=(0.0, -2.3))
    result = problem.solve()
    assert result.min_det_F == pytest.approx(-1.3, rel=1e-9)
    assert result.reason == "full steps"  # not the increments that found nothing better
    assert result.summary()["min_det_F"] == result.min_det_F
    message = said(log, "inside out")
    assert "det F is -1.3" in message
    assert list(result.warnings) == ["min_det_F", "beside of 'contact'"]
    assert block(n=4, cell="tri").solve().min_det_F is None


def test_a_linear_body_pressed_through_itself_gives_a_warning():
    """A plate of thickness 0.1 is lowered by 0.9, as with lengths in other units."""
    plate = mesh.create_rectangle(COMM, [(0.0, 0.9), (1.0, 1.0)], (8, 2))
    floor = HalfSpace((0.0, 0.9), (0.0, 1.0))
    way = dict(where=lambda domain: facets(domain, 1, 0.9), obstacle=floor)
    result = block(domain=plate, top=(0.0, -0.9), **way).solve()
    assert result.min_det_F < 0.0
    assert "the same units" in result.warnings["min_det_F"]


@pytest.mark.ranks(2)
def test_a_second_body_without_support_gives_a_warning():
    """The lower block is pushed away by the upper one without force."""
    blocks = two_blocks()
    blocks.top.x.array[1::2] = -0.01
    pair = ContactPair(blocks.u, blocks.slave, master_facets=blocks.master, law=Coulomb(0.3))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(blocks.u) * ufl.dx
    alone = ContactProblem(energy, blocks.u, [pair], bcs=blocks.bcs[:1]).solve()
    assert "rotation of part" in alone.warnings["floating"]
    held = ContactProblem(energy, blocks.u, [pair], bcs=blocks.bcs).solve()
    assert "floating" not in held.warnings


@pytest.mark.ranks(2)
def test_a_body_that_touches_nothing_gives_a_warning(log):
    """The top of a block is lifted instead of pressed; a step from a state may lift it."""
    problem = block(n=4, cell="quad", top=(0.0, 0.01))
    assert problem.solve().indicators.apart == pytest.approx(0.01, rel=1e-9)
    assert "the smallest gap is 0.01" in said(log, "no contact point touches")
    assert problem.step_from(problem.snapshot()).solve().indicators.apart is None
    assert block(n=4, cell="quad").solve().indicators.apart is None
    below = HalfSpace((0.0, -0.1), (0.0, 1.0))
    at_rest = block(n=4, cell="quad", top=(0.0, 0.0), obstacle=below).solve()
    assert at_rest.indicators.apart is None


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("lift", "height"), [(1e-15, -0.1), (-0.01, -0.01 - 1e-15)])
def test_round_off_is_neither_a_motion_nor_a_gap(lift, height):
    """A block moves by round-off over a floor; or by 0.01, down to round-off above the floor."""
    floor = HalfSpace((0.0, height), (0.0, 1.0))
    result = block(n=4, cell="quad", top=(0.0, lift), obstacle=floor).solve()
    assert result.indicators.apart is None


@pytest.mark.ranks(2)
def test_a_crack_may_open_without_a_warning():
    """Two blocks are drawn apart, and a block with a crack that ends in its middle."""
    parted = stacked(2, "quad", 4, heights=(-0.5, 0.5))
    domain, tags = cracked(2, "quad", 0.5)
    for body, master, apart in (
        (parted, 2, pytest.approx(0.01, rel=1e-6)),
        (crack(domain, [5], facet_tags=tags), "5_opposite", None),
    ):
        u = displacement(body.mesh)
        slave = 3 if master == 2 else 5
        pair = ContactPair(u, body, slave=slave, master=master, law=Coulomb(0.3))
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        bcs = [held(u, body.facet_tags, t, v) for t, v in ((1, (0.0, 0.0)), (4, (0.0, 0.01)))]
        result = ContactProblem(energy, u, [pair], bcs=bcs).solve()
        assert result.indicators.apart == apart
        assert result.counts["stick"] == result.counts["slip"] == 0


def turned(degrees, material):
    """A square turned about its corner by its Dirichlet data, far above its obstacle."""
    domain = box(COMM, 3, "tri")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    motion = fem.Function(u.function_space)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    motion.interpolate(lambda x: np.stack([c * x[0] - s * x[1] - x[0], s * x[0] + c * x[1] - x[1]]))
    floor = HalfSpace((0.0, -3.0), (0.0, 1.0))
    face = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Frictionless())
    top = fem.locate_dofs_topological(u.function_space, 1, facets(domain, 1, 1.0))
    bcs = [fem.dirichletbc(motion, top)]
    return ContactProblem(material.energy(u) * ufl.dx, u, [face], bcs=bcs).solve()


def test_rotating_linear_body_gives_a_warning(log):
    """Linear strains grow with the square of a rotation; the tangent of the angle is measured."""
    linear = LinearElastic.from_young(1.0, 0.0)
    result = turned(5.0, linear)
    assert result.indicators.rotation == pytest.approx(5.0, rel=0.01)
    assert "rotation" not in result.warnings
    assert not said(log, "rotation")
    result = turned(30.0, linear)
    assert result.indicators.rotation == pytest.approx(np.degrees(0.5), rel=0.05)
    assert list(result.warnings) == ["rotation", "apart"]
    assert "linear body has rotated" in said(log, "rotation")
    nonlinear = turned(30.0, StVenantKirchhoff(0.0, 0.5))
    assert nonlinear.indicators.rotation is None
    assert "rotation" not in nonlinear.warnings


@pytest.mark.ranks(2)
@pytest.mark.ranks(2)
def test_an_option_that_petsc_does_not_read_gives_a_warning(log):
    """Not if it was not needed: without a step, or in multigrid."""
    options = {
        "snes_maxit": 5,
        "snes_max_it": 30,
        "snes_linesearch_maxstep": 1e6,
        "ksp_error_if_not_converged": True,
        "mat_mumps_icntl_14": 50,
        "amg_pc_type": "hypre",
    }
    resting = block(n=2, options=options, top=(0.0, 0.0)).solve()
    assert "petsc_options" not in resting.warnings
    problem = block(n=2, options=options)
    assert "snes_maxit" in problem.solve().warnings["petsc_options"]
    text = said(log, "petsc_options")
    assert text.startswith("petsc_options: PETSc has not read snes_maxit: misspelled")
    problem.u.x.array[:] = 0.0
    assert "petsc_options" in problem.solve().warnings
    assert not said(log, "petsc_options")
    del problem.petsc_options["snes_maxit"]
    assert "petsc_options" not in problem.solve().warnings


@pytest.mark.ranks(2)
def test_displacement_in_other_units_than_the_mesh_gives_a_warning(log):
    """A mesh in m that is pressed by a hundredth of its height, or by as much in mm."""
    assert block(n=4).solve().indicators.displacement < 0.02
    assert not log.records
    result = block(n=4, top=(4.0, -10.0)).solve()
    assert result.indicators.displacement > 9
    assert "the same units" in said(log, "displacements within a linear body")


# -- cells ---------------------------------------------------------------------------------------


def strip(order):
    """Four triangles in a row, on rank 0 in the given order; the third is empty."""
    cells = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]], dtype=np.int64)[order]
    x = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 1], [1, 2]], dtype=np.float64)
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    if COMM.rank > 0:
        cells = cells[:0]
        x = x[:0]
    return mesh.create_mesh(COMM, cells=cells, x=x, e=ufl.Mesh(element))


@pytest.mark.ranks(2)
@pytest.mark.parametrize("order", [[0, 1, 2, 3], [2, 3, 1, 0], [3, 0, 1, 2]])
def test_an_empty_cell_is_named(order):
    """The error has its number in the input, on every rank, when the problem is made."""
    domain = strip(order)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, 0), (0, 1)), law=Coulomb(0.3)
    )
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    with pytest.raises(ValueError, match="cells without volume: 1,") as info:
        ContactProblem(energy, u, [surface])
    assert f"cell {order.index(2)} (in the order of the input), at (0.5, 1)" in str(info.value)
    assert len(set(COMM.allgather(str(info.value)))) == 1


# -- obstacles -----------------------------------------------------------------------------------


WHOLE = {"where": lambda d: mesh.exterior_facet_indices(d.topology)}
#: Obstacles on the wrong side of the unit square or cube, and the place where that shows.
WRONG = {
    "floor reversed": ("tri", {"obstacle": HalfSpace((0, -0.1), (0, -1))}, "(0, 0)"),
    "floor reversed, 3D": ("tet", {"obstacle": HalfSpace((0, 0, 0), (0, 0, -1))}, "(0, 0, 0)"),
    "disc inside": ("tri", {"obstacle": Sphere((0.5, 0.3), 0.2)}, "(0.5, 0)"),
    "ball inside": ("hex", {"obstacle": Sphere((0.5, 0.5, 0.3), 0.1)}, "(0.5, 0.5, 0)"),
    "disc inside, all in contact": ("quad", {"obstacle": Sphere((0.5, 0.3), 0.2), **WHOLE}, "0)"),
}
#: Obstacles that are where they should be.
RIGHT = {
    "floor": ("tri", {}),
    "floor below": ("tet", {"obstacle": HalfSpace((0, 0, -3.0), (0, 0, 1))}),
    "steep plane": ("quad", {"obstacle": HalfSpace((0, 0), (0.9, 0.4))}),
    "disc below": ("tri", {"obstacle": Sphere((0.4, -3.0), 3.0)}),
    "small disc in the body": ("tri", {"obstacle": Sphere((0.5, -0.05), 0.2)}),
    "floor high in the body": ("tri", {"obstacle": HalfSpace((0, 0.3), (0, 1))}),
    "all of the surface": ("tri", WHOLE),
    "all of it, deep in the floor": ("quad", {"obstacle": HalfSpace((0, 0.8), (0, 1)), **WHOLE}),
    "all of it over a ball": ("tet", {"obstacle": Sphere((0.5, 0.5, -1.0), 1.0), **WHOLE}),
    "ball beside the face": ("tri", {"obstacle": Sphere((2.5, 1.2), 0.5)}),
    "ball beside it, 3D": ("tet", {"obstacle": Sphere((2.5, 0.5, 1.2), 0.5)}),
    "inside of a ring": ("tri", {"obstacle": LevelSet(lambda x: 2 - ufl.sqrt(ufl.dot(x, x)))}),
}


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", WRONG)
def test_obstacle_on_the_wrong_side_gives_a_warning(name, log):
    cell, options, place = WRONG[name]
    block(n=4, cell=cell, **options)
    message = said(log, "wrong side")
    assert f"{place}, where the body comes nearest" in message


@pytest.mark.parametrize("name", RIGHT)
def test_obstacle_on_the_right_side_gives_no_warning(name, log):
    cell, options = RIGHT[name]
    block(n=4, cell=cell, **options)
    assert not log.records


@pytest.mark.parametrize("what", ["normal", "centre"])
def test_obstacle_moved_to_the_wrong_side_gives_a_warning(what, log):
    """Constants change between two solves; nothing touches, and a warning gives the reason."""
    domain = box(COMM, 4, "tri")
    before, after = {"normal": ([0, 1], [0, -1]), "centre": ([0.5, -1.0], [0.5, 1.3])}[what]
    value = fem.Constant(domain, np.array(before, dtype=np.float64))
    obstacle = HalfSpace((0, 0), value) if what == "normal" else Sphere(value, 1.0)
    problem = block(domain=domain, obstacle=obstacle)
    assert not problem.solve().warnings
    assert not said(log, "wrong side")
    value.value[:] = after
    result = problem.solve()
    assert np.abs(result.resultants["contact"]).max() < 1e-9
    assert said(log, "the obstacle is on the wrong side")
    assert list(result.warnings) == ["side of 'contact'", "apart"]


def test_reversed_floor_that_pulls_gives_a_warning():
    domain = box(COMM, 4, "tri")
    normal = fem.Constant(domain, (0.0, 1.0))
    problem = block(domain=domain, obstacle=HalfSpace((0, -0.1), normal))
    assert list(problem.solve().warnings) == ["apart"]
    normal.value[:] = 0.0, -1.0
    result = problem.solve()
    assert result.resultants["contact"][1] < -1e-3
    assert result.indicators.surfaces["contact"].across == pytest.approx(1.0)
    assert "across of 'contact'" in result.warnings


def test_reversed_floor_under_a_round_foot_gives_a_warning(log):
    """The points deepest in it are the rims of the foot, which face neither way."""
    domain = box(COMM, 8, "tri")
    x = domain.geometry.x
    x[:, 1] += (1 - x[:, 1]) * (1 - np.sqrt(1 - (0.999 * (2 * x[:, 0] - 1)) ** 2))
    below = mesh.locate_entities_boundary(
        domain,
        1,
        lambda x: np.isclose(x[1], 1 - np.sqrt(1 - (0.999 * (2 * x[0] - 1)) ** 2), atol=1e-9),
    )
    for normal, wrong in (((0, 1), False), ((0, -1), True)):
        floor = HalfSpace((0, 0), normal)
        block(domain=domain, where=lambda d: below, obstacle=floor)
        message = said(log, "wrong side")
        assert ("at (0.5, 0), " in message) == wrong


def _held_in_one_direction(law=None, **options):
    """Nodes on two planes of symmetry, and a floor that moves along one of them."""
    domain = box(COMM, 2, "hex")
    u = displacement(domain)
    V = u.function_space
    top = facets(domain, 2, 1.0)
    tags = mesh.meshtags(domain, 2, np.sort(top), np.ones(len(top), dtype=np.int32))
    load = 20.0 * u[2] * ufl.ds(subdomain_data=tags)(1)
    bcs = [
        fem.dirichletbc(
            0.0, fem.locate_dofs_topological(V.sub(i), 2, facets(domain, i, 0.0)), V.sub(i)
        )
        for i in (0, 1)
    ]
    given = {"x": 0.05, **dict.fromkeys(("y", "z", "rx", "ry", "rz"), 0.0)}
    floor = RigidBody(HalfSpace((0, 0, 0), (0, 0, 1)), about=(0, 0, 0), motion=given)
    surface = ContactSurface(u, facets(domain, 2, 0.0), obstacle=floor, law=law or Coulomb(0.3))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx + load
    return ContactProblem(energy, u, [surface], bcs=bcs, **options).solve()


@pytest.mark.ranks(2, 3)
def test_friction_is_opposite_to_slip_that_dirichlet_data_impose():
    """Nodes held along the motion of the floor also slip across it; r is arbitrary."""
    across = []
    for r in (None, 10.0, 1e4):
        result = _held_in_one_direction(r=r)
        assert "law" not in result.warnings
        across.append(result.resultants["contact"][1])
        table = result.tables["contact"]
        held = (table.x[:, 0] < 1e-9) & (table.x[:, 1] > 1e-9)
        slip, friction = table.increment[held], table.friction[held]
        size = np.linalg.norm(slip, axis=1)
        assert np.all(size > 0.04)
        expected = -0.3 * table.rn[held] * slip[:, 1] / size
        np.testing.assert_allclose(friction[:, 1], expected, rtol=1e-8)
    np.testing.assert_allclose(across, across[0], rtol=1e-8)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("along", "across", "angle"), [(0.3, 0.3, 0.0), (0.2, 0.4, 0.5)])
def test_orthotropic_friction_of_driven_nodes_dissipates_the_most(along, across, angle):
    """The law has no friction disc: shear -rn A (A ut)/|A ut|, axes of the grain, for any r."""
    grain = np.array([np.cos(angle), np.sin(angle), 0.0])
    other = np.array([-np.sin(angle), np.cos(angle), 0.0])
    A = along * np.outer(grain, grain) + across * np.outer(other, other)
    total = []
    for r in (None, 1e2, 1e4):
        result = _held_in_one_direction(Orthotropic(along, across, angle), r=r)
        assert "law" not in result.warnings
        total.append(result.resultants["contact"][1])
        table = result.tables["contact"]
        slip = table.increment @ A
        expected = -table.rn[:, None] * (slip @ A) / np.linalg.norm(slip, axis=1)[:, None]
        for fixed, free in ((0, 1), (1, 0)):
            nodes = (table.x[:, fixed] < 1e-9) & (table.x[:, free] > 1e-9)
            friction = table.friction[nodes, free]
            np.testing.assert_allclose(friction, expected[nodes, free], rtol=1e-8)
    np.testing.assert_allclose(total, total[0], rtol=1e-8)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_friction_missing_in_the_force_on_a_rigid_body_gives_a_warning(dim):
    """The floor moves in x and the face x = 0 is held in x; its friction opposes its slip."""
    domain = box(COMM, 2, "hex" if dim == 3 else "quad")
    u = displacement(domain)
    V = u.function_space
    side = fem.locate_dofs_topological(V.sub(0), dim - 1, facets(domain, 0, 0.0))
    top = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    bcs = [fem.dirichletbc(np.array([0.0] * (dim - 1) + [-0.01]), top, V)]
    normal = np.eye(dim)[-1]
    motion = dict.fromkeys(("y", "rz") if dim == 2 else ("y", "z", "rx", "ry", "rz"), 0.0)
    motion["x"] = 0.1
    floor = RigidBody(HalfSpace(0 * normal, normal), about=0 * normal, motion=motion)
    surface = ContactSurface(u, facets(domain, dim - 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    name = "friction on 'rigid body'"
    free = ContactProblem(energy, u, [surface], bcs=bcs).solve()
    assert name not in free.warnings
    bcs.append(fem.dirichletbc(0.0, side, V.sub(0)))
    result = ContactProblem(energy, u, [surface], bcs=bcs).solve()
    table = result.tables["contact"]
    nodes = table.x[:, 0] < 1e-9
    slip = table.increment[nodes]
    friction = 0.3 * table.rn[nodes] * np.abs(slip[:, 0]) / np.linalg.norm(slip, axis=1)
    part = friction.sum() / np.linalg.norm(result.rigid_bodies["rigid body"].force)
    assert part > 0.05
    assert f"friction of {part:.2g} of its size" in result.warnings[name]


@pytest.mark.ranks(2)
def test_a_violated_law_gives_a_warning(log):
    """Newton's method may stop early."""
    result = _held_in_one_direction(petsc_options={"snes_rtol": 0.1})
    assert "snes_rtol" in result.warnings["law"]
    assert "violated by" in said(log, "the law of contact is violated")


@pytest.mark.parametrize("unit", [1.0, 1e9])
def test_a_contact_pressure_near_the_modulus_gives_a_warning(unit):
    given = {"law": Frictionless(), "young": 1000.0 * unit, "poisson": 0.0}
    results = [block(top=(0.0, -depth), **given).solve() for depth in (0.1, 0.5)]
    values = [r.indicators.surfaces["contact"].pressure for r in results]
    assert values[1] == pytest.approx(5 * values[0])
    assert 0.05 <= values[0] <= 0.1  # p/E is 0.1, and the modulus is one to two times E
    assert ["pressure of 'contact'" in r.warnings for r in results] == [False, True]
