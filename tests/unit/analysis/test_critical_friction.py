"""Critical friction: known coefficients, an independent condensation, exact continua."""

from mpi4py import MPI

import cases.two_blocks
import numpy as np
import pytest
import scipy.linalg
from cases._triangle import linear_triangle
from cases.critical_friction import main as demo
from support.blocks import restore_statuses
from support.leaning_bodies import block, in_plane, leaning, on_box, stiffness_of_points

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Sphere,
)
from dolfinx_contact.analysis import critical_friction
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD

QUADRILATERAL = mesh.CellType.quadrilateral
LAME = {(1.0, 1.0): (2.0, 1.83333333, 1.78580249, 1.7666602)}
LAME[(100.0, 82.0)] = (1.9010989, 1.73663256, 1.68791278, 1.66953114)


def by_hand(problem, xi=None):
    """All coefficients by a dense condensation onto the contact nodes, on one rank."""
    dim = problem.V.mesh.geometry.dim
    S, _ = stiffness_of_points(problem)
    xi = np.eye(dim)[0] if xi is None else xi
    tangential = np.einsum("iajb,a,b->ij", S, xi, xi)
    normal = S[:, dim - 1, :, :] @ xi
    return scipy.linalg.eig(tangential, normal)


def one_signed(values, vectors):
    """The real coefficients of slips of one sign, the smallest first."""
    real = np.abs(values.imag) < 1e-9 * np.abs(values)
    signed = real & (np.abs(np.sign(vectors.real).sum(axis=0)) == len(vectors))
    expected = values[signed].real
    return expected[np.argsort(np.abs(expected))]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("lame", LAME)
@pytest.mark.verifies(
    "critical friction",
    reference="closed form: kt/k of one element, and known coefficients of finer meshes",
    aspects=("2D",),
)
def test_hilds_triangle_has_its_critical_friction(lame):
    for n, expected in zip((1, 2, 4, 8), LAME[lame], strict=True):
        problem = linear_triangle(n, 0.3, lame=lame).problem
        for dense in (True, False):
            found = critical_friction(problem, dense=dense)
            assert abs(found.friction - expected) < 1e-7
            assert found.complete is dense
            assert found.slips.max() == pytest.approx(1.0)
            assert len(found.slips) == n


def test_large_mesh_converges():
    """n = 128, approaching the limit of the sequence of meshes."""
    coarse, middle, fine = (
        critical_friction(linear_triangle(n, 0.3, lame=(100.0, 82.0)).problem).friction
        for n in (8, 32, 128)
    )
    assert coarse > middle > fine > middle - 0.3 * (coarse - middle)


@pytest.mark.parametrize("cell", [mesh.CellType.quadrilateral, mesh.CellType.triangle])
@pytest.mark.parametrize("offset", [1.0, -0.6])
@pytest.mark.verifies(
    "critical friction",
    reference="independent code: a dense condensation in numpy",
    aspects=("2D",),
)
def test_critical_friction_agrees_with_an_own_condensation(cell, offset):
    problem = leaning(5, offset=offset, cell=cell)
    values, vectors = by_hand(leaning(5, offset=offset, cell=cell, comm=MPI.COMM_SELF))
    found = critical_friction(problem)
    np.testing.assert_allclose(found.one_signed, one_signed(values, vectors), rtol=1e-9)
    every = np.sort_complex(np.array(found.one_signed + found.others).round(6))
    np.testing.assert_allclose(every, np.sort_complex(values.round(6)), atol=3e-6)


def test_critical_friction_falls_with_the_height_of_a_leaning_body(folder):
    """A leaning body: F goes to zero like 2 W/H; an upright one: it does not."""
    options = ["--shape=parallelogram", "--width=1", "--height=4", "--offset=1", "--n=4"]
    found = demo([*options, "--young=1", "--poisson=0.3", f"--output={folder}"])
    np.testing.assert_allclose(found["falls"], [1.319, 0.823, 0.468, 0.247], rtol=0.04)
    assert found["critical_friction"] == found["falls"][2] == found["levels"][-1]["critical"]
    upright = [critical_friction(leaning(4, height=h, offset=0.0)).friction for h in (1.0, 4.0)]
    np.testing.assert_allclose(upright, [1.95, 2.11], rtol=0.01)  # the positive one of a pair


