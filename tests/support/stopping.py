"""Interrupted runs, and comparison of the records of two runs."""

import numpy as np

from dolfinx_contact.records import read_journal

ENERGIES = ("external", "stored", "dissipated", "residue", "kinetic", "contact")


def require_same(folder, other, tolerance=1e-10):
    """The same states, in the journals and in what was kept of the points."""
    a, b = (read_journal(path) for path in (folder, other))
    assert [s.status for s in a.states] == [s.status for s in b.states]
    rows = a.rows(), b.rows()
    for name in rows[0][0]:
        found, wanted = (np.array([row[name] for row in each]) for each in rows)
        if wanted.dtype.kind != "f":
            if name not in ("newton_iterations", "strategy"):
                np.testing.assert_array_equal(found, wanted, err_msg=name)
            continue
        energy = name in ENERGIES
        scale = max(r["external"] for r in rows[1]) if energy else np.abs(wanted).max(initial=0)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * scale, err_msg=name)
    norm = max(s.size for s in b.states)
    for s, t in zip(a.states, b.states, strict=True):
        assert abs(s.size - t.size) <= tolerance * norm
    found = kept_of(folder, a)
    wanted = kept_of(other, b)
    length = max(np.abs(w[name]).max(initial=0.0) for w in wanted for name in w if "jump" in name)
    for f, w in zip(found, wanted, strict=True):
        assert sorted(f) == sorted(w)
        for name in f:
            scale = length if "jump" in name else np.abs(w[name]).max(initial=0)
            atol = tolerance * scale if w[name].dtype.kind == "f" else 0
            np.testing.assert_allclose(f[name], w[name], rtol=0, atol=atol, err_msg=name)


def kept_of(folder, journal):
    """The arrays of all states: statuses and memory."""
    files = [folder / "checkpoints" / f"{s.checkpoint}.npz" for s in journal.states]
    every = [dict(np.load(file)) for file in files]
    return [{k: v for k, v in f.items() if k.startswith(("statuses", "memory"))} for f in every]


class Stop(Exception):
    """What an observer raises."""


def stopping(number):
    def observer(step):
        if step.number == number:
            raise Stop

    return observer
