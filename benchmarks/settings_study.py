# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which settings of multigrid and of the forcing are the fastest, and where?

Cold solves of bodies of other shapes, cells, materials, friction and loads than those of
`elasticity_ratio.py`: flat cells, rounded feet, plates, columns, P1 and P2, pairs, a neo-Hookean
body, friction 0 to 1, Poisson's ratio to 0.49. All settings take turns in one process. The table
has the processor seconds (of all ranks) of each over those of the default, Newton and Krylov
iterations, and hierarchies built; geometric means at the end. Two thirds of the cases are those
that settings are chosen by; ``--aside`` takes the others, which are for the end.

    python3 benchmarks/settings_study.py --output study.json
"""

from __future__ import annotations

import argparse
import fnmatch
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from timing import clean, save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Sphere,
)
from dolfinx_contact._inexact import Forcing
from dolfinx_contact.materials import LinearElastic, NeoHookean
from dolfinx_contact.meshing import join

CELLS = {
    "tet": mesh.CellType.tetrahedron,
    "hex": mesh.CellType.hexahedron,
    "tri": mesh.CellType.triangle,
    "quad": mesh.CellType.quadrilateral,
}
PREFIX = "study_"


@dataclass(frozen=True)
class Case:
    """A body and its data.

    Attributes:
        size: of the box.
        cells: along its edges.
        cell: their kind.
        degree: of the displacement.
        friction: coefficient.
        poisson: Poisson's ratio.
        material: linear or neo-Hookean.
        foot: how far the rim of the lower face lies above its middle; 0 for a flat one.
        sphere: radius of the sphere below; 0 for a plane.
        press: downward motion of the top.
        shift: sideways motion of the top.
        pair: whether the floor is an elastic body.
    """

    size: tuple[float, ...] = (1.0, 1.0, 1.0)
    cells: tuple[int, ...] = (18, 18, 18)
    cell: str = "tet"
    degree: int = 1
    friction: float = 0.3
    poisson: float = 0.3
    material: type = LinearElastic
    foot: float = 0.0
    sphere: float = 0.0
    press: float = 0.02
    shift: float = 0.004
    pair: bool = False


#: By name; those that begin with ``aside`` were not looked at when settings were chosen.
CASES = {
    "foot, F 0": Case(foot=0.05, friction=0.0),
    "foot, F 0.3": Case(foot=0.05),
    "foot, F 1": Case(foot=0.05, friction=1.0, shift=0.01),
    "flat cells 1:10": Case(size=(1.0, 1.0, 0.1), press=0.001, shift=0.001),
    "plate": Case(size=(1.0, 1.0, 0.05), cells=(44, 44, 4), foot=0.01, press=0.01, shift=0.001),
    "column": Case(size=(0.3, 0.3, 2.0), cells=(8, 8, 54), foot=0.01),
    "nu 0.45": Case(foot=0.05, poisson=0.45),
    "nu 0.49": Case(poisson=0.49, sphere=5.0),
    "hex, sphere": Case(cell="hex", sphere=10.0),
    "hex, nu 0.45, F 0.8": Case(cell="hex", poisson=0.45, friction=0.8, shift=0.02),
    "P2": Case(cells=(9, 9, 9), degree=2, foot=0.05),
    "hex Q2": Case(cells=(8, 8, 8), degree=2, cell="hex", sphere=10.0),
    "neo-Hookean": Case(material=NeoHookean, foot=0.05, press=0.1, shift=0.03),
    "pair": Case(pair=True, cells=(12, 12, 12)),
    "tri": Case(size=(1.0, 1.0), cells=(120, 120), cell="tri", foot=0.02),
    "quad, larger": Case(size=(2.0, 1.0), cells=(500, 250), cell="quad", foot=0.02),
    "larger, sphere": Case(cells=(32, 32, 32), sphere=10.0),
    "larger, hex": Case(cells=(32, 32, 32), cell="hex", foot=0.05),
    "aside flat cells 1:20": Case(size=(1.0, 1.0, 0.05), press=0.0005, shift=0.0005),
    "aside foot, F 0.6": Case(foot=0.1, friction=0.6, press=0.05, shift=0.03),
    "aside nu 0.49": Case(poisson=0.49, foot=0.03),
    "aside hex plate": Case(
        size=(1.0, 1.0, 0.1), cells=(36, 36, 5), cell="hex", foot=0.01, press=0.01, shift=0.001
    ),
    "aside P2, sphere": Case(cells=(10, 10, 10), degree=2, sphere=5.0, friction=0.5),
    "aside pair, F 0.8": Case(pair=True, cells=(14, 14, 10), friction=0.8, shift=0.01),
    "aside neo-Hookean hex": Case(
        cell="hex", material=NeoHookean, foot=0.1, press=0.08, friction=0.5
    ),
    "aside larger, foot": Case(cells=(30, 30, 36), foot=0.05, friction=0.5),
    "aside quad": Case(size=(2.0, 1.0), cells=(200, 100), cell="quad", foot=0.02, friction=0.7),
}


OLD = Forcing(largest=1e-1, first=3e-2, reserve=0.01, near=1.0)
#: By name, PETSc options of the hierarchy and a forcing (None for the default).
SETTINGS = {
    "default": ({}, None),
    "plain": ({"pc_gamg_agg_nsmooths": 0}, None),
    "V": ({"pc_mg_cycle_type": "v", "pc_gamg_coarse_eq_limit": 50}, None),
    "coarse 200": ({"pc_gamg_coarse_eq_limit": 200}, None),
    "largest 0.01": ({}, Forcing(largest=1e-2)),
    "looks 0.1": ({}, Forcing(looks=1e-1)),
    "plain, aggressive 2": ({"pc_gamg_agg_nsmooths": 0, "pc_gamg_aggressive_coarsening": 2}, None),
    "smoothed": ({"pc_gamg_agg_nsmooths": 1, "pc_gamg_aggressive_coarsening": 1}, None),
    "smoothed, aggressive 2": (
        {"pc_gamg_agg_nsmooths": 1, "pc_gamg_aggressive_coarsening": 2},
        None,
    ),
    "smoothed, old forcing": (
        {"pc_gamg_agg_nsmooths": 1, "pc_gamg_aggressive_coarsening": 1},
        OLD,
    ),
    "plain, old forcing": ({"pc_gamg_agg_nsmooths": 0}, OLD),
}


def box(comm, case, low):
    """A box with its lower face at ``low``, in the middle at least."""
    dim = len(case.size)
    corners = [[0.0] * (dim - 1) + [low], [*case.size[:-1], low + case.size[-1]]]
    make = mesh.create_rectangle if dim == 2 else mesh.create_box
    domain = make(comm, corners, list(case.cells), CELLS[case.cell])
    return domain


def bend(domain, case):
    """Round the lower face of a box."""
    dim = len(case.size)
    x = domain.geometry.x
    middle = np.array(case.size[:-1]) / 2
    away = np.sum(((x[:, : dim - 1] - middle) / middle) ** 2, axis=1) / (dim - 1)
    x[:, dim - 1] += case.foot * away * (1 - x[:, dim - 1] / case.size[-1])


def facets_at(domain, height):
    dim = domain.topology.dim
    return mesh.locate_entities_boundary(
        domain, dim - 1, lambda x: np.isclose(x[dim - 1], height, atol=1e-12)
    )


def problem_of(comm, case, options):
    """The contact problem of a case, made anew."""
    dim = len(case.size)
    if case.pair:
        return _pair_of(comm, case, options)
    domain = box(comm, case, 0.0)
    bottom = facets_at(domain, 0.0)
    top = facets_at(domain, case.size[-1])
    bend(domain, case)
    V = fem.functionspace(domain, ("Lagrange", case.degree, (dim,)))
    u = fem.Function(V)
    normal = (0.0,) * (dim - 1) + (1.0,)
    obstacle = HalfSpace((0.0,) * dim, normal)
    if case.sphere:
        center = [*(s / 2 for s in case.size[:-1]), -case.sphere]
        obstacle = Sphere(tuple(center), case.sphere)
    surface = ContactSurface(u, bottom, obstacle=obstacle, law=Coulomb(case.friction))
    bcs = [_moved(case, V, top)]
    return _problem(case, u, [surface], bcs, options)


def _pair_of(comm, case, options):
    """The box on another that is wider, with a coarser mesh."""
    coarser = tuple(max(2 * n // 3 + 2, 2) for n in case.cells)
    base = Case(size=(1.5, 1.5, 1.0), cells=coarser, cell=case.cell)
    lower = box(comm, base, -1.0)
    lower.geometry.x[:, :2] -= 0.25
    upper = box(comm, case, 0.0)
    tags = []
    for domain, heights in ((lower, (-1.0, 0.0)), (upper, (0.0, case.size[-1]))):
        found = [facets_at(domain, z) for z in heights]
        values = np.repeat(np.array([1, 2], dtype=np.int32), [len(f) for f in found])
        values += 2 if domain is upper else 0
        facets = np.concatenate(found)
        order = np.argsort(facets)
        tags.append(mesh.meshtags(domain, 2, facets[order], values[order]))
    both = join([lower, upper], facet_tags=tags)
    V = fem.functionspace(both.mesh, ("Lagrange", case.degree, (3,)))
    u = fem.Function(V)
    pair = ContactPair(u, both.facet_tags, slave=3, master=2, law=Coulomb(case.friction))
    held = fem.locate_dofs_topological(V, 2, both.facet_tags.find(1))
    bcs = [
        _moved(case, V, both.facet_tags.find(4)),
        fem.dirichletbc(np.zeros(3), held, V),
    ]
    return _problem(case, u, [pair], bcs, options)


def _moved(case, V, top):
    dim = len(case.size)
    value = np.zeros(dim)
    value[0] = case.shift
    value[-1] = -case.press
    return fem.dirichletbc(value, fem.locate_dofs_topological(V, dim - 1, top), V)


def _problem(case, u, surfaces, bcs, options):
    linear = LinearElastic.from_young(1.0, case.poisson)
    energy = case.material(linear.lmbda, linear.mu).energy(u) * ufl.dx
    given = {"linear_solver": "amg", "snes_rtol": 1e-8}
    given |= {f"amg_{name}": value for name, value in options.items()}
    return ContactProblem(
        energy, u, surfaces, bcs=bcs, petsc_options=given, petsc_options_prefix=PREFIX
    )


def run(comm, case, setting):
    """A cold solve, with its construction."""
    options, forcing = SETTINGS[setting]
    clean(comm)
    comm.barrier()
    start = time.process_time()
    problem = problem_of(comm, case, options)
    made = time.process_time()
    if forcing is not None:
        problem.linear_solver.forcing = forcing
    result = problem.solve()
    comm.barrier()
    end = time.process_time()
    solver = problem.linear_solver
    record = {
        "seconds": comm.allreduce(end - made),
        "construction": comm.allreduce(made - start),
        "newton": sum(a.iterations for a in result.attempts),
        "krylov": sum(a.krylov_iterations for a in result.attempts),
        "builds": getattr(solver, "builds", 0),
        "strategy": result.reason,
        "solver": solver.name,
        "unknowns": result.dofs,
        "counts": result.counts,
    }
    for name in PETSc.Options().getAll():
        if name.startswith(PREFIX):
            PETSc.Options().delValue(name)
    return record


def main(argv: list[str] | None = None, tell: Callable[[str], None] = print) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--aside", action="store_true", help="the cases that were set aside")
    parser.add_argument("--cases", nargs="+", default=["*"], help="names or patterns")
    parser.add_argument("--settings", nargs="+", default=["*"], help="names or patterns")
    parser.add_argument("--repeats", type=int, default=2, help="timed runs; the fastest counts")
    parser.add_argument("--output", default="settings_study.json")
    args, _ = parser.parse_known_args(argv)
    comm = MPI.COMM_WORLD
    logging.getLogger("dolfinx_contact").setLevel(logging.ERROR)
    names = [
        n
        for n in CASES
        if n.startswith("aside") == args.aside and any(fnmatch.fnmatch(n, p) for p in args.cases)
    ]
    settings = [s for s in SETTINGS if any(fnmatch.fnmatch(s, p) for p in args.settings)]
    table = {}
    for name in names:
        rows = {s: run(comm, CASES[name], s) for s in settings}  # compiles, and touches memory
        for _ in range(args.repeats):
            for s in settings:
                record = run(comm, CASES[name], s)
                if record["seconds"] < rows[s]["seconds"] or not rows[s].get("timed"):
                    rows[s] = {**record, "timed": True}
        table[name] = rows
        if comm.rank == 0:
            _show(name, rows, settings, tell)
    if comm.rank == 0:
        for s in settings:
            over = [
                rows[s]["seconds"] / rows[settings[0]]["seconds"]
                for rows in table.values()
                if rows[s]["solver"] == "amg"
            ]
            if over:
                mean = float(np.exp(np.mean(np.log(over))))
                worst = max(over)
                tell(f"{s:28s} {mean:.2f} times {settings[0]} in the mean, {worst:.2f} at worst")
        save(args.output, table)


def _show(name, rows, settings, tell):
    first = rows[settings[0]]
    tell(f"{name}: {first['unknowns']} unknowns, {first['counts']}")
    for s, r in rows.items():
        strategy = "" if r["strategy"] == "full steps" else f", {r['strategy']}"
        solver = "" if r["solver"] == "amg" else f", {r['solver']}"
        tell(
            f"  {s:28s} {r['seconds']:6.2f} s ({r['seconds'] / first['seconds']:.2f}), "
            f"{r['newton']:3d} Newton {r['krylov']:4d} Krylov {r['builds']} built"
            f"{strategy}{solver}"
        )


if __name__ == "__main__":
    main()
