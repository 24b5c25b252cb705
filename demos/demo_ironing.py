# SPDX-License-Identifier: LGPL-3.0-or-later
# # A die irons a slab
#
# This demo illustrates how to:
#
# - let two deformable bodies slide over each other by many facets (`sliding="large"`);
# - define a hyperelastic material by its energy in UFL;
# - run a quasi-static history (`QuasiStatic`) and monitor the contact force.
#
# A stiff die with a round edge is pressed by 1 mm into a soft slab and then dragged along it; plane
# strain, mm and MPa. The die starts 0.2 mm above the slab. It is pressed in at $t = 1$ and would
# have travelled 10 mm at $t = 2$. This is the shallow ironing problem of the literature.
#
# Published forces differ by a quarter in the vertical and by more than a half in the horizontal
# direction. Much of the difference is due to the elastic law: authors use four volumetric parts.
# Here the isochoric neo-Hookean law of code_aster is taken, with $K = \lambda + 2\mu/3$,
#
# $$W = \frac{\mu}{2}\left(J^{-2/3} I_1 - 3\right)
#   + \frac{K}{2}\left(\frac{J^2 - 1}{2} - \ln J\right),\qquad I_1 = \mathrm{tr}\, F^T F + 1.$$

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.meshing import join, name_groups

comm = MPI.COMM_WORLD
size = 0.2  # of the cells, mm
until = 1.1  # time at which the history ends
friction = 0.3
poisson = 0.32
young = {"slab": 689.6, "die": 6896.0}
slab_length, slab_height, edge_radius = 12.0, 4.0, 0.75

# ## The meshes
#
# Both bodies are grids of quadrilaterals. The cells of the slab grow towards its bottom. The grid
# of the die is mapped so that its lower side becomes an arc. `name_groups` names parts of a mesh,
# and `join` puts both meshes into one with these names.

heights = [0.0]
step = size
while heights[-1] < slab_height:
    heights.append(heights[-1] + step)
    step = min(1.12 * step, 0.4)
depth = np.array(heights) * slab_height / heights[-1]
along = np.linspace(0.0, slab_length, round(slab_length / size) + 1)
slab = create_grid(comm, [along, (slab_height - depth)[::-1]], mesh.CellType.quadrilateral)

across = np.linspace(0.0, 1.0, round(1.39 / size) + 1)
up = np.linspace(0.0, 1.0, max(round(1.05 / size), 3) + 1)
die = create_grid(comm, [across, up], mesh.CellType.quadrilateral)
slab_sides = {
    "below": lambda x: np.isclose(x[1], 0.0),
    "slab": lambda x: np.isclose(x[1], slab_height),
}

# The contact face of the die continues around its corners, otherwise the slab would lose contact
# with the end of the face.

die_sides = {
    "die": lambda x: np.isclose(x[1], 0.0) | np.isclose(x[0], 0.0) | np.isclose(x[0], 1.0),
    "above": lambda x: np.isclose(x[1], 1.0),
}
slab = name_groups(slab, slab_sides, cells="slab")
named_die = name_groups(die, die_sides, cells="die")
x = die.geometry.x
angle = np.arcsin(0.8) * (2 * x[:, 0] - 1)
arc = np.array([0.8 + edge_radius * np.sin(angle), 4.2 + edge_radius * (1 - np.cos(angle))])
flat = np.array([0.2 + 1.2 * x[:, 0], np.full(len(x), 5.4)])
x[:, :2] = ((1 - x[:, 1]) * arc + x[:, 1] * flat).T
bodies = join([slab, named_die])

# ## The problem
#
# The displacement is one function on both bodies. Their energies differ in Young's modulus only:
# the die is ten times stiffer. The bottom of the slab is clamped, and the top of the die moves as a
# rigid plate.


def stored(u, modulus):
    mu = modulus / (2 * (1 + poisson))
    lmbda = modulus * poisson / ((1 + poisson) * (1 - 2 * poisson))
    bulk = lmbda + 2 * mu / 3
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    first = ufl.inner(F, F) + 1  # plane strain: the stretch across is 1
    isochoric = mu / 2 * (J ** (-2 / 3) * first - 3)
    return isochoric + bulk / 2 * ((J**2 - 1) / 2 - ufl.ln(J))


