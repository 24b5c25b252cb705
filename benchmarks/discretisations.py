# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear and quadratic elements with each discretisation of contact: orders and errors.

`orders` solves the manufactured problem of tests/support/manufactured.py, a block on an obstacle
that is open, sticks and slips, with a coefficient of friction that is the same everywhere or grows
along the face. Errors in L2 are relative. The pressure is the field of the multiplier, and the
error of the resultants is that of the total force on the face over its size. The violation is
`kkt_violation`.

`hertz` and `punch` compare elements at similar numbers of unknowns: a parabola pressed on a plane
(`cases.hertz`, compared with the closed form), and a block under a punch that is flat with round
edges (compared with a fine mesh of degree 2). `ball` presses a half-sphere on a plane.

Seconds are processor times of a second solve from zero.

    docker/run python3 benchmarks/discretisations.py --output output/discretisations.json
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from mpi4py import MPI

import cases.hertz
import gmsh
import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, Frictionless, HalfSpace
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh
from dolfinx_contact.obstacles import LevelSet

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))

from support.blocks import box, facets  # noqa: E402
from support.manufactured import (  # noqa: E402
    STEEL,
    GapField,
    exact,
    hooke,
    norm,
    prescribed,
    sides,
)

COMM = MPI.COMM_WORLD
#: Degree of the displacement and method.
KINDS = ((1, "nodal"), (1, "mixed"), (1, "integral"), (2, "mixed"), (2, "integral"))
#: Cells along an edge of the block.
MESHES = {"tri": (8, 16, 32), "quad": (8, 16, 32), "tet": (4, 8), "hex": (4, 8)}
FRICTION = 0.3
LOAD = 0.02  # depth of the punch
FLAT, ROUND = 0.25, 1.0  # half of the flat part of the punch, and radius of its edges
APPROACH = 0.05  # of the half-sphere, over its radius


def timed(problem):
    """Return the result of a second solve from zero, and its processor seconds."""
    problem.solve(progress=False)
    problem.u.x.array[:] = 0.0
    problem.surfaces[0].multiplier.x.array[:] = 0.0
    begun = time.process_time()
    result = problem.solve(progress=False)
    return result, time.process_time() - begun


def manufactured(cell, n, degree, method, slope):
    """Errors on one mesh, with the friction 0.3 + slope x."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    e = exact(ufl.SpatialCoordinate(domain), "Coulomb", slope=slope)
    stress = hooke(ufl.grad(e.u))
    accurate = {"quadrature_degree": 6}
    traction = ufl.dot(stress, ufl.FacetNormal(domain))
    residual = ufl.inner(STEEL.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    residual += ufl.dot(ufl.div(stress), v) * ufl.dx(metadata=accurate)
    residual -= sides(domain) * ufl.dot(traction, v) * ufl.ds(metadata=accurate)
    bottom = facets(domain, dim - 1, 0.0)
    surface = ContactSurface(
        u, bottom, obstacle=GapField(e.gap), law=Coulomb(e.friction), method=method
    )
    top = [prescribed(V, e.u, facets(domain, dim - 1, 1.0))]
    tight = {"snes_rtol": 1e-12}
    problem = ContactProblem(residual, u, [surface], bcs=top, petsc_options=tight)
    result = problem.solve(progress=False)
    face = problem.surfaces[0].submesh.mesh
    known = exact(ufl.SpatialCoordinate(face), "Coulomb", slope=slope).pressure
    multiplier = problem.surfaces[0].multiplier
    tags = mesh.meshtags(domain, dim - 1, np.sort(bottom), np.full(len(bottom), 1, dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata=accurate)(1)
    forces = [fem.assemble_scalar(fem.form(traction[i] * ds)) for i in range(dim)]
    forces = np.array(COMM.allreduce(np.array(forces)))
    found = result.resultants["contact"]
    return {
        "displacement": norm(domain, u - e.u) / norm(domain, e.u),
        "gradient": norm(domain, ufl.grad(u - e.u)) / norm(domain, ufl.grad(e.u)),
        "pressure": norm(face, multiplier[dim - 1] - known) / norm(face, known),
        "resultants": float(np.linalg.norm(found - forces) / np.linalg.norm(forces)),
        "violation": result.kkt_violation,
    }


def orders():
    """Rows of the table of orders."""
    rows = []
    for cell, numbers in MESHES.items():
        for slope in (0.0, 0.2) if cell == "tri" else (0.0,):
            for degree, method in KINDS:
                found = [manufactured(cell, n, degree, method, slope) for n in numbers]
                last, before = found[-1], found[-2]
                row = {"cells": cell, "friction": "0.3 + 0.2 x" if slope else "0.3"}
                row |= {"contact": f"P{degree} {method}", "n": numbers[-1]}
                for name in ("displacement", "gradient", "pressure", "resultants"):
                    order = np.log2(before[name] / last[name])
                    row[name] = f"{order:.1f}, {last[name]:.1e}"
                row["violation"] = f"{last['violation']:.0e}"
                rows.append(row)
    return rows


def hertz():
    """Rows of the comparison on Hertz's line contact."""
    rows = []
    for degree, method, levels in (
        (1, "nodal", (10, 20, 40)),
        (2, "mixed", (5, 10, 20)),
        (2, "integral", (5, 10, 20)),
    ):
        words = ["--degree", str(degree), "--method", method]
        args = cases.hertz.arguments([*words, "--levels", *map(str, levels)])
        _, _, found = cases.hertz.solve(args, COMM)
        a = args.hertz.radius(args.load)
        delta = args.hertz.approach(args.load, args.size * a, args.poisson)
        for level in found:
            n = level["cells_over_radius"]
            _, seconds = timed(cases.hertz.problem(args, COMM, n, a, delta))
            row = {"contact": f"P{degree} {method}", "unknowns": level["dofs"]}
            row |= {"cells in a": n, "Newton": level["newton_iterations"]}
            row["seconds"] = f"{seconds:.2f}"
            for name in ("radius", "peak_pressure", "profile"):
                row[name.replace("_", " ")] = f"{level[name + '_error']:.1e}"
            rows.append(row)
    return rows


