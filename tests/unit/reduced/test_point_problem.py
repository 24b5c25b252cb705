"""The body condensed onto its contact points: errors, files, and the conventions of FCLib."""

import importlib.util
import sys

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import block, half_block

from dolfinx_contact import Coulomb, HalfSpace, Tresca
from dolfinx_contact.algorithms import GaussSeidel, PointProblem, load_points, save_points
from dolfinx_contact.algorithms.exchange import fclib_local
from dolfinx_contact.reduced import Reduction

COMM = MPI.COMM_WORLD
NAMES = ("S", "p", "friction", "bound", "augmentation", "positions", "gap", "frames", "rate")
ERRORS = ("S_error", "p_error", "rate_error")


def tilted(comm, cell):
    """Return a block above a tilted floor, with frames off the axes and gaps that are not 0."""
    dim = 2 if cell in ("tri", "quad") else 3
    floor = HalfSpace((*[0.0] * (dim - 1), -0.002), (0.1, *[0.05] * (dim - 2), 1.0))
    return block(comm, n=3, cell=cell, obstacle=floor)


def shared(path):
    """The path of rank 0, on every rank."""
    return COMM.bcast(path)


def write(file, problem):
    """Write the reduced problem of a contact problem on rank 0, and return it on every rank."""
    with Reduction.of(problem.equations) as reduction:
        points = reduction.problem()
    if COMM.rank == 0:
        save_points(file, points)
    COMM.barrier()
    return points


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["tri", "hex"])
def test_point_problem_is_stored_exactly(cell, tmp_path):
    file = shared(tmp_path) / "points.npz"
    problem = tilted(COMM, cell)
    problem.u.x.array[:] = 1e-3
    known = write(file, problem)
    np.testing.assert_array_equal(problem.u.x.array, 1e-3)
    found = load_points(file)
    for name in (*NAMES, *ERRORS):
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name), err_msg=name)
    assert found.force == known.force
    assert found.length == known.length


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.verifies(
    "point problems in files",
    "Gauss-Seidel",
    reference="itself: the forces of the solve",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_what_is_saved_is_the_problem(cell, tmp_path):
    """An algorithm on numpy arrays alone finds the forces of the solve, in global components."""
    file = shared(tmp_path) / "points.npz"
    problem = tilted(COMM, cell)
    write(file, problem)
    points = load_points(file)
    found = GaussSeidel().run(points, tolerance=1e-12)
    assert found.converged
    table = problem.solve().tables["contact"]
    force = np.einsum("iap,ip->ia", points.frames, found.r)
    size = np.abs(table.force).max()
    np.testing.assert_allclose(points.positions, table.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(force, table.force, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(found.a[:, -1], table.un, rtol=0, atol=1e-11)


@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.verifies(
    "point problems in files",
    reference="independent code: compliances by unit forces, in numpy",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_error_bounds_cover_the_difference_from_unit_forces(cell):
    """The bound covers the difference from the compliance by unit forces."""
    points, W, q, _ = compliance(cell)
    order = local_order(points)
    S = np.linalg.inv(W)[np.ix_(order, order)]
    p = S @ q[order]
    slack = 1e-11 * np.abs(S).max()
    assert (np.abs(points.S - S) <= points.S_error + slack).all()
    assert points.S_error.max() < 1e-9 * np.abs(points.S).max()
    assert (np.abs(points.p - p) <= points.p_error + slack * np.abs(q).max()).all()


def test_rate_of_the_load_is_a_difference():
    """The difference of the loads of two problems without a parameter, within its error."""
    system = linear_triangle(4, 0.5)
    condensed = system.condensed(system.create_vector(), 0.0)
    points = condensed.problem(0.4)
    loads = []
    errors = 0.0
    for gamma in (0.0, 1.0):
        system.constant.value = gamma
        with Reduction.of(system.equations) as reduction:
            found = reduction.problem()
        assert not found.rate.any()
        loads.append(found.p)
        errors = errors + found.p_error
    size = np.abs(points.rate).max()
    assert size > 0
    off = np.abs(loads[1] - loads[0] - points.rate)
    assert (off <= points.rate_error + errors + 1e-14 * size).all()
    assert points.rate_error.max() < 1e-9 * size
    scaled = condensed.problem(0.4, unit=2.0)
    np.testing.assert_array_equal(2.0 * scaled.rate, points.rate)
    np.testing.assert_array_equal(2.0 * scaled.rate_error, points.rate_error)


def local_order(points):
    """Places of (ut, un) in an order with the normal first."""
    d = points.dim
    first = np.arange(0, len(points.p), d)[:, None]
    return (first + np.array([*range(1, d), 0])).reshape(-1)


def compliance(cell):
    """Return a problem, and W and q of FCLib by unit forces on the stiffness, on one rank.

    The normal into the body comes first; the gap is computed from positions.
    """
    problem = tilted(MPI.COMM_SELF, cell)
    points = problem.reduced()
    eq = problem.equations
    d = points.dim
    K = eq.bulk.stiffness(np.zeros_like(eq.bulk.displacement.x.array))
    n = K.getSize()[0]
    K = K[np.arange(n, dtype=PETSc.IntType), np.arange(n, dtype=PETSc.IntType)]
    fixed = eq.fixed[:n]
    free = np.flatnonzero(~fixed)
    prescribed = np.where(fixed, eq.constraints.displacement()[:n], 0.0)
    nodes = problem.u.function_space.tabulate_dof_coordinates()[:, :d]
    up = np.array((0.1, *[0.05] * (d - 2), 1.0)) / np.linalg.norm((0.1, *[0.05] * (d - 2), 1.0))
    rows = np.zeros((d * points.number, n))
    gaps = np.zeros(d * points.number)
    for i, (x, T) in enumerate(zip(points.positions, points.frames, strict=True)):
        node = int(np.linalg.norm(nodes - x, axis=1).argmin())
        np.testing.assert_allclose(T[:, -1], up, atol=1e-12)  # minus the normal of the body
        np.testing.assert_allclose(T.T @ T, np.eye(d), atol=1e-12)
        axes = [up, *T[:, : d - 1].T]
        rows[d * i : d * (i + 1), d * node : d * (node + 1)] = axes
        gaps[d * i] = up @ x + 0.002 * up[-1]
    R = rows[:, free]
    compliant = np.linalg.solve(K[np.ix_(free, free)], R.T)
    moved = np.linalg.solve(K[np.ix_(free, free)], -(K @ prescribed)[free])
    return points, R @ compliant, R @ moved + gaps, gaps


@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.verifies(
    "point problems in files",
    reference="independent code: compliances by unit forces, in numpy",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_fclib_conventions_agree_with_unit_forces(cell):
    """u = W r + q, the normal first, W by unit forces on the body's own stiffness."""
    points, W, q, gaps = compliance(cell)
    local = fclib_local(points)
    d = points.dim
    m = points.number
    size = d * m
    assert all(name.startswith("/fclib_local/") for name in local)
    given = {name.removeprefix("/fclib_local/"): v for name, v in local.items()}
    assert given["spacedim"].tolist() == [d]
    numbers = {"m": size, "n": size, "nzmax": size * size, "nz": -2}
    assert {name: given[f"W/{name}"].tolist() for name in numbers} == {
        name: [number] for name, number in numbers.items()
    }
    for name in ("spacedim", "W/m", "W/p", "W/i"):
        assert given[name].dtype == np.int32
    dense = np.zeros((size, size))
    for row in range(size):
        part = slice(given["W/p"][row], given["W/p"][row + 1])
        dense[row, given["W/i"][part]] = given["W/x"][part]
    np.testing.assert_allclose(dense, W, rtol=0, atol=1e-12 * np.abs(W).max())
    np.testing.assert_allclose(given["vectors/q"], q, rtol=0, atol=1e-12 * np.abs(q).max())
    np.testing.assert_allclose(points.gap, gaps[::d], rtol=0, atol=1e-15)
    np.testing.assert_allclose(given["vectors/mu"], [0.3] * m, rtol=1e-15)
    assert given["info/title"].tobytes().endswith(b"\0")
    # A solution by another formula: (u + mu |u_T| n) in the dual of the cone, r in the cone.
    found = GaussSeidel().run(points, tolerance=1e-13)
    r = np.roll(found.r, 1, axis=1)
    u = (dense @ r.reshape(-1) + given["vectors/q"]).reshape(m, d)
    slip = np.linalg.norm(u[:, 1:], axis=1)
    force = np.abs(r).max()
    length = np.abs(u).max()
    assert (np.linalg.norm(r[:, 1:], axis=1) <= 0.3 * r[:, 0] + 1e-9 * force).all()
    hat = u[:, 0] + 0.3 * slip
    assert (0.3 * slip <= hat + 1e-9 * length).all()
    along = hat * r[:, 0] + np.sum(u[:, 1:] * r[:, 1:], axis=1)
    assert np.abs(along).max() <= 1e-9 * force * length
    assert (r[:, 0] > 0).any()
    assert (slip > 1e-6).any()


@pytest.mark.ranks(2)
@pytest.mark.skipif(importlib.util.find_spec("h5py") is None, reason="needs h5py")
@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.verifies(
    "point problems in files",
    reference="independent code: the reader h5py",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_fclib_file_is_read_by_h5py(cell, tmp_path):
    import h5py

    file = shared(tmp_path) / "points.hdf5"
    problem = tilted(COMM, cell)
    expected = fclib_local(write(file, problem))
    with h5py.File(file) as data:
        for name, values in expected.items():
            if values.dtype.kind != "S":
                np.testing.assert_array_equal(data[name][()], values)
                assert data[name].dtype == values.dtype
        title = data["/fclib_local/info/title"]
        assert title.shape == ()
        assert h5py.check_string_dtype(title.dtype).length is not None


def test_save_points_refuses_names_and_laws(tmp_path):
    points = block(n=2).reduced()
    with pytest.raises(ValueError, match=r"saved as \.npz, \.hdf5 or \.h5 \(FCLib\), not as"):
        save_points(tmp_path / "points.csv", points)
    with pytest.raises(FileNotFoundError):
        save_points(tmp_path / "nowhere" / "points.npz", points)
    with pytest.raises(ValueError, match="FCLib supports Coulomb friction only"):
        save_points(tmp_path / "points.h5", block(n=2, law=Tresca(1.0)).reduced())
    assert not list(tmp_path.iterdir())


@pytest.mark.ranks(2)
def test_reduction_refuses_partly_clamped_bodies():
    with pytest.raises(ValueError, match="without partial Dirichlet data"):
        Reduction.of(half_block(method="mixed").equations)


def test_a_missing_h5py_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ModuleNotFoundError, match=r"h5py is not installed: .* python3-h5py"):
        save_points(tmp_path / "points.hdf5", block(n=2).reduced())
    assert not list(tmp_path.iterdir())


def test_load_points_refuses_other_files(tmp_path):
    file = tmp_path / "points.npz"
    with pytest.raises(FileNotFoundError):
        load_points(file)
    file.write_text("nothing")
    with pytest.raises(ValueError, match=r"is not an npz file$"):
        load_points(file)
    np.savez(file, S=np.eye(2))
    with pytest.raises(ValueError, match="has no points: its format is 'nothing'"):
        load_points(file)
    save_points(file, PointProblem(np.eye(2), np.ones(2), np.array([0.3])))
    with np.load(file) as data:
        arrays = dict(data)
    assert set(arrays) == {
        *("format", "S", "p", "friction", "bound", "augmentation", "force", "length")
    }
    np.savez(file, **(arrays | {"S": -np.eye(2)}))
    with pytest.raises(ValueError, match="is not positive definite"):
        load_points(file)
    np.savez(file, **(arrays | {"more": np.eye(2)}))
    with pytest.raises(ValueError, match="unexpected keyword argument 'more'"):
        load_points(file)


def test_save_points_leaves_other_files_unchanged(tmp_path):
    names = ("points.npz.part", ".points.npz.part", ".points.part.npz")
    for name in names:
        (tmp_path / name).write_text("mine")
    save_points(tmp_path / "points.npz", block(n=2).reduced())
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*names, "points.npz"])
    assert [(tmp_path / name).read_text() for name in names] == ["mine"] * 3


def test_a_point_problem_converts_between_units():
    with Reduction.of(block(n=2, law=Coulomb(0.5)).equations) as reduction:
        unit = reduction.force_unit
        a, b = reduction.problem(), reduction.problem(unit=unit)
    np.testing.assert_allclose(a.S, b.S * unit, rtol=1e-14)
    np.testing.assert_allclose(a.p, b.p * unit, rtol=1e-14)
    np.testing.assert_allclose(a.free, b.free, rtol=0, atol=1e-12 * np.abs(b.free).max())
    assert np.diag(b.S).mean() == pytest.approx(1.0)
