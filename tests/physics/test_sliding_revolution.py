"""Bodies of revolution that slide over each other without friction."""

from mpi4py import MPI

import demo_press_fit
import numpy as np
import pytest
from support.blocks import CELLS
from test_mortar import hats, stacked
from test_pair import displacement, tagged
from test_sliding_pair import errors_with_parts_held, of_upper, smooth

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, LinearElastic, NeoHookean, lame
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(*lame(1000.0, 0.3))
LARGE = {"law": Frictionless(), "sliding": "large", "axisymmetric": True}
EXACT = {"snes_rtol": 1e-12}


def energy_of(material, u):
    # One quadrature for all derivatives, which are those of each other then.
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    return Axisymmetric(material).energy(u) * dx


def held(V, tags, values):
    """Conditions on facets with a tag, each a component and its value."""
    bcs = []
    for tag, axis, value in values:
        W = V.sub(axis)
        bcs.append(fem.dirichletbc(value, fem.locate_dofs_topological(W, 1, tags.find(tag)), W))
    return bcs


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.parametrize("cell", ["tri", "quad"])
@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    reference="differences: of the residual",
    aspects=("2D", "pairs", "large sliding"),
)
def test_jacobian(cell, slave, monkeypatch):
    """Of two discs that lean and slide outwards, up to the axis, with the common parts held."""
    both = stacked(5, 7, (0.0, 1.2), (0.0, 1.0), cell)
    u = displacement(both.mesh)
    V = u.function_space
    pair = ContactPair(u, both, slave=slave, master=5 - slave, interference=True, **LARGE)
    bcs = held(V, both.facet_tags, [(1, 0, 0.0), (1, 1, 0.0), (4, 1, 0.0)])
    problem = ContactProblem(energy_of(RUBBER, u), u, [pair], bcs=bcs)
    (pair,) = problem.surfaces
    eq = problem.equations
    n = eq.owned_sizes[0]
    X = V.tabulate_dof_coordinates()[: n // 2, :2]
    moved = smooth(X, 3, 0.05)
    upper = of_upper(both, V)
    r = X[upper, 0]
    moved[upper] += np.stack([0.1 * r, -0.04 + 0.25 * r - 0.2 * r**2], axis=1)
    ids = pair.points.ids[:, 0]
    waves = np.outer(ids, [1.0, 2.0])
    x = problem.create_vector()
    v = x.duplicate()
    for f, field, tractions in ((x, moved, 2e-3 * np.sin(waves)), (v, smooth(X, 8, 1.0), waves)):
        f.array[:n] = field.reshape(-1)
        f.array[:n][eq.fixed[:n]] = 0.0
        f.array[n:] = tractions.reshape(-1)
    v.array[n:] = 0.1 * np.cos(v.array[n:])
    state, errors = errors_with_parts_held(problem, pair, x, v, monkeypatch)
    assert errors[0] < 1e-5
    assert errors[1] < 0.02 * errors[0] + 1e-9
    used = np.unique(np.concatenate(COMM.allgather(state.statuses[0])))
    assert len(used) > 1
    # On the axis the normal is axial, and the sum of the areas is that of the smaller disc: what is
    # opposite to a face that leans and is in the other lies beyond the axis.
    nodal = state.surfaces[0].kinematics.operator.facing.nodal
    on_axis = np.abs(X[:, 0]) < 1e-12
    mine = on_axis[pair.points.vertex_trace_dofs[: pair.points.number]]
    assert COMM.allreduce(int(mine.sum())) == 1
    assert np.abs(nodal.normal[: len(mine)][mine, 0]).max(initial=0.0) == 0.0
    if slave == 3:
        area = COMM.allreduce(float(nodal.weight[: len(mine)].sum()))
        assert area == pytest.approx(np.pi, rel=1e-12)


# -- patches ---------------------------------------------------------------------------------------

SHRINK = 0.95  # of all lengths
STIFF = 500.0  # mu of a material with nu = 0
PRESSURE = STIFF * (1 / SHRINK - SHRINK)


def shaft_and_tube(shaft, tube, cell, slope):
    """Of the radii 0 (or 1, of a cone) to 2 and 2 to 3, with the given nodes along the axis."""
    inner = 1.0 if slope else 0.0
    bodies = []
    tags = []
    for i, (r, z) in enumerate(((np.linspace(inner, 2, 4), shaft), (np.linspace(2, 3, 3), tube))):
        body = create_grid(COMM, [r, z], CELLS[cell])
        planes = {f"t{i + 1}": (1, z[0]), f"t{i + 3}": (1, z[-1])}
        planes |= {f"t{2 * i + 5}": (0, r[0]), f"t{2 * i + 6}": (0, r[-1])}
        tags.append(tagged(body, **planes))
        bodies.append(body)
    both = join(bodies, facet_tags=tags)
    both.mesh.geometry.x[:, 0] += slope * both.mesh.geometry.x[:, 1]
    return both


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(("cell", "slave"), [("tri", 6), ("quad", 7)])
@pytest.mark.parametrize("shape", ["cone", "slid"])
@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    reference="closed form: the same pressure everywhere",
    aspects=("2D", "pairs", "large sliding"),
)
def test_patch(shape, cell, slave):
    """Lengths shrink by a part: exact between cones, and of a tube that has slid along a shaft."""
    slope = 0.3 if shape == "cone" else 0.0
    way = 0.37 * 0.25 if shape == "slid" else 0.0
    z = np.linspace(0, 2, 9)
    above = np.linspace(*((0.5, 1.5) if way else (0.0, 2.0)), 6)
    both = shaft_and_tube(z, above, cell, slope)
    u = displacement(both.mesh)
    V = u.function_space
    pair = ContactPair(u, both, slave=slave, master=13 - slave, **LARGE)
    X = V.tabulate_dof_coordinates()[:, :2]
    tube = np.unique(V.dofmap.list[both.cell_tags.find(2)])
    exact = fem.Function(V)
    moved = exact.x.array.reshape(-1, 2)
    moved[:] = (SHRINK - 1) * X
    moved[tube, 1] += way
    exact.x.scatter_forward()
    ends = [(tag, 1, (SHRINK - 1) * z[end]) for tag, end in ((1, 0), (3, -1))]
    ends += [(tag, 1, (SHRINK - 1) * above[end] + way) for tag, end in ((2, 0), (4, -1))]
    bcs = held(V, both.facet_tags, ends)
    for tag in (8, 5) if slope else (8,):
        dofs = fem.locate_dofs_topological(V, 1, both.facet_tags.find(tag))
        bcs.append(fem.dirichletbc(exact, dofs))
    load = fem.Function(V)
    if way:  # on what the tube leaves free
        low, high = above[[0, -1]] + way / SHRINK
        share = (hats(z, 0.0, low) + hats(z, high, 2.0)) / hats(z, 0.0, 2.0)
        face = fem.locate_dofs_topological(V, 1, both.facet_tags.find(6))
        load.x.array.reshape(-1, 2)[face, 0] = (
            -PRESSURE * share[np.rint(4 * X[face, 1]).astype(int)]
        )
    at_vertices = {"quadrature_rule": "vertex", "quadrature_degree": 1}
    ds = ufl.Measure("ds", both.mesh, subdomain_data=both.facet_tags)(6, metadata=at_vertices)
    energy = energy_of(NeoHookean(0.0, STIFF), u)
    energy -= ufl.dot(load, u) * ds
    u.x.array.reshape(-1, 2)[tube, 1] = way
    u.x.scatter_forward()
    result = ContactProblem(energy, u, [pair], bcs=bcs, petsc_options=EXACT).solve()
    off = np.abs(u.x.array - exact.x.array).max(initial=0.0)
    assert COMM.allreduce(off, max) < 1e-10
    table = result.tables["contact"]
    touching = ~np.isnan(table.un)
    force = table.area * (table.pressure - PRESSURE)
    area = 2 * np.pi * 2.0 if way else np.pi * (2 + 2 + 2 * slope) * np.hypot(2, 2 * slope)
    assert np.abs(force[touching]).max() < 1e-9 * PRESSURE
    assert table.rn.sum() == pytest.approx(PRESSURE * area, rel=1e-9)
    assert result.pairs["contact"].imbalance < 1e-12
    assert result.pairs["contact"].moment is None


