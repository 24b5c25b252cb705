"""Half a model of bodies that slide over each other, beside the whole one."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS
from test_pair import displacement
from test_sliding_pair import errors_with_parts_held, smooth

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
    ParametricContact,
    SelfContact,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(*lame(1.0, 0.3))
SLAVE, MASTER = 1, 2


def bodies(dim, *, whole, overlap=0.0):
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
            x[:, up] += (x[:, up] + 1.0) * (overlap - 0.15 * (x[:, :up] ** 2).sum(axis=1))
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
    """Gaps, slips and tractions of the half are those of the whole, as are Newton's steps; also
    where the bodies start in each other, and what is opposite lies behind the plane.
    """
    dim = 2
    whole, steps = pressed(dim, whole=True, **start)
    part, same_steps = pressed(dim, whole=False, **start)
    x = part.x
    match = [int(np.argmin(np.linalg.norm(whole.x - place, axis=1))) for place in x]
    np.testing.assert_allclose(whole.x[match], x, atol=1e-12)
    assert (part.pressure > 1e-3).sum() >= dim
    assert np.abs(part.ut).max() > 1e-3
    for name in ("un", "ut", "pressure", "shear"):
        there, here = (np.nan_to_num(getattr(t, name)) for t in (whole, part))
        np.testing.assert_allclose(here, there[match], atol=1e-10, err_msg=name)
    assert same_steps == steps


@pytest.mark.parametrize("slave", [MASTER, 0])
def test_planes_may_be_anywhere(slave):
    """Half a model with its plane at x = 0.7 is that with its plane at x = 0."""
    given = dict(whole=False, interference=True, overlap=0.04, slave=slave)
    (there, _), (here, _) = (pressed(2, plane=x, **given) for x in (0.0, 0.7))
    np.testing.assert_allclose(here.x - [0.7, 0.0], there.x, atol=1e-12)
    for name in ("un", "ut", "pressure", "shear"):
        values = (np.nan_to_num(getattr(t, name)) for t in (here, there))
        np.testing.assert_allclose(*values, atol=1e-10, err_msg=name)


def paired(dim, overlap, *, whole, slave=SLAVE):
    """A displacement of the bodies, and a pair of them; with slave 0 one face of both."""
    body = bodies(dim, whole=whole, overlap=overlap)
    u = displacement(body.mesh)
    planes = {} if whole else dict.fromkeys(range(dim - 1), 0.0)
    given = dict(search_distance=0.5, law=Coulomb(0.3), symmetry=planes, interference=True)
    return u, touching(u, body, slave, **given)


def moved(x):
    """A displacement (dim, n) that is symmetric to both planes, at places of the mesh."""
    up = len(x) - 1
    values = 0.1 * x * (1.0 + x[up] + x[0] ** 2)
    values[up] = -0.3 * x[0] ** 2
    return values


def seen(dim, overlap, *, whole, slave=SLAVE):
    """At a symmetric displacement positions, normals and jumps of the slave's nodes (n, 3 dim), and
    positions and forces of all nodes (m, 2 dim) under symmetric tractions.
    """
    u, pair = paired(dim, overlap, whole=whole, slave=slave)
    pair = discretise(pair)
    u.interpolate(lambda x: moved(x[:dim]))
    n = pair.owned_nodes
    now = u.x.array.reshape(-1, dim)[:n]
    operator = pair.points.at(now, 0.3 * now)
    nodal = operator.facing.nodal
    x = pair.positions
    number = len(x)
    rows = np.hstack([x, nodal.normal[:number], nodal.jump[:number]])
    tractions = np.cos(x)
    tractions[:, :-1] = np.sin(x[:, :-1])
    forces = operator.transpose(tractions).reshape(-1, dim)
    forces = np.hstack([pair.node_positions[:n], forces])
    return [np.concatenate(COMM.allgather(values)) for values in (rows, forces)]


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    ("overlap", "slave"), [(-0.05, SLAVE), (0.1, SLAVE), (0.1, MASTER), (-0.05, 0), (0.1, 0)]
)
@pytest.mark.verifies(
    "sliding pairs",
    reference="itself: the whole model, of which it is a half or a quarter",
    aspects=("2D", "3D", "pairs", "large sliding"),
)
def test_part_sees_what_the_whole_sees(dim, overlap, slave):
    """Normals, gaps, slips and forces, apart and in each other; of one face too."""
    whole, all_forces = seen(dim, overlap, whole=True, slave=slave)
    part, forces = seen(dim, overlap, whole=False, slave=slave)
    assert len(part) == (1 if slave else 2) * 3 ** (dim - 1)
    for row in part:
        off = np.linalg.norm(whole[:, :dim] - row[:dim], axis=1)
        np.testing.assert_allclose(row, whole[np.argmin(off)], atol=1e-12)
    tilted = np.abs(part[:, dim]).max()
    slip = np.abs(part[:, 2 * dim]).max()
    assert min(tilted, slip) > 0.01
    for row in forces:
        off = np.linalg.norm(all_forces[:, :dim] - row[:dim], axis=1)
        other = all_forces[np.argmin(off), dim:]
        on = np.abs(row[: dim - 1]) < 1e-9  # planes, across which it is held
        along = np.append(~on, True)
        # Half of what comes from both sides.
        np.testing.assert_allclose(row[dim:][along], other[along] / 2 ** on.sum(), atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.verifies(
    "sliding pairs",
    reference="differences: of the residual",
    aspects=("2D", "3D", "pairs", "large sliding"),
)
def test_jacobian_with_images(dim, monkeypatch):
    """Of bodies that are in each other beside the planes, with the common parts held."""
    u, pair = paired(dim, 0.1, whole=False)
    V = u.function_space
    X = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local, :dim]
    bcs = []
    for axis in range(dim - 1):
        W = V.sub(axis)

        def here(x, axis=axis):
            return np.isclose(x[axis], 0.0)

        plane = mesh.locate_entities_boundary(V.mesh, dim - 1, here)
        dofs = fem.locate_dofs_topological(W, dim - 1, plane)
        bcs.append(fem.dirichletbc(fem.Constant(V.mesh, 0.0), dofs, W))
    problem = ContactProblem(RUBBER.energy(u) * ufl.dx, u, [pair], bcs=bcs)
    eq = problem.equations
    n = eq.owned_sizes[0]
    (pair,) = problem.surfaces
    waves = np.outer(pair.points.ids[:, 0], np.arange(1.0, 1.0 + dim))
    x = problem.create_vector()
    v = x.duplicate()
    place = moved(X.T).T + smooth(X, 3, 0.01)
    for f, field, tractions in ((x, place, 2e-3 * np.sin(waves)), (v, smooth(X, 8, 1.0), waves)):
        f.array[:n] = field.reshape(-1)
        f.array[:n][eq.fixed[:n]] = 0.0
        f.array[n:] = tractions.reshape(-1)
    v.array[n:] = 0.1 * np.cos(v.array[n:])
    state, errors = errors_with_parts_held(problem, pair, x, v, monkeypatch)
    assert errors[0] < 1e-5
    assert errors[1] < 0.02 * errors[0] + 1e-9
    facing = state.surfaces[0].kinematics.operator.facing
    assert COMM.allreduce(int((facing.mirrors < 0).any(axis=1).sum())) > 0


@pytest.mark.ranks(2)
@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs", "large sliding"))
def test_refused():
    """Planes that are none, do not end the face, have a master behind, or that nodes can leave."""
    body = bodies(2, whole=False)
    u = displacement(body.mesh)
    given = dict(law=Coulomb(0.3), slave=SLAVE, master=MASTER, sliding="large")
    for symmetry, words in (
        ({2: 0.0}, "an axis of symmetry must be one of 0, 1; got 2"),
        ([0], "planes by their axis"),
        ({0: 0.5}, r"x = 0.5 does not end the face: \d of its nodes lie on it, [1-9] below"),
        ({0: -1.0}, "0 of its nodes lie on it"),
    ):
        with pytest.raises(ValueError, match=words):
            discretise(ContactPair(u, body.facet_tags, symmetry=symmetry, **given))
    crossed = bodies(2, whole=MASTER)
    words = "both faces lie on one side of it; below are 0 nodes of the slave and 2 of the master"
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
def test_a_plane_that_moves(dim, itself):
    """A value across it that is changed after the problem is made, or by a step of a history."""
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


@pytest.mark.ranks(2)
@pytest.mark.parametrize("evolution", ["history", "motion"])
@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs", "large sliding"))
def test_a_plane_that_is_off_at_the_start(evolution):
    """Also where the displacement is what is prescribed, and the first step takes it back."""
    problem, moved, _ = led(2, "Constant", itself=False)
    n = problem.equations.owned_sizes[0]
    held = problem.equations.fixed[:n]

    def load(t):
        moved.value = 0.01 - t

    def start():
        if evolution == "motion":
            NSCD(problem, 1.0, dt=0.01, load=load).run([0.0, 0.01])
        else:
            QuasiStatic(problem, load).run([0.0, 0.01])

    moved.value = 0.01
    given = problem.equations.prescribed.values().reshape(-1)[:n]
    problem.u.x.array[:n][held] = given[held]
    problem.u.x.scatter_forward()
    before = problem.u.x.array.copy()
    with pytest.raises(ValueError, match=f"contact at the start: Dirichlet data {OFF}"):
        start()
    np.testing.assert_array_equal(problem.u.x.array, before)


@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs", "large sliding"))
def test_a_plane_that_a_branch_moves():
    """Values of a Function that the parameter drives are looked at before anything is followed."""
    problem, moved, gamma = led(2, "Function", itself=False)
    problem.solve()
    system = ParametricContact(problem, gamma, driven=[(moved, 0.01 * gamma)])
    x = system.create_vector()
    problem.write(x)
    with pytest.raises(ValueError, match=r"at gamma = 0.03125: .*off the plane of symmetry x = 0"):
        follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    np.testing.assert_array_equal(moved.x.array, 0.0)
    moved.x.array[:] = 0.01  # the parameter does not drive it, and it has changed since the solve
    with pytest.raises(ValueError, match=OFF):
        follow(ParametricContact(problem, gamma), x, 0.0, gamma_range=(-0.1, 0.1))


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


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "self contact", reference="closed form: an area", aspects=("2D", "large sliding")
)
@pytest.mark.parametrize("direction", [(0, 1), (1, 0), (0, -1)])
def test_walls_of_one_height(direction):
    """Facets as far along the direction as what they face meet it nevertheless, once."""
    body = side_by_side(([0.0, 0.0], [1.0, 1.0]), ([1.1, 0.0], [2.0, 1.0]), (1, 2))
    walls = mesh.locate_entities_boundary(
        body.mesh, 1, lambda x: np.isclose(x[0], 1.0) | np.isclose(x[0], 1.1)
    )
    u = displacement(body.mesh)
    face = discretise(
        SelfContact(u, walls, law=Coulomb(0.3), direction=direction, search_distance=0.3)
    )
    operator = face.points.at(np.zeros((face.owned_nodes, 2)), None)
    facing = COMM.allreduce(float(operator.areas.sum()))
    assert facing == pytest.approx(1.0)
