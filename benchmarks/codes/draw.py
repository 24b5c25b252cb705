# SPDX-License-Identifier: LGPL-3.0-or-later
"""The picture of the results: how far every answer is from the contact law, by problem and code.

docker/run python3 benchmarks/codes/draw.py benchmarks/codes/results.json docs/images/codes.png
"""

from __future__ import annotations

import json
import sys

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
from run import CODES, PROBLEMS, figures_of

_LEAST, _MOST = 1e-16, 3.0
_MARKS = {"recommended": ("o", "none", 0.14), "tuned": ("o", "tab:blue", -0.14)}


def worst(record):
    """The largest figure of an answer, or None without one."""
    figures = record.get("figures")
    return figures and min(max(*(figures[f] for f in figures_of(record["problem"])), _LEAST), 1.0)


def draw(records, path):
    """Write the picture."""
    names = list(CODES)
    figure, axes = plt.subplots(3, 3, figsize=(11, 7.6), sharex=True, sharey=True)
    for ax, problem in zip(axes.flat, PROBLEMS, strict=True):
        ax.set_title(problem, fontsize=10)
        ax.set_xscale("log")
        ax.set_xlim(_LEAST / 5, _MOST)
        ax.set_ylim(-0.5, len(names) - 0.5)
        ax.grid(axis="x", color="0.9")
        for record in records:
            if record["problem"] != problem:
                continue
            mark, face, up = _MARKS[record["way"]]
            at = len(names) - 1 - names.index(record["code"]) + up
            value = worst(record)
            if value is None:
                ax.plot(1.0, at, marker="x", color="0.6")
                continue
            if record["record"].get("mu") == 0:
                mark = "^"
            edge = "tab:blue" if record["record"]["converged"] else "tab:red"
            face = face if face == "none" else edge
            ax.plot(value, at, marker=mark, markerfacecolor=face, markeredgecolor=edge)
        ax.set_yticks(range(len(names)), [CODES[n].title.split(" (")[0] for n in names[::-1]])
    for ax in axes[-1]:
        ax.set_xlabel("largest figure of the judge")
    figure.text(
        0.01, 0.01,
        "hollow: recommended settings; full: tuned; blue: it says it succeeded; red: it says it "
        "did not; triangle: solved without friction; grey cross: no answer",
        fontsize=8,
    )  # fmt: skip
    figure.tight_layout(rect=(0, 0.03, 1, 1))
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    with open(sys.argv[1]) as file:
        draw(json.load(file)["runs"], sys.argv[2])