@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    reference="closed form: uniform pressure between discs",
    aspects=("2D", "pairs", "large sliding"),
)
def test_discs():
    """Exact up to the axis."""
    both = stacked(5, 7, (0.0, 1.0), (0.0, 1.0), "tri")
    u = displacement(both.mesh)
    pair = ContactPair(u, both, slave=3, master=2, **LARGE)
    ends = [(1, 1, 0.0), (4, 1, 2 * (SHRINK - 1))]
    bcs = held(u.function_space, both.facet_tags, ends)
    energy = energy_of(NeoHookean(0.0, STIFF), u)
    table = (
        ContactProblem(energy, u, [pair], bcs=bcs, petsc_options=EXACT).solve().tables["contact"]
    )
    np.testing.assert_allclose(table.pressure, PRESSURE, rtol=1e-9)
    assert table.rn.sum() == pytest.approx(np.pi * PRESSURE, rel=1e-10)
    z = u.function_space.tabulate_dof_coordinates()[:, 1]
    exact = np.stack([np.zeros(len(z)), (SHRINK - 1) * (z + 1)], axis=1)
    assert np.abs(u.x.array - exact.reshape(-1)).max() < 1e-10


@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    "quasi-static",
    reference="closed form: uniform pressure between discs, at every time",
    aspects=("2D", "pairs", "large sliding"),
)
def test_two_pairs_in_a_history():
    """Three discs with other nodes each, pressed step by step: exact in both pairs at every time,
    and the work of the load is stored.
    """
    bodies = []
    tags = []
    for i, n in enumerate((5, 7, 4)):
        z = i + np.linspace(0.0, 1.0, 3)
        bodies.append(create_grid(COMM, [np.linspace(0.0, 1.0, n), z], CELLS["quad"]))
        tags.append(tagged(bodies[-1], **{f"t{2 * i + 1}": (1, z[0]), f"t{2 * i + 2}": (1, z[-1])}))
    both = join(bodies, facet_tags=tags)
    u = displacement(both.mesh)
    V = u.function_space
    pairs = [
        ContactPair(u, both, slave=3, master=2, name="lower", **LARGE),
        ContactPair(u, both, slave=4, master=5, name="upper", **LARGE),
    ]
    down = fem.Constant(both.mesh, 0.0)
    bcs = held(V, both.facet_tags, [(1, 1, 0.0), (6, 1, down)])
    energy = energy_of(NeoHookean(0.0, STIFF), u)
    problem = ContactProblem(energy, u, pairs, bcs=bcs, petsc_options=EXACT)

    def load(t):
        down.value = 3 * (SHRINK - 1) * t

    history = QuasiStatic(problem, load).run([0.0, 0.4, 0.7, 1.0])
    for step in history.steps:
        length = 1 + (SHRINK - 1) * step.time
        pressure = STIFF * (1 / length - length)
        for name in ("lower", "upper"):
            table = step.result.tables[name]
            np.testing.assert_allclose(table.pressure, pressure, rtol=1e-8)
            assert table.rn.sum() == pytest.approx(np.pi * pressure, rel=1e-8)
    assert len(history.steps) == 3
    # W = mu/2 (s^2 - 1 - 2 ln s) of a bar with nu = 0, of the volume 3 pi.
    stored = 3 * np.pi * STIFF / 2 * (SHRINK**2 - 1 - 2 * np.log(SHRINK))
    assert history.energies.stored == pytest.approx(stored, rel=1e-8)
    assert history.energies.dissipated == pytest.approx(0.0, abs=1e-10 * stored)


