# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures: how far every answer is from the contact law, by problem and code; and the problems.

docker/run python3 benchmarks/codes/draw.py benchmarks/codes/results.json docs/images/codes.png
docker/run python3 benchmarks/codes/draw.py output/codes docs/images/codes_problems.png

The second has this package's answers in a folder of `run.py`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from problems import Problem
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
    figure, axes = plt.subplots(3, 4, figsize=(13, 7.6), sharex=True, sharey=True)
    axes.flat[-1].set_axis_off()
    for ax, problem in zip(axes.flat, PROBLEMS, strict=False):
        ax.set_title(problem, fontsize=10)
        ax.set_xscale("log")
        ax.set_xlim(_LEAST / 5, _MOST)
        ax.set_ylim(-0.5, len(names) - 0.5)
        ax.grid(axis="x", color="0.9")
        for record in records:
            if record["problem"] != problem or record["way"] not in _MARKS:
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


#: Steps that are drawn, of those with many; bodies drawn where they are; what is seen of one.
_STEP = {"bar": 100, "cyclic": 1}
_AS_IT_IS = ("roller", "bar", "ironing")
_SEEN = {"roller": ((-25, 25), (-25, 25))}


def draw_problems(folder, path):
    """Write a picture of the displacements of every problem, in units of the largest."""
    figure, axes = plt.subplots(3, 4, figsize=(13, 8.5))
    for ax in axes.flat:
        ax.set_axis_off()
    for ax, name in zip(axes.flat, PROBLEMS, strict=False):
        problem = Problem.load(folder / f"{name}.npz")
        with np.load(folder / f"{name}-ours-recommended.npz") as answer:
            u = answer["u"][_STEP.get(name, -1)]
        if problem.dim == 3:
            shown = draw_base(ax, problem, u)
        else:
            shown = draw_body(ax, problem, u, 1.0 if name in _AS_IT_IS else None)
        ax.set_title(f"{name}: {shown}", fontsize=9)
        for limits, put in zip(_SEEN.get(name, ()), (ax.set_xlim, ax.set_ylim), strict=False):
            put(limits)
    figure.tight_layout()
    figure.savefig(path, dpi=100)


def draw_body(ax, problem, u, factor):
    """The cells of a plane body where they have moved to, by the size of displacements."""
    size, length = np.ptp(problem.x, axis=0).max(), np.abs(u).max()
    factor = factor or 0.08 * size / length
    at = problem.x + factor * u
    values = np.linalg.norm(u[problem.cells].mean(axis=1), axis=1)
    width = 0.0 if problem.name == "roller" else 0.2
    cells = PolyCollection(at[problem.cells], array=values, cmap="viridis", lw=width, ec="k")
    ax.add_collection(cells)
    if not len(problem.master_faces):
        along = np.array([problem.normal[1], -problem.normal[0]])
        middle = problem.x[problem.contact].mean(axis=0)
        middle = middle - ((middle - problem.point) @ problem.normal) * problem.normal
        ends = middle + np.outer([-0.8, 0.8], size * along)
        ax.plot(*ends.T, color="k", lw=1)
    ax.autoscale_view()
    ax.set_aspect("equal")
    return f"displacements times {factor:.2g}"


def draw_base(ax, problem, u):
    """The lower face of a block, by the size of its slip over the largest displacement."""
    slip = np.linalg.norm(u[problem.contact][:, :2], axis=1) / np.abs(u).max()
    place = problem.x[problem.contact]
    picture = ax.tripcolor(place[:, 0], place[:, 1], slip, cmap="viridis", shading="gouraud")
    ax.set_aspect("equal")
    ax.figure.colorbar(picture, ax=ax, shrink=0.7)
    return "slip of its base over L"


def main(source, path):
    if Path(source).is_dir():
        draw_problems(Path(source), path)
        return
    with open(source) as file:
        draw(json.load(file)["runs"], path)


if __name__ == "__main__":
    main(*sys.argv[1:])
