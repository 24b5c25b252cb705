# SPDX-License-Identifier: LGPL-3.0-or-later
"""Branches side by side with GetFEM: time per step, and of all rays of a degenerate point.

Two examples of Ligursky and Renard: the linear triangle with 64 contact nodes and the block of
Ciarlet and Geymonat's material. In every repetition GetFEM makes some steps, then this package
does, so that what else the machine does hits both. Seconds are of the clock, `cpu` of the
processor; a ratio is GetFEM's figure over ours. Nothing is asked of GetFEM that takes longer than a
time limit; what was cut off is a lower bound and is called one.

    python3 benchmarks/branches_vs_getfem.py --output branches.json
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

import cases.ciarlet_geymonat
import numpy as np
from cases._triangle import linear_triangle
from getfem_side import GetFEM

from dolfinx_contact.continuation import StepControl, explore
from dolfinx_contact.continuation.cone_rays import outgoing
from dolfinx_contact.continuation.follow import follower_for
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.reduced.reduction import Reduction

LOAD = (26.0, 7.5)
LAME = (100.0, 82.0)
FRICTION = 1.7
#: The second load of the triangle: pressed by a constant traction, sheared to and fro.
PRELOAD = (0.0, -7.5)
SHEAR = (26.0, 0.0)
#: GetFEM's augmentation parameters and tolerances of the two problems.
TRIANGLE = {"max_res": 5e-10, "max_diff": 5e-10, "max_res_solve": 1e-10}
BLOCK = {"max_res": 5e-8, "max_diff": 5e-8, "max_res_solve": 1e-8}
R_TRIANGLE = 10.0
R_BLOCK = 100.0
PARTS = ("triangle-steps", "triangle-kinks", "triangle-rays", "block-steps", "block-rays")


class Stopwatch(Observer):
    """Seconds and linear algebra between the points of a branch, and what is special about each."""

    def __init__(self, bordered):
        self._bordered = bordered

    def begin(self, task, state):
        self.steps = []
        self._last = None

    def step(self, step, state):
        if self._last is not None:
            passed = zip(self._last, self._now(), strict=True)
            wall, cpu, factorisations, solves = (b - a for a, b in passed)
            self.steps.append(
                {
                    "wall": wall,
                    "cpu": cpu,
                    "factorisations": factorisations,
                    "solves": solves,
                    "gamma": step.point.gamma,
                    "kinds": [s.kind for s in step.special],
                }
            )
        self._last = self._now()

    def _now(self):
        b = self._bordered
        return time.perf_counter(), time.process_time(), b.solver.factorisations, b.solver.solves


def timed(function):
    """What a function returns, and its seconds as the stopwatch writes them."""
    wall = time.perf_counter()
    cpu = time.process_time()
    value = function()
    return value, {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}


def summary(samples):
    """Median and minimum of times."""
    if not samples:
        return None
    wall, cpu = ([s[key] for s in samples] for key in ("wall", "cpu"))
    return {
        "samples": len(samples),
        "median_seconds": float(np.median(wall)),
        "minimum_seconds": min(wall),
        "median_cpu_seconds": float(np.median(cpu)),
        "minimum_cpu_seconds": min(cpu),
    }


def ratios(getfem, ours, *, lower_bound=False):
    """GetFEM's times over ours, with numerators and denominators."""
    if getfem is None or ours is None:
        return None
    found = {"lower_bound": lower_bound}
    for key, name in (
        ("median_seconds", "median"),
        ("minimum_seconds", "minimum"),
        ("median_cpu_seconds", "median_cpu"),
        ("minimum_cpu_seconds", "minimum_cpu"),
    ):
        found[f"{name}_numerator"] = getfem[key]
        found[f"{name}_denominator"] = ours[key]
        found[f"{name}_ratio"] = getfem[key] / ours[key]
    return found


def per(times, count):
    """A summary divided by a number of steps."""
    return {k: v / count if k != "samples" else v for k, v in times.items()}


def start_of(system, gamma, statuses=None):
    """A solution, found by Newton's method, with these statuses if there is one."""
    system.set_parameter(gamma)
    expected = [] if statuses is None else [[system.piece_of(statuses).codes]]
    system.problem.solve(expected=expected)
    x = system.create_vector()
    system.problem.write(x)
    return x


def our_steps(system, x, gamma, gamma_range, *, route, count=1000, direction="increasing"):
    """A branch with the seconds of its steps and its counts of linear algebra."""
    scale = gamma_range[1] - gamma_range[0]
    with follower_for(system, x, gamma, StepControl(), gamma_scale=scale, route=route) as follower:
        watch = Stopwatch(follower.bordered)
        point = follower.start(x, gamma, direction=direction)
        branch = follower.run(point, gamma_range=gamma_range, max_steps=count, observer=watch)
    return branch, watch.steps


