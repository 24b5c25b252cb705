"""Cracks that cross: groups of their own for the arms, or a refusal that says so."""

from mpi4py import MPI

import numpy as np
import pytest
from support.pairs import displacement

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, name_groups

COMM = MPI.COMM_WORLD
NEAR = 1e-9
STEEL = LinearElastic.from_young(100.0, 0.3)
#: Pressures of steel on planes across x and y under the strains -0.01 and -0.02 along these axes.
SQUEEZED = [100 * 0.3 / (1.3 * 0.4) * 0.03 + 100 / 1.3 * strain for strain in (0.01, 0.02)]
#: Axis and sense of the arms right, left, up and down.
ARMS = ((0, 1), (0, -1), (1, 1), (1, -1))
#: Groups of the arms.
LINE = (1, 2)
TEE = (1, 2, 3)
CROSS = (1, 2, 3, 4)
#: Axis and place of the sides left, right, bottom, top (and lowest in space), tags from 11.
SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0), (2, -1.0))


def crossing(groups, *, reach=0.5, cells=8, comm=COMM, cell="quadrilateral"):
    """Return a square or cube [-1, 1]^dim with a crack along each axis.

    Args:
        groups: tags of the arms.
        reach: half length of the arms; 1 for cracks through the body.
        cells: number of cells along a side.
        comm: communicator.
        cell: cell type.

    Returns:
        Body with the cracks.
    """
    kind = mesh.CellType[cell]
    dim = mesh.cell_dim(kind)
    make = mesh.create_rectangle if dim == 2 else mesh.create_box
    domain = make(comm, [-np.ones(dim), np.ones(dim)], [cells] * dim, kind)
    domain.topology.create_entities(dim - 1)
    at = []
    values = []
    for tag, (axis, sense) in zip(groups, ARMS, strict=False):

        def arm(x, axis=axis, sense=sense):
            along = sense * x[axis]
            across = np.abs(x[1 - axis])
            return (across < NEAR) & (along > -NEAR) & (along < reach + NEAR)

        at.append(mesh.locate_entities(domain, dim - 1, arm))
        values.append(np.full(len(at[-1]), tag, dtype=np.int32))
    for tag, (axis, place) in enumerate(SIDES[: 2 * dim - 1 + (dim == 2)], 11):
        on = mesh.locate_entities(domain, dim - 1, lambda x, i=axis, v=place: abs(x[i] - v) < NEAR)
        at.append(on)
        values.append(np.full(len(on), tag, dtype=np.int32))
    facets = np.concatenate(at)
    order = np.argsort(facets)
    tags = mesh.meshtags(domain, dim - 1, facets[order], np.concatenate(values)[order])
    return crack(domain, list(dict.fromkeys(groups)), facet_tags=tags)


def pairs_of(u, body, groups, law=None, *, exchanged=(), **options):
    """A pair for every group; slave and master of some exchanged."""
    pairs = []
    for t in dict.fromkeys(groups):
        slave, master = (f"{t}_opposite", t) if t in exchanged else (t, f"{t}_opposite")
        options = {"law": law or Coulomb(0.5), **options}
        pairs.append(ContactPair(u, body, slave=slave, master=master, name=f"arm {t}", **options))
    return pairs


def driven(u, body, pairs, values):
    """A problem in which all sides are displaced as a Function says, in plane."""
    V = u.function_space
    at = [fem.locate_dofs_topological(V, 1, body.facet_tags.find(tag)) for tag in (11, 12, 13, 14)]
    sides = np.unique(np.concatenate(at))
    bcs = [fem.dirichletbc(values, sides)]
    return ContactProblem(STEEL.energy(u) * ufl.dx, u, pairs, bcs=bcs)


