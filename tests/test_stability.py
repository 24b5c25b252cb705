"""Stability at rest: one node in closed form, continua of slip, points that just touch."""

from mpi4py import MPI

import numpy as np
import pytest
from demo_linear_triangle import linear_triangle
from test_critical_friction import block, leaning, on_box

from dolfinx import mesh

from dolfinx_contact.analysis import SteadySliding, critical_friction, stability_at_rest
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.laws import MINUS, PLUS, STICK

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_labels_of_one_node(damping):
    """kt = kn = 2, k = 1, F = 3, p = (-2.5, -1): stick and open stay, slip to the left grows."""
    density, m = 6.0, 6.0 / 12  # mass of the node of a linear triangle of area 1/2
    system = linear_triangle(1, 3.0, (-5.0, -2.0), (1.0, 1.0))
    system.problem.solve()
    found = find_solutions(system, [system.create_vector()], -1.0)
    labels = {}
    for point in found.points(system):
        x = system.create_vector()
        x.array[:] = point.y.array_r[: x.getLocalSize()]
        system.put(x, point.gamma, point.piece)
        status = system.problem.table(system.problem.surfaces[0]).status[0]
        labels[status] = stability_at_rest(system.problem, density=density, damping=damping)
    assert {k: v.label for k, v in labels.items()} == {
        "o": "stable",
        "k": "stable",
        "-": "unstable",
    }
    # m l^2 + eta (kt - F k) l + kt - F k = 0, with the damping of the same motion
    excess = 3.0 * 1.0 - 2.0
    b = damping * excess
    growth = (b + np.sqrt(b**2 + 4 * m * excess)) / (2 * m)
    assert labels["-"].growth == pytest.approx(growth, rel=1e-9)
    if damping == 0:
        assert growth == pytest.approx(np.sqrt(excess / m))
    assert labels["-"].border == 1


def pressed(problem, friction, codes, sense, part=1.0):
    """Put a state of uniform pressure at rest into the Functions, its shear at the bound."""
    s, dim = problem.surfaces[0], problem.V.mesh.geometry.dim
    shear = np.zeros(dim)
    shear[0], shear[-1] = -sense * friction * part, 1.0
    s.multiplier.x.array[:] = np.tile(shear, len(s.multiplier.x.array) // dim)
    s.statuses[:] = codes
    return problem


def test_slip_of_one_sign():
    """All points at the bound: they leave where friction exceeds the critical one."""
    critical = critical_friction(leaning(3)).friction
    for part, label in ((0.98, "stable"), (1.02, "unstable")):
        problem = pressed(leaning(3), part * critical, MINUS, -1.0)
        problem.surfaces[0].law.friction.value = part * critical
        found = stability_at_rest(problem, density=1.0)
        assert (found.label, found.border) == (label, 4)
    onset = SteadySliding(problem, (-1.0, 0.0), density=1.0).modes(part * critical)
    real = onset.eigenvalues[onset.eigenvalues.imag == 0].real
    assert found.growth == pytest.approx(real.max(), rel=1e-8)


def test_other_way():
    """The same pressure with the shear of the other sense stays."""
    problem = pressed(leaning(3), 2.0, PLUS, 1.0)
    problem.surfaces[0].law.friction.value = 2.0
    assert stability_at_rest(problem, density=1.0).label == "stable"


def test_inside_the_cone():
    """With the shear below its bound all points stick, and nothing can grow."""
    problem = pressed(leaning(3), 2.0, STICK, -1.0, part=0.9)
    problem.surfaces[0].law.friction.value = 2.0
    found = stability_at_rest(problem, density=1.0)
    assert (found.label, found.border, found.pieces) == ("stable", 0, 0)


def test_stuck_neighbours():
    """Where only some points may slip, the others hold them longer."""
    critical = critical_friction(leaning(3)).friction
    problem = pressed(leaning(3), 1.02 * critical, MINUS, -1.0)
    s = problem.surfaces[0]
    s.law.friction.value = 1.02 * critical
    inner = s.positions[:, 0] > 0.4
    s.statuses[inner] = STICK
    traction = s.multiplier.x.array.reshape(-1, 2)
    x = s.Q.tabulate_dof_coordinates()[:, 0]
    traction[x > 0.4, 0] *= 0.5
    found = stability_at_rest(problem, density=1.0)
    assert (found.label, found.border) == ("stable", 2)
    s.law.friction.value = 0.0
    critical = critical_friction(problem, "solution").friction  # along the slip: negative
    friction = 1.05 * abs(critical)
    traction[:, 0] = np.where(x > 0.4, 0.5, 1.0) * friction
    s.law.friction.value = friction
    assert stability_at_rest(problem, density=1.0).label == "unstable"


def test_few_eigenproblems():
    """With a budget what was not looked at is not decided."""
    problem = pressed(leaning(3), 0.3, MINUS, -1.0)
    found = stability_at_rest(problem, density=1.0, most=5)
    assert (found.label, found.pieces) == ("not decided", 5)
    assert found.reason == "5 of 16 pieces were looked at"


def test_just_touching():
    """Without load a node may do anything, and a pressure that would fall keeps it: stable."""
    system = linear_triangle(1, 3.0, (0.0, 0.0), (1.0, 1.0))
    system.problem.solve()
    found = stability_at_rest(system.problem, density=1.0)
    assert (found.label, found.border, found.pieces) == ("stable", 1, 4)


def test_3d():
    """Slip against the shear in 3D; points that just touch are not decided."""
    critical = critical_friction(block(1), (1.0, 0.0, 0.0)).friction
    sense = -np.sign(critical)
    for part, label in ((0.98, "stable"), (1.02, "unstable")):
        friction = part * abs(critical)
        problem = pressed(block(1, friction=friction), friction, PLUS, sense)
        assert stability_at_rest(problem, density=1.0).label == label
    assert (
        stability_at_rest(pressed(problem, friction, PLUS, -sense), density=1.0).label == "stable"
    )
    found = stability_at_rest(block(1), density=1.0)
    assert found.label == "not decided"


def test_bad_input():
    problem = leaning(2)
    with pytest.raises(ValueError, match="density must be positive"):
        stability_at_rest(problem, density=-1.0)
    with pytest.raises(ValueError, match="eigenproblems must be 1 or more"):
        stability_at_rest(problem, density=1.0, most=0)
    domain = mesh.create_unit_square(COMM, 2, 2)
    with pytest.raises(ValueError, match="nodal or mixed"):
        stability_at_rest(on_box(domain, method="integral"), density=1.0)