def counts(steps):
    """Factorisations and solves per step, with and without something special."""
    found = {}
    events = [s for s in steps if s["kinds"]]
    for name, part in (("plain", plain(steps)), ("with_event", events), ("all", steps)):
        if part:
            found[name] = {"steps": len(part)} | {
                f"{key}_per_step": sum(s[key] for s in part) / len(part)
                for key in ("factorisations", "solves")
            }
    return found


def plain(steps):
    """Steps without anything special."""
    return [s for s in steps if not s.get("kinds") and not s.get("label")]


# -- time per step -------------------------------------------------------------------------------


def plain_steps(system, x, side, gamma, gamma_range, args, *, direction):
    """Plain steps with detection on from one start on either side, repeated in turn."""
    theirs = []
    mine = []
    our_steps(system, x, gamma, gamma_range, route="steps", count=2, direction=direction)
    for _ in range(args.repeats):
        theirs += [side.ask("step", limit=args.limit) for _ in range(args.steps)]
        _, steps = our_steps(
            system, x, gamma, gamma_range, route="steps", count=args.steps, direction=direction
        )
        mine += steps
    getfem = summary(plain(theirs))
    ours = summary(plain(mine))
    return {
        "getfem": getfem,
        "ours": ours,
        "ours_with_event": summary([s for s in mine if s["kinds"]]),
        "linear_algebra": counts(mine),
        "speedup": ratios(getfem, ours),
    }


def triangle_side(args, preload=(0.0, 0.0), load=LOAD):
    """The triangle in GetFEM, whose traction at gamma is preload - gamma load."""
    end = (np.array(preload) - np.array(load)).tolist()
    parameters = {"friction": FRICTION, "lame": LAME, "start": preload, "end": end}
    return GetFEM("triangle", n=args.n, r=R_TRIANGLE, **parameters)


def triangle_steps(args):
    """Seed load, from gamma = -1 towards 0: nothing happens on the way."""
    system = linear_triangle(args.n, FRICTION)
    side = triangle_side(args)
    side.ask("solve", gammas=[-1.0], tolerance=TRIANGLE["max_res"])
    # Steps that are long enough would come to gamma = 0 at once.
    side.ask("begin", sense=1.0, h_max=0.02, **TRIANGLE)
    x = start_of(system, -1.0)
    found = plain_steps(system, x, side, -1.0, (-1.0, 1.0), args, direction="increasing")
    side.close()
    condensations = []
    segments = []
    for _ in range(args.repeats):
        condensations.append(timed(lambda: condensation(system, x, -1.0))[1])
        segments += our_steps(system, x, -1.0, (-1.0, -0.5), route="pivoting")[1]
    found["condensation"] = summary(condensations)
    found["one_segment"] = summary(segments)
    found["segment_speedup"] = ratios(found["getfem"], found["one_segment"])
    return found


def condensation(system, x, gamma):
    """The problem condensed onto its contact points, anew."""
    Reduction(system, x, gamma, exact=True)


