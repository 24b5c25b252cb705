"""Assumption: users draw the stress of the form that they solve.

Two materials side by side have different stresses. The written stress is compared with closed forms
in each cell, and stresses with other tags are refused. Nothing checks that a stress belongs to the
form of the problem.
"""

import xml.etree.ElementTree as ET

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, move, two_blocks
from support.checks import assert_close

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, io, materials

COMM = MPI.COMM_WORLD

STEEL = materials.LinearElastic.from_young(1000.0, 0.0)
GLASS = materials.LinearElastic.from_young(3000.0, 0.0)


def columns(cells=(4, 2), size=(1.0, 1.0, 1.0), *, middle=None, **kind):
    """A block pressed by 1 % and the measure of its cells: 1 on the left, 2 on the right.

    Args:
        cells: numbers of cells.
        size: lengths of the edges.
        middle: axis whose halves are tagged, by default x.
        kind: further arguments of `block`.
    """
    dim = len(cells)
    body = block(cells, size[:dim], **kind)
    body.move_top(*[0.0] * (dim - 1), -0.01 * size[dim - 1])
    axis = middle or 0
    first = mesh.locate_entities(
        body.domain, dim, lambda x: x[axis] < 0.5 * size[axis] + 1e-9 * size[axis]
    )
    index_map = body.domain.topology.index_map(dim)
    values = np.full(index_map.size_local + index_map.num_ghosts, 2, dtype=np.int32)
    values[first] = 1
    cells_here = np.arange(len(values), dtype=np.int32)
    tags = mesh.meshtags(body.domain, dim, cells_here, values)
    return body, ufl.Measure("dx", body.domain, subdomain_data=tags)


def solved(body, bulk, **options):
    problem = body.problem(bulk=bulk, **options)
    problem.solve()
    return problem


def steel_and_glass(**kind):
    body, dx = columns(**kind)
    return body, solved(body, STEEL.energy(body.u) * dx(1) + GLASS.energy(body.u) * dx(2))


def both_stresses(u):
    return {1: STEEL.full_stress(u), 2: GLASS.full_stress(u)}


def array(piece, name):
    data = next(d for d in piece.iter("DataArray") if d.get("Name") == name)
    return np.array(
        data.text.split(), dtype=np.float64 if "Float" in data.get("type") else np.int64
    )


def written(folder, problem, stress):
    """Centres of cells and their stresses at every point, in the file for ParaView."""
    io.write_fields(folder, problem, stress=stress, format="vtk")
    COMM.barrier()
    centres, found = [], []
    for file in sorted(folder.glob("body_stress_p*_000000.vtu")):
        piece = ET.parse(file).getroot()[0][0]
        points = next(d for d in piece.find("Points"))
        x = np.array(points.text.split(), dtype=np.float64).reshape(-1, 3)
        cells = np.split(array(piece, "connectivity"), array(piece, "offsets")[:-1])
        stresses = array(piece, "stress").reshape(-1, 3, 3)
        centres += [x[c].mean(axis=0) for c in cells]
        found += [stresses[c] for c in cells]
    COMM.barrier()
    return np.array(centres), np.array(found)


def assert_stresses(folder, problem, stress, left, right, axis=1, middle=0.5):
    """Compare the normal stress along ``axis`` in each cell with the closed form of its column."""
    centres, stresses = written(folder, problem, stress)
    expected = np.zeros_like(stresses)
    expected[:, :, axis, axis] = np.where(centres[:, :1] < middle, left, right)
    assert 0 < np.sum(centres[:, 0] < middle) < len(centres)
    assert_close(stresses, expected)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param({"cells": (4, 2)}, marks=pytest.mark.sample),
        {"cells": (2, 1, 1)},
        {"cells": (2, 1), "size": (2e-6, 1e-6)},
    ],
)
def test_two_columns_carry_their_own_stresses(kind, folder):
    body, problem = steel_and_glass(**kind)
    middle = 0.5 * kind.get("size", (1.0,))[0]
    axis = len(kind["cells"]) - 1
    assert_stresses(folder, problem, both_stresses(body.u), -10.0, -30.0, axis, middle)


def test_two_layers_of_quadratic_triangles_carry_the_same_stress(folder):
    """0.01 / (0.5 / 1000 + 0.5 / 3000) = 15."""
    body, problem = steel_and_glass(cells=(2, 2), cell="tri", degree=2, middle=1)
    assert_stresses(folder, problem, both_stresses(body.u), -15.0, -15.0)


def test_two_bodies_on_each_other_carry_the_same_stress(folder):
    """Springs in a row: 60 / 7."""
    both = two_blocks((3, 1), (2, 2))
    move(both.top, 0.0, -0.01)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Frictionless())
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    bulk = STEEL.energy(both.u) * dx(1) + GLASS.energy(both.u) * dx(2)
    problem = ContactProblem(bulk, both.u, [pair], bcs=both.bcs)
    problem.solve()
    centres, found = written(folder, problem, both_stresses(both.u))
    expected = np.zeros_like(found)
    expected[:, :, 1, 1] = -60 / 7
    assert len(centres) == 7
    assert_close(found, expected)


def test_two_materials_of_revolution_carry_their_own_stresses(folder):
    body, dx = columns()
    core, shell = materials.Axisymmetric(STEEL), materials.Axisymmetric(GLASS)
    bulk = core.energy(body.u) * dx(1) + shell.energy(body.u) * dx(2)
    problem = solved(body, bulk, axisymmetric=True)
    both = {1: core.full_stress(body.u), 2: shell.full_stress(body.u)}
    assert_stresses(folder, problem, both, -10.0, -30.0)


