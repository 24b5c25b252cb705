# SPDX-License-Identifier: LGPL-3.0-or-later
# # A strip peeled off its base: snap-back
#
# This demo illustrates how to:
#
# - bond a body to an obstacle by an adhesive that damages (`RCCM`);
# - follow an evolution by arc length where the load must decrease (`ArcLength`);
# - locate the folds of the load, and compare them with beam theory.
#
# A strip of thickness 1 and modulus $E$ is bonded to a rigid base beyond a crack of length $a_0$. A
# testing machine of stiffness $k$ pulls the free end up by $\gamma$. A beam with a crack of length
# $a$ and the fracture energy $w$ needs the force and the opening
#
# $$P = \frac{\sqrt{2 E I w}}{a},\qquad D = \sqrt{\frac{2 w}{9 E I}}\, a^2,
# \qquad \gamma = D + \frac{P}{k}.$$
#
# Hence $P^2 D$ is constant, and $\gamma$ decreases until $a = (3 E I/(2k))^{1/3}$: the machine must
# move back for the bond to break slowly. A history with increasing $\gamma$ would jump here.
#
# The root of the beam, about two thicknesses long, is elastic too and lengthens the crack; $P^2 D$
# and the turning point do not depend on it. The elements are half as long as the strip is thick, so
# that nodes break one by one, each with folds of its own.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
    io,
    plot,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n = 2  # cells per thickness along the strip
peeled_length = 3.0  # at which the run stops
young, inertia, fracture_energy = 1.0, 1 / 12, 1e-4
length, crack = 18.0, 5.0
turning_crack = 10.0  # length of the crack where gamma turns
machine = 1.5 * young * inertia / turning_crack**3  # its stiffness
root = 2.0
P_a = np.sqrt(2 * young * inertia * fracture_energy)  # force times crack length
D_a2 = np.sqrt(2 * fracture_energy / (9 * young * inertia))  # opening over its square

# ## The strip
#
# The machine is a spring between its grip, at $\gamma$, and the free end. The constant part of its
# energy, $k\gamma^2/2$, is omitted.

corners = [[0.0, 0.0], [length, 1.0]]
cells = [int(n * length), max(n // 2, 1)]
domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
gamma = fem.Constant(domain, 0.0)
free_end = np.sort(mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 0)))
ds = ufl.Measure("ds", domain, subdomain_data=mesh.meshtags(domain, 1, free_end, 1))(1)
spring = machine * (u[1] ** 2 / 2 - gamma * u[1]) * ds
elastic = LinearElastic.from_young(young, 0.0)
far_end = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], length))
clamped = fem.dirichletbc(np.zeros(2), far_end, V)

# ## The bond
#
# The model of Raous, Cangemi and Cocou has an intensity $\beta$ that falls from 1 to 0. The bond
# carries $C u \beta^2$ and damages when $C u^2 \beta$ exceeds $w$. Its stiffness $C$ determines how
# long the elastic root of the beam is.

stiffness = 4 * young * inertia / root**4
law = RCCM(stiffness, stiffness, fracture_energy)
bonded = mesh.locate_entities_boundary(
    domain, 1, lambda x: np.isclose(x[1], 0) & (x[0] > crack - 1e-9)
)
base = HalfSpace((0, 0), (0, 1))
bond = ContactSurface(u, np.sort(bonded), obstacle=base, law=law)
problem = ContactProblem(elastic.energy(u) * ufl.dx + spring, u, [bond], bcs=[clamped])
system = ParametricContact(problem, gamma)

# ## The path
#
# An observer computes the force of the machine in each step. The path stops when enough is peeled,
# and a second run leads the machine back to zero, where the strip is at rest again.

force_form = fem.form(machine * (gamma - u[1]) * ds)
forces = []


def peeled(step):
    table = step.result.tables["contact"]
    return float(np.dot(1 - table.beta, table.area))


def record_force(step):
    forces.append(comm.allreduce(fem.assemble_scalar(force_form)))


def stop(step):
    return "enough is peeled" if peeled(step) > peeled_length else ""


largest = 1.3 * (D_a2 * crack**2 + P_a / crack / machine)
path = ArcLength(system)
control = StepControl(maximum=0.1)
out = path.run(gamma_range=(0.0, largest), control=control, observer=record_force, stop=stop)
back = path.run(gamma_range=(1e-3 * largest, largest), control=control, direction="back")

# ## Comparison
#
# The machine opens the crack and returns, so that its total work is the fracture energy of the
# peeled length. At the folds where a node has just broken, $P^2 D$ is that of the beam.

load = np.array([step.gamma for step in out.steps])
kinds = np.array([step.event for step in out.steps])
area = np.array([peeled(step) for step in out.steps])
P = np.array(forces)
D = load - P / machine
at_fold = (kinds == "smooth fold") & (area > root)
constant = (P**2 * D / (P_a**2 * D_a2))[at_fold]
work_ratio = back.energies.external / (fracture_energy * area[-1])
say = io.Report(comm)
span = f"{constant.min():.4f} to {constant.max():.4f}"
say(f"P^2 D over that of the beam at {at_fold.sum()} folds: {span}, closed form 1")
say(f"work over the fracture energy of the peeled length: {work_ratio:.4f}, closed form 1")

# ## The picture
#
# The force rises linearly while the bond is intact. Then each node that breaks causes a pair of
# folds: at a nonsmooth fold the bond of a node begins to break, at a smooth fold it is broken. The
# zigzag follows the curve of the beam, along which the machine moves back.

folder = io.output_folder(comm, "output/peeling")
if comm.rank == 0:
    a = np.linspace(crack, np.sqrt(D[-1] / D_a2), 100)
    beam = (D_a2 * a**2 + P_a / a / machine, P_a / a)
    folds = {
        f"{kind}s": (load[kinds == kind], P[kinds == kind])
        for kind in ("smooth fold", "nonsmooth fold")
    }
    labels = ("displacement of the machine", "force")
    curves = {"strip": (load, P)}
    plot.draw_curves(
        folder / "peeling.png", curves, marks=folds, dotted={"beam": beam}, labels=labels
    )