def squeezed(groups, strain=(-0.01, -0.02), **options):
    """The square under a strain along its axes, prescribed at its sides, and its displacement."""
    body = crossing(groups)
    u = displacement(body.mesh)
    given = fem.Function(u.function_space)
    pairs = pairs_of(u, body, groups, **options)
    given.interpolate(lambda x: np.array(strain)[:, None] * x[:2])
    return driven(u, body, pairs, given), given


def loaded(groups, load, cell="quadrilateral", degree=1, cells=4, **options):
    """Blocks between cracks, on rollers on two sides (three in space), under pressures on two."""
    body = crossing(groups, reach=1.0, cells=cells, cell=cell)
    u = displacement(body.mesh, degree)
    V = u.function_space
    dim = body.mesh.geometry.dim
    pairs = pairs_of(u, body, groups, **options)
    ds = ufl.Measure("ds", body.mesh, subdomain_data=body.facet_tags)
    energy = STEEL.energy(u) * ufl.dx + load[0] * u[0] * ds(12) + load[1] * u[1] * ds(14)
    bcs = []
    for tag, axis in ((11, 0), (13, 1), (15, 2))[:dim]:
        W = V.sub(axis)
        held = fem.locate_dofs_topological(W, dim - 1, body.facet_tags.find(tag))
        bcs.append(fem.dirichletbc(0.0, held, W))
    return ContactProblem(energy, u, pairs, bcs=bcs)


def check_pressures(result, pressures, *, carrying=None):
    """Pressures on planes across x and y, and no shear, at every point carrying contact."""
    for table in result.tables.values():
        on = table.letters != "d"
        across = int(abs(table.n[0, 1]) > 0.5)
        assert on.sum() == (carrying or on.sum()) > 0
        np.testing.assert_allclose(table.pressure[on], pressures[across], rtol=1e-9)
        np.testing.assert_allclose(table.shear[on], 0.0, atol=1e-9 * max(pressures))


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron"])
@pytest.mark.parametrize("groups", [TEE, CROSS], ids=["T", "X"])
def test_crack_refuses_one_group_of_several_arms(groups, cell):
    with pytest.raises(ValueError, match=r"tag 1 crosses itself or branches.* a group of its own"):
        crossing((1,) * len(groups), reach=1.0, cells=4, cell=cell)


@pytest.mark.ranks(2)
def test_crack_refuses_new_names_that_exist():
    domain = mesh.create_rectangle(COMM, [(-1, -1), (1, 1)], [4, 4])
    domain.topology.create_entities(1)
    fault = mesh.locate_entities(domain, 1, lambda x: np.abs(x[0]) < NEAR)
    side = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 1.0))
    body = name_groups(domain, {"fault": fault, "fault_opposite": side})
    message = "the crack names its sides fault_opposite: rename these groups"
    with pytest.raises(ValueError, match=message):
        crack(body, ["fault"])


@pytest.mark.parametrize("groups", [(1, 1, 2), (1, 1, 2, 2)], ids=["T", "X"])
def test_two_groups_are_refused(groups):
    with pytest.raises(ValueError, match=r"where cracks cross.*each arm needs a group of its own"):
        squeezed(groups)