V = fem.functionspace(bodies.mesh, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
energy = sum(stored(u, modulus) * bodies.dx(name) for name, modulus in young.items())
motion = fem.Constant(bodies.mesh, np.zeros(2))
held = {"below": np.zeros(2), "above": motion}
bcs = [fem.dirichletbc(value, bodies.dofs(V, name), V) for name, value in held.items()]

# The soft body is the slave, whose nodes carry the contact forces. With `sliding="large"` the
# facets opposite each other are searched in every iterate, and gap and normal are those of the
# deformed faces. The friction law applies to the slip of each step. Neither a penalty nor a
# regularisation parameter is needed.

law = Coulomb(friction)
pair = ContactPair(u, bodies, slave="slab", master="die", law=law, sliding="large")
problem = ContactProblem(energy, u, [pair], bcs=bcs)

# ## The history
#
# In a step the die slides by at most one facet, or 0.1 mm. A step whose solve fails is halved, and
# the extrapolated state is the initial guess of the next step (`extrapolate=True`). `load` is
# called with the time and sets the Constant of the Dirichlet data. The observer is called after
# each accepted step.


def load(t):
    motion.value[:] = 10 * max(t - 1, 0.0), -min(t, 1.0)


def force_on_die(step):
    """Horizontal and vertical force of the slab's answer, dragging and pressing positive."""
    horizontal, vertical = step.result.resultants["contact"]
    return horizontal, -vertical


say = io.Report(comm)


def report(step):
    H, V = force_on_die(step)
    say(f"t = {step.time:.3f}: V = {V:.2f}, H = {H:.2f} N/mm")


slide = np.linspace(1.0, 2.0, round(10 / min(size, 0.1)) + 1)
times = np.union1d(np.linspace(0.0, 1.0, 21), slide[slide <= until + 1e-9])
history = QuasiStatic(problem, load).run(times, halve_steps=True, extrapolate=True, observer=report)

# ## Comparison
#
# Refined meshes (down to cells of 0.05 mm) converge to V = 330.6 and H = 68.2 at $t = 1$, and to
# V = 403.9 and H = 128.8 at $t = 1.1$. Published values at $t = 1$ are 332.0 and 71.0 (code_aster,
# the same law), 319.5 and 67.2 (Hartmann), 297.9 and 62.1 (Fischer and Wriggers), 289.7 and 58.5
# (Yastrebov), 267.9 and 55.3 (Poulios and Renard). The table of all laws is in the documentation of
# the benchmarks.

H_pressed, V_pressed = force_on_die(history.at(1.0))
say(f"pressed: V = {V_pressed:.2f}, converged 330.6; H = {H_pressed:.2f}, converged 68.2")
if until >= 1.1:
    H_dragged, V_dragged = force_on_die(history.at(1.1))
    say(f"dragged: V = {V_dragged:.2f}, converged 403.9; H = {H_dragged:.2f}, converged 128.8")

# ## The pictures
#
# `ironing.png` shows both bodies at the end: the slab rises on both sides of the die and meets its
# round edge, so that the contact normals turn along the face. `forces.png` shows both forces over
# time. Contact begins at $t = 0.2$. The horizontal force is positive before the die slides: the die
# is pressed near the free end of the slab, which moves to the left under it. At $t = 1$ the die
# starts to slide: friction is mobilised within a few steps, and the vertical force rises as well.

folder = io.output_folder(comm, "output/ironing")
plot.picture_of_body(folder / "ironing.png", problem)
if comm.rank == 0:
    t = np.array([s.time for s in history.steps])
    H, V = np.transpose([force_on_die(s) for s in history.steps])
    curves = {"vertical": (t, V), "horizontal": (t, H)}
    plot.draw_curves(folder / "forces.png", curves, labels=("time", "force, N/mm"))
