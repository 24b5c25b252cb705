"""Contact between faces of different meshes."""

from mpi4py import MPI

import cases.two_cylinders
import numpy as np
import pytest
from support.mortars import (
    BASE,
    CASES,
    SIDES,
    SOLID_BASE,
    SOLID_CASES,
    TILT,
    hats,
    sheared,
    solids,
    solved_patch,
    stacked,
)
from support.pairs import displacement, largest

from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    Frictionless,
    records,
)
from dolfinx_contact.continuation import StepControl, follow
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize(("slave", "master"), SIDES)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.verifies(
    "mortar",
    reference="closed form: integrals over the common part",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_mortar_forces_are_exact_integrals_of_uniform_tractions(case, slave, master, angle):
    """Forces on both faces are integrals over their intersection, node by node."""
    both = stacked(*case, angle=angle)
    u = displacement(both.mesh)
    pair = discretise(ContactPair(u, both, slave=slave, master=master, law=Frictionless()))
    assert not pair.obstacle.opposite.matching
    ones, sums = pair.points.operator.B.createVecs()
    ones.set(1.0)
    pair.points.operator.B.mult(ones, sums)
    assert largest(sums.array_r) < 1e-14
    V = u.function_space
    n = V.dofmap.index_map.size_local
    uniform = np.tile([1.0, -2.0], (pair.points.number, 1))
    force = pair.points.operator.transpose(uniform).reshape(-1, 2)[:n]
    covered = ~pair.obstacle.opposite.none[pair.points.trace_nodes[: pair.points.number]]
    force -= pair.points.operator.transpose(
        np.where(covered[:, None], 0.0, np.tile([1.0, -2.0], (pair.points.number, 1)))
    ).reshape(-1, 2)[:n]
    common = max(case[2][0], case[3][0]), min(case[2][1], case[3][1])
    along = V.tabulate_dof_coordinates()[:n, :2] @ [np.cos(angle), np.sin(angle)]
    for tag, sign in ((slave, 1.0), (master, -1.0)):
        count, reach = (case[0], case[2]) if tag == 2 else (case[1], case[3])
        points = np.linspace(*reach, count + 1)
        exact = hats(points, *common)
        nodes = fem.locate_dofs_topological(V, 1, both.facet_tags.find(tag))
        nodes = nodes[nodes < n]
        at = np.searchsorted(points, along[nodes] - 1e-9)
        np.testing.assert_allclose(force[nodes, 0], sign * exact[at], atol=1e-14)
        np.testing.assert_allclose(force[nodes, 1], -2 * sign * exact[at], atol=1e-14)
    x = V.tabulate_dof_coordinates()[:n, :2]
    moment = COMM.allreduce(float(np.sum(x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0])))
    assert abs(moment) < 1e-13


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("cell", ["tri", "quad"])
@pytest.mark.parametrize(("slave", "master"), SIDES)
@pytest.mark.parametrize("case", CASES[:2])
@pytest.mark.verifies(
    "mortar",
    "Coulomb",
    reference="closed form: a linear displacement",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_linear_displacement_over_different_meshes_is_exact(case, slave, master, cell, angle):
    """A linear displacement, with pressure and a shear below the bound, to round-off."""
    both = stacked(*case, cell=cell, angle=angle)
    c = np.cos(angle)
    s = np.sin(angle)
    frame = np.array([[c, -s], [s, c]])
    solved_patch(both, frame, BASE, (slave, master), (1, 1), (4, 5, 6), method="nodal")


# -- in space --------------------------------------------------------------------------------------


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("cells", ["tet", "hex"])
@pytest.mark.parametrize(("slave", "master"), SIDES)
@pytest.mark.parametrize("case", SOLID_CASES[:2])
@pytest.mark.verifies(
    "mortar",
    "Coulomb",
    reference="closed form: a linear displacement",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_a_linear_displacement_over_different_meshes_in_space_is_exact(case, slave, master, cells):
    """A linear displacement, with pressure and a shear below the bound, to round-off."""
    both = solids(*case, cells)
    aside = (4, 5, 6, 7, 8)
    solved_patch(both, TILT, SOLID_BASE, (slave, master), (1, 1), aside, method="nodal")


@pytest.mark.verifies(
    "pivoting",
    "mortar",
    "records of branches",
    reference="itself: the branch by steps",
    aspects=(
        "2D",
        "pairs",
        "branches",
        "records",
    ),
)
def test_branch_between_bodies_has_the_events_of_steps(folder):
    """Pivoting and steps, interrupted and resumed, have the same events and agree with a solve."""
    system, x = sheared()
    energy = fem.form(system.problem.energy)
    seen = {
        "energy": lambda problem: problem.comm.allreduce(fem.assemble_scalar(energy)),
        "force": records.total("rt"),
    }
    paths = []
    for route in ("pivoting", "steps"):
        control = StepControl(kinks="exact")
        with records.BranchRecord(folder / route, system, seen, every=2) as record:
            options = dict(gamma_range=(0.0, 1.0), control=control, record=record)
            follow(system, x, 0.0, route=route, max_steps=3, **options)
        with records.BranchRecord(folder / route, system, seen, every=2, resume=True) as record:
            branch = record.go_on(max_steps=200)
        assert branch.reason == "gamma reached the end of its range"
        special = records.read_journal(folder / route).special()
        found = special[special["kind"] == "event"].to_dict("records")
        changes = [[(c["before"], c["after"]) for c in e["changes"]] for e in found]
        paths.append(list(zip([e["gamma"] for e in found], changes, strict=True)))
        last = records.read_journal(folder / route).to_pandas().iloc[-1]
        fresh, _ = sheared()
        fresh.set_parameter(1.0)
        result = fresh.problem.solve()
        assert result.tables["contact"].status == last["status"]
        table = result.tables["contact"]
        assert last["force"] == pytest.approx(table.along(table.rt).sum(), rel=1e-7)
    assert len(paths[0]) == len(paths[1]) > 3
    for a, b in zip(*paths, strict=True):
        assert a[0] == pytest.approx(b[0], abs=1e-8)
        assert a[1:] == b[1:]


@pytest.mark.long
@pytest.mark.verifies(
    "mortar",
    "Signorini",
    reference="paper: NAFEMS, benchmark CB-1",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_steel_on_aluminium_agrees_with_nafems(folder):
    """NAFEMS CB-1: the peak within 2 %, the radius within 2 % or a cell, and the force carried."""
    levels = ["0.5"] if COMM.size > 1 else ["1", "0.5", "0.25"]
    words = ["--output", str(folder), "--levels", *levels]
    summary = cases.two_cylinders.main(words)
    for level in summary["levels"]:
        assert level["peak"] == pytest.approx(3585.37, rel=0.02)
        assert level["radius"] == pytest.approx(6.21, abs=max(0.02 * 6.21, level["size"]))
        assert level["peak"] == pytest.approx(level["hertz_peak"], rel=0.02)
    assert summary["force_imbalance"] < 1e-10
    assert (folder / "body.png").stat().st_size > 20_000
    if COMM.size == 1:
        # The other body as the finer one: nearer to each other than to the closed form's tolerance.
        other = cases.two_cylinders.main(
            ["--output", str(folder), "--levels", "0.5", "--ratio", "1.25"]
        )
        assert other["peak"] == pytest.approx(summary["levels"][1]["peak"], rel=0.01)
