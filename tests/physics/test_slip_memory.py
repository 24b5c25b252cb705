"""Friction depending on the distance slipped, in histories: it is remembered, and grows."""

from mpi4py import MPI

import numpy as np
import pytest
from support import bonds
from support.bonds import bonded
from support.histories import put
from support.own_laws import SlipWeakening

from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.io import write_contact_table

COMM = MPI.COMM_WORLD
STATIC = 0.4
KINETIC = 0.2
D = 0.05
LAW = SlipWeakening(STATIC, KINETIC, D)


def mu(s):
    return KINETIC + (STATIC - KINETIC) * np.exp(-s / D)


def dragged(cell="quad", n=2, *, law=LAW, young=1e3, **given):
    """A block on a floor or on another block, and the Function by which its top moves."""
    return bonded(cell, n, law=law, young=young, poisson=0.3, snes_rtol=1e-10, **given)


def along(top, *corners):
    """A load from corner to corner, two components each, one in each unit of time."""
    between = [0.0] * (top.function_space.mesh.geometry.dim - 2)
    return bonds.along(top, *[(x, *between, y) for x, y in corners])


#: Pressed, dragged there and back, lifted, brought back in the air, pressed and dragged again.
PATH = (
    *((0, -0.01), (0.03, -0.01), (0, -0.01), (0, 0.01)),
    *((0.01, 0.01), (0.01, -0.01), (0.05, -0.01)),
)


@pytest.mark.parametrize(
    ("cell", "given"),
    [
        pytest.param("quad", {"method": "mixed"}, marks=pytest.mark.long),
        pytest.param("quad", {}, marks=pytest.mark.long),
        ("tri", {"pair": True}),
        ("hex", {}),
    ],
)
@pytest.mark.verifies(
    "friction of the slip",
    "laws of one's own",
    "quasi-static",
    reference="closed form: the bound at the sum of slips so far",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_shear_of_every_point_follows_its_way(cell, given):
    """The shear of every point against its accumulated slip, summing the slips of all tables."""
    problem, top = dragged(cell, **given)
    history = QuasiStatic(problem, along(top, *PATH)).run(np.linspace(0.0, 7.0, 22))
    slid = 0.0
    spent = 0.0
    for step in history.steps:
        t = step.result.tables["contact"]
        assert step.result.kkt_violation < 1e-8
        slid = slid + np.where(t.letters == "o", 0.0, np.linalg.norm(t.increment, axis=1))
        shear = np.linalg.norm(t.rt, axis=1)
        size = 1e-8 * np.abs(t.force).max() + 1e-10
        assert (shear <= mu(slid) * t.rn + size).all()
        slips = np.isin(t.letters, list("+-s"))
        np.testing.assert_allclose(shear[slips], (mu(slid) * t.rn)[slips], rtol=0, atol=size)
        np.testing.assert_allclose(t.slid, slid, rtol=1e-10, atol=1e-13)
        spent -= np.sum(t.rt * t.increment)
        assert step.energies.dissipated == pytest.approx(spent, rel=1e-9, abs=1e-12)
    assert (mu(slid) < 0.75 * STATIC).all()
    letters = "".join(s.status for s in history.steps)
    assert {"o", "k"} < set(letters)


@pytest.mark.verifies(
    "friction of the slip",
    "energies of histories",
    reference="closed form: mu(s) N against the way, and its work",
    aspects=("2D",),
)
def test_stiff_block_follows_slip_weakening():
    """T = mu(s) N against the way s beyond the elastic slip, forwards and backwards."""
    residues = []
    for n in (6, 12):
        problem, top = dragged(n=1, young=1e6)
        load = along(top, (0.0, -1e-5), (0.03, -1e-5), (0.0, -1e-5), (0.03, -1e-5))
        history = QuasiStatic(problem, load).run([0.0, *np.linspace(1.0, 4.0, 3 * n + 1)])
        for step in history.steps[1:]:
            way = 0.03 * (step.time - 1.0)
            found = np.abs(step.result.resultants["contact"])
            assert found[0] / found[1] == pytest.approx(mu(way), abs=1e-3)
        residues.append(abs(history.energies.residue))
    # The work of friction, integrated; what the steps leave is of first order.
    spent = history.energies.dissipated - history.at(1.0).energies.dissipated
    closed = KINETIC * way + (STATIC - KINETIC) * D * (1 - np.exp(-way / D))
    assert spent == pytest.approx(found[1] * closed, rel=0.02)
    assert residues[1] < 0.6 * residues[0] < 0.1 * spent


@pytest.mark.ranks(2)
def test_a_static_start_has_slipped(folder):
    """Slip under the static law counts, and friction continues from there."""
    problem, top = dragged()
    put(top, (0.02, -0.01))
    before = problem.solve().tables["contact"]
    load = along(top, (0.0, -0.01), (0.02, -0.01))
    history = QuasiStatic(problem, lambda t: load(t + 2.0)).run([0.0, 1e-6])
    after = history.steps[0].result.tables["contact"]
    np.testing.assert_allclose(after.rt, before.rt, rtol=0, atol=1e-4 * np.abs(before.rt).max())
    np.testing.assert_allclose(before.slid, np.linalg.norm(before.ut, axis=1), atol=1e-14)
    np.testing.assert_allclose(after.slid, before.slid, atol=1e-4)
    write_contact_table(COMM, folder, [after])
    head, row, *_ = (folder / "contact.csv").read_text().splitlines()
    assert head.split(",")[-1] == "slid"
    assert float(row.split(",")[-1]) == after.slid[0]
