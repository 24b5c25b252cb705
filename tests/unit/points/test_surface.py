"""Contact points, their places and areas; where multipliers are removed; options of the solver."""

import gc

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import KINDS, block, box, facets
from support.pairs import branched

import ufl
from dolfinx import fem

from dolfinx_contact import ContactSurface, Coulomb, Cylinder, HalfSpace, Sphere
from dolfinx_contact.io import write_contact_table
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("dim", "cell"), KINDS)
def test_points_lie_where_they_should(dim, cell, degree):
    """Points of parent facets and dofs of the submesh are the same points, on any facet."""
    domain = box(COMM, 3, cell)
    where = facets(domain, dim - 1, 0.0)
    x = domain.geometry.x
    x[:, 0] += 0.1 * np.sin(5 * x[:, 0]) * x[:, 1] + 0.05 * x[:, 2]
    x[:, dim - 1] += 0.1 * np.sin(4 * x[:, 0] + 1.0)
    u = fem.Function(fem.functionspace(domain, ("Lagrange", degree, (dim,))))
    s = discretise(
        ContactSurface(
            u,
            where,
            obstacle=HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
            law=Coulomb(0.3),
            method="integral",
        )
    )
    n = s.points.number
    places = s.points.space.tabulate_dof_coordinates()[:n, :dim]
    np.testing.assert_allclose(s.positions, places, atol=1e-12)
    # Areas of the points add up to that of the surface.
    n = s.points.number
    area = COMM.allreduce(float(s.points.areas[:n].sum()))
    n = s.points.vertices.dofmap.index_map.size_local
    around = COMM.allreduce(float(s.points.geometry.vertex_areas[:n].sum()))
    np.testing.assert_allclose(area, around, rtol=1e-2)
    # A field that is not constant is evaluated at the points, not near them.
    u.interpolate(lambda y: np.vstack([y[0] + 2 * y[1], *(0 * y[0] for _ in range(dim - 1))]))
    jump = s.kinematics(u.x.array.reshape(-1, dim)).jump
    np.testing.assert_allclose(jump[:, 0], places[:, 0] + 2 * places[:, 1], atol=1e-12)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("obstacle", "distance"),
    [
        (HalfSpace((0, 0, -1), (0.0, 3.0, 4.0)), lambda x: 0.6 * x[1] + 0.8 * (x[2] + 1)),
        (Sphere((0, 0, -3), 2.0), lambda x: np.linalg.norm(x - np.c_[[0, 0, -3]], axis=0) - 2),
        (Cylinder((0, 0, -3), (0, 5, 0), 2.0), lambda x: np.hypot(x[0], x[2] + 3) - 2),
    ],
    ids=["half-space", "sphere", "cylinder"],
)
@pytest.mark.verifies(
    "planes", "spheres", "cylinders", reference="closed form: distances", aspects=("3D",)
)
def test_gap_and_normal_are_those_of_the_obstacle(obstacle, distance):
    domain = box(COMM, 3, "tet")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
    s = discretise(ContactSurface(u, facets(domain, 2, 0.0), obstacle=obstacle, law=Coulomb(0.3)))
    x = s.positions.T
    n = s.points.number
    np.testing.assert_allclose(s.points.vertex_gaps[:n], distance(x), atol=1e-12)
    # The normal points into the obstacle: minus the gradient of the distance.
    step = 1e-6
    for axis in range(3):
        e = step * np.eye(3)[:, [axis]]
        slope = (distance(x + e) - distance(x - e)) / (2 * step)
        np.testing.assert_allclose(s.points.vertex_normals[:n, axis], -slope, atol=1e-8)


@pytest.mark.ranks(2, 3)
def test_facets_may_be_named_on_one_rank_only():
    """Owned facets alone, without ghosts, give the same surface."""
    domain = box(COMM, 4, "tet")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
    everything = facets(domain, 2, 0.0)
    owned = everything[everything < domain.topology.index_map(2).size_local]
    surfaces = [
        discretise(ContactSurface(u, f, obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=Coulomb(0.3)))
        for f in (everything, owned)
    ]
    for s in surfaces:
        assert s.points.space.dofmap.index_map.size_global == 25
        n = s.points.number
        np.testing.assert_allclose(COMM.allreduce(float(s.points.areas[:n].sum())), 1.0, rtol=1e-12)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "options", reference="itself: the tolerance that was asked for", aspects=("3D",)
)
def test_several_solves_in_one_process():
    """Two problems with two prefixes, the command line winning over the options of the caller."""
    PETSc.Options()["contact_snes_rtol"] = 0.05
    loose = block(n=4, cell="hex", options={"snes_rtol": 1e-12}).solve()
    assert loose.history[-1].measures.worst > 1e-6
    PETSc.Options().delValue("contact_snes_rtol")
    tight = block(n=4, cell="hex").solve()
    assert tight.history[-1].measures.worst < 1e-10
    assert tight.iterations > loose.iterations


