"""Half a model of bodies sliding over each other, beside the whole one."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS
from support.pairs import displacement

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    SelfContact,
    Sphere,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(*lame(1.0, 0.3))
SLAVE, MASTER = 1, 2


def bodies(dim, *, whole, overlap=0.0, curvature=0.3):
    """A block with a curved top below a larger one, whole, or but for one on a side of planes."""
    parts = []
    up = dim - 1
    for width, cells, low, tag in ((1.0, 2, -1.0, SLAVE), (1.5, 2, 0.0, MASTER)):
        both_sides = whole is True or whole == tag
        start, number = (-width, 2 * cells) if both_sides else (0.0, cells)
        aside = [np.linspace(start, width, number + 1)] * up
        kind = "quad" if dim == 2 else "hex"
        body = create_grid(COMM, [*aside, np.linspace(low, low + 1.0, 3)], CELLS[kind])

        def here(x):
            return np.isclose(x[up], 0.0)

        facets = np.sort(mesh.locate_entities_boundary(body, up, here))
        tags = np.full(len(facets), tag, dtype=np.int32)
        if tag == SLAVE:
            x = body.geometry.x
            x[:, up] += (x[:, up] + 1.0) * (overlap - curvature / 2 * (x[:, :up] ** 2).sum(axis=1))
        parts.append((body, mesh.meshtags(body, up, facets, tags)))
    both, tags = zip(*parts, strict=True)
    return join(both, facet_tags=tags)


def touching(u, body, slave, **given):
    """A pair of both faces, or with slave 0 one face of both."""
    if not slave:
        facets = np.union1d(body.facet_tags.find(SLAVE), body.facet_tags.find(MASTER))
        return SelfContact(u, facets, **given)
    faces = dict(slave=slave, master=SLAVE + MASTER - slave, sliding="large")
    return ContactPair(u, body.facet_tags, **faces, **given)


def pressed(dim, *, whole, overlap=0.0, slave=SLAVE, plane=0.0, **start):
    """The table of the pair after two steps with friction, and the iterations of each."""
    body = bodies(dim, whole=whole, overlap=overlap)
    domain = body.mesh
    domain.geometry.x[:, : dim - 1] += plane
    u = displacement(domain)
    V = u.function_space
    planes = {} if whole else dict.fromkeys(range(dim - 1), plane)
    given = dict(law=Coulomb(0.3), search_distance=0.5, symmetry=planes, **start)
    pair = touching(u, body, slave, **given)
    down = fem.Constant(domain, [0.0] * dim)

    def held(value, V, axis, place):
        def here(x):
            return np.isclose(x[axis], place)

        facets = mesh.locate_entities_boundary(domain, dim - 1, here)
        return fem.dirichletbc(value, fem.locate_dofs_topological(V, dim - 1, facets), V)

    bcs = [held(down, V, dim - 1, 1.0), held(np.zeros(dim), V, dim - 1, -1.0)]
    for axis in planes:
        W = V.sub(axis)
        bcs.append(held(fem.Constant(domain, 0.0), W, axis, plane))
    problem = ContactProblem(RUBBER.energy(u) * ufl.dx, u, [pair], bcs=bcs)

    def load(t):
        down.value[dim - 1] = -t

    steps = QuasiStatic(problem, load).run([0.0, 0.1, 0.2]).steps
    last = steps[-1].result
    assert last.imbalance < 1e-9  # along planes, where all forces are those of the model
    return last.tables["contact"], [s.result.iterations for s in steps]


def assert_part_of(whole, part):
    """The points of a part have the values of the whole."""
    match = [int(np.argmin(np.linalg.norm(whole.x - place, axis=1))) for place in part.x]
    np.testing.assert_allclose(whole.x[match], part.x, atol=1e-12)
    for name in ("un", "ut", "pressure", "shear"):
        there, here = (np.nan_to_num(getattr(t, name)) for t in (whole, part))
        np.testing.assert_allclose(here, there[match], atol=1e-10, err_msg=name)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "start",
    [
        {},
        {"remove_overlap": 0.1, "overlap": 0.04},
        {"interference": True, "overlap": 0.04, "slave": MASTER},
        {"interference": True, "overlap": 0.04, "slave": 0},
    ],
)
@pytest.mark.verifies(
    "sliding pairs",
    reference="itself: the whole model, of which it is a half",
    aspects=("2D", "pairs", "large sliding"),
)
def test_half_is_the_whole(start):
    """Gaps, slips, tractions and Newton steps of the half agree with the whole body.

    This includes bodies that overlap at the start with opposing faces behind the plane.
    """
    dim = 2
    whole, steps = pressed(dim, whole=True, **start)
    part, same_steps = pressed(dim, whole=False, **start)
    assert (part.pressure > 1e-3).sum() >= dim
    assert np.abs(part.ut).max() > 1e-3
    assert_part_of(whole, part)
    assert same_steps == steps


def pressed_slightly(dim, surface, degree, *, whole, **algorithm):
    """The table of contact in small sliding, the lower body pressed upwards."""
    body = bodies(dim, whole=whole, curvature=0.0)
    domain = body.mesh
    u = displacement(domain, degree)
    V = u.function_space
    up = np.zeros(dim)
    up[-1] = 1.0
    contact = surface(u, body, up)

    def on(space, axis, place):
        here = mesh.locate_entities_boundary(domain, dim - 1, lambda x: np.isclose(x[axis], place))
        return fem.locate_dofs_topological(space, dim - 1, here)

    ends = (1.0, 0.0), (-1.0, 0.1)
    bcs = [fem.dirichletbc(push * up, on(V, dim - 1, end), V) for end, push in ends]
    for axis in range(0 if whole else dim - 1):
        W = V.sub(axis)
        bcs.append(fem.dirichletbc(0.0, on(W, axis, 0.0), W))
    energy = LinearElastic.from_young(1.0, 0.4).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [contact], bcs=bcs, r=2.0)
    return problem.solve(**algorithm).tables["contact"]


def pair(method, slave=SLAVE):
    def surface(u, body, up):
        faces = dict(slave=slave, master=SLAVE + MASTER - slave)
        return ContactPair(u, body.facet_tags, **faces, law=Coulomb(0.3), method=method)

    return surface


def on_a_disc(method):
    def surface(u, body, up):
        disc = Sphere(5.0 * up, 5.0)
        given = dict(obstacle=disc, law=Coulomb(0.3), sliding="small", method=method)
        return ContactSurface(u, body.facet_tags, tag=SLAVE, **given)

    return surface


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    ("surface", "degree"),
    [
        (pair("nodal"), 1),
        (pair("mixed"), 1),
        (pair("integral"), 1),
        (pair("mixed"), 2),
        (pair("nodal", MASTER), 1),
        (pair("mixed", MASTER), 1),
        (pair("mixed", MASTER), 2),
        (on_a_disc("mixed"), 1),
        (on_a_disc("mixed"), 2),
        (on_a_disc("integral"), 2),
    ],
)
def test_half_is_the_whole_in_small_sliding(dim, surface, degree):
    """Multipliers at the plane have no component across it, nor have jumps there."""
    both = (pressed_slightly(dim, surface, degree, whole=whole) for whole in (True, False))
    whole, part = both
    assert (part.pressure > 1e-3).sum() >= dim
    assert np.abs(part.shear).max() > 1e-3
    assert_part_of(whole, part)


@pytest.mark.ranks(2)
def test_half_of_a_mortar_is_condensed_exactly():
    """The algorithms of the condensed problem find the same solution as Newton's method."""
    half = dict(dim=2, surface=pair("nodal"), degree=1, whole=False)
    assert_part_of(pressed_slightly(**half), pressed_slightly(**half, algorithm="lemke"))