# -- closed forms, other codes ---------------------------------------------------------------------


def fit(n, d):
    """The hub and ring of `demo_press_fit.py` in a section, the bore of the hub widened by d."""
    bodies = []
    tags = []
    for i, (name, k) in enumerate((("hub", n), ("ring", round(1.5 * n)))):
        a, b = demo_press_fit.RADII[name]
        body = mesh.create_rectangle(COMM, [(a, 0), (b, 10)], [k, k], CELLS["quad"])
        tags.append(
            tagged(
                body,
                **{f"t{2 * i + 1}": (0, a), f"t{2 * i + 2}": (0, b)},
                t5=(1, 0.0),
                t6=(1, 10.0),
            )
        )
        bodies.append(body)
    both = join(bodies, facet_tags=tags)
    u = displacement(both.mesh)
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    energy = 0
    for k, name in ((1, "hub"), (2, "ring")):
        elastic = LinearElastic.from_young(demo_press_fit.YOUNG[name], demo_press_fit.NU[name])
        energy += Axisymmetric(elastic).energy(u) * dx(k)
    bcs = held(u.function_space, both.facet_tags, [(5, 1, 0.0), (6, 1, 0.0), (1, 0, d)])
    pair = ContactPair(u, both, slave=3, master=2, **LARGE)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def pressure_of_fit(d):
    """Lame: u = A r + B/r in both, s = E/((1 + nu)(1 - 2 nu)) (A - (1 - 2 nu) B/r^2)."""
    (a, c), (_, b) = demo_press_fit.RADII["hub"], demo_press_fit.RADII["ring"]
    rows = []
    for name in ("hub", "ring"):
        E, nu = demo_press_fit.YOUNG[name], demo_press_fit.NU[name]
        k = E / ((1 + nu) * (1 - 2 * nu))
        rows.append(lambda r, k=k, nu=nu: np.array([k, -k * (1 - 2 * nu) / r**2]))
    hub, ring = rows
    none = np.zeros(2)
    u = np.array([c, 1 / c])
    matrix = [[a, 1 / a, *none], [*u, *-u], [*hub(c), *-ring(c)], [*none, *ring(b)]]
    found = np.linalg.solve(matrix, [d, 0.0, 0.0, 0.0])
    return -hub(c) @ found[:2]