@pytest.mark.ranks(2)
def test_monitor_sees_every_iterate():
    steps = []
    result = block(n=6, cell="tri").solve(monitor=steps.append)
    assert steps == result.history
    assert [s.iteration for s in steps] == list(range(len(steps)))
    assert steps[1].flips == 7  # all nodes close in the first step
    assert steps[-1].flips == 0
    assert steps[0].measures.worst == 1.0


@pytest.mark.verifies(
    "moving obstacles", "planes", reference="closed form: the distance to a plane", aspects=("2D",)
)
def test_constants_in_a_tuple_move_the_obstacle():
    """Gap and normal follow a Constant that is one component of a point or of a normal."""
    domain = box(COMM, 2, "tri")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    height = fem.Constant(domain, -0.1)
    tilt = fem.Constant(domain, 0.0)
    floor = HalfSpace((0, height), (tilt, 1.0))
    s = discretise(ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3)))
    np.testing.assert_allclose(s.points.vertex_gaps, 0.1, atol=1e-14)
    height.value = -0.3
    tilt.value = 0.75
    s.update_geometry()
    x = s.positions[:, 0]
    gaps = s.points.vertex_gaps[: len(x)]
    normals = s.points.vertex_normals[: len(x)]
    np.testing.assert_allclose(gaps, 0.8 * 0.3 + 0.6 * x, atol=1e-14)
    np.testing.assert_allclose(normals, np.broadcast_to([-0.6, -0.8], normals.shape), atol=1e-14)
    with pytest.raises(ValueError, match="the point of the half-space must be a finite number"):
        HalfSpace((height, "a"), (0, 1)).on(domain)
    x = ufl.SpatialCoordinate(domain)
    assert not HalfSpace((0, 0), (0.1 * x[0], 1.0)).flat
    assert floor.flat


def doubled(table):
    """The rows of the two points at the end of the arm."""
    return np.flatnonzero(np.isclose(table.x[:, 0], 0.5) & np.isclose(table.x[:, 1], 0.5))


def alone(make):
    """Return on every rank the value that rank 0 computes."""
    gc.collect()  # what other ranks have a part in goes now: they wait below
    return COMM.bcast(make(MPI.COMM_SELF) if COMM.rank == 0 else None)


def columns(system):
    """The table at the end of the branch."""
    t = system.problem.table(system.problem.surfaces[0])
    return {k: getattr(t, k) for k in ("x", "un", "ut", "force", "pressure", "letters")}


@pytest.mark.ranks(2, 3)
@pytest.mark.skipif(COMM.size == 1, reason="one rank and all ranks are the same")
@pytest.mark.parametrize("method", ["nodal", "integral"])
@pytest.mark.verifies(
    "cracks",
    "matching meshes",
    reference="itself: the solve on one rank",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_tables_do_not_depend_on_ranks(method, folder):
    def found(comm):
        system = branched(comm, method=method)
        system.set_parameter(1.0)
        result = system.problem.solve()
        write_contact_table(comm, folder / str(comm.size), result.tables.values())
        return columns(system)

    for size in {1, COMM.size}:
        if COMM.rank == 0:
            (folder / str(size)).mkdir()
    COMM.barrier()
    single = alone(found)
    several = found(COMM)
    np.testing.assert_array_equal(single["letters"], several["letters"])
    for key in ("x", "un", "ut", "force", "pressure"):
        scale = np.abs(single[key]).max()
        np.testing.assert_allclose(several[key], single[key], atol=1e-9 * scale, err_msg=key)
    rows = [(folder / str(n) / "contact.csv").read_text().splitlines() for n in (1, COMM.size)]
    words = [[line.split(",")[16] for line in lines] for lines in rows]
    assert words[0] == words[1]
    assert len(several["x"]) == (8 if method == "nodal" else 2 * 6)


@pytest.mark.ranks(2)
def test_two_points_at_one_place_differ():
    system = branched(COMM)
    system.set_parameter(1.0)
    table = system.problem.solve().tables["contact"]
    a, b = doubled(table)
    np.testing.assert_array_equal(table.x[a], table.x[b])
    assert table.letters[a] != table.letters[b]
    assert np.linalg.norm(table.ut[a] - table.ut[b]) > 1e-3
