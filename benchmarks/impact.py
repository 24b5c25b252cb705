# SPDX-License-Identifier: LGPL-3.0-or-later
"""What schemes, levels, theta and mass do to a bar that bounces, over elements and time steps.

Contact force and energy of `cases.bouncing_bar` against its exact solution. The library runs with
``--library`` elements; a numpy code (`tests/support/moving_bar.py`), from which the forces of the
library differ by round-off, as is measured here, runs them all. It also runs what the library
refuses. Then a bar that is thrown at a wall, over its elements, with orders, and two bars by the
library.

    python3 benchmarks/impact.py --output impact.json
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from mpi4py import MPI

import numpy as np
from timing import save

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import cases.bouncing_bar as demo
import cases.two_bars
from support.moving_bar import Bar

from dolfinx_contact.evolution import NSCD

SCHEMES = ("theta", "theta-euler", "modified-theta")
MASSES = ("redistributed", "lumped", "consistent")


def combinations():
    """Scheme, theta, level, mass and restitution."""
    for theta in (0.5, 0.52, 1.0):
        for scheme in SCHEMES if theta < 1 else SCHEMES[:1]:
            for mass in MASSES:
                yield scheme, theta, "position", mass, 0.0
                yield scheme, theta, "velocity", mass, 0.0
    yield "theta", 0.5, "velocity", "lumped", 1.0


def measured(times, force, energy):
    """Errors over the exact solution; those of impacts by impact."""
    found = demo.compared(times, force)
    exact = ((1.0, 5 / 3, 800 / 3), (11 / 3, 13 / 3, 800 / 3))
    found["energy"] = float(energy)
    found["impacts"] = [[float(x) for x in impact] for impact in found["impacts"]]
    found |= {"number_of_impacts": len(found["impacts"]), "impulse_error": None, "time_error": None}
    if len(found["impacts"]) == 2:
        off = np.abs(np.array(found["impacts"]) - exact)
        found |= {"impulse_error": off[:, 2].max() / (800 / 3), "time_error": off[:, :2].max()}
    names = {"force_error": "raw", "force_error_averaged": "averaged"}
    names |= {"force_error_largest": "largest"}
    return {
        names.get(k, k): float(v) if isinstance(v, np.floating) else v for k, v in found.items()
    }


def by_numpy(n, times, scheme, theta, level, mass, restitution):
    return Bar(n, mass).run(times, scheme, theta, level, restitution)


def by_library(comm, n, dt, scheme, theta, level, mass, restitution):
    """Times and forces, or why it is refused."""
    how = dict(scheme=scheme, theta=theta, level=level, mass=mass, restitution=restitution)
    problem = demo.bar(n, comm)
    try:
        motion = NSCD(problem, demo.DENSITY, dt=dt, **how)
    except ValueError as error:
        return None, str(error)
    history = motion.run([0.0, demo.PERIOD], progress=False)
    force = [s.result.tables["contact"].rn.sum() for s in history.steps]
    return np.array([0.0, *(s.time for s in history.steps)]), np.array(force)


def thrown(n, mass):
    """Errors of a bar thrown at a wall at its mean velocity, over exact values; dt = h/c."""
    speed = 10.0
    end = 1.2 * 2 * demo.LENGTH / demo.SPEED
    times = np.linspace(0.0, end, round(end * demo.SPEED * n / demo.LENGTH) + 1)
    force, _, energy = Bar(n, mass, weight=0.0, height=0.0, velocity=-speed).run(times)
    rebound = force.sum() * times[1] / demo.LENGTH - speed
    duration = times[np.flatnonzero(force > 150)[-1] + 1] / (2 * demo.LENGTH / demo.SPEED)
    start = demo.LENGTH * speed**2 / 2
    errors = (1 - rebound / speed, abs(1 - duration), 1 - energy[-1] / start)
    vibration = (energy[-1] - demo.LENGTH * rebound**2 / 2) / start
    names = ("rebound", "duration", "energy", "vibration")
    return dict(zip(names, map(float, (*errors, vibration)), strict=True))


def by_elements(rows):
    """Print a table of errors over elements, with orders between its rows."""
    names = [k for k in rows[0] if k not in ("case", "elements")]
    print(f"| case | elements | {' | '.join(names)} |")
    print("|" + (len(names) + 2) * "---|")
    for before, row in zip([None, *rows], rows, strict=False):
        cells = []
        for k in names:
            cells.append(f"{row[k]:.3g}")
            if before and before["case"] == row["case"] and min(before[k], row[k]) > 1e-9:
                ratio = row["elements"] / before["elements"]
                cells[-1] += f" ({np.log(before[k] / row[k]) / np.log(ratio):.2f})"
        print(f"| {row['case']} | {row['elements']} | {' | '.join(cells)} |", flush=True)


def two_bars(n):
    """Errors of the velocities of two bars after their impact, over that of the first."""
    with tempfile.TemporaryDirectory() as folder:
        found = cases.two_bars.main([f"--elements={n}", f"--output={folder}"])
    return {
        "velocity": abs(found["velocities"][0]) / cases.two_bars.SPEED,
        "duration": abs(1 - found["duration"] / (2 * cases.two_bars.LENGTH / cases.two_bars.C)),
        "vibration": found["vibration"],
    }


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--elements", type=int, nargs="+", default=[50, 100, 200, 400])
    parser.add_argument("--courant", type=float, nargs="+", default=[1.0, 0.5], help="c dt/h")
    parser.add_argument("--library", type=int, default=50, help="elements of the library's runs")
    parser.add_argument("--bars", type=int, nargs="*", default=[16, 32, 64], help="of two bars")
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    comm = MPI.COMM_WORLD
    record = []
    head = "scheme, theta, level, mass, e"
    columns = ("raw", "largest", "averaged", "impulse_error", "time_error", "energy", "oscillation")
    print(f"| {head} | elements | c dt/h | {' | '.join(columns)} | library differs by |")
    print("|" + (len(columns) + 4) * "---|")
    for how in combinations():
        name = "{}, {:g}, {}, {}, {:g}".format(*how)
        refused = None
        known = None
        if args.library:
            known = by_library(comm, args.library, demo.LENGTH / args.library / demo.SPEED, *how)
            refused = known[1] if known[0] is None else None
        for n in args.elements:
            for courant in args.courant:
                steps = round(demo.PERIOD * demo.SPEED * n / demo.LENGTH / courant)
                times = np.linspace(0.0, demo.PERIOD, steps + 1)
                differs = None
                with np.errstate(over="ignore", invalid="ignore"):
                    force, _, energy = by_numpy(n, times, *how)
                if known and not refused and n == args.library and courant == 1:
                    differs = float(np.abs(known[1] - force).max() / force.max())
                row = {"case": name, "elements": n, "courant": courant, "differs": differs}
                row |= measured(times, force, 1 + energy[-1] / demo.ENERGY) | {"refused": refused}
                record.append(row)
                values = ["-" if row[k] is None else f"{row[k]:.3g}" for k in columns]
                last = "refused" if refused else "" if differs is None else f"{differs:.1e}"
                print(f"| {name} | {n} | {courant:g} | {' | '.join(values)} | {last} |", flush=True)
    for reason in sorted({r["refused"] for r in record if r["refused"]}):
        print("refused:", reason)
    rows = [
        {"case": mass, "elements": n} | thrown(n, mass) for mass in MASSES for n in args.elements
    ]
    by_elements(rows)
    pairs = [{"case": "two bars", "elements": n} | two_bars(n) for n in args.bars]
    if pairs:
        by_elements(pairs)
    if args.output and comm.rank == 0:
        save(args.output, {"bouncing": record, "thrown": rows, "two_bars": pairs})
    return record


if __name__ == "__main__":
    main()
