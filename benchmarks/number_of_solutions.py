# SPDX-License-Identifier: LGPL-3.0-or-later
"""Number of solutions under mesh refinement, for friction coefficients of at most 0.5.

Static law: three bodies. The loads are tractions in 36 directions: all around for the first two
bodies; for the wedge between horizontal and 18 degrees above, where several solutions were found in
a search all around. Solutions scale with the load, since the gaps are zero, so that only the
direction matters. `find_solutions` counts them.

- `triangle`: the right triangle of Ligursky and Renard, clamped on its longest side.
- `leaning`: a parallelogram of width 1 and height 2, whose top is clamped and shifted by 2.
- `wedge`: half of a wedge whose side is inclined by tan = 0.2 to the vertical, on a plane of
  symmetry, between rigid walls. A soft foundation on its top (0.01 E over the height) holds it
  vertically.

Rate law: the wedge is pushed between its walls; then a load, a twentieth of the one that pushed,
pulls it out. The solutions of the step from the pushed state to the load that pulls are counted.

    docker/run python3 benchmarks/number_of_solutions.py --output number.json --picture number.png
"""

from __future__ import annotations

import argparse
import logging
import time

from mpi4py import MPI

import numpy as np
from timing import save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_SELF
DIRECTIONS = 36
FRICTIONS = (0.1, 0.3, 0.5)
SLOPE = 0.2  # of the sides of the wedge
FOUNDATION = 0.01  # stiffness on the top of the wedge, over Young's modulus and height
PULL = 0.05  # load that pulls, over the load that pushed
STEEL = LinearElastic.from_young(1.0, 0.3)


def facets(domain, axis, value):
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], value))


def contact(u, loaded, touching, bcs, friction, wall, foundation=0.0):
    """Return the contact problem of a body, the factor of its traction, and the traction.

    Args:
        u: displacement.
        loaded: facets with the traction and the foundation.
        touching: facets that may touch the wall.
        bcs: Dirichlet conditions.
        friction: coefficient.
        wall: obstacle.
        foundation: stiffness against vertical motion of the loaded facets, per area.
    """
    domain = u.function_space.mesh
    ones = np.ones(len(loaded), dtype=np.int32)
    tags = mesh.meshtags(domain, 1, np.sort(loaded), ones)
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    traction = fem.Constant(domain, np.zeros(2))
    gamma = fem.Constant(domain, 1.0)
    surface = ContactSurface(u, touching, obstacle=wall, law=Coulomb(friction), name="wall")
    energy = STEEL.energy(u) * ufl.dx - gamma * ufl.dot(traction, u) * ds
    if foundation:
        energy += 0.5 * foundation * u[1] ** 2 * ds
    return ContactProblem(energy, u, [surface], bcs=bcs), gamma, traction


def triangle(n, friction):
    square = mesh.create_unit_square(COMM, n, n, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    domain = mesh.create_submesh(square, 2, half)[0]
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    side, bottom = facets(domain, 0, 0.0), facets(domain, 1, 0.0)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    clamped = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    plane = HalfSpace((0, 0), (0, 1))
    return contact(u, side, bottom, [clamped], friction, plane)


def leaning(n, friction):
    sizes = [[0.0, 0.0], [1.0, 2.0]]
    domain = mesh.create_rectangle(COMM, sizes, [n, 2 * n], mesh.CellType.quadrilateral)
    bottom, top, side = facets(domain, 1, 0.0), facets(domain, 1, 2.0), facets(domain, 0, 0.0)
    domain.geometry.x[:, 0] += domain.geometry.x[:, 1]
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    clamped = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, top), V)
    plane = HalfSpace((0, 0), (0, 1))
    return contact(u, side, bottom, [clamped], friction, plane)


def wedge(n, friction):
    kind = mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(COMM, [[0.0, 0.0], [1.0, 1.0]], [n, n], kind)
    axis, side, top = facets(domain, 0, 0.0), facets(domain, 0, 1.0), facets(domain, 1, 1.0)
    x = domain.geometry.x
    x[:, 0] *= 0.5 + SLOPE * x[:, 1]
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    symmetric = fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), 1, axis), V.sub(0))
    wall = HalfSpace((0.5, 0.0), np.array([-1.0, SLOPE]) / np.hypot(1.0, SLOPE))
    return contact(u, top, side, [symmetric], friction, wall, FOUNDATION)