@pytest.mark.parametrize("residual", [False, True])
def test_rubber_beside_steel_carries_its_cauchy_stress(residual, folder):
    """With lambda = 0 under the uniaxial stretch s: mu (s^2 - 1) / s beside E (s - 1)."""
    body, dx = columns()
    rubber = materials.NeoHookean(0.0, 500.0)
    bulk = STEEL.energy(body.u) * dx(1) + rubber.energy(body.u) * dx(2)
    if residual:
        bulk = ufl.derivative(bulk, body.u, ufl.TestFunction(body.V))
    both = {1: STEEL.full_stress(body.u), 2: rubber.full_stress(body.u)}
    s = 0.99
    right = 1000.0 * (s - 1.0), 500.0 * (s**2 - 1.0) / s
    assert_stresses(folder, solved(body, bulk), both, *right)


def test_parts_given_as_lists_of_cells_are_refused_with_the_way_to_do_it(folder):
    body, dx = columns()
    tags = dx.subdomain_data()
    size = body.domain.topology.index_map(2).size_local
    lists = [(t, np.sort(tags.find(t)[tags.find(t) < size])) for t in (1, 2)]
    by_lists = ufl.Measure("dx", body.domain, subdomain_data=lists)
    bulk = STEEL.energy(body.u) * by_lists(1) + GLASS.energy(body.u) * by_lists(2)
    problem = solved(body, bulk)
    with pytest.raises(ValueError, match="subdomain_data=cell_tags"):
        io.write_fields(folder, problem, stress=both_stresses(body.u), format="vtk")


@pytest.mark.parametrize("pairs", [True, False])
def test_a_material_everywhere_and_another_on_top_add(pairs, folder):
    body, dx = columns()
    both = both_stresses(body.u)
    everywhere = dx((1, 2)) if pairs else dx
    problem = solved(body, STEEL.energy(body.u) * everywhere + GLASS.energy(body.u) * dx(2))
    assert_stresses(folder, problem, {1: both[1], 2: both[1] + both[2]}, -10.0, -40.0)


def test_materials_that_differ_by_their_constants_alone_are_two(folder):
    body, dx = columns()
    moduli = [fem.Constant(body.domain, 1000.0) for _ in range(2)]
    left, right = (materials.LinearElastic.from_young(m, 0.0) for m in moduli)
    problem = solved(body, left.energy(body.u) * dx(1) + right.energy(body.u) * dx(2))
    moduli[1].value = 3000.0
    problem.solve()
    both = {1: left.full_stress(body.u), 2: right.full_stress(body.u)}
    assert_stresses(folder, problem, both, -10.0, -30.0)


def test_one_material_over_two_tags_is_one(folder):
    """A weight over one of them is not a stress."""
    body, dx = columns()
    weight = fem.Constant(body.domain, (0.0, 0.0))
    bulk = STEEL.energy(body.u) * (dx(1) + dx(2)) - ufl.dot(weight, body.u) * dx(2)
    stress = STEEL.full_stress(body.u)
    assert_stresses(folder, solved(body, bulk), stress, -10.0, -10.0)


def cellwise(body, left, right):
    young = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    young.interpolate(lambda x: left + (right - left) * (x[0] > 0.5))
    return materials.LinearElastic.from_young(young, 0.0)


def test_a_cellwise_modulus_stands_for_two_tags(folder):
    body, problem = steel_and_glass()
    stress = cellwise(body, 1000.0, 3000.0).full_stress(body.u)
    assert_stresses(folder, problem, stress, -10.0, -30.0)


@pytest.mark.parametrize("kind", ["condition", "Function", "Function over tags"])
def test_a_modulus_that_jumps_with_the_place_is_drawn_cell_by_cell(kind, folder):
    body, dx = columns()
    if kind == "condition":
        left = ufl.lt(ufl.SpatialCoordinate(body.domain)[0], 0.5)
        young = ufl.conditional(left, 1000.0, 3000.0)
        material = materials.LinearElastic.from_young(young, 0.0)
    else:
        material = cellwise(body, 1000.0, 3000.0)
    measure = dx(1) + dx(2) if "tags" in kind else ufl.dx
    problem = solved(body, material.energy(body.u) * measure)
    assert_stresses(folder, problem, material.full_stress(body.u), -10.0, -30.0)


STEEL_OF, GLASS_OF = STEEL.full_stress, GLASS.full_stress
MISFITS = {
    "one missing": lambda u: {1: STEEL_OF(u)},
    "the other missing": lambda u: {2: GLASS_OF(u)},
    "one too many": lambda u: {1: STEEL_OF(u), 2: GLASS_OF(u), 7: GLASS_OF(u)},
    "another tag": lambda u: {2: STEEL_OF(u), 3: GLASS_OF(u)},
    "words": lambda u: {"1": STEEL_OF(u), "2": GLASS_OF(u)},
    "fractions": lambda u: {1.0: STEEL_OF(u), 2.5: GLASS_OF(u)},
    "none": lambda u: {},
}


@pytest.mark.parametrize("name", MISFITS)
def test_stresses_whose_tags_do_not_fit_are_refused(name, folder):
    body, problem = steel_and_glass()
    with pytest.raises(ValueError, match="tag"):
        io.write_fields(folder, problem, stress=MISFITS[name](body.u), format="vtk")
