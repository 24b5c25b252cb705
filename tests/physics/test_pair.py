"""Contact between bodies with matching faces."""

import json
from functools import partial
from inspect import signature
from pathlib import Path

from mpi4py import MPI

import cases.linear_triangle
import cases.two_blocks
import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import CELLS, KINDS, box, facets
from support.checks import solved_start
from support.pairs import (
    MATERIAL,
    cracked,
    displacement,
    held,
    largest,
    stacked,
    tagged,
    triangle_on_a_body,
)

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    records,
)
from dolfinx_contact.continuation import explore
from dolfinx_contact.meshing import crack, join

COMM = MPI.COMM_WORLD

# Since DOLFINx 0.10 it wants a prefix of its options.
linear_problem = (
    partial(LinearProblem, petsc_options_prefix="whole_")
    if "petsc_options_prefix" in signature(LinearProblem).parameters
    else LinearProblem
)
ORACLE = json.loads((Path(__file__).parents[1] / "data" / "two_blocks.json").read_text())


@pytest.mark.parametrize("case", ["two_n8", pytest.param("rigid_n8", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "matching meshes",
    "Coulomb",
    reference="independent code: both bodies condensed onto their jumps",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_two_blocks_have_the_forces_of_another_code(folder, case):
    """All nodal forces of another code, condensing both bodies onto their jumps."""
    given = ORACLE[case]
    wanted = given["static_end_of_shear"]
    words = ["--n", given["n"], "--friction", given["F"], "--upper", given["E1"], given["nu1"]]
    if given["rigid_floor"]:
        words += ["--rigid-floor"]
    else:
        words += ["--lower", given["E2"], given["nu2"]]
    words += ["--top", wanted["ux"], wanted["uy"], "--output", folder]
    summary = cases.two_blocks.main([*map(str, words), "--static", "-contact_snes_rtol", "1e-12"])
    step = summary["steps"][0]
    force = max(wanted["rn"])
    assert step["status"] == wanted["status"]
    for key, scale in {"rn": force, "rt": force, "ut": 0.01, "un": 0.01}.items():
        np.testing.assert_allclose(step[key], wanted[key], rtol=0, atol=1e-10 * scale)
    assert summary["force_imbalance"] < 1e-12


@pytest.mark.parametrize(
    ("dim", "cell", "degree", "method"),
    [
        *((dim, cell, 1, "nodal") for dim, cell in KINDS),
        *((dim, cell, 2, "integral") for dim, cell in KINDS),
        (2, "tri", 1, "integral"),
        (3, "tet", 1, "mixed"),
    ],
)
@pytest.mark.verifies(
    "matching meshes",
    "integral contact",
    reference="independent code: one body in plain DOLFINx",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_what_sticks_everywhere_is_one_body(dim, cell, degree, method):
    """To round-off, where jumps vanish at nodes: where multipliers are as many as these."""
    both = stacked(dim, cell, 2)
    u = displacement(both.mesh, degree)
    shift = np.zeros(dim)
    shift[0] = 0.01
    shift[-1] = -0.05
    multiplier = {"multiplier_degree": degree} if method == "integral" else {}
    pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(100.0), method=method, **multiplier)
    ends = [held(u, both.facet_tags, 1, np.zeros(dim)), held(u, both.facet_tags, 4, shift)]
    problem = ContactProblem(
        MATERIAL.energy(u) * ufl.dx, u, [pair], bcs=ends, petsc_options={"snes_rtol": 1e-12}
    )
    result = problem.solve()
    assert result.counts["slip"] == result.counts["open"] == 0
    assert largest(problem.evaluate().surfaces[0].jump) < 1e-12

    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    whole = create(
        COMM, [[0.0] * dim, [*[1.0] * (dim - 1), 2.0]], [*[2] * (dim - 1), 4], CELLS[cell]
    )
    one = displacement(whole, degree)
    tags = tagged(whole, t1=(dim - 1, 0.0), t4=(dim - 1, 2.0))
    ends = [held(one, tags, 1, np.zeros(dim)), held(one, tags, 4, shift)]
    v = ufl.TestFunction(one.function_space)
    energy = MATERIAL.energy(one) * ufl.dx
    stiffness = ufl.derivative(ufl.derivative(energy, one, v), one)
    nothing = ufl.dot(fem.Constant(whole, np.zeros(dim)), v) * ufl.dx
    options = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    solved = linear_problem(stiffness, nothing, bcs=ends, petsc_options=options).solve()
    energies = [
        COMM.allreduce(fem.assemble_scalar(fem.form(MATERIAL.energy(f) * ufl.dx)))
        for f in (u, solved)
    ]
    assert energies[0] == pytest.approx(energies[1], rel=1e-11)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "matching meshes",
    "Signorini",
    reference="itself: one body on a rigid plane",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_mirrored_bodies_carry_the_forces_of_a_rigid_plane(dim, cell):
    """Without friction they carry the forces of one body on a rigid plane."""
    press = np.zeros(dim)
    press[-1] = -0.02
    law = Frictionless()
    both = stacked(dim, cell, 3, heights=(-1.0, 0.0))
    if cell in ("tri", "tet"):  # the mirror image of the mesh
        bodies = [box(COMM, 3, cell), box(COMM, 3, cell)]
        bodies[0].geometry.x[:, dim - 1] *= -1.0
        tags = [
            tagged(bodies[0], t1=(dim - 1, -1.0), t2=(dim - 1, 0.0)),
            tagged(bodies[1], t3=(dim - 1, 0.0), t4=(dim - 1, 1.0)),
        ]
        both = join(bodies, facet_tags=tags)
    u = displacement(both.mesh)
    pair = ContactPair(u, both, slave=3, master=2, law=law)
    ends = [held(u, both.facet_tags, 1, -press), held(u, both.facet_tags, 4, press)]
    options = {"snes_rtol": 1e-12}
    found = ContactProblem(
        MATERIAL.energy(u) * ufl.dx, u, [pair], bcs=ends, petsc_options=options
    ).solve()
    domain = box(COMM, 3, cell)
    w = displacement(domain)
    plane = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(w, facets(domain, dim - 1, 0.0), obstacle=plane, law=law)
    top = held(w, tagged(domain, t4=(dim - 1, 1.0)), 4, press)
    alone = ContactProblem(
        MATERIAL.energy(w) * ufl.dx, w, [surface], bcs=[top], petsc_options=options
    ).solve()
    a = found.tables["contact"]
    b = alone.tables["contact"]
    np.testing.assert_allclose(a.force, b.force, rtol=0, atol=1e-10 * np.abs(b.force).max())
    np.testing.assert_allclose(a.ut, 0.0, atol=1e-12)


@pytest.mark.ranks(2)
def test_a_given_gap_is_that_of_the_geometry():
    """The gap of the geometry, or one that is given, to the same solution."""
    tables = []
    for gap in (None, 0.01):
        both = stacked(2, "quad", 4, gap=0.01 if gap is None else 0.0)
        u = displacement(both.mesh)
        pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(0.3), gap=gap)
        ends = [held(u, both.facet_tags, 1, (0, 0)), held(u, both.facet_tags, 4, (0.004, -0.03))]
        result = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [pair], bcs=ends).solve()
        tables.append(result.tables["contact"])
    assert tables[0].rn.sum() > 0
    np.testing.assert_allclose(tables[0].force, tables[1].force, rtol=1e-8, atol=1e-8)


# -- branches --------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("route", ["pivoting", pytest.param("steps", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "all solutions",
    "pivoting",
    "matching meshes",
    reference="itself: the triangle on a rigid floor",
    aspects=(
        "2D",
        "pairs",
        "branches",
    ),
)
def test_branches_on_a_clamped_body_agree_with_the_triangle(route):
    """All three solutions of the linear triangle, at the same forces."""
    ends = []
    seen = cases.linear_triangle.FUNCTIONALS
    for system in (triangle_on_a_body(4, 2.5), linear_triangle(4, 2.5)):
        x = solved_start(system)
        diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), route=route)
        rows = records.journal_of(system, diagram.branches, seen).rows()
        last = [r for r in rows if abs(abs(r["gamma"]) - 1) < 1e-12]
        last.sort(key=lambda r: (r["gamma"], r["status"]))
        ends.append(last)
        assert diagram.complete
    assert len(ends[0]) == len(ends[1]) >= 4
    for a, b in zip(*ends, strict=True):
        assert a["status"] == b["status"]
        for key in seen:
            assert a[key] == pytest.approx(b[key], abs=1e-9)