@pytest.mark.parametrize("slave", [MASTER, 0])
def test_planes_may_be_anywhere(slave):
    """Half a model with its plane at x = 0.7 is that with its plane at x = 0."""
    given = dict(whole=False, interference=True, overlap=0.04, slave=slave)
    (there, _), (here, _) = (pressed(2, plane=x, **given) for x in (0.0, 0.7))
    np.testing.assert_allclose(here.x - [0.7, 0.0], there.x, atol=1e-12)
    for name in ("un", "ut", "pressure", "shear"):
        values = (np.nan_to_num(getattr(t, name)) for t in (here, there))
        np.testing.assert_allclose(*values, atol=1e-10, err_msg=name)


def moved(x):
    """A displacement (dim, n) that is symmetric to both planes, at places of the mesh."""
    up = len(x) - 1
    values = 0.1 * x * (1.0 + x[up] + x[0] ** 2)
    values[up] = -0.3 * x[0] ** 2
    return values


@pytest.mark.ranks(2)
@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs", "large sliding"))
def test_planes_that_do_not_bound_a_half_are_refused():
    """Planes not bounding the face, having a master behind them, or not fixing their nodes."""
    body = bodies(2, whole=False)
    u = displacement(body.mesh)
    given = dict(law=Coulomb(0.3), slave=SLAVE, master=MASTER, sliding="large")
    for symmetry, words in (
        ({2: 0.0}, "an axis of symmetry must be one of 0, 1; got 2"),
        ([0], "planes by their axis"),
        ({0: 0.5}, r"must end at the symmetry plane x = 0.5: \d nodes lie on it, [1-9] below"),
        ({0: -1.0}, "0 nodes lie on it"),
    ):
        with pytest.raises(ValueError, match=words):
            discretise(ContactPair(u, body.facet_tags, symmetry=symmetry, **given))
    crossed = bodies(2, whole=MASTER)
    words = "0 below and . above. Both faces lie on one side .* 2 of its nodes are below"
    with pytest.raises(ValueError, match=words):
        discretise(
            ContactPair(displacement(crossed.mesh), crossed.facet_tags, symmetry={0: 0.0}, **given)
        )
    bottom = mesh.locate_entities_boundary(body.mesh, 1, lambda x: np.isclose(x[1], -1.0))
    with pytest.raises(ValueError, match="lies in a plane of symmetry instead of ending there"):
        discretise(SelfContact(u, bottom, law=Coulomb(0.3), symmetry={1: -1.0}, direction=(1, 0)))
    with pytest.raises(ValueError, match=r"\[0.0, 1.0\] has a component along y"):
        discretise(SelfContact(u, bottom, law=Coulomb(0.3), symmetry={1: -1.0}))
    small = given | {"sliding": "small", "symmetry": {0: 0.0}}
    with pytest.raises(ValueError, match="only sliding='large' supports symmetry"):
        discretise(ContactPair(u, body.facet_tags, **small))
    top = body.facet_tags.find(SLAVE)
    for number, surface in (
        (2, ContactPair(u, body.facet_tags, symmetry={0: 0.0}, **given)),  # one of each face
        (1, SelfContact(u, top, law=Coulomb(0.3), symmetry={0: 0.0})),
    ):
        with pytest.raises(ValueError, match=f"let {number} nodes leave the plane of symmetry"):
            ContactProblem(RUBBER.energy(u) * ufl.dx, u, [surface])


