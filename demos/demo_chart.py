# SPDX-License-Identifier: LGPL-3.0-or-later
# # How many solutions, over load and friction coefficient
#
# This demo illustrates how to:
#
# - follow folds of branches while a second parameter varies (`event_curves`);
# - divide a plane of parameters into regions with equal sets of solutions (`solution_regions`);
# - prove the solutions in each region.
#
# The body is Hild's triangle, one element clamped on its slope (see `demo_hild_triangle.py`).
# First, the load grows to the left while the friction coefficient $F$ varies. Folds are located at
# $\gamma = F$ (stick to slip) and at $\gamma = k_t/k = 2$ (slip to separation). They meet and end
# in a cusp at $F = \gamma = 2$: below it, the solution is unique.
#
# Second, both components of the load vary at a fixed friction coefficient. The regions are those of
# Hild's Proposition 2.

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
from dolfinx_contact.analysis import contact_family, event_curves, solution_regions
from dolfinx_contact.continuation import follow
from dolfinx_contact.laws.status import NAMES
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import name_groups

frictions = (1.0, 4.0)  # range of the chart
largest_load = 3.0  # of the regions
say = io.Report(MPI.COMM_WORLD)

# ## The element
#
# Its traction is any UFL expression of two Constants.


def element(law, traction, first, second):
    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1, diagonal=mesh.DiagonalType.left)
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
    a, b = fem.Constant(domain, first), fem.Constant(domain, second)
    energy = LinearElastic(1.0, 1.0).energy(u) * ufl.dx
    energy -= ufl.dot(traction(a, b), u) * body.ds("side")
    clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=law)
    return ContactProblem(energy, u, [surface], bcs=[clamped]), a, b


def branch_of(system, gammas):
    """Branch through the solution at the smallest value of the parameter."""
    system.set_parameter(gammas[0])
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    return follow(system, x, gammas[0], gamma_range=gammas)


# ## Folds over the friction coefficient
#
# A branch is followed at each end of the range. From its folds, the curves of folds are followed
# exactly while both parameters vary.

law = Coulomb(frictions[1])
problem, gamma, _ = element(law, lambda a, b: ufl.as_vector([-2 * a, -2 + 0 * b]), 0.0, 0.0)
system = ParametricContact(problem, gamma)
friction = problem.surfaces[0].law.friction
gammas = (0.0, 1.2 * frictions[1])
branches = []
for value in reversed(frictions):
    friction.value = value
    branches.append((value, branch_of(system, gammas)))
curves = event_curves(system, friction, branches, mu_range=frictions, gamma_range=gammas)
for curve in curves.folds:
    start, end = curve.span
    say(f"folds from F = {start:.6f} to {end:.6f}")
cusps = curves.cusps
for F, load in cusps:
    say(f"they meet at F = {F:.10f}, gamma = {load:.10f}; closed form 2, 2")

# ## Regions of loads
#
# For each sign of a small horizontal load, a branch over all vertical loads meets the borders of
# the regions. In every region a proof lists the solutions.

critical = 2.0
span = (-largest_load, largest_load)
folder = io.output_folder(MPI.COMM_WORLD, "output/chart")
numbers = {}
for F in (0.5 * critical, 1.5 * critical):
    problem, horizontal, vertical = element(
        Coulomb(F), lambda a, b: ufl.as_vector([a, b]), 1.0, 0.0
    )
    system = ParametricContact(problem, vertical)
    branches = []
    for value in (-largest_load / 10, largest_load / 10):
        horizontal.value = value
        branches.append((value, branch_of(system, span)))
    borders = event_curves(
        system, horizontal, branches, mu_range=span, gamma_range=span, folds_only=False
    )
    family = contact_family(system, horizontal, mu_range=span)
    regions = solution_regions(family, borders, mu_range=span, gamma_range=span)
    sets = sorted({cell.solutions for cell in regions.cells}, key=len)
    numbers[F] = max(len(solutions) for solutions in sets)
    names = {s: " or ".join(NAMES[letter] for letter in s) for s in sets}
    say(f"F = {F:g}: {'; '.join(names.values())}; proved: {regions.proved}")
    if MPI.COMM_WORLD.rank == 0:
        labels = dict(labels=("$F_1$", "$F_2$"), title=f"F = {F:g}, critical: {critical:g}")
        plot.draw_chart(folder / f"regions_{F:g}.png", regions, borders, names, **labels)