def triangle_kinks(args):
    """A pressed triangle sheared to and fro: many changes of status, one after the other."""
    system = linear_triangle(args.n, FRICTION, SHEAR, preload=PRELOAD)
    x = start_of(system, -1.0)
    side = triangle_side(args, PRELOAD, SHEAR)
    side.ask("solve", gammas=[-1.0], tolerance=TRIANGLE["max_res"])
    side.ask("begin", sense=1.0, **TRIANGLE)
    same_start = (
        side.ask("statuses")["status"] == system.letters(system.piece_at(x, -1.0))[: args.n]
    )
    theirs = []
    totals = []
    vertices = []
    stepped = []
    condensations = []
    begun = time.monotonic()
    cut = ""
    branches = {}
    our_steps(system, x, -1.0, (-1.0, 1.0), route="pivoting")
    for repeat in range(args.repeats):
        while not cut and len(theirs) < args.kink_steps * (repeat + 1) // args.repeats:
            left = args.limit - (time.monotonic() - begun)
            try:
                theirs.append(side.ask("step", limit=left))
            except TimeoutError:
                cut = f"stopped after {args.limit:g} s"
            if theirs and (theirs[-1]["failed"] or theirs[-1]["gamma"] >= 1.0):
                cut = "a step failed" if theirs[-1]["failed"] else "gamma reached 1"
        condensations.append(timed(lambda: condensation(system, x, -1.0))[1])
        for route in ("pivoting", "steps"):
            (branches[route], steps), total = timed(
                lambda r=route: our_steps(system, x, -1.0, (-1.0, 1.0), route=r)
            )
            if route == "pivoting":
                totals.append(total)
                vertices += steps
            else:
                stepped += steps
    side.close()
    events = [s.gamma for s in branches["pivoting"].special]
    both = [s.gamma for s in branches["steps"].special]
    agree = len(events) == len(both) and float(np.abs(np.subtract(events, both)).max()) < 1e-8
    reached = theirs[-1]["gamma"]
    passed = sum(-1.0 < g < reached for g in events)
    every = {key: sum(s[key] for s in theirs) for key in ("wall", "cpu")}
    getfem_plain = summary(plain(theirs))
    getfem_mean = per(summary([every]), len(theirs))
    per_vertex = per(summary(totals), len(events))
    with_condensation = per(
        summary([{k: t[k] + c[k] for k in t} for t, c in zip(totals, condensations, strict=True)]),
        len(events),
    )
    mean_steps = {key: sum(s[key] for s in stepped) / args.repeats for key in ("wall", "cpu")}
    found = {
        "same_start": same_start,
        "events": len(events),
        "routes_agree": agree,
        "getfem": {
            "steps": len(theirs),
            "ended": cut or "the budget of steps was used",
            "gamma": reached,
            "events_passed": passed,
            "step": getfem_plain,
            "mean_step": getfem_mean,
            "seconds": every["wall"],
            "longest_step_seconds": max(s["wall"] for s in theirs),
        },
        "condensation": summary(condensations),
        "vertex": summary(vertices),
        "per_vertex": per_vertex,
        "per_vertex_with_condensation": with_condensation,
        "steps_route": {
            "plain": summary(plain(stepped)),
            "with_event": summary([s for s in stepped if s["kinds"]]),
            "linear_algebra": counts(stepped),
        },
        "vertex_speedup": ratios(getfem_plain, per_vertex),
        "vertex_with_condensation_speedup": ratios(getfem_plain, with_condensation),
        "plain_step_speedup": ratios(getfem_plain, summary(plain(stepped))),
        "mean_step_speedup": ratios(
            getfem_mean, per(summary([mean_steps]), len(stepped) // args.repeats)
        ),
    }
    if passed:
        found["event_speedup"] = ratios(per(summary([every]), passed), per_vertex)
        found["event_steps_route_speedup"] = ratios(
            per(summary([every]), passed), per(summary([mean_steps]), len(events))
        )
    return found


def block_steps(args):
    """The block from gamma = 1 down."""
    system = cases.ciarlet_geymonat.block(args.nx, 2 * args.nx, 1.0)
    side = GetFEM("block", nx=args.nx, ny=2 * args.nx, friction=1.0, r=R_BLOCK)
    side.ask("solve", gammas=np.linspace(0.1, 1.0, 10).tolist(), tolerance=BLOCK["max_res"])
    side.ask("begin", sense=-1.0, **BLOCK)
    statuses = side.ask("statuses")["status"]
    x = start_of(system, 1.0, statuses)
    same_start = statuses == system.letters(system.piece_at(x, 1.0))
    found = plain_steps(system, x, side, 1.0, (-1.0, 1.0), args, direction="decreasing")
    side.close()
    return {"same_start": same_start, "dofs": {"getfem": side.size, "ours": x.getSize()}, **found}


# -- all rays of the degenerate point ------------------------------------------------------------


def getfem_rays(args, make, gammas, sense, tolerances):
    """GetFEM's search for branches at gamma = 0, for some numbers of spans of directions."""
    found = []
    for spans in args.spans:
        side = make()
        side.ask("solve", gammas=gammas, tolerance=tolerances["max_res"])
        side.ask("begin", sense=sense, nb_span=spans, **tolerances)
        record = {"spans": spans, "tangents": None, "lower_bound": False, "approach_steps": 0}
        wall = cpu = 0.0
        while True:
            begun = time.perf_counter()
            try:
                step = side.ask("step", limit=args.limit)
            except TimeoutError as stopped:
                spent = {"wall": time.perf_counter() - begun, "cpu": stopped.args[0]}
                record |= {"search": spent, "lower_bound": True}
                break
            if "tangents" in step:
                record |= {"search": {k: step[k] for k in ("wall", "cpu")}}
                record |= {"tangents": step["tangents"], "gamma": step["at"]}
                break
            if step["failed"] or sense * step["gamma"] > 1e-6:
                # It went on without noticing that there are branches.
                record |= {"search": {k: step[k] for k in ("wall", "cpu")}}
                record["passed_by"] = True
                break
            record["approach_steps"] += 1
            wall = wall + step["wall"]
            cpu = cpu + step["cpu"]
        record["approach"] = {"wall": wall, "cpu": cpu}
        side.close()
        print("GetFEM", record, flush=True)
        found.append(record)
    return found


def rays(args, system, start, make, gammas, sense, tolerances):
    """The degenerate point: the step that resolves it, the bare search, the whole diagram."""
    x = start_of(system, start)
    theirs = getfem_rays(args, make, gammas, sense, tolerances)
    at_zero = system.create_vector()
    routes = ["pivoting", "steps"] if system.is_piecewise_affine else ["steps"]
    bare = []
    steps = {r: [] for r in routes}
    explored = {r: [] for r in routes}
    number = set()
    direction = "increasing" if start < 0 else "decreasing"
    for _ in range(args.repeats):
        ways, seconds = timed(lambda: bare_search(system, at_zero))
        bare.append(seconds)
        number.add(len(ways.rays))
        for route in routes:
            begin = x if route == "pivoting" else start_of(system, 0.02 * start)
            gamma = start if route == "pivoting" else 0.02 * start
            _, times = our_steps(
                system, begin, gamma, (-1.0, 1.0), route=route, count=100, direction=direction
            )
            steps[route] += [s for s in times if "bifurcation" in s["kinds"]]
            diagram, seconds = timed(
                lambda r=route: explore(system, [(x, start)], gamma_range=(-1.0, 1.0), route=r)
            )
            explored[route].append(
                seconds
                | {
                    "branches": len(diagram.edges),
                    "rays": [len(node.rays) for node in diagram.nodes],
                    "points": sum(len(b.points) for b in diagram.branches),
                    "factorisations": sum(b.factorisations for b in diagram.branches),
                    "solves": sum(b.solves for b in diagram.branches),
                }
            )
    found = {
        "getfem": theirs,
        "rays": sorted(number),
        "method": ways.method,
        "complete": ways.complete,
        "bare_search": summary(bare),
        "step_with_all_rays": {r: summary(s) for r, s in steps.items()},
        "explore": {r: summary(e) for r, e in explored.items()},
        "explored": {r: e[-1] for r, e in explored.items()},
    }
    for record in theirs:
        name = f"spans_{record['spans']}"
        search = summary([record["search"]])
        less = record["lower_bound"]
        found[name] = {
            "rays_of_getfem": record["tangents"],
            "bare_search": ratios(search, found["bare_search"], lower_bound=less),
        } | {
            r: {
                "step": ratios(search, found["step_with_all_rays"][r], lower_bound=less),
                "whole_explore": ratios(search, found["explore"][r], lower_bound=less),
            }
            for r in routes
        }
    return found


def bare_search(system, x):
    """Condensation at the undeformed state and the rays of its tangent cone."""
    condensed = Reduction(system, x, 0.0, exact=False)
    return outgoing(condensed.system.tangent_cone(condensed.contract(x), 1e-12))


def triangle_rays(args):
    system = linear_triangle(args.n, FRICTION)
    gammas = [-1.0, -0.02]
    return rays(args, system, -1.0, lambda: triangle_side(args), gammas, 1.0, TRIANGLE)


def block_rays(args):
    system = cases.ciarlet_geymonat.block(args.nx, 2 * args.nx, 1.0)

    def side():
        return GetFEM("block", nx=args.nx, ny=2 * args.nx, friction=1.0, r=R_BLOCK)

    gammas = np.linspace(0.01, 0.05, 5).tolist()
    return rays(args, system, 1.0, side, gammas, -1.0, BLOCK)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", default="branches_vs_getfem.json")
    parser.add_argument("--part", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--n", type=int, default=64, help="contact nodes of the triangle")
    parser.add_argument("--nx", type=int, default=20, help="cells of the block, nx * 2 nx")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--steps", type=int, default=10, help="plain steps of a repetition")
    parser.add_argument("--kink-steps", type=int, default=45, help="GetFEM's, many kinks")
    parser.add_argument(
        "--spans", type=int, nargs="+", default=[1, 5], help="spans of directions of its search"
    )
    parser.add_argument("--limit", type=float, default=300.0, help="seconds for GetFEM's searches")
    args = parser.parse_args()
    parts = {
        "triangle-steps": triangle_steps,
        "triangle-kinks": triangle_kinks,
        "triangle-rays": triangle_rays,
        "block-steps": block_steps,
        "block-rays": block_rays,
    }
    record = {"arguments": vars(args), "cores": os.cpu_count(), "load_average": {}}
    for part in args.part:
        record["load_average"][part] = os.getloadavg()[0]
        record[part] = parts[part](args)
        print(part, json.dumps(record[part], indent=1), flush=True)
        Path(args.output).parent.mkdir(parents=True, exist_ok=True)
        Path(args.output).write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