@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    reference="closed form: Lame's pressure between two cylinders",
    aspects=("2D", "pairs", "large sliding"),
)
def test_lame():
    """A hub that widens in a ring with other nodes: to the square of the mesh size."""
    d = 1e-4
    errors = []
    for n in (4, 8):
        table = fit(n, d).solve().tables["contact"]
        np.testing.assert_allclose(table.pressure, table.pressure.mean(), rtol=1e-3)
        errors.append(abs(table.pressure.mean() / pressure_of_fit(d) - 1))
    assert errors[1] < 3e-3
    assert errors[1] < 0.3 * errors[0]


def seal(n, comm=COMM, *, obstacle=None, wide=0.7, press=0.25):
    """A ring with a round face, pressed on a plate and widened: its upper face is led."""
    bodies = [
        create_grid(comm, [np.linspace(4, 6, 2 * n + 1), np.linspace(0, 1, n + 1)], CELLS["quad"])
    ]
    tags = [tagged(bodies[0], t3=(1, 0.0), t4=(1, 1.0))]
    if obstacle is None:
        r = np.linspace(3.5, 7.5, 3 * n)
        bodies.insert(0, create_grid(comm, [r, [-0.2, 0.0]], CELLS["quad"]))
        tags.insert(0, tagged(bodies[0], t1=(1, -0.2), t2=(1, 0.0)))
    both = join(bodies, facet_tags=tags)
    x = both.mesh.geometry.x
    ring = x[:, 1] > 1e-9
    on_face = np.unique(mesh.entities_to_geometry(both.mesh, 1, both.facet_tags.find(3)))
    ring[on_face] = True
    x[:, 1] += np.where(ring, 0.2 * (x[:, 0] - 5) ** 2 * (1 - x[:, 1]), 0.0)
    u = displacement(both.mesh)
    V = u.function_space
    energy = energy_of(RUBBER, u)
    way = [fem.Constant(both.mesh, 0.0) for _ in range(2)]
    upper = [(4, axis, value) for axis, value in enumerate(way)]
    if obstacle is None:
        face = ContactPair(u, both, slave=3, master=2, search_distance=0.3, **LARGE)
        upper += [(tag, axis, 0.0) for tag in (1, 2) for axis in (0, 1)]
    else:
        given = {"law": Frictionless(), "method": "mixed", "axisymmetric": True}
        face = ContactSurface(u, both, tag=3, obstacle=obstacle, **given)
    bcs = held(V, both.facet_tags, upper)
    problem = ContactProblem(energy, u, [face], bcs=bcs, petsc_options={"snes_rtol": 1e-11})
    for part in np.linspace(0, 1, 6)[1:]:
        way[1].value = -press * min(2 * part, 1.0)
        way[0].value = wide * part
        result = problem.solve()
    return result


@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    reference="itself: a plane obstacle, and one rank",
    aspects=("2D", "pairs", "large sliding"),
)
def test_seal():
    """Over several facets of a plate that is held: the axial force on the plane that it is."""
    plane = HalfSpace((0.0, 0.0), (0.0, 1.0))
    errors = []
    for n in (4, 8):
        result = seal(n)
        pair = result.pairs["contact"]
        assert pair.imbalance < 1e-12
        wanted = seal(n, obstacle=plane).resultants["contact"]
        errors.append(abs(pair.slave[1] / wanted[1] - 1))
        assert wanted[1] > 0
    assert errors[1] < 1e-4
    assert errors[1] < 0.3 * errors[0]
    alone = seal(4, MPI.COMM_SELF)
    together = seal(4)
    a, b = (r.tables["contact"].pressure for r in (alone, together))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-8 * np.max(b))


