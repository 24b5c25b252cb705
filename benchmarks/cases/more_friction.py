# SPDX-License-Identifier: LGPL-3.0-or-later
"""More friction, fewer solutions.

Reference: enumeration.

That friction makes solutions multiply is what one expects, and in Hild's triangle
(`hild_triangle.py`) it is so for nearly all loads. P. Hild noted that their number may as
well *decrease* when the coefficient grows (Int. J. Appl. Math. Comput. Sci. 12 (2002) 41-50).
Two elements and two contact nodes show it for a whole interval of loads: the triangles ABC and
BDC with A = (0, 0) and B = (1, 0) on the floor, C = (1/2, 1/2) and D = (3/2, 3/2) held and moved
apart, C by (-2, 0) and D by (1, -1) hundredths. One solution, then three, then one again.
"""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import leftmost, rightmost

MOVED = {(0.5, 0.5): (-0.02, 0.0), (1.5, 1.5): (0.01, -0.01)}
FUNCTIONALS = {"ut_A": leftmost("ut"), "un_A": leftmost("un"), "ut_B": rightmost("ut")}


def body(friction, comm=MPI.COMM_WORLD):
    corners = [(0.0, 0.0), (1.0, 0.0), *MOVED]
    cells = np.array([[0, 1, 2], [1, 3, 2]] if comm.rank == 0 else np.zeros((0, 3)), np.int64)
    points = np.array(corners if comm.rank == 0 else np.zeros((0, 2)))
    shape = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    domain = mesh.create_mesh(comm, cells=cells, x=points, e=shape)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    bcs = [
        fem.dirichletbc(
            np.array(way),
            fem.locate_dofs_geometrical(V, lambda x, p=p: np.hypot(x[0] - p[0], x[1] - p[1]) < 0.1),
            V,
        )
        for p, way in MOVED.items()
    ]
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, below, obstacle=floor, law=Coulomb(friction))
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=bcs)


# How many there are.
#
# Two points have 16 pieces; all are examined, so that the numbers are certain.


def words_at(friction, comm=MPI.COMM_WORLD):
    problem = body(friction, comm)
    system = ParametricContact(problem, fem.Constant(problem.V.mesh, 0.0))
    found = find_solutions(system, [system.create_vector()], 0.0)
    assert found.complete
    return sorted(system.letters(s.piece) for s in found.found)


# The branch.
#
# From weak friction A lifts off and B slips to the left. The branch turns back where A touches the
# floor, and again where A, which slips to the left now, gets stuck; from there B keeps slipping,
# however strong friction is. Between both folds there are three solutions.


def main(argv=None):
    parser = ScriptParser("More friction, fewer solutions", output="output/more_friction")
    parser.add_argument("--friction", type=number(above=0), nargs=2, default=(0.5, 12.0))
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    low, high = args.friction
    problem = body(low, comm)
    problem.solve()
    (surface,) = problem.surfaces
    system = ParametricContact(problem, surface.law.friction)
    x = system.create_vector()
    problem.write(x)
    branch = follow(system, x, low, gamma_range=(low, high))
    journal = records.journal_of(system, [branch], FUNCTIONALS)
    folds = [s.gamma for s in branch.folds]
    ends = sorted({low, high, *folds})
    between = [(a + b) / 2 for a, b in pairwise(ends)]
    solutions = {f"{f:.6g}": words_at(f, comm) for f in between}
    for f, words in solutions.items():
        say(f"F = {f}: {len(words)} solutions, {', '.join(words)}")
    say(f"folds at F = {', '.join(f'{f:.10g}' for f in folds)}; {branch.reason}")
    if comm.rank == 0:
        title = "One solution, three, and one again"
        words = dict(title=title, parameter="friction coefficient F")
        plot.draw_diagram(folder / "branch.png", journal, {"ut_A": "$u_t$ of A"}, **words)
    summary = branch.summary() | {"fold_frictions": folds, "solutions": solutions}
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