def counted(problem, gamma, seconds):
    """Return the number of solutions at gamma = 1, and whether it is proved."""
    system = ParametricContact(problem, gamma)
    found = find_solutions(system, [system.create_vector()], 1.0, proof_seconds=seconds)
    return len(found.found), bool(found.complete), found.method


def static(body, sector, n, friction, seconds):
    """Count the solutions of the static law for all directions of the load in a sector."""
    problem, gamma, traction = body(n, friction)
    counts = []
    for angle in np.radians(sector) * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS:
        traction.value[:] = 0.01 * np.array([np.cos(angle), np.sin(angle)])
        counts.append(counted(problem, gamma, seconds))
    return record(n, friction, counts)


def rate(n, friction, seconds):
    """Count the solutions of a step of the rate law from a wedge that was pushed in."""
    problem, gamma, traction = wedge(n, friction)
    traction.value[:] = (0.0, -0.01)
    problem.solve()
    state = problem.snapshot()
    traction.value[:] = (0.0, PULL * 0.01)
    return record(n, friction, [counted(problem.step_from(state), gamma, seconds)])


def record(n, friction, counts):
    numbers = [number for number, _, _ in counts]
    return {
        "points": n + 1,
        "friction": friction,
        "largest": max(numbers),
        "loads_with_several": sum(number > 1 for number in numbers),
        "loads": len(numbers),
        "proved": sum(complete for _, complete, _ in counts),
        "numbers": numbers,
        "methods": sorted({method for _, complete, method in counts if not complete}),
    }


def draw(records, path):
    """Draw the largest number of solutions over the number of contact points."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(r["body"] for r in records))
    figure = Figure(figsize=(2.6 * len(names), 2.8), layout="constrained")
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        for shift, friction in enumerate(FRICTIONS):
            mine = [r for r in records if r["body"] == name and r["friction"] == friction]
            points = np.array([r["points"] for r in mine]) * 1.06 ** (shift - 1)
            axes.semilogx(points, [r["largest"] for r in mine], "o-", label=f"F = {friction}")
        ticks = sorted({r["points"] for r in records})
        axes.set_xticks(ticks, [str(t) for t in ticks])
        axes.minorticks_off()
        axes.set_title(name, fontsize="medium")
        axes.set_xlabel("contact points")
    panels[0].set_ylabel("largest number of solutions")
    panels[0].set_yticks(range(1, max(r["largest"] for r in records) + 1))
    panels[0].legend()
    figure.savefig(path, dpi=120)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", nargs="+", type=int, default=[1, 2, 4, 8, 16, 32])
    parser.add_argument("--seconds", type=float, default=20.0, help="limit of one proof")
    parser.add_argument("--output")
    parser.add_argument("--picture")
    args = parser.parse_args(argv)
    logging.getLogger("dolfinx_contact").setLevel(logging.ERROR)
    cases = {
        "triangle": lambda *given: static(triangle, 360.0, *given),
        "leaning": lambda *given: static(leaning, 360.0, *given),
        "wedge": lambda *given: static(wedge, 18.0, *given),
        "wedge, rate": rate,
    }
    records = []
    print("| body | F | points | largest number | loads with several | proved | s |")
    print("|" + 7 * "---|")
    for name, count in cases.items():
        for friction in FRICTIONS:
            for n in args.n:
                begun = time.process_time()
                r = {"body": name, **count(n, friction, args.seconds)}
                r["processor_seconds"] = time.process_time() - begun
                records.append(r)
                print(
                    f"| {name} | {friction} | {r['points']} | {r['largest']} | "
                    f"{r['loads_with_several']} of {r['loads']} | {r['proved']} of {r['loads']} | "
                    f"{r['processor_seconds']:.1f} |",
                    flush=True,
                )
    if args.output:
        save(args.output, records)
    if args.picture:
        draw(records, args.picture)
    return records


if __name__ == "__main__":
    main()
