"""Bodies of revolution sliding over each other without friction."""

from mpi4py import MPI

import cases.press_fit
import numpy as np
import pytest
from support.blocks import CELLS
from support.mortars import hats, stacked
from support.pairs import displacement, energy_of_revolution, tagged

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Frictionless,
)
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, NeoHookean
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD
FIT = [(cases.press_fit.YOUNG[k], cases.press_fit.NU[k]) for k in ("hub", "ring")]
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


# -- patches ---------------------------------------------------------------------------------------

SHRINK = 0.95  # of all lengths
STIFF = 500.0  # mu of a material with nu = 0
PRESSURE = STIFF * (1 / SHRINK - SHRINK)


def shaft_and_tube(shaft, tube, cell, slope):
    """Return a shaft of radius 2 (with a hole, for a cone) in a tube of radius 2 to 3."""
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
def test_a_uniform_strain_of_sliding_rings_is_exact(shape, cell, slave):
    """Lengths shrink by a factor: exact between cones, and for a tube sliding along a shaft."""
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
def test_sliding_discs_of_revolution_are_exact():
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


# -- closed forms, other codes ---------------------------------------------------------------------


def fit(n, d):
    """The hub and ring of `cases.press_fit` in a section, the bore of the hub widened by d."""
    bodies = []
    tags = []
    for i, (name, k) in enumerate((("hub", n), ("ring", round(1.5 * n)))):
        a, b = cases.press_fit.RADII[name]
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
    energy = energy_of_revolution(u, both, *FIT)
    bcs = held(u.function_space, both.facet_tags, [(5, 1, 0.0), (6, 1, 0.0), (1, 0, d)])
    pair = ContactPair(u, both, slave=3, master=2, **LARGE)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def pressure_of_fit(d):
    """Lame: u = A r + B/r in both, s = E/((1 + nu)(1 - 2 nu)) (A - (1 - 2 nu) B/r^2)."""
    (a, c), (_, b) = cases.press_fit.RADII["hub"], cases.press_fit.RADII["ring"]
    rows = []
    for name in ("hub", "ring"):
        E, nu = cases.press_fit.YOUNG[name], cases.press_fit.NU[name]
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
def test_a_sliding_press_fit_has_lames_pressure():
    """A hub widening in a ring with other nodes: to the square of the mesh size."""
    d = 1e-4
    errors = []
    for n in (4, 8):
        table = fit(n, d).solve().tables["contact"]
        np.testing.assert_allclose(table.pressure, table.pressure.mean(), rtol=1e-3)
        errors.append(abs(table.pressure.mean() / pressure_of_fit(d) - 1))
    assert errors[1] < 3e-3
    assert errors[1] < 0.3 * errors[0]