# -- cracks ----------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("reach", [0.5, 1.0])
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "cracks",
    reference="closed form: how many nodes are doubled, and the balance of forces",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_crack_doubles_nodes_but_not_its_front(dim, cell, reach):
    """Nodes inside a crack and where it comes to the surface are doubled, its front is not."""
    domain, tags = cracked(dim, cell, reach)
    body = crack(domain, [5], facet_tags=tags)
    along = 5 if reach == 1.0 else 2
    doubled = along * 5 ** (dim - 2)
    before, after = (m.geometry.index_map().size_global for m in (domain, body.mesh))
    assert after == before + doubled
    cells = body.mesh.topology.index_map(dim - 1).size_local
    sizes = {
        name: COMM.allreduce(int((body.facets(name) < cells).sum()))
        if isinstance(name, str)
        else COMM.allreduce(int((body.facet_tags.find(name) < cells).sum()))
        for name in (1, 4, 5, "5_opposite")
    }
    assert sizes[5] == sizes["5_opposite"] == (4 if reach == 1.0 else 2) * sizes[1] // 4
    assert sizes[1] == sizes[4]
    u = displacement(body.mesh)
    pair = ContactPair(u, body, slave=5, master="5_opposite", law=Coulomb(0.2))
    shift = np.zeros(dim)
    shift[0] = 0.02
    shift[-1] = -0.02
    ends = [held(u, body.facet_tags, 1, np.zeros(dim)), held(u, body.facet_tags, 4, shift)]
    problem = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [pair], bcs=ends)
    # The first side is the lower one, whose normal points up.
    np.testing.assert_allclose(problem.surfaces[0].points.data.n[:, -1], 1.0)
    result = problem.solve()
    assert result.counts["clamped"] == (0 if reach == 1.0 else 5 ** (dim - 2))
    assert result.counts["slip"] > 0
    assert result.imbalance < 1e-12


# -- bad input -------------------------------------------------------------------------------------
