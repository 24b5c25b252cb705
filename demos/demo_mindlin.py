# SPDX-License-Identifier: LGPL-3.0-or-later
# # Cattaneo and Mindlin: a contact that is sheared and unloaded
#
# This demo illustrates how to:
#
# - press two bodies together, shear them by a force, and reverse it (`QuasiStatic`);
# - give a pair of flat faces an initial gap that represents their curvature (`gap=`);
# - compare shear traction and stick zone with closed forms that depend on the history.
#
# Two equal cylinders are pressed together by $P$ per length and then sheared by $Q < \mu P$. Only
# the sum of their curvatures matters, which is modelled by the gap $x^2/(2R)$ between two flat
# blocks. With Hertz's contact radius $a$ and peak pressure $p_0$, the middle $|x| < c$ sticks and
#
# $$q(x) = \mu p_0 \left[\sqrt{1 - \frac{x^2}{a^2}} - \frac{c}{a}\sqrt{1 - \frac{x^2}{c^2}}\right],
# \qquad c = a \sqrt{1 - \frac{Q}{\mu P}},$$
#
# where a root of a negative number counts as zero. When $Q^*$ falls to $Q$, the ends slip back at
# once. The traction then changes by $-2\mu p_0 [\ldots]$ with
# $c' = a \sqrt{1 - (Q^* - Q)/(2 \mu P)}$ in place of $c$ (K. L. Johnson, *Contact Mechanics*,
# 1985, chapter 7). A static solve cannot give this result, since it has no memory.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join, name_groups

comm = MPI.COMM_WORLD
n = 20  # cells on about half of the contact
steps = 4  # of the shear, each way
friction, young, poisson = 0.2, 200.0, 0.3
radius = 4.0  # of the relative curvature
size = 12.0  # of the blocks
indentation = 0.215
loaded, unloaded = 0.46808, -0.1  # Q/(mu P) at the turn and at the end

# ## Two blocks
#
# The cells have the size h on the contact and grow away from it. Both blocks have nodes at the same
# places of the contact line, so that contact is evaluated node by node. The blocks are much larger
# than the contact and represent half-planes.

h = 0.68 / n
face_half_length = 0.9
growing = h * np.cumsum(1.25 ** np.arange(60))
y = np.concatenate(([0.0], growing[growing < 0.8 * size], [size]))
half = np.append(np.arange(0.0, face_half_length, h), face_half_length + y[1:])
x = np.append(-half[:0:-1], half)
quadrilateral = mesh.CellType.quadrilateral


def at(height, reach=np.inf):
    return lambda x: np.isclose(x[1], height) & (np.abs(x[0]) < reach)


# The faces of both blocks coincide; their names, which `join` keeps, distinguish them.

face = at(0.0, face_half_length)
upper = name_groups(create_grid(comm, (x, y), quadrilateral), {"upper_face": face, "top": at(size)})
lower = name_groups(
    create_grid(comm, (x, -y[::-1]), quadrilateral), {"lower_face": face, "base": at(-size)}
)
blocks = join([upper, lower])
domain = blocks.mesh

# ## The problem
#
# The top descends and is loaded by a shear traction, the bottom is held vertically. One node of the
# bottom is held horizontally as well; friction transmits the shear force to it.

V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V)
traction = fem.Constant(domain, 0.0)
down = fem.Constant(domain, 0.0)
material = LinearElastic.from_young(young, poisson)
energy = material.energy(u) * ufl.dx - traction * u[0] * blocks.ds("top")

horizontal, vertical = V.sub(0), V.sub(1)
zero = fem.Constant(domain, 0.0)
node = mesh.locate_entities_boundary(domain, 0, lambda x: np.hypot(x[0], x[1] + size) < 1e-9)
bcs = [
    fem.dirichletbc(down, blocks.dofs(vertical, "top"), vertical),
    fem.dirichletbc(zero, blocks.dofs(vertical, "base"), vertical),
    fem.dirichletbc(zero, fem.locate_dofs_topological(horizontal, 0, node), horizontal),
]
gap = ufl.SpatialCoordinate(domain)[0] ** 2 / (2 * radius)
law = Coulomb(friction)
contact = ContactPair(u, blocks, slave="upper_face", master="lower_face", law=law, gap=gap)
problem = ContactProblem(energy, u, [contact], bcs=bcs)

# ## The history
#
# The blocks are pressed until $t = 1$. Then $P$ is known, the shear force rises until $t = 2$ and
# falls until $t = 3$. The second run continues from the end of the first one. In each step friction
# opposes the slip since the previous step, which is the memory that the closed form contains too.

P = 0.0


def load(t):
    share = np.interp(t, [1, 2, 3], [0, loaded, unloaded])
    down.value = -indentation * min(t, 1.0)
    traction.value = friction * P / (2 * half[-1]) * share


evolution = QuasiStatic(problem, load)
pressed = evolution.run([0.0, 0.5, 1.0]).steps[-1]
P = float(pressed.result.tables["contact"].rn.sum())
history = evolution.run(np.linspace(1.0, 3.0, 2 * steps + 1))

# ## Comparison
#
# The modulus of the pair is $E^* = E/(2(1 - \nu^2))$. The closed form holds for half-planes, at the
# measured force $P$. The stick radius is known up to one cell; the traction has infinite slopes at
# the ends of contact and stick, where the error is largest.

a = np.sqrt(8 * P * radius * (1 - poisson**2) / (np.pi * young))
bound = friction * 2 * P / (np.pi * a)  # mu p0
stick_radius = {"loaded": a * np.sqrt(1 - loaded)}
stick_radius["unloaded"] = a * np.sqrt(1 - (loaded - unloaded) / 2)


def hertz(x, c):
    return c / a * np.sqrt(np.maximum(1 - (x / c) ** 2, 0.0))


say = io.Report(comm)
errors = {}
curves, exact_curves = {}, {}
for name, time in (("loaded", 2.0), ("unloaded", 3.0)):
    table = history.at(time).result.tables["contact"]
    x = table.x[:, 0]
    q = -table.along(table.shear) / bound
    exact = hertz(x, a) - hertz(x, stick_radius["loaded"])
    if name == "unloaded":
        exact -= 2 * (hertz(x, a) - hertz(x, stick_radius[name]))
    inside = np.abs(x) < a
    errors[name] = float(np.sqrt(np.mean((q - exact)[inside] ** 2)))
    stuck = np.abs(x[table.letters == "k"]).max()
    say(f"{name}: stick radius {stuck:.4f}, closed form {stick_radius[name]:.4f}")
    say(f"{name}: root mean square error of the shear {errors[name]:.4f} (in mu p0)")
    curves[name] = (x, q)
    exact_curves[f"closed form, {name}"] = (x, exact)

# ## The picture
#
# The dotted curves are closed forms. Under load, the shear has peaks at the ends of the stick zone,
# and equals $\mu p$ between there and the ends of contact. After unloading, the ends have slipped
# back and their shear has the opposite sign. The middle sticks and keeps the slip of the loading:
# the result depends on the history.

folder = io.output_folder(comm, "output/mindlin")
if comm.rank == 0:
    labels = ("x", r"shear traction over $\mu p_0$")
    plot.draw_curves(folder / "shear.png", curves, dotted=exact_curves, labels=labels)
