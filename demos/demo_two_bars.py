# SPDX-License-Identifier: LGPL-3.0-or-later
# # Two bars that hit each other
#
# This demo illustrates how to:
#
# - let two bodies with mass hit each other (`ContactPair`, `NSCD`), each with its own velocity;
# - look at the velocity in the middle of the contact, and at what an impact leaves in the bodies.
#
# A bar with the speed V hits an equal one at rest, end to end. Waves run out from the contact, in
# which the material moves by V/2 under the pressure rho c V/2, are reflected at the free ends, and
# when they are back, after 2 L/c, the bars part: the first is at rest, the second has V, and no
# vibration is left. So it is for bars without Poisson's effect (the default). With it (`--poisson
# 0.3`) the sides move too, waves of many speeds follow, and some of the energy stays as vibration.
#
# Velocities of the faces are means over steps. Where nodes without mass (the default) have been
# let go they alternate, about what the bar does.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

LENGTH, WIDTH, DENSITY, YOUNG, SPEED = 10.0, 1.0, 1.0, 900.0, 20.0
C, EARLY = 30.0, 0.1  # of waves; time until the impact


def arguments(argv=None):
    parser = ScriptParser("Two bars", output="output/two_bars", poisson=0.0)
    part, levels = number(least=0, most=1), ("position", "velocity")
    masses = ("redistributed", "lumped", "consistent")
    schemes = ("theta", "theta-euler", "modified-theta")
    parser.add_argument("--elements", type=number(int, above=1), default=50, help="along a bar")
    parser.add_argument("--across", type=number(int, above=1), default=2, help="and across it")
    parser.add_argument("--scheme", choices=schemes, default="theta", help="of steps")
    parser.add_argument("--level", choices=levels, default="position", help="of the law")
    parser.add_argument("--theta", type=part, default=0.5, help="weight of a step's end")
    parser.add_argument("--dt", type=number(above=0), help="length of a step (default: h/c)")
    parser.add_argument("--mass", choices=masses, default="redistributed", help="matrix")
    parser.add_argument("--restitution", type=part, default=0.0, help="at the velocity level")
    args = parser.parse(argv)
    args.dt = args.dt or LENGTH / args.elements / C
    return args


def two_bars(args, comm):
    """The problem, the velocity at the start, and the dofs along the bars amid their faces."""
    gap, half = SPEED * EARLY, WIDTH / 2
    ends, n = ((-LENGTH, 0.0), (gap, gap + LENGTH)), [args.elements, args.across]
    bodies = [
        mesh.create_rectangle(comm, [[a, -half], [b, half]], n, mesh.CellType.quadrilateral)
        for a, b in ends
    ]
    domain = join(bodies).mesh
    faces = [
        mesh.locate_entities_boundary(domain, 1, lambda x, at=at: np.isclose(x[0], at))
        for at in (0.0, gap)
    ]
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, velocity = fem.Function(V, name="displacement"), fem.Function(V)
    velocity.interpolate(lambda x: np.array([SPEED * (x[0] < gap / 2), 0 * x[0]]))
    pair = ContactPair(u, faces[0], master_facets=faces[1], law=Frictionless())
    energy = LinearElastic.from_young(YOUNG, args.poisson).energy(u) * ufl.dx
    middles = [
        2 * fem.locate_dofs_geometrical(V, lambda x, a=a: np.hypot(x[0] - a, x[1]) < 1e-9)
        for a in (0.0, gap)
    ]
    owned = 2 * V.dofmap.index_map.size_local
    return ContactProblem(energy, u, [pair]), velocity, [m[m < owned] for m in middles]


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, velocity, middles = two_bars(args, comm)
    how = {k: getattr(args, k) for k in ("scheme", "level", "theta", "mass", "restitution")}
    motion, places = NSCD(problem, DENSITY, dt=args.dt, velocity=velocity, **how), [[0.0, 0.0]]

    def watch(_):
        mine = [problem.u.x.array[dofs].sum() for dofs in middles]
        places.append([comm.allreduce(float(x)) for x in mine])

    history = motion.run([0.0, EARLY, EARLY + 2.5 * LENGTH / C], observer=watch)
    times = np.array([0.0, *(s.time for s in history.steps)])
    steps, mass = np.diff(times), DENSITY * LENGTH * WIDTH
    faces = np.diff(np.array(places), axis=0) / steps[:, None]
    force = -np.array([s.result.resultants["contact"][0] for s in history.steps])
    energies, end = [s.energies for s in history.steps], history.energies
    after = np.array([SPEED, 0.0]) + np.array([-1, 1]) * (force @ steps) / mass
    pressed = np.flatnonzero(force > 0.5 * force.max())
    start = mass * SPEED**2 / 2
    inner = (times[1:] > EARLY + 0.1) & (times[1:] < EARLY + 0.5)
    summary = {
        "velocities": after,
        "duration": times[pressed[-1] + 1] - times[pressed[0]],
        "pressure": force[inner].mean() / WIDTH / (DENSITY * C * SPEED / 2),
        "vibration": (end.kinetic + end.stored - mass * (after @ after) / 2) / start,
        "energy_end": (end.kinetic + end.stored) / start,
        "energy_residue": max(abs(e.residue) for e in energies) / start,
    }
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    rows = zip(times[1:], force, *faces.T, strict=True)
    rows = [dict(zip(("t", "force", "first", "second"), row, strict=True)) for row in rows]
    output.write_rows(comm, folder / "contact_force.csv", rows)
    if comm.rank == 0:
        curves = {"first bar": (times[1:], faces[:, 0]), "second": (times[1:], faces[:, 1])}
        axes = "time", "normal velocity in the middle of the contact"
        output.draw_curves(folder / "velocity.png", curves, labels=axes)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