def pressed(n, degree, method, friction):
    """Half of a block under a punch with round edges, on one mesh with 2n cells below the punch."""
    axis = graded(2.0, 0.5 / n, n, n)
    domain = create_grid(COMM, [axis, axis], mesh.CellType.quadrilateral)
    domain.geometry.x[:, 1] -= 2.0
    domain.geometry.x[:, 1] *= -1.0
    domain.geometry.x[:, 1] -= 2.0
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)

    def shape(x):
        beyond = ufl.max_value(x[0] - FLAT, 0.0)
        return beyond**2 / (2 * ROUND) - LOAD - x[1]

    law = Coulomb(friction) if friction else Frictionless()
    inside = axis[n] + 1e-9
    top = mesh.locate_entities_boundary(
        domain, 1, lambda x: np.isclose(x[1], 0.0, atol=1e-9) & (x[0] < inside)
    )
    surface = ContactSurface(
        u, top, obstacle=LevelSet(shape), law=law, method=method, sliding="small"
    )
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], -2.0))
    left = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 0.0))
    bcs = [
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V),
        fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), 1, left), V.sub(0)),
    ]
    steel = LinearElastic.from_young(1.0, 0.3)
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [surface], bcs=bcs)
    result, seconds = timed(problem)
    return {
        "unknowns": result.dofs,
        "seconds": seconds,
        "Newton": result.iterations,
        "force": float(-result.resultants["contact"][1]),
        "energy": float(result.energies["bulk"]),
        "violation": result.kkt_violation,
    }


def punch():
    """Rows of the comparison under the punch."""
    rows = []
    for friction in (0.0, FRICTION):
        fine = pressed(64, 2, "mixed", friction)
        for degree, method, numbers in (
            (1, "nodal", (8, 16, 32)),
            (2, "mixed", (4, 8, 16)),
            (2, "integral", (4, 8, 16)),
        ):
            for n in numbers:
                found = pressed(n, degree, method, friction)
                row = {"friction": friction, "contact": f"P{degree} {method}"}
                row |= {k: found[k] for k in ("unknowns", "Newton")}
                row["seconds"] = f"{found['seconds']:.2f}"
                for name in ("force", "energy"):
                    row[name] = f"{abs(found[name] / fine[name] - 1):.1e}"
                row["violation"] = f"{found['violation']:.0e}"
                rows.append(row)
    return rows


