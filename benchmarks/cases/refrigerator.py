# SPDX-License-Identifier: LGPL-3.0-or-later
"""Creep under regularised friction.

Reference: closed form.

A refrigerator of the weight N stands on a floor, and somebody leans against it with a force Q far
below F N. Coulomb's friction holds it for ever. Regularised friction, the shear F p phi(v/eps) at
the slip velocity v, is in balance with Q at the velocity

    eps artanh(q) for tanh,   eps q/sqrt(1 - q^2) for the square root,   q = Q/(F N),

at every point of the contact, whatever the pressures are: "the solid is always moving" (M. Raous,
on regularised friction). A smaller eps only makes it slower. Dimensions, weight and force are no
source's; the force acts on the whole body, as where the floor is not level.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Regularised,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic

WIDTH = 0.6  # metres
HEIGHT = 1.8
WEIGHT = 800.0  # newtons
YEAR = 365.25 * 86400.0  # seconds
CREEP = {"tanh": np.arctanh, "sqrt": lambda q: q / np.sqrt(1 - q**2)}  # velocity over eps
EPS = np.logspace(-9, -5, 5)  # m/s


def arguments(argv=None):
    given = dict(n=4, friction=0.3, young=1e6, poisson=0.3)
    parser = ScriptParser("The refrigerator", output="output/refrigerator", **given)
    parser.add_argument("--force", type=number(above=0), default=5.0, help="Q, in newtons")
    parser.add_argument("--steps", type=number(int, least=2), default=6, help="of the year")
    args = parser.parse(argv)
    if not args.force < args.friction * WEIGHT:
        parser.error(f"--force must stay below F N = {args.friction * WEIGHT:g}")
    return args


# A year under a force.
#
# It begins at rest under the weight, by the static law, which knows no velocity: there a
# regularised law is one of the slip, of a `width`. Then the force stays. Steps of months are no
# approximation of that: the velocity is constant, and implicit steps of any length have it exactly.


def year(args, law, comm):
    """Mean slips at the start and at the ends of the steps, and the last step."""
    corners = [(0.0, 0.0), (WIDTH, HEIGHT)]
    cells = (args.n, 3 * args.n)
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    force = fem.Constant(domain, (0.0, 0.0))
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, below, obstacle=floor, law=law)
    stored = LinearElastic.from_young(args.young, args.poisson).energy(u)
    energy = (stored - ufl.dot(force, u)) * ufl.dx
    tight = {"snes_rtol": 1e-11}
    problem = ContactProblem(energy, u, [contact], petsc_options=tight)

    def load(t):
        push = args.force if t > 0 else 0.0
        force.value[:] = np.array((push, -WEIGHT)) / (WIDTH * HEIGHT)

    load(0.0)
    start = problem.solve().tables["contact"]
    times = np.linspace(0.0, YEAR, args.steps + 1)
    history = QuasiStatic(problem, load).run(times)

    tables = [start]
    for step in history.steps:
        tables.append(step.result.tables["contact"])
    slips = [t.area @ t.ut[:, 0] / t.area.sum() for t in tables]
    return np.array(slips), history.steps[-1]


def creep(args, comm, say, shape, exact_speed):
    """A year of each eps: the rows of the summary, and the last step."""
    rows = []
    for eps in EPS:
        law = Regularised(Coulomb(args.friction), width=1e-4, shape=shape, speed=eps)
        slips, last = year(args, law, comm)
        metres = float(slips[-1] - slips[0])
        speed = float((slips[-1] - slips[-2]) / (YEAR / args.steps))
        exact = float(eps * exact_speed)
        row = {
            "eps": float(eps),
            "metres": metres,
            "speed": speed,
            "exact": exact,
            "dissipated": last.energies.dissipated,
        }
        rows.append(row)
        off = speed / exact - 1
        say(f"{shape}, eps = {eps:.0e} m/s: {metres:.3g} m, speed off by {off:+.0e}")
    return rows, last


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    q = args.force / (args.friction * WEIGHT)
    slips, last = year(args, Coulomb(args.friction), comm)
    coulomb = float(slips[-1] - slips[0])
    say(f"Coulomb: {coulomb:.1e} m in a year, {last.result.counts}")

    summary = {"q": q, "coulomb": coulomb}
    marks = {}
    dotted = {}
    for shape, closed in CREEP.items():
        exact_speed = closed(q)  # over eps
        rows, last = creep(args, comm, say, shape, exact_speed)
        summary[shape] = rows
        metres = [row["metres"] for row in rows]
        marks[shape] = (EPS, metres)
        dotted[f"closed form, {shape}"] = (EPS, YEAR * EPS * exact_speed)
    if comm.rank == 0:
        title = f"Under {q:.1%} of what friction holds; Coulomb: {coulomb:.0e} m"
        look = dict(labels=("eps, m/s", "metres in a year"), loglog=True, title=title)
        plot.draw_curves(folder / "creep.png", {}, marks=marks, dotted=dotted, **look)
    return io.write_summary(comm, folder, last.result.summary() | summary)


if __name__ == "__main__":
    main()