def led(dim, value, *, itself):
    """A problem of the half between its held ends, with a value of the plane across it."""
    body = bodies(dim, whole=False)
    domain = body.mesh
    u = displacement(domain)
    V = u.function_space
    given = dict(law=Coulomb(0.3), search_distance=0.2, symmetry={0: 0.0})
    surface = touching(u, body, 0 if itself else SLAVE, **given)

    def on(spaces, axis, place):
        here = mesh.locate_entities_boundary(
            domain, dim - 1, lambda x: np.isclose(np.abs(x[axis]), place)
        )
        return fem.locate_dofs_topological(spaces, dim - 1, here)

    W = V.sub(0)
    moved = fem.Constant(domain, 0.0) if value == "Constant" else fem.Function(W.collapse()[0])
    spaces = W if value == "Constant" else (W, moved.function_space)
    bcs = [fem.dirichletbc(np.zeros(dim), on(V, dim - 1, 1.0), V)]
    bcs.append(fem.dirichletbc(moved, on(spaces, 0, 0.0), W))
    gamma = fem.Constant(domain, 0.0)
    energy = RUBBER.energy(u) * ufl.dx + gamma * u[dim - 1] * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=bcs), moved, gamma


OFF = "move nodes by 0.01 off the plane of symmetry x = 0"


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("dim", "itself"), [(2, False), (2, True), (3, False)])
@pytest.mark.refuses("sliding pairs", aspects=("2D", "3D", "pairs", "large sliding"))
def test_displacements_across_a_plane_of_symmetry_are_refused(dim, itself):
    """A displacement across it changing after construction, or in a step of a history."""
    problem, moved, _ = led(dim, "Constant", itself=itself)
    moved.value = 1e-12  # round-off
    problem.solve()
    before = problem.u.x.array.copy()
    moved.value = -0.01
    with pytest.raises(ValueError, match=OFF):
        problem.solve()
    np.testing.assert_array_equal(problem.u.x.array, before)

    def load(t):
        moved.value = 0.01 * max(t - 1.0, 0.0)

    with pytest.raises(ValueError, match=OFF):
        QuasiStatic(problem, load).run([0.0, 1.0, 2.0])


