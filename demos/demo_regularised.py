# SPDX-License-Identifier: LGPL-3.0-or-later
# # The price of regularised friction
#
# This demo illustrates how to:
#
# - replace Coulomb's threshold by a smooth law of a width (`Regularised`);
# - follow a solution as the width varies, and find the width at which solutions are lost;
# - measure the creep that a regularised law causes where Coulomb's law holds a body for ever.
#
# A regularised law replaces the bound by a smooth function of the slip, for instance
# $t = -F p \tanh(u_t/\varepsilon)$. It is popular since it avoids the nonsmooth problem. This demo
# shows two consequences: solutions disappear, and nothing sticks.

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
    Regularised,
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import explore, follow
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import name_groups
from dolfinx_contact.records import leftmost

comm = MPI.COMM_WORLD
n = 16  # cells along an edge of the triangle
friction = 2.0
width = 1e-4
say = io.Report(comm)

# ## Lost solutions
#
# The triangle of `demo_linear_triangle.py` has three solutions under the load $\gamma = 1$: its
# corner $A$ opens, sticks, or slips to the left.


def triangle(law):
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
    gamma = fem.Constant(domain, -1.0)
    load = fem.Constant(domain, (26.0, 7.5))
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx
    energy += gamma * ufl.dot(load, u) * body.ds("side")
    clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=law(domain))
    return ContactProblem(energy, u, [surface], bcs=[clamped]), gamma


# `explore` gives the three solutions of Coulomb's law as ends of branches.

problem, gamma = triangle(lambda _: Coulomb(friction))
true = ParametricContact(problem, gamma)
problem.solve()
x = true.create_vector()
problem.write(x)
diagram = explore(true, [(x, -1.0)], gamma_range=(-1.0, 1.0))
ends = [point for b in diagram.branches for point in (b.points[0], b.points[-1])]
solutions = {true.letters(point.piece)[0]: point for point in ends if point.gamma == 1.0}

# The regularised problem starts from the solution in which $A$ sticks. The width is a Constant of
# the law, and the branch is followed in it.

widths = []


def smooth(domain):
    widths.append(fem.Constant(domain, width))
    return Regularised(Coulomb(fem.Constant(domain, friction)), widths[0], "tanh")


true.result_at(solutions["k"])  # writes this solution into the problem
regularised, load = triangle(smooth)
load.value = 1.0
regularised.u.x.array[:] = problem.u.x.array
force, true_force = (p.surfaces[0].multiplier for p in (regularised, problem))
force.x.array[:] = true_force.x.array
regularised.solve()
system = ParametricContact(regularised, widths[0])
x = system.create_vector()
regularised.write(x)
branch = follow(system, x, width, gamma_range=(0.1 * width, 1.0))
lost = branch.folds[0].gamma
say(f"the sticking and the slipping solution vanish in a fold at a width of {lost:.6g}")

# A computation that starts with a larger width and reduces it arrives at the open solution and
# never detects the others.

# ## Creep
#
# A refrigerator of weight $N$ stands on a floor and is pushed by a force $Q$ far below $F N$.
# Coulomb's friction holds it for ever. If the law is regularised by the slip rate $v$,
# $t = -F p \tanh(v/\varepsilon)$, every point of the contact face moves with the velocity
# $v = \varepsilon\, \mathrm{artanh}(Q/(F N))$, whatever the pressure is. With a constant velocity,
# implicit steps of months are exact.

breadth, height, weight, push = 0.6, 1.8, 800.0, 5.0  # metres and newtons
friction_of_floor = 0.3
year = 365.25 * 86400.0  # seconds
cells = (4, 12)
steps = 6


def metres_in_a_year(law):
    """Velocity at the end, in metres per year, and the history."""
    corners = [(0.0, 0.0), (breadth, height)]
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    force = fem.Constant(domain, (0.0, 0.0))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    surface = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    stored = LinearElastic.from_young(1e6, 0.3).energy(u)
    energy = (stored - ufl.dot(force, u)) * ufl.dx
    options = {"snes_rtol": 1e-11}
    refrigerator = ContactProblem(energy, u, [surface], petsc_options=options)

    def load(t):
        force.value[:] = np.array((push if t > 0 else 0.0, -weight)) / (breadth * height)

    load(0.0)
    refrigerator.solve()
    history = QuasiStatic(refrigerator, load).run(np.linspace(0.0, year, steps + 1))
    tables = [step.result.tables["contact"] for step in history.steps]
    slips = [table.area @ table.ut[:, 0] / table.area.sum() for table in tables]
    return (slips[-1] - slips[-2]) * steps, history


share = push / (friction_of_floor * weight)
held, _ = metres_in_a_year(Coulomb(friction_of_floor))
say(f"Coulomb: {held:.1e} m in a year")
eps = [1e-9, 1e-7, 1e-5]
crept = []
for value in eps:
    law = Regularised(Coulomb(friction_of_floor), width=1e-4, shape="tanh", speed=value)
    crept.append(metres_in_a_year(law)[0])
    exact = year * value * np.arctanh(share)
    say(f"eps = {value:g} m/s: {crept[-1]:.6g} m in a year, closed form {exact:.6g} m")

# ## The picture
#
# Slip of $A$ along the branch: creep at small widths, then the fold, and slip on the way back.

folder = io.output_folder(comm, "output/regularised")
journal = records.journal_of(system, [branch], {"ut_A": leftmost("ut")})
if comm.rank == 0:
    along = journal.columns()
    curves = {"regularised": (along["gamma"], along["ut_A"])}
    labels = (r"width $\varepsilon$", "$u_t$ of A")
    plot.draw_curves(folder / "width.png", curves, labels=labels)