def half_ball(h):
    """Half of a unit ball above its pole at z = 0, with cells of size h at the pole."""
    occ = gmsh.model.occ
    field = gmsh.model.mesh.field
    occ.addSphere(0, 0, 1, 1, angle1=-np.pi / 2, angle2=0)
    occ.synchronize()
    (ball,) = (tag for _, tag in gmsh.model.getEntities(3))
    gmsh.model.addPhysicalGroup(3, [ball], name="ball")
    for _, tag in gmsh.model.getEntities(2):
        flat = gmsh.model.getType(2, tag) == "Plane"
        gmsh.model.addPhysicalGroup(2, [tag], name="equator" if flat else "face")
    away = "sqrt(x*x + y*y + z*z)"
    growth = field.add("MathEval")
    field.setString(growth, "F", f"{h} * (1 + 4 * max({away} - 0.3, 0))")
    field.setAsBackgroundMesh(growth)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.model.mesh.generate(3)


def entered(u, facets):
    """Largest penetration of the plane z = 0 on a grid of points of straight triangles."""
    domain = u.function_space.mesh
    domain.topology.create_connectivity(2, 3)
    domain.topology.create_connectivity(3, 2)
    cells = domain.topology.connectivity(2, 3)
    corners = mesh.entities_to_geometry(domain, 2, facets)
    steps = np.linspace(0.0, 1.0, 21)
    weights = np.array([(1 - a - b, a, b) for a in steps for b in steps if a + b < 1 + 1e-9])
    points = np.einsum("pi,fij->fpj", weights, domain.geometry.x[corners]).reshape(-1, 3)
    inside = np.repeat([cells.links(f)[0] for f in facets], len(weights))
    return float(-(points + u.eval(points, inside))[:, 2].min())


def ball():
    """Rows of the half-sphere."""
    rows = []
    for degree, method, levels in (
        (1, "nodal", (0.065, 0.03)),
        (2, "mixed", (0.1, 0.06)),
        (2, "integral", (0.1, 0.06)),
    ):
        for h in levels:
            row = {"contact": f"P{degree} {method}"}
            for friction in (0.0, FRICTION):
                body = mesh_from_gmsh(COMM, lambda h=h: half_ball(h))
                V = fem.functionspace(body.mesh, ("Lagrange", degree, (3,)))
                u = fem.Function(V)
                held = fem.dirichletbc(np.array([0.0, 0.0, -APPROACH]), body.dofs(V, "equator"), V)
                surface = ContactSurface(
                    u,
                    body,
                    tag="face",
                    obstacle=HalfSpace((0, 0, 0), (0, 0, 1)),
                    law=Coulomb(friction) if friction else Frictionless(),
                    method=method,
                )
                energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
                result, seconds = timed(ContactProblem(energy, u, [surface], bcs=[held]))
                if not friction:
                    depth = entered(u, body.facets("face")) / APPROACH
                    force = result.resultants["contact"][2]
                    row |= {"unknowns": result.dofs, "force": f"{force:.5f}"}
                    row["penetration"] = f"{depth:.1%}"
                row |= {
                    f"violation, F = {friction}": f"{result.kkt_violation:.0e}",
                    f"Newton, F = {friction}": result.iterations,
                    f"seconds, F = {friction}": f"{seconds:.2f}",
                }
            rows.append(row)
    return rows


def table(rows):
    """The rows as a table in Markdown."""
    head = list(rows[0])
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(row[name]) for name in head) + " |" for row in rows]
    return "\n".join(lines)


def main(argv=None):
    parts = {"orders": orders, "hertz": hertz, "punch": punch, "ball": ball}
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(parts)}; default: all")
    parser.add_argument("--output", type=Path, help="file for the rows, as JSON")
    args = parser.parse_args(argv)
    found = {name: parts[name]() for name in args.parts or parts}
    for name, rows in found.items():
        print(f"\n{name}\n\n{table(rows)}", flush=True)
    if args.output and COMM.rank == 0:
        args.output.parent.mkdir(parents=True, exist_ok=True)
        args.output.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
