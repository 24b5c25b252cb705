# SPDX-License-Identifier: LGPL-3.0-or-later
# # A bond that breaks, and an indenter that sticks
#
# This demo illustrates how to:
#
# - glue a surface by an adhesive that damages, with or without viscosity (`RCCM`);
# - let bonds form and recover at points that touch (`recovers=True`);
# - pass a jump of the state in a history (`locate_jumps=True`).
#
# The adhesive of Raous, Cangemi and Cocou has an intensity $\beta$ between 1 (intact) and 0
# (broken). With the stiffness $C$, the fracture energy $w$ and the viscosity $b$, an opening $u$
# causes the traction and the evolution
#
# $$R = C u \beta^2,\qquad b\, \dot\beta = -\left(C u^2 \beta - w\right)^+.$$
#
# Without viscosity, $\beta = 1$ up to $u_0 = \sqrt{w/C}$ and $\beta = (u_0/u)^2$ beyond. The
# largest traction is $\sqrt{w C}$, and the work until $u$ is $w\,(1 - u_0^2/(2 u^2))$.

from itertools import pairwise

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, Sphere, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
say = io.Report(comm)
folder = io.output_folder(comm, "output/adhesion")

# ## A glued block
#
# The top of a stiff block is lifted so that its face opens at the constant speed $u_0$. The lift
# exceeds the opening by the elongation of the block, the traction over its stiffness.

stiffness, fracture_energy, young = 100.0, 1.0, 1e4
u0 = np.sqrt(fracture_energy / stiffness)
steps = 20  # for each half of u0


def intensities(viscosity, times):
    """Intensity at each time by implicit steps, for the prescribed opening."""
    beta = [1.0]
    for before, now in pairwise(times):
        dt = now - before
        drive = stiffness * (u0 * now) ** 2
        trial = (viscosity * beta[-1] + dt * fracture_energy) / (viscosity + dt * drive)
        beta.append(min(beta[-1], trial))
    return beta


def opened(viscosity):
    """Opening over u0 and traction over the root of w C, along an opening up to 6 u0."""
    domain = mesh.create_unit_square(comm, 2, 2)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    lift = fem.Constant(domain, (0.0, 0.0))
    top = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    law = RCCM(stiffness, stiffness, fracture_energy, viscosity=viscosity)
    surface = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    energy = LinearElastic.from_young(young, 0.0).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(lift, top, V)])
    times = np.linspace(0.0, 6.0, 12 * steps + 1)
    beta = intensities(viscosity, times)

    def load(t):
        lift.value[1] = u0 * t * (1 + np.interp(t, times, beta) ** 2 * stiffness / young)

    history = QuasiStatic(problem, load).run(times)
    tables = [step.result.tables["contact"] for step in history.steps]
    opening = np.array([table.un.mean() for table in tables]) / u0
    traction = np.array([-table.pressure.mean() for table in tables])
    return opening, traction / np.sqrt(fracture_energy * stiffness), history


opening, traction, history = opened(0.0)
last = history.steps[-1]
work = last.energies.damage + last.energies.stored - last.result.energies["bulk"]
say(f"largest traction {traction.max():.6f}, closed form 1, in units of the root of w C")
say(f"work up to 6 u0 {work / fracture_energy:.6f}, closed form {71 / 72:.6f}, in units of w")

# With $b = w$ the largest traction is 1.107952, at $u = 1.2075\, u_0$.

viscous_opening, viscous, _ = opened(fracture_energy)
at = viscous_opening[np.argmax(viscous)]
say(f"with viscosity {viscous.max():.4f} at {at:.3f} u0, closed form 1.1080 at 1.208 u0")

# ## An indenter on a polymer
#
# A rigid cylinder of radius $R$ is pressed into a soft block, rests, and is drawn off. At first
# nothing is bonded; bonds form where the surfaces touch, at the rate $w/b$. When the indenter
# moves up they hold it until it comes off in a jump. For bonds that break slowly and on a short
# length, the pull-off force per length of Johnson, Kendall and Roberts for a line contact is
# $\frac34 (4 \pi E^* w^2 R)^{1/3}$ (Barquins, 1988). Viscosity and a coarse mesh raise it. The
# parameters (N, mm, s) are our own, of a soft rubber.

n = 12  # cells on the fine part of the face
radius, edge, reach = 10.0, 6.0, 1.2
rest, speed, depth, off = 0.1, 0.1, 0.04, 0.08
polymer = LinearElastic.from_young(1.0, 0.45)
w = 1e-3
h = reach / n
square = mesh.CellType.quadrilateral
x = graded(edge, h, n, n // 3)
domain = create_grid(comm, (x, -graded(edge, h, 1, n // 2)[::-1]), square)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V)
centre = fem.Constant(domain, (0.0, 0.0))


def held(axis, place):
    W = V.sub(axis)
    facets = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], place))
    zero = fem.Constant(domain, 0.0)
    return fem.dirichletbc(zero, fem.locate_dofs_topological(W, 1, facets), W)


face = mesh.locate_entities_boundary(
    domain, 1, lambda x: np.isclose(x[1], 0) & (x[0] < 1.5 * reach)
)
law = RCCM(12.5, 12.5, w, viscosity=0.05 * w, beta=0.0, order=2, recovers=True)
contact = ContactSurface(u, face, obstacle=Sphere(centre, radius), law=law)
bcs = [held(0, 0.0), held(1, -edge), held(0, edge)]
problem = ContactProblem(polymer.energy(u) * ufl.dx, u, [contact], bcs=bcs)

# The indenter descends, rests, and rises; the state jumps when it comes off.

heights = [off / 10, -depth, -depth, off]
turns = np.cumsum([0.0, (off / 10 + depth) / speed, rest, (off + depth) / speed])


def load(t):
    centre.value[1] = radius + np.interp(t, turns, heights)


parts = zip(pairwise(turns), (6, 5, 24), strict=True)
times = np.unique(np.concatenate([np.linspace(a, b, k + 1) for (a, b), k in parts]))
history = QuasiStatic(problem, load).run(times, locate_jumps=True, at_jump="jump")
indentation = np.array([-np.interp(step.time, turns, heights) for step in history.steps])
force = np.array([2 * step.result.tables["contact"].rn.sum() for step in history.steps])
modulus = 1.0 / (1 - 0.45**2)
johnson = 0.75 * (4 * np.pi * modulus * w**2 * radius) ** (1 / 3)
say(f"pull-off force {-force.min():.4f} N/mm, Johnson, Kendall and Roberts {johnson:.4f} N/mm")

# ## The pictures

if comm.rank == 0:
    curves = {"b = 0": (opening, traction), "b = w": (viscous_opening, viscous)}
    exact = {"closed form, b = 0": (opening, np.minimum(opening, opening**-3.0))}
    labels = ("$u/u_0$", r"$R/\sqrt{wC}$")
    plot.draw_curves(folder / "traction.png", curves, dotted=exact, labels=labels)
    labels = ("indentation, mm", "force, N/mm")
    plot.draw_curves(folder / "indenter.png", {"indenter": (indentation, force)}, labels=labels)