def test_criterion_falls_on_finer_meshes_and_critical_friction_does_not(folder):
    """For alternating slips the criterion falls like h^(1/2); the critical friction does not."""
    levels = demo(["--n=32", f"--output={folder}"])["levels"]
    last = levels[-1]
    before = levels[-2]
    assert last["alternating"] / before["alternating"] == pytest.approx(0.5**0.5, abs=0.01)
    assert last["critical"] / before["critical"] > 0.995
    assert all(row["alternating"] <= row["one_way"] < row["critical"] for row in levels)


# -- 3D ----------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "critical friction", reference="itself: the body in plane strain", aspects=("3D",)
)
def test_slice_has_the_critical_friction_of_the_plane():
    """A slice in plane strain has the coefficients of the plane body; slip along y is held."""
    domain = mesh.create_box(COMM, [[0, 0, 0], [1, 0.3, 2]], [4, 1, 8], mesh.CellType.hexahedron)
    domain.geometry.x[:, 0] += 0.5 * domain.geometry.x[:, 2]
    problem = on_box(domain, sides=in_plane)
    plane = critical_friction(leaning(4))
    for dense in (True, False):
        found = critical_friction(problem, (1.0, 0.0, 0.0), dense=dense)
        assert found.friction == pytest.approx(plane.friction, rel=1e-9)
    np.testing.assert_allclose(found.slips.reshape(5, 2), plane.slips[:, None].repeat(2, axis=1))
    with pytest.raises(ValueError, match="no contact point can slip"):
        critical_friction(problem, (0.0, 1.0, 0.0))


@pytest.mark.verifies(
    "critical friction",
    reference="independent code: a dense condensation in numpy",
    aspects=("3D",),
)
def test_critical_friction_works_in_any_direction():
    problem = block(4)
    angle = 0.4
    xi = np.array([np.cos(angle), np.sin(angle), 0.0])
    expected = one_signed(*by_hand(block(4, comm=MPI.COMM_SELF), xi))
    found = critical_friction(problem, 3.0 * xi + [0.0, 0.0, 1.0])  # the tangential part counts
    np.testing.assert_allclose(found.one_signed, expected, rtol=1e-9)
    reverse = critical_friction(problem, -xi, dense=False).friction
    assert reverse == pytest.approx(-found.friction, rel=1e-9)


# -- of a solution, pairs, other discretisations, bad input --------------------------------------


