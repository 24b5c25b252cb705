# SPDX-License-Identifier: LGPL-3.0-or-later
# # A fibre pulled out of a matrix
#
# This demo illustrates how to:
#
# - solve a problem of revolution with two bodies (`axisymmetric=True`);
# - clamp one body in the other by a misfit of the radii (`gap`, `interference=True`);
# - let a bond with friction break along an interface (`RCCM`), past the jump at the end.
#
# A polymer fibre of radius $a$ lies in a stiff matrix that has shrunk on it by a misfit. Lamé's
# pressure $p$ holds it, and a bond of stiffness $C$ and fracture energy $w$. As long as the inner
# end of the fibre is at rest, a bar of stiffness $EA$ gives the force for the slip $u$ where the
# fibre leaves the matrix,
#
# $$P^2 = 4 \pi a\, EA\, \Phi(u),\qquad
# \Phi = \frac{C u^2}{2}\ (u \le u_0),\qquad
# \Phi = w - \frac{w u_0^2}{2 u^2} + \mu p \left(u - u_0 + u_0 \Big(\frac{u_0}{u} - 1\Big)\right).$$
#
# When the bond has broken all along, the fibre has stored more energy than is needed to break the
# rest. The state jumps to friction alone, $2 \pi a L\, \mu p$. Interfaces of this kind are also
# steel bars in concrete and piles in soil (`benchmarks/cases/steel_concrete.py` and `pile.py`). The
# parameters (mm, N) are our own.

from mpi4py import MPI

import numpy as np

from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactPair, ContactProblem, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.meshing import join, name_groups

comm = MPI.COMM_WORLD
n = 4  # cells per mm along the fibre
steps, end = 25, 0.06  # of the history, and the displacement at its end
length, outside = 5.0, 0.5  # of the fibre in the matrix, and beyond it
a, outer = 0.25, 1.0  # radii of fibre and matrix
young_fibre, young_matrix = 5e3, 30e3
bond, fracture_energy, friction, misfit = 625.0, 0.01, 0.3, 6e-5
u0 = np.sqrt(fracture_energy / bond)
EA = np.pi * a**2 * young_fibre

# ## The bodies
#
# The section is meshed in the coordinates r, y. Both Poisson's ratios are zero, so that tension
# does not make the fibre thinner.

quadrilateral = mesh.CellType.quadrilateral
up = np.linspace(0, length, round(length * n) + 1)
beyond = np.linspace(0, outside, round(outside * n) + 1)
along = np.append(up, length + beyond[1:])
fibre = create_grid(comm, (np.linspace(0, a, 3), along), quadrilateral)
radii = a + (outer - a) * np.array([0, 0.1, 0.3, 0.6, 1])
matrix = create_grid(comm, (radii, up), quadrilateral)


def interface(x):
    return np.isclose(x[0], a) & (x[1] < length + 1e-9)


fibre_sides = {"sleeve": interface, "end": lambda x: np.isclose(x[1], length + outside)}
matrix_sides = {"hole": interface, "rim": lambda x: np.isclose(x[0], outer)}
fibre = name_groups(fibre, fibre_sides, cells="fibre")
both = join([fibre, name_groups(matrix, matrix_sides, cells="matrix")])
V = fem.functionspace(both.mesh, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
energy = Axisymmetric(LinearElastic.from_young(young_fibre, 0.0)).energy(u) * both.dx("fibre")
energy += Axisymmetric(LinearElastic.from_young(young_matrix, 0.0)).energy(u) * both.dx("matrix")

# The end of the fibre is drawn along the axis; the rim of the matrix is held along it.

drawn = fem.Constant(both.mesh, 0.0)
W = V.sub(1)
held = {"end": drawn, "rim": 0.0}
bcs = [fem.dirichletbc(value, both.dofs(W, name), W) for name, value in held.items()]

# ## Bond, friction and misfit
#
# A negative gap is an overlap that the bodies have to make room for.

law = RCCM(bond, bond, fracture_energy, friction)
pair = ContactPair(
    u,
    both,
    slave="sleeve",
    master="hole",
    law=law,
    axisymmetric=True,
    gap=-misfit,
    interference=True,
)
problem = ContactProblem(energy, u, [pair], bcs=bcs)
clamped = problem.solve().tables["contact"]
pressure = clamped.rn.sum() / clamped.area.sum()
compliance = 1 / young_fibre + (outer**2 + a**2) / (outer**2 - a**2) / young_matrix
lame_pressure = misfit / a / compliance
say = io.Report(comm)
say(f"pressure {pressure:.5f}, Lamé {lame_pressure:.5f} N/mm^2")

# ## The pull
#
# `locate_jumps` finds the time at which the state jumps, and the history continues behind it.


def load(t):
    drawn.value = t * end


history = QuasiStatic(problem, load).run(
    np.linspace(0.0, 1.0, steps + 1), locate_jumps=True, at_jump="jump"
)
tables = [step.result.tables["contact"] for step in history.steps]
displacement = end * np.array([step.time for step in history.steps])
force = np.array([-step.result.resultants["contact"][1] for step in history.steps])
foot = np.array([table.ut[0, 1] for table in tables])
mouth = np.array([table.ut[-1, 1] for table in tables])

# ## Comparison
#
# The closed form of the bar holds while the inner end is at rest.

v = np.maximum(mouth, u0)
rubbing = friction * lame_pressure * (v - u0 + u0 * (u0 / v - 1))
damaged = fracture_energy * (1 - (u0 / v) ** 2 / 2) + rubbing
phi = np.where(mouth < u0, bond * mouth**2 / 2, damaged)
bar = np.sqrt(4 * np.pi * a * EA * phi)
at_rest = foot < 0.1 * u0
worst = float(np.abs(force / bar - 1)[at_rest].max())
plateau = clamped.area.sum() * friction * lame_pressure
say(f"force while the bond breaks: within {worst:.1%} of the bar")
say(f"force after the jump {force[-1]:.4f}, friction alone {plateau:.4f} N")

folder = io.output_folder(comm, "output/pull_out")
if comm.rank == 0:
    curves = {"elastic bodies": (displacement, force)}
    dotted = {"bar": (displacement[at_rest], bar[at_rest])}
    labels = ("displacement of the end, mm", "force, N")
    plot.draw_curves(folder / "force.png", curves, dotted=dotted, labels=labels)
plot.picture_of_body(folder / "body.png", problem)