@pytest.mark.parametrize("groups", [LINE, TEE, CROSS], ids=["line", "T", "X"])
@pytest.mark.verifies(
    "cracks that cross",
    "cracks",
    reference="closed form: uniform compression",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_closed_arms_carry_uniform_compression(groups, caplog):
    """A patch test of arms that end in the body: the crossing has no pressure of its own."""
    problem, given = squeezed(groups)
    assert not any("share nodes" in record.getMessage() for record in caplog.records)
    result = problem.solve()
    error = np.abs(problem.u.x.array - given.x.array).max(initial=0.0)
    assert COMM.allreduce(error, op=MPI.MAX) < 1e-12
    check_pressures(result, SQUEEZED, carrying=1)
    for table in result.tables.values():
        assert table.count("d") == 2


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("friction", [0.5, 0.0])
@pytest.mark.parametrize(
    ("groups", "options"),
    [
        (TEE, {"method": "mixed"}),
        (TEE, {"method": "integral", "degree": 2}),
        (CROSS, {"method": "mixed"}),
        (CROSS, {"method": "integral", "cell": "triangle"}),
        (CROSS, {"method": "integral", "degree": 2}),
        (CROSS, {}),
    ],
    ids=["T mixed", "T P2", "X mixed", "X integral", "X P2", "X nodal"],
)
@pytest.mark.verifies(
    "cracks that cross",
    "mixed contact",
    "integral contact",
    reference="closed form: two pressures",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_crossing_cracks_carry_unequal_pressures(groups, options, friction):
    problem = loaded(groups, (1.0, 3.0), law=Coulomb(friction), **options)
    check_pressures(problem.solve(), (1.0, 3.0))


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    ("groups", "options"),
    [
        (TEE, {"cell": "tetrahedron", "method": "integral"}),
        (TEE, {"cell": "hexahedron"}),
        (CROSS, {"cell": "tetrahedron"}),
    ],
)
@pytest.mark.verifies(
    "cracks that cross",
    reference="closed form: two pressures",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_crossing_planes_meet_in_a_line(groups, options):
    """In space pairs meet in a line of nodes."""
    result = loaded(groups, (1.0, 3.0), **options).solve()
    check_pressures(result, (1.0, 3.0))
    if "method" not in options:
        assert all(table.count("d") == 5 for table in result.tables.values())


def test_through_crack_of_one_group_divides_a_stem():
    """A stem ending on it: the side that the stem divides is the slave."""
    result = loaded((1, 1, 2), (1.0, 3.0), exchanged=(1,)).solve()
    check_pressures(result, (1.0, 3.0))
    assert result.tables["arm 1"].status == "kkddkk"


@pytest.mark.parametrize("groups", [TEE, CROSS], ids=["T", "X"])
@pytest.mark.verifies(
    "cracks that cross",
    "cracks",
    reference="closed form: uniform strain and slip",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_slip_on_one_crack_moves_a_half(groups):
    """Along a crack without friction one half moves; stresses and slip are uniform."""
    body = crossing(groups, reach=1.0, cells=4)
    u = displacement(body.mesh)
    given = fem.Function(u.function_space)
    pairs = [
        *pairs_of(u, body, LINE, Coulomb(0.0)),
        *pairs_of(u, body, groups[2:]),
    ]
    domain = body.mesh
    index_map = domain.topology.index_map(2)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    above = mesh.compute_midpoints(domain, 2, cells)[:, 1] > 0
    for slip, chosen in ((0.0, cells[~above]), (0.03, cells[above])):
        given.interpolate(lambda x, s=slip: np.array([s - 0.01 * x[0], -0.02 * x[1]]), chosen)
    given.x.scatter_forward()
    problem = driven(u, body, pairs, given)
    result = problem.solve()
    error = np.abs(u.x.array - given.x.array).max(initial=0.0)
    assert COMM.allreduce(error, op=MPI.MAX) < 1e-12
    check_pressures(result, SQUEEZED, carrying=1)
    for tag in LINE:
        np.testing.assert_allclose(np.abs(result.tables[f"arm {tag}"].ut[:, 0]), 0.03, rtol=1e-9)


@pytest.mark.ranks(2)
def test_crossing_pairs_refuse_arms_of_one_facet():
    """Arms of one facet from the crossing to where they end in the body."""
    body = crossing(CROSS, reach=0.5, cells=4)
    u = displacement(body.mesh)
    pairs = pairs_of(u, body, CROSS)
    with pytest.raises(ValueError, match=r"arm 1: crosses other pairs at \(0, 0\).*two facets"):
        driven(u, body, pairs, fem.Function(u.function_space))
    with pytest.raises(ValueError, match="take multiplier_degree=1"):
        loaded(CROSS, (1.0, 3.0), degree=2, multiplier_degree=2)
