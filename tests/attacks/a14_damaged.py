"""Files that are no proofs: empty, cut short, text, a folder, other shapes, NaN, other kinds.

The checker ends with status 1, or 2 where there is no file, in words and without a traceback. The
twin has a file that another name and folder, with a space, do not hinder.
"""

import numpy as np
from a14_tampered import on_root, run, several

from dolfinx_contact.analysis import Certificate, InvalidCertificate


def files(folder):
    """Paths of files that are not whole."""
    whole = folder / "whole.npz"
    several().certificate.save(whole)
    content = whole.read_bytes()
    for name, some in (
        ("empty.npz", b""),
        ("short.npz", content[: len(content) // 2]),
        ("end.npz", content[-200:]),
        ("text.npz", b"the proof holds\n"),
        ("flipped.npz", content[:200] + bytes([content[200] ^ 255]) + content[201:]),
    ):
        (folder / name).write_bytes(some)
        yield folder / name
    (folder / "folder.npz").mkdir()
    yield folder / "folder.npz"
    with np.load(whole) as stored:
        data = {key: stored[key] for key in stored}
    S = data["S"]
    for name, other in (
        ("missing", {k: v for k, v in data.items() if k != "p_error"}),
        ("shape", data | {"S": S[:-1]}),
        ("flat", data | {"S": S.ravel()}),
        ("nan", data | {"p": np.full_like(data["p"], np.nan)}),
        ("inf", data | {"S_error": np.full_like(S, np.inf)}),
        ("complex", data | {"S": S + 0j}),
        ("text", data | {"friction": np.array(["1.0", "1.0"])}),
        ("less", data | {"friction": -data["friction"]}),
        ("none", data | {"S": np.zeros((0, 0)), "p": np.zeros(0)}),
        ("no json", data | {"steps": np.array("[{")}),
        ("no list", data | {"steps": np.array('{"do": "pieces"}')}),
        ("no steps", data | {"steps": np.array("[3, null]")}),
        ("nan vectors", data | {"vectors": np.full((1, S.shape[0]), np.nan)}),
        ("format", data | {"format": np.array("dolfinx_contact proof 99")}),
    ):
        np.savez(folder / f"{name}.npz", **other)
        yield folder / f"{name}.npz"


def tried(folder):
    answers = []
    for path in files(folder):
        try:
            Certificate.load(path)
            answers.append((path.name, "accepted"))
        except InvalidCertificate:
            answers.append((path.name, "refused"))
        except Exception as error:
            answers.append((path.name, f"{type(error).__name__}: {error}"))
    ends = [(name, *run(folder / name)) for name in ("nan.npz", "folder.npz", "nothing.npz")]
    return answers, ends


def attack(case):
    answers, ends = on_root(case, tried)
    for name, word in answers:
        # A folder is refused by the system.
        case.true(f"{name}: refused, not {word}", word == "refused" or name == "folder.npz")
    for name, status, text in ends:
        case.true(f"{name}: {status}, {text}", status in (1, 2) and "Traceback" not in text)
    case.true("status 2 where there is none", ends[-1][1] == 2)


def honest(case):
    def moved(folder):
        (folder / "a folder").mkdir()
        path = folder / "a folder" / "my proof.npz"
        several().certificate.save(path)
        return run(path)

    case.true("the proof holds", on_root(case, moved)[0] == 0)
