# SPDX-License-Identifier: LGPL-3.0-or-later
# # Wedged: friction holds a body without any load
#
# This demo illustrates how to:
#
# - compute the smallest friction coefficient with which a body can stay wedged after unloading,
#   with a proof that there is no smaller one (`wedging_friction`);
# - compare it with the critical friction of sliding states;
# - follow loading and unloading with memory by arc length (`ArcLength`).
#
# A wedged state consists of displacements and contact forces without load, in which each point is
# open, or closed with a force in its friction cone (Kim, Jang and Barber, 2019). The direction of
# the shear is free: it depends on the history. Since everything is homogeneous, the coefficient
# depends on neither the load nor the history.

from mpi4py import MPI

import numpy as np

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
)
from dolfinx_contact.analysis import critical_friction, wedging_friction
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import name_groups

comm = MPI.COMM_WORLD
meshes = [1, 2, 4, 8]  # cells along an edge
lame = (100.0, 82.0)
load = (-98.5, -17.4)  # a traction that wedges the triangle

# ## The body
#
# Half of the unit square, clamped on its diagonal, on a floor; the traction $-\gamma f$ acts on its
# left side.


def triangle(n, friction):
    square = mesh.create_unit_square(comm, n, n, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    sides = {
        "slope": lambda x: np.isclose(x[0] + x[1], 1),
        "side": lambda x: np.isclose(x[0], 0),
        "bottom": lambda x: np.isclose(x[1], 0),
    }
    body = name_groups(mesh.create_submesh(square, 2, half)[0], sides)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 0.0)
    force = fem.Constant(domain, load)
    energy = LinearElastic(*lame).energy(u) * ufl.dx + gamma * ufl.dot(force, u) * body.ds("side")
    clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=Coulomb(friction))
    problem = ContactProblem(energy, u, [surface], bcs=[clamped])
    return ParametricContact(problem, gamma)


# ## The coefficient under refinement
#
# On one or two elements it equals the critical coefficient of sliding, $(\lambda + 3\mu)/(\lambda +
# \mu)$ for one element. On finer meshes it is smaller, since points in the middle open.

say = io.Report(comm)
wedging, sliding = [], []
for n in meshes:
    problem = triangle(n, 1.0).problem
    found = wedging_friction(problem)
    wedging.append(found.friction)
    sliding.append(critical_friction(problem).friction)
    proved = "proved" if found.complete else "not proved"
    say(f"n = {n}: wedged from F = {wedging[-1]:.8f} ({proved}); sliding {sliding[-1]:.8f}")
closed_form = (lame[0] + 3 * lame[1]) / (lame[0] + lame[1])
say(f"one element: {wedging[0]:.10f}, closed form {closed_form:.10f}")

# ## Loading, unloading and pulling
#
# With memory, friction opposes the increments of slip. The load grows, vanishes, grows and vanishes
# again, and then pulls. Slightly above the coefficient the body stays in contact without load and
# is freed by a pull only; slightly below, the forces vanish with the load.

n = meshes[-1]
paths = {}
for share in (0.99, 1.01):
    system = triangle(n, share * wedging[-1])
    path = ArcLength(system)
    control = StepControl(kinks="exact", initial=0.5, maximum=0.5)
    rows, without_load = [], []
    for direction, least in (("increasing", 0.0), ("back", 0.0), ("back", 0.0), ("back", -1.0)):
        way = path.run(gamma_range=(least, 1.0), direction=direction, control=control)
        for step in way.steps:
            (force,) = step.result.resultants.values()
            rows.append((step.gamma, force[1]))
        if abs(rows[-1][0]) < 1e-9:
            without_load.append(rows[-1][1])
        if rows[-1][1] < 1e-9:
            break
    paths[share] = np.array(rows)
    left = without_load[0]
    say(f"{share:g} of the coefficient: normal force {left:.6f} after unloading")
    say(f"  smallest load in contact {paths[share][:, 0].min():.6f}")

folder = io.output_folder(comm, "output/wedging")
if comm.rank == 0:
    h = 1 / np.array(meshes)
    curves = {"wedged": (h, wedging), "sliding in continua": (h, sliding)}
    labels = ("cell size h", "friction coefficient F")
    plot.draw_curves(folder / "coefficients.png", curves, labels=labels)
    curves = {f"{share:g} of the coefficient": tuple(path.T) for share, path in paths.items()}
    plot.draw_curves(folder / "paths.png", curves, labels=("load", "normal force"))
