"""A proof file with arrays of Python objects, which run code where they are unpickled.

Nothing in the file may be run, and it is refused with status 1 and no traceback; so by
`Certificate.load`.
"""

import os

import numpy as np
from a14_tampered import on_root, run, several

from dolfinx_contact.analysis import Certificate, InvalidCertificate


class _Trap:
    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def tried(folder):
    several().certificate.save(folder / "proof.npz")
    with np.load(folder / "proof.npz") as stored:
        data = {key: stored[key] for key in stored}
    answers = []
    for key in (*data, "another"):
        trap = np.empty((), dtype=object)
        trap[()] = _Trap(folder / f"sprung_{key}")
        path = folder / f"trap_{key}.npz"
        np.savez(path, **(data | {key: trap}))
        try:
            Certificate.load(path)
            refused = key == "another"
        except InvalidCertificate:
            refused = True
        answers.append((key, refused))
    status, text = run(folder / "trap_p.npz")
    return answers, status, text, sorted(p.name for p in folder.glob("sprung_*"))


def attack(case):
    answers, status, text, sprung = on_root(case, tried)
    case.true(f"nothing was run, {sprung}", not sprung)
    case.true(f"all are refused, {answers}", all(refused for _, refused in answers))
    case.true(f"status 1 without traceback, {status}: {text}", status == 1)
    case.true("no traceback", "Traceback" not in text)