def side_by_side(first, second, names):
    """Two blocks by their corners, all facets of each marked by a name."""
    parts = []
    for (low, high), tag in zip((first, second), names, strict=True):
        ends = [np.linspace(a, b, 3) for a, b in zip(low, high, strict=True)]
        body = create_grid(COMM, ends, CELLS["quad"])
        facets = mesh.locate_entities_boundary(body, 1, lambda x: x[0] < np.inf)
        tags = np.full(len(facets), tag, dtype=np.int32)
        parts.append((body, mesh.meshtags(body, 1, facets, tags)))
    both, tags = zip(*parts, strict=True)
    return join(both, facet_tags=tags)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "sliding pairs", reference="closed form: a way", aspects=("2D", "pairs", "large sliding")
)
def test_what_crosses_a_plane_gives_a_warning():
    """A master that is led through the plane is in its own image, which shows nowhere else."""
    corners = ([0.0, -1.0], [1.0, 0.0]), ([0.3, 0.01], [0.8, 0.5])
    body = side_by_side(*corners, (SLAVE, MASTER))
    domain = body.mesh
    u = displacement(domain)
    V = u.function_space
    top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    given = dict(law=Frictionless(), symmetry={0: 0.0}, search_distance=0.3, sliding="large")
    pair = ContactPair(u, top, master_facets=body.facet_tags.find(MASTER), **given)
    way = fem.Constant(domain, (0.0, 0.0))
    held = [np.unique(V.dofmap.list[body.cell_tags.find(tag)]) for tag in (1, 2)]
    bcs = [
        fem.dirichletbc(np.zeros(2), held[0].astype(np.int32), V),
        fem.dirichletbc(way, held[1].astype(np.int32), V),
    ]
    problem = ContactProblem(RUBBER.energy(u) * ufl.dx, u, [pair], bcs=bcs)
    for left, depth in ((-0.29, 0.0), (-0.5, 0.2)):
        way.value = left, 0.0
        result = problem.solve()
        found = result.indicators.surfaces["contact"]
        assert found.behind_plane == pytest.approx(depth / found.facet, abs=1e-9)
        assert ("behind_plane of 'contact'" in result.warnings) == (depth > 0.0)
