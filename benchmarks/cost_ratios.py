# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of a frictional solve relative to a linear elastic solve, for many cases.

The cases vary the friction coefficient and the load of a cube on a plane, the shape of the body (a
rocker with a curved face), the degree of the elements, and the obstacle (a second body). Each ratio
is measured as in `elasticity_ratio.py` and `pair_ratio.py`: both solves run in turns in one
process, and the elastic solve has the fastest of several multigrid settings. The ratio is that of
processor times, summed over ranks, because they depend less on other work of the machine.

    docker/run python3 benchmarks/cost_ratios.py --output cost_ratios.json
    docker/run mpirun -n 2 python3 benchmarks/cost_ratios.py --output cost_ratios_2.json
"""

from __future__ import annotations

import argparse

from mpi4py import MPI

import elasticity_ratio
import numpy as np
import pair_ratio
from elasticity_ratio import BLOCK, CELLS, Case
from timing import save

from dolfinx import fem, mesh

#: Downward and sideways motion of the top, relative to the height of the body.
LOADS = {
    "pressed": (0.02, 0.0),
    "pressed and dragged": (0.02, 0.004),
    "dragged": (0.01, 0.02),
}
FRICTIONS = (0.1, 0.3, 0.7)
LENGTH = 3.0  # of the rocker, relative to its height
DEPTH = 0.02  # height of the ends of its lower face


def rocker(args, n, comm):
    """Return the space and the lower and upper facets of a rocker of 3 n x n x n cells."""
    sizes = [[0, 0, 0], [LENGTH, 1, 1]]
    domain = mesh.create_box(comm, sizes, [round(LENGTH) * n, n, n], CELLS[args.cell])
    bottom, top = (
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z)) for z in (0, 1)
    )
    x = domain.geometry.x
    x[:, 2] += DEPTH * (1 - x[:, 2]) * (2 * x[:, 0] / LENGTH - 1) ** 2
    return fem.functionspace(domain, ("Lagrange", args.degree, (3,))), bottom, top


def cases(n):
    """Return names, kinds and arguments of all cases; n is the number of cells of an edge."""
    common = ["--settings", "few"]
    result = []
    for load, (press, shift) in LOADS.items():
        for friction in FRICTIONS:
            values = {"n": n, "press": press, "shift": shift, "friction": friction}
            result.append((f"cube, {load}, F = {friction}", BLOCK, values))
    drag = {"press": 0.02, "shift": 0.004, "friction": 0.3}
    curved = Case(rocker, elasticity_ratio.elasticity, elasticity_ratio.contact_problem)
    result += [
        ("rocker", curved, {"n": round(n * LENGTH ** (-1 / 3)), **drag}),
        ("cube, P2", BLOCK, {"n": n // 2, "degree": 2, **drag}),
        ("pair", pair_ratio.PAIR, {"n": round(0.8 * n), **drag}),
    ]
    options = []
    for name, case, values in result:
        module = pair_ratio if case is pair_ratio.PAIR else elasticity_ratio
        words = [word for key, value in values.items() for word in (f"--{key}", str(value))]
        options.append((name, case, module.arguments([*common, *words])))
    return options


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=20, help="cells of an edge of the cube")
    parser.add_argument("--only", help="part of the name of the cases; default: all")
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    comm = MPI.COMM_WORLD
    records = {}
    if comm.rank == 0:
        print("| case | unknowns | Newton steps | Krylov iterations | ratio |", flush=True)
        print("|" + 5 * "---|", flush=True)
    for name, case, options in cases(args.n):
        if args.only and args.only not in name:
            continue
        elasticity_ratio.compile_forms(options, comm, case)
        record = elasticity_ratio.run(options, options.n, comm, case)
        contact = record["contact"]
        records[name] = record
        if comm.rank == 0:
            steps = f"{contact['newton_iterations']} | {contact['krylov_iterations']}"
            print(
                f"| {name} | {record['dofs']} | {steps} | {record['processor_ratio']:.2f} |",
                flush=True,
            )
    if args.output and comm.rank == 0:
        save(args.output, records)
    return records


if __name__ == "__main__":
    main()
