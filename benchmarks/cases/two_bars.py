# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two bars that collide.

Reference: exchange of velocities.

A bar with the speed V hits an equal one at rest, end to end. Waves run out from the contact, in
which the material moves by V/2 under the pressure rho c V/2, are reflected at the free ends, and
when they are back, after 2 L/c, the bars part: the first is at rest, the second has V, and no
vibration is left. So it is for bars without Poisson's effect (the default). With it (`--poisson
0.3`) the sides move too, waves of many speeds follow, and some of the energy stays as vibration.

Velocities of the faces are means over steps. Where nodes without mass (the default) have been
released they alternate, about what the bar does.
"""

from mpi4py import MPI

import numpy as np
from _case import MOTION, ScriptParser, motion_of, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, io, plot
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

LENGTH = 10.0
WIDTH = 1.0
DENSITY = 1.0
YOUNG = 900.0
SPEED = 20.0
C = 30.0  # of waves
EARLY = 0.1  # time until the impact


def arguments(argv=None):
    parser = ScriptParser("Two bars", output="output/two_bars", poisson=0.0, **MOTION)
    add = parser.add_argument
    count = number(int, above=1)
    add("--elements", type=count, default=50, help="along a bar")
    add("--across", type=count, default=2, help="and across it")
    add("--dt", type=number(above=0), help="length of a step (default: h/c)")
    args = parser.parse(argv)
    args.dt = args.dt or LENGTH / args.elements / C
    return args


def two_bars(args, comm):
    """The problem, the velocity at the start, and the dofs along the bars amid their faces."""
    gap = SPEED * EARLY
    half = WIDTH / 2
    cells = [args.elements, args.across]

    def bar(left, right):
        corners = [[left, -half], [right, half]]
        return mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)

    first = bar(-LENGTH, 0.0)
    second = bar(gap, gap + LENGTH)
    domain = join([first, second]).mesh

    def face(at):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], at))

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    velocity = fem.Function(V)
    velocity.interpolate(lambda x: np.array([SPEED * (x[0] < gap / 2), 0 * x[0]]))
    pair = ContactPair(u, face(0.0), master_facets=face(gap), law=Frictionless())
    elastic = LinearElastic.from_young(YOUNG, args.poisson)
    energy = elastic.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair])

    middles = []
    owned = 2 * V.dofmap.index_map.size_local
    for at in (0.0, gap):
        nodes = fem.locate_dofs_geometrical(V, lambda x, at=at: np.hypot(x[0] - at, x[1]) < 1e-9)
        dofs = 2 * nodes
        middles.append(dofs[dofs < owned])
    return problem, velocity, middles


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, velocity, middles = two_bars(args, comm)
    motion = NSCD(
        problem,
        DENSITY,
        dt=args.dt,
        velocity=velocity,
        **motion_of(args),
    )
    places = [[0.0, 0.0]]

    def watch(_):
        now = []
        for dofs in middles:
            mine = float(problem.u.x.array[dofs].sum())
            now.append(comm.allreduce(mine))
        places.append(now)

    history = motion.run([0.0, EARLY, EARLY + 2.5 * LENGTH / C], observer=watch)

    ends = np.array([s.time for s in history.steps])
    times = np.append(0.0, ends)
    dt = np.diff(times)
    faces = np.diff(np.array(places), axis=0) / dt[:, None]
    first = faces[:, 0]
    second = faces[:, 1]
    force = -np.array([s.result.resultants["contact"][0] for s in history.steps])
    energies = [s.energies for s in history.steps]

    # The force takes from the first bar what it gives to the second.
    mass = DENSITY * LENGTH * WIDTH
    given = np.array([-1, 1]) * (force @ dt)
    after = np.array([SPEED, 0.0]) + given / mass
    pressed = np.flatnonzero(force > 0.5 * force.max())
    inner = (ends > EARLY + 0.1) & (ends < EARLY + 0.5)
    wave = DENSITY * C * SPEED / 2
    start = mass * SPEED**2 / 2
    end = history.energies.kinetic + history.energies.stored
    summary = {
        "velocities": after,
        "duration": times[pressed[-1] + 1] - times[pressed[0]],
        "pressure": force[inner].mean() / WIDTH / wave,
        "vibration": (end - mass * (after @ after) / 2) / start,
        "energy_end": end / start,
        "energy_residue": max(abs(e.residue) for e in energies) / start,
    }
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    rows = []
    for k, t in enumerate(ends):
        row = {"t": t, "force": force[k], "first": first[k], "second": second[k]}
        rows.append(row)
    io.write_rows(comm, folder / "contact_force.csv", rows)
    if comm.rank == 0:
        curves = {"first bar": (ends, first), "second": (ends, second)}
        axes = ("time", "normal velocity in the middle of the contact")
        plot.draw_curves(folder / "velocity.png", curves, labels=axes)
    last = history.steps[-1].result.summary()
    return io.write_summary(comm, folder, last | summary)


if __name__ == "__main__":
    main()
