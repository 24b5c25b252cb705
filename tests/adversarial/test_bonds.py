"""Assumption: steps of a history of breaking bonds are short enough.

Fibres, plates and bars come off bonds in a few long steps; the states after it are known in closed
form or do not depend on the number of steps.
"""

import numpy as np
import pytest
from support.bodies import block
from support.checks import assert_close

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM
from dolfinx_contact.evolution import QuasiStatic

FIBRES = {  # cells, modulus, work, times, unit of force
    "soft": (8, 2.0, 0.5, [0.0, 0.05, 0.2, 0.5, 1.0], 1.0),
    "stiff, in 1e9": (6, 200.0, 0.5, [0.0, 0.5, 1.0], 1e9),
    "short": (4, 200.0, 0.01, np.linspace(0.0, 0.2, 9), 1.0),
}


@pytest.mark.parametrize("name", FIBRES)
def test_a_fibre_is_pulled_out_by_a_few_long_steps(name):
    """The shear is (1 - beta) mu p + beta^2 C u with beta = w / (C u^2), node by node."""
    cells, young, work, times, unit = FIBRES[name]
    stiffness, mu, press, ky = 100.0 * unit, 0.5, 0.02, 10.0 * unit
    young, work = young * unit, work * unit
    body = block((cells, 1), (1.0, 0.05))
    u = body.u
    energy = young / 2 * u[0].dx(0) ** 2 / 0.05 + 5e3 * young / 2 * u[0].dx(1) ** 2
    energy += ky * 0.05 / 2 * u[1].dx(1) ** 2
    end = mesh.locate_entities_boundary(body.domain, 1, lambda x: np.isclose(x[0], 1.0))
    pull = fem.Constant(body.domain, 0.0)
    bcs = [
        fem.dirichletbc(-press, body.dofs_of(1, body.top), body.V.sub(1)),
        fem.dirichletbc(pull, body.dofs_of(0, end), body.V.sub(0)),
    ]
    problem = body.problem(RCCM(stiffness, stiffness, work, mu), energy * ufl.dx, bcs=bcs)
    problem.solve()

    def load(t):
        pull.value = t

    history = QuasiStatic(problem, load).run(times, locate_jumps=True, at_jump="jump")
    last = history.steps[-1]
    table = last.result.tables["contact"]
    p = ky * press
    assert_close(history.time, times[-1])
    free = ~np.isclose(table.x[:, 0], 1.0)
    way = table.ut[free, 0]
    beta = work / (stiffness * way**2)
    shear = (1 - beta) * mu * p + beta**2 * stiffness * way
    assert_close(table.beta[free], beta, 1e-5)
    assert_close(table.force[free, 0] / table.area[free], -shear, 1e-4)
    assert_close(last.result.support[0], shear @ table.area[free], 1e-4)
    assert_close(times[-1] - table.ut[0, 0], shear.mean() / (2 * young), 4e-2)
    assert_close(table.pressure, np.full(len(table.pressure), p))


@pytest.mark.sample
def test_bonds_that_break_slowly_end_the_same_after_one_step_and_many():
    """Cohesion is softer than the body: nothing jumps."""
    ends = []
    for steps in (1, 6):
        body = block((3, 1), (1.0, 0.5))
        problem = body.problem(RCCM(20.0, 20.0, 0.02, 0.5), body.elastic(500.0, 0.3))
        evolution = QuasiStatic(problem, lambda t, b=body: b.move_top(0.0, 0.2 * t))
        history = evolution.run(np.linspace(0.0, 1.0, steps + 1))
        assert not any(s.jump for s in history.steps)
        table = history.steps[-1].result.tables["contact"]
        ends.append((table.un, table.beta))
    assert_close(ends[0][0], ends[1][0], 1e-3)
    assert_close(ends[0][1], ends[1][1], 1e-3)
    assert ends[1][1].max() < 0.5


@pytest.mark.parametrize(
    ("cells", "size", "cell"), [((4, 1), (1.0, 0.5), "tri"), ((2, 2, 1), (1.0, 1.0, 1.0), "hex")]
)
def test_a_plate_comes_off_its_bonds_in_a_single_step(cells, size, cell):
    """At the end all bonds are open, at the height of the lift."""
    dim = len(cells)
    body = block(cells, size, cell)
    problem = body.problem(RCCM(100.0, 100.0, 0.01, 0.3), body.elastic(20.0, 0.3))
    pull = np.array((0.05,) + (0.0,) * (dim - 2) + (0.6,))
    evolution = QuasiStatic(problem, lambda t: body.move_top(*(t * pull)))
    history = evolution.run([0.0, 1.0, 1.2], locate_jumps=True, at_jump="jump")
    last = history.steps[-1].result
    gaps = last.tables["contact"].un
    assert_close(history.time, 1.2)
    assert abs(last.resultants["contact"][-1]) < 0.02 * 100 * 0.01
    assert_close(gaps, np.full(len(gaps), 0.72), 0.02)


BARS = {  # stiffness over that of the bonds, cells, times in openings u0 = 0.1
    "soft": (0.5, (1, 1), [0.0, 1.0, 2.0, 2.9, 5.0]),
    "soft, in space": (1.0, (1, 1, 1), [0.0, 1.0, 1.5, 4.0]),
    "stiff": (6.0, (1, 1), [0.0, 0.5, 1.0, 1.5, 2.0, 3.0]),
}


@pytest.mark.parametrize("name", BARS)
def test_a_bar_snaps_off_its_bonds_where_it_is_soft(name):
    """Up to U = u0 (1 + 1 / K) they hold; beyond, U = u + u0^4 / (K u^3)."""
    K, cells, times = BARS[name]
    dim = len(cells)
    body = block(cells)
    problem = body.problem(RCCM(100.0, 0.0, 1.0), body.elastic(100.0 * K))
    evolution = QuasiStatic(problem, lambda t: body.move_top(*(0.0,) * (dim - 1), 0.1 * t))
    history = evolution.run(times, locate_jumps=True, at_jump="jump")
    assert_close(history.time, times[-1])
    assert any(s.jump for s in history.steps) == (K < 3)
    roots = np.roots([1.0, -times[-1], 0, 0, 1 / K])
    u = 0.1 * max(r.real for r in roots if abs(r.imag) < 1e-9)
    assert_close(history.steps[-1].result.tables["contact"].un.mean(), u, 1e-4)
