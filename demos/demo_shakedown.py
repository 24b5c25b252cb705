# SPDX-License-Identifier: LGPL-3.0-or-later
# # Shakedown: does friction come to rest under cyclic loads?
#
# This demo illustrates how to:
#
# - compute the largest load factor up to which residual slips can hold all points at rest
#   (`shakedown`, the static bound of Melan);
# - verify the bound by stepping through cycles below and above it;
# - recognise problems for which the theorem does not hold.
#
# A block is pressed down by its top, which then moves to and fro. If the block lies on its mirror
# image, slips do not change the pressure. Then the theorem of Klarbring, Ciavarella and Barber
# (2007) holds: below the bound the pair comes to rest from every initial state. On a rigid floor
# slip and pressure are coupled, and the initial state may decide.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.analysis import shakedown
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join, name_groups

comm = MPI.COMM_WORLD
n = 6  # cells along an edge
friction, down, across = 0.3, -0.01, 0.002  # and the displacements of the top

# ## A block on a floor or on its mirror image
#
# The pair is sheared from both ends, so that the upper block deforms like the one on the floor.


def at(y):
    return lambda x: np.isclose(x[1], y)


def block(mirrored):
    """The problem, and the displacements of the ends (Constants)."""
    quadrilateral = mesh.CellType.quadrilateral
    side, half = np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 0.5, n // 2 + 1)
    body = create_grid(comm, (side, half), quadrilateral)
    body = name_groups(body, {"sole": at(0.0), "top": at(0.5)})
    if mirrored:
        image = create_grid(comm, (side, half - 0.5), quadrilateral)
        body = join([body, name_groups(image, {"seat": at(0.0), "base": at(-0.5)})])
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    ends, bcs = [], []
    for name in ("top", "base") if mirrored else ("top",):
        ends.append(fem.Constant(body.mesh, np.zeros(2)))
        bcs.append(fem.dirichletbc(ends[-1], body.dofs(V, name), V))
    law = Coulomb(friction)
    if mirrored:
        contact = ContactPair(u, body, slave="sole", master="seat", law=law)
    else:
        contact = ContactSurface(u, body, tag="sole", obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [contact], bcs=bcs), ends


# ## The bound, and cycles around it
#
# A load is a function that sets the Constants. The cycle passes its corners in turn; the steady
# load is the part that does not vary. With `factor=` cycles are run at a given load factor, with
# `starts=` from several initial states.

say = io.Report(comm)
folder = io.output_folder(comm, "output/shakedown")
factors, endings, theorem = {}, {}, {}
for name, mirrored in (("pair", True), ("floor", False)):
    problem, ends = block(mirrored)

    def displaced(amount, ends=ends):
        def load():
            for sign, end in zip((1.0, -1.0), ends, strict=False):
                end.value[:] = (sign * amount, sign * down)

        return load

    corners, steady = [displaced(across), displaced(-across)], displaced(0.0)
    below = shakedown(problem, corners, steady=steady, cycles=100)
    above = shakedown(
        problem, corners, steady=steady, factor=1.05 * below.factor, cycles=100, starts=0
    )
    factors[name], theorem[name] = below.factor, below.theorem_holds
    endings[name] = (
        sorted({cycle.ending for cycle in below.cycles}),
        sorted({cycle.ending for cycle in above.cycles}),
    )
    say(f"{name}: bound {below.factor:.6f}, theorem holds: {below.theorem_holds}")
    say(f"  cycles at 0.95 of the bound: {endings[name][0]}; at 1.05: {endings[name][1]}")
    if comm.rank == 0:
        work = {
            f"0.95, start {cycle.start}": (1 + np.arange(cycle.number), cycle.dissipation)
            for cycle in below.cycles
        }
        work["1.05"] = (1 + np.arange(above.cycles[0].number), above.cycles[0].dissipation)
        first = {key: (x[:10], np.asarray(y)[:10]) for key, (x, y) in work.items()}
        labels = ("cycle", "dissipation")
        plot.draw_curves(folder / f"{name}.png", first, labels=labels)
