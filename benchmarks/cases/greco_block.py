# SPDX-License-Identifier: LGPL-3.0-or-later
"""The GRECO block of Raous, in any units.

Reference: Code_Aster SSNV128.

Half of a long bar of square section, 40 x 40 mm in plane strain, lies on a rigid plane and is
pressed by 5e7 Pa on its top and by 15e7 Pa on its left side; its right side is the symmetry line.
Friction is strong (F = 1). Near the left edge the bar lifts off, then it slips, then it sticks.
"""

from mpi4py import MPI

import numpy as np
from _case import CELLS, ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.materials import LinearElastic

#: Metres and pascals in one unit of length and of stress.
UNITS = {"Pa-m": (1.0, 1.0), "MPa-mm": (1e-3, 1e6), "GPa-m": (1.0, 1e9)}
#: Points of the contact line (m) at which the benchmark gives u_x, and Code_Aster's QUAD8 values.
POINTS = {"A": 0.0, "B": 1.25e-3, "C": 5e-3, "D": 7.5e-3, "E": 11.25e-3}
CODE_ASTER = {
    "A": 2.85984956e-5,
    "B": 2.72076359e-5,
    "C": 2.28268638e-5,
    "D": 1.97916483e-5,
    "E": 1.54063959e-5,
}
WIDTH = 0.04


def arguments(argv=None):
    bar = dict(n=32, friction=1.0, young=1.3e11, poisson=0.2)
    parser = ScriptParser("The GRECO block, in m and Pa", output="output/greco_block", **bar)
    parser.add_argument("--cell", choices=("quad", "tri"), default="quad", help="kind of cells")
    parser.add_argument("--side-pressure", type=number(), default=15e7, help="from the left")
    parser.add_argument("--top-pressure", type=number(), default=5e7, help="from above")
    parser.add_argument("--units", choices=UNITS, default="Pa-m", help="in which to compute")
    return parser.parse(argv)


# The problem.
#
# The right side is a symmetry line, and its lowest node is clamped: there the multiplier has
# nothing to do and is removed, and the reaction comes from the support.


def problem(args, comm):
    metre, pascal = (1 / unit for unit in UNITS[args.units])
    width = WIDTH * metre
    corners = [[0.0, 0.0], [width, width]]
    domain = mesh.create_rectangle(comm, corners, [args.n, args.n], CELLS[args.cell])

    def line(axis, value):
        return mesh.locate_entities_boundary(
            domain, 1, lambda x: np.isclose(x[axis], value, atol=1e-9 * width)
        )

    right = line(0, width)
    bottom = line(1, 0.0)
    top = line(1, width)
    left = line(0, 0.0)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    v = ufl.TestFunction(V)
    symmetry = fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), 1, right), V.sub(0))
    corner = fem.locate_dofs_geometrical(
        V, lambda x: np.isclose(x[0], width) & np.isclose(x[1], 0.0, atol=1e-9 * width)
    )
    clamped = fem.dirichletbc(np.zeros(2), corner, V)

    facets = np.concatenate([top, left])
    order = np.argsort(facets)
    values = np.repeat(np.array([1, 2], dtype=np.int32), [len(top), len(left)])
    tags = mesh.meshtags(domain, 1, facets[order], values[order])
    ds = ufl.Measure("ds", domain, subdomain_data=tags)
    down = fem.Constant(domain, (0.0, -args.top_pressure * pascal))
    inward = fem.Constant(domain, (args.side_pressure * pascal, 0.0))
    material = LinearElastic.from_young(args.young * pascal, args.poisson)
    residual = ufl.inner(material.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    residual -= ufl.dot(down, v) * ds(1) + ufl.dot(inward, v) * ds(2)
    plane = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, bottom, obstacle=plane, law=Coulomb(args.friction))
    return ContactProblem(residual, u, [surface], bcs=[symmetry, clamped])


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    bar = problem(args, comm)
    result = bar.solve()
    say.result(result)
    table = result.tables["contact"]
    metre = UNITS[args.units][0]
    x = table.x[:, 0] * metre
    ut = table.ut[:, 0] * metre
    summary = result.summary(bar.uniqueness()) | {"status": table.status}
    for name, at in POINTS.items():
        summary[f"ux_{name}"] = ux = float(np.interp(at, x, ut))
        say(f"{name}: u_x {ux:.8e} m, Code_Aster QUAD8 {CODE_ASTER[name]:.8e}")
    summary["residual_history"] = [step.measures.worst for step in result.history]
    plot.picture_of_contact(folder / "contact.png", bar)
    io.write_contact_table(comm, folder, [table])
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