@pytest.mark.refuses("sliding pairs", "bodies of revolution", aspects=("2D", "pairs"))
def test_friction_is_refused():
    both = stacked(4, 4, (0.0, 1.0), (0.0, 1.0))
    u = displacement(both.mesh)
    given = {"slave": 3, "master": 2} | LARGE | {"law": Coulomb(0.3)}
    with pytest.raises(ValueError, match="take Frictionless"):
        discretise(ContactPair(u, both, **given))


def widened_ring(around, slave):
    """Axial forces on a ring that is pressed on a wider one, and widened on it, without friction.

    Args:
        around: cells of a quarter of a circle, which ends at two planes of symmetry; 0 for half a
            section.
        slave: 2 for the upper ring, or 3.
    """
    dim = 3 if around else 2
    rings = []
    for r, z, low, high in (
        (np.linspace(1.0, 2.0, 3), [0.0, 0.6], 2, 4),
        (np.linspace(0.7, 2.6, 5), [-0.6, 0.0], 1, 3),
    ):
        ends = [r, *[np.linspace(0.0, 0.5 * np.pi, around + 1)] * (dim - 2), z]
        ring = create_grid(COMM, ends, CELLS["hex" if around else "quad"])
        faces = {f"t{low}": (dim - 1, z[0]), f"t{high}": (dim - 1, z[1])}
        tags = tagged(ring, **faces)
        x = ring.geometry.x
        if low == 2:  # a curved sole
            x[:, dim - 1] += 0.1 * (x[:, 0] - 1.4) ** 2 * (1.0 - x[:, dim - 1] / 0.6)
        if around:
            radius, angle = x[:, :2].T.copy()
            x[:, 0] = radius * np.cos(angle)
            x[:, 1] = radius * np.sin(angle)
        rings.append((ring, tags))
    bodies, tags = zip(*rings, strict=True)
    both = join(bodies, facet_tags=tags)
    u = displacement(both.mesh)
    V = u.function_space
    kind = {"symmetry": {0: 0.0, 1: 0.0}} if around else {"axisymmetric": True}
    given = dict(law=Frictionless(), sliding="large", search_distance=0.3)
    pair = ContactPair(u, both, slave=slave, master=5 - slave, **kind, **given)
    move = fem.Function(V)
    top = fem.locate_dofs_topological(V, dim - 1, both.facet_tags.find(4))
    below = fem.locate_dofs_topological(V, dim - 1, both.facet_tags.find(1))
    bcs = [fem.dirichletbc(move, top), fem.dirichletbc(np.zeros(dim), below, V)]
    for axis in range(dim - 1 if around else 0):
        W = V.sub(axis)
        plane = mesh.locate_entities_boundary(V.mesh, 2, lambda x, i=axis: np.isclose(x[i], 0.0))
        dofs = fem.locate_dofs_topological(W, 2, plane)
        bcs.append(fem.dirichletbc(fem.Constant(V.mesh, 0.0), dofs, W))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    energy = RUBBER.energy(u) * dx if around else energy_of(RUBBER, u)
    problem = ContactProblem(energy, u, [pair], bcs=bcs)

    def load(t):
        def moved(x):
            out = x[: dim - 1] / np.linalg.norm(x[: dim - 1], axis=0)
            return np.vstack([0.2 * max(t - 1.0, 0.0) * out, np.full(x.shape[1], -0.1 * min(t, 1))])

        move.interpolate(moved)

    steps = QuasiStatic(problem, load).run([0.0, 1.0, 2.0]).steps
    parts = 4 if around else 1
    return parts * np.array([abs(s.result.pairs["contact"].slave[-1]) for s in steps])


@pytest.mark.long
@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.verifies(
    "sliding pairs",
    "bodies of revolution",
    reference="itself: a quarter of the body in space; order of convergence",
    aspects=("2D", "pairs", "large sliding"),
)
def test_a_seal_in_space(slave):
    """The chords of a quarter between two planes of symmetry make an error of the second order."""
    wanted = widened_ring(0, slave)
    coarse, fine = (np.abs(widened_ring(around, slave) / wanted - 1.0) for around in (3, 6))
    assert (coarse < 0.06).all()
    np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.15)