@pytest.mark.ranks(2, 3)
def test_critical_friction_takes_the_directions_of_a_solution():
    """In full slip to the right the field is uniform, and F has the other sign."""
    problem = leaning(4)
    uniform = critical_friction(problem)
    restore_statuses(problem, 2)
    assert critical_friction(problem, "solution").friction == pytest.approx(uniform.friction)
    restore_statuses(problem, 3)
    assert critical_friction(problem, "solution").friction == pytest.approx(-uniform.friction)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "options", [["--lower", "1e9", "0.3"], ["--lower", "1e9", "0.3", "--ratio=2"]]
)
@pytest.mark.verifies(
    "critical friction",
    reference="itself: the body on a rigid floor",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_stiff_second_body_has_the_coefficients_of_a_rigid_one(options):
    """On a body that is very stiff, with matching faces or others, as on a rigid floor."""
    rigid, pair = (
        critical_friction(two_blocks(["--n=4", "--upper", "1.0", "0.3", *given]))
        for given in (["--rigid-floor"], options)
    )
    assert pair.friction == pytest.approx(rigid.friction, rel=1e-6)
    np.testing.assert_allclose(pair.slips, rigid.slips, atol=1e-5)


def two_blocks(options):
    return cases.two_blocks.problem(cases.two_blocks.arguments(options), COMM)[0]


# -- how far they are known, and what slips of both signs bring ------------------------------------


# -- large bodies ----------------------------------------------------------------------------------


def stiff_inside():
    """A block with a core a thousand times as stiff."""
    V = fem.functionspace(block(4).V.mesh, ("DG", 0))
    young = fem.Function(V)
    young.interpolate(lambda x: np.where((x[2] > 0.3) & (x[2] < 1.2), 1e3, 1.0))
    return on_box(V.mesh, material=LinearElastic.from_young(young, 0.3))


def on_a_curve():
    return on_box(leaning(6).V.mesh, floor=Sphere((0.4, -3.0), 3.0))


def unlike_pair():
    """Nodes of two faces that do not match."""
    upper, lower = ["--upper", "1.0", "0.3"], ["--lower", "50.0", "0.3"]
    return two_blocks(["--n=4", "--ratio=2", *upper, *lower])


def two_on_a_floor(left, right, lowest=-1.0):
    """Two bodies touching above a height, their nodes not opposite, with a floor below the left.

    With the first height slave and floor share a corner; the clamped end of the slave weakens the
    row of the node beside it.
    """
    grids = [
        create_grid(COMM, (np.linspace(i, i + 1, 5), np.linspace(0, 2, n + 1)), QUADRILATERAL)
        for i, n in enumerate((left, right))
    ]
    both = join(grids)
    domain = both.mesh
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    markers = (
        lambda x: np.isclose(x[0], 1.0) & (x[1] > lowest),
        lambda x: np.isclose(x[1], 0.0) & (x[0] < 1.0 + 1e-9),
        lambda x: np.isclose(x[1], 2.0),
    )
    face, floor, top = (mesh.locate_entities_boundary(domain, 1, marker) for marker in markers)
    to_cells = domain.topology.connectivity(1, 2)
    on_left = np.isin(to_cells.array[to_cells.offsets[face]], both.cell_tags.find(1))
    clamped = fem.locate_dofs_topological(u.function_space, 1, top)
    dx = ufl.Measure("dx", domain, subdomain_data=both.cell_tags)
    energy = sum(
        LinearElastic.from_young(E, 0.3).energy(u) * dx(i) for i, E in ((1, 1.0), (2, 3.0))
    )
    contact = [
        ContactSurface(
            u, floor, obstacle=HalfSpace((0, 0), (0, 1)), law=Coulomb(0.3), name="floor"
        ),
        ContactPair(u, face[on_left], master_facets=face[~on_left], law=Coulomb(0.3), name="pair"),
    ]
    bcs = [fem.dirichletbc(np.zeros(2), clamped, u.function_space)]
    return ContactProblem(energy, u, contact, bcs=bcs)


LARGE = {
    "plane": (lambda: leaning(8), None),
    "in space": (lambda: block(4), (1.0, 0.4, 0.0)),
    "stiff inside": (stiff_inside, (1.0, 0.0, 0.0)),
    "on a curve": (on_a_curve, None),
    "pair": (unlike_pair, None),
    "pair with a node on a floor": (lambda: two_on_a_floor(8, 4), None),
    "pair with a clamped end": (lambda: two_on_a_floor(4, 8, 0.3), None),
}


@pytest.mark.ranks(2)
@pytest.mark.parametrize("body", LARGE)
@pytest.mark.verifies(
    "critical friction",
    reference="itself: all eigenvalues, by a factorisation",
    aspects=("2D", "3D", "pairs", "multigrid"),
)
def test_critical_friction_by_multigrid_agrees(body):
    make, direction = LARGE[body]
    whole = critical_friction(make(), direction, dense=True, solver="direct")
    assert (whole.solver, whole.solves, whole.iterations) == ("direct", 0, 0)
    expected = np.abs([*whole.one_signed, *whole.others]).min()  # of a mirrored pair either
    for dense in (False, True):
        found = critical_friction(make(), direction, dense=dense, solver="amg")
        sizes = np.abs([*found.one_signed, *found.others])
        assert sizes.min() == pytest.approx(expected, rel=1e-8)
        assert found.friction == (whole.friction and pytest.approx(whole.friction, rel=1e-8))
        np.testing.assert_allclose(found.slips, whole.slips, atol=1e-7)
        assert (found.solver, found.complete) == ("amg", dense)
        assert 0 < found.solves < found.iterations
        assert found.residual < 1e-7
