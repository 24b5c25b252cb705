# SPDX-License-Identifier: LGPL-3.0-or-later
# # The refrigerator that crosses the kitchen
#
# This demo illustrates how to:
#
# - regularise friction in a history, by the velocity of the slip (`Regularised(..., speed=eps)`);
# - see what that costs: under any force, however small, a body creeps.
#
# A refrigerator of the weight N stands on a floor, and somebody leans against it with a force Q far
# below F N. Coulomb's friction holds it for ever. Regularised friction, the shear F p phi(v/eps) at
# the slip velocity v, is in balance with Q at the velocity
#
#     eps artanh(q) for tanh,   eps q/sqrt(1 - q^2) for the square root,   q = Q/(F N),
#
# at every point of the contact, whatever the pressures are: "the solid is always moving" (M. Raous,
# on regularised friction). A smaller eps only makes it slower. Dimensions, weight and force are no
# source's; the force acts on the whole body, as where the floor is not level.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, Regularised, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic

WIDTH, HEIGHT, WEIGHT, YEAR = 0.6, 1.8, 800.0, 365.25 * 86400.0  # metres, newtons, seconds
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


# ## A year under a force
#
# It begins at rest under the weight, by the static law, which knows no velocity: there a
# regularised law is one of the slip, of a `width`. Then the force stays. Steps of months are no
# approximation of that: the velocity is constant, and implicit steps of any length have it exactly.


def year(args, law, comm):
    """Mean slips at the start and at the ends of the steps, and the last step."""
    corners = [(0.0, 0.0), (WIDTH, HEIGHT)]
    square = mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, corners, (args.n, 3 * args.n), square)
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))), name="displacement")
    force = fem.Constant(domain, (0.0, 0.0))
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    contact = ContactSurface(u, below, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    body = LinearElastic.from_young(args.young, args.poisson).energy(u)
    energy = (body - ufl.dot(force, u)) * ufl.dx
    tight = {"snes_rtol": 1e-11}
    problem = ContactProblem(energy, u, [contact], petsc_options=tight)

    def load(t):
        force.value[:] = np.array((args.force * (t > 0), -WEIGHT)) / (WIDTH * HEIGHT)

    load(0.0)
    start = problem.solve().tables["contact"]
    times = np.linspace(0.0, YEAR, args.steps + 1)
    history = QuasiStatic(problem, load).run(times, sudden=np.inf)
    tables = [start, *(s.result.tables["contact"] for s in history.steps)]
    slips = np.array([t.area @ t.ut[:, 0] / t.area.sum() for t in tables])
    return slips, history.steps[-1]


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    q = args.force / (args.friction * WEIGHT)
    slips, last = year(args, Coulomb(args.friction), comm)
    summary = {"q": q, "coulomb": float(slips[-1] - slips[0])}
    say(f"Coulomb: {summary['coulomb']:.1e} m in a year, {last.result.counts}")
    marks, dotted = {}, {}
    for shape, closed in CREEP.items():
        rows = []
        for eps in EPS:
            law = Regularised(Coulomb(args.friction), width=1e-4, shape=shape, speed=eps)
            slips, last = year(args, law, comm)
            found = float((slips[-1] - slips[-2]) / (YEAR / args.steps))
            exact = float(eps * closed(q))
            way, off = float(slips[-1] - slips[0]), found / exact - 1
            row = {"eps": float(eps), "metres": way, "speed": found, "exact": exact}
            rows.append(row | {"dissipated": last.energies.dissipated})
            say(f"{shape}, eps = {eps:.0e} m/s: {way:.3g} m, speed off by {off:+.0e}")
        summary[shape] = rows
        marks[shape] = (EPS, [row["metres"] for row in rows])
        dotted[f"closed form, {shape}"] = (EPS, YEAR * EPS * closed(q))
    if comm.rank == 0:
        look = dict(labels=("eps, m/s", "metres in a year"), loglog=True)
        look["title"] = f"Under {q:.1%} of what friction holds; Coulomb: {summary['coulomb']:.0e} m"
        output.draw_curves(folder / "creep.png", {}, marks=marks, dotted=dotted, **look)
    return output.write_summary(comm, folder, last.result.summary() | summary)


if __name__ == "__main__":
    main()
