# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wheel rolling on a rail.

Reference: Carter.

A wheel is pressed on a rail of the same material. Its hub goes to the right by s and turns
clockwise by s (1 - xi)/R, with the creepage xi = (v - w R)/v. Where nothing drives or brakes it,
it rolls with a creepage of its own, xi_0, which is zero for half-planes and here small: hub and
bottom of the rail hold the bodies. A driven wheel turns faster, a braked one slower: the front
part of what touches sticks, the rear one slips. Between half-planes of like materials (Carter,
1926; Johnson, Contact Mechanics, 1985, section 8.3) the tractive force Q on the wheel obeys

    xi - xi_0 = -(mu a/R) sign(Q) (1 - sqrt(1 - |Q|/(mu P)))

with the force P, and a half of the width that touches, by Hertz a^2 = 4 P R/(pi E*),
E* = E/(2 (1 - nu^2)). It is a steady state: the hub rolls until Q hardly changes any more, two
widths 2 a after the start. With 10, 20 and 40 cells on a width the creepage of the braked wheel
less that of the driven one is 0.958, 0.973 and 0.976 of Carter's.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _hertz import Hertz

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.meshing import join

RADIUS = 1.0
HUB = 0.5  # its radius
YOUNG = 1.0
NU = 0.3
MODULUS = YOUNG / (2 * (1 - NU**2))  # E*
HERTZ = Hertz(2, RADIUS, MODULUS)
HALF_WIDTH = 0.025  # a, about
APPROACH = 1.155e-3  # of the hub
SPOT = 6e-4  # angle by which the hub turns at most before it rolls
PRELOAD = 0.93  # Q then, over that of Carter
DEPTH = 0.5  # of the rail


def arguments(argv=None):
    parser = ScriptParser("A rolling wheel", output="output/wheel", n=20, friction=0.3)
    parser.add_argument(
        "--creepage",
        type=number(above=0, below=1),
        default=0.4,
        help="of the driven wheel, over mu a/R; of the braked one less that",
    )
    parser.add_argument("--way", type=number(above=0), default=2.0, help="over 2 a")
    return parser.parse(argv)


# The bodies.
#
# Quadrilaterals of the size 2 a/n where the bodies touch or will touch, larger ones elsewhere. Of
# the wheel its lower half is there.


def sizes(args):
    """Size of cells, and how far to the left and right of the start they have it."""
    h = 2 * HALF_WIDTH / args.n
    return h, 1.5 * HALF_WIDTH, 2 * HALF_WIDTH * args.way + 1.5 * HALF_WIDTH


def spread(length, size, left, right):
    """Coordinates from -length to length, with cells of a size from -left to right."""
    parts = []
    for fine in (left, right):
        cells = round(fine / size)
        parts.append(graded(length, size, cells, 14))
    return np.concatenate([-parts[0][::-1], parts[1][1:]])


def bodies(args, comm):
    h, left, right = sizes(args)
    deep = graded(DEPTH, h, 4, 12)
    cell = mesh.CellType.quadrilateral
    rail = create_grid(comm, [spread(1.0, h, left, right), -deep[::-1]], cell)
    along = spread(0.5 * np.pi * RADIUS, h, left, right)
    wheel = create_grid(comm, [along, graded(RADIUS - HUB, h, 4, 12)], cell)
    s, depth = wheel.geometry.x[:, :2].T.copy()
    # What rolls over the rail from the left to the right lies on the right of the pole.
    angle = s / RADIUS
    r = RADIUS - depth
    wheel.geometry.x[:, 0] = r * np.sin(angle)
    wheel.geometry.x[:, 1] = RADIUS - r * np.cos(angle)
    return join([rail, wheel])


class Hub:
    """The motion of the hub, and of the plane at which the wheel is cut.

    Args:
        V: displacement space.
    """

    def __init__(self, V):
        self.motion = fem.Function(V)
        self.start = V.tabulate_dof_coordinates()[:, :2]

        def held(x):
            r = np.hypot(x[0], x[1] - RADIUS)
            inside = np.isclose(r, HUB) | (np.isclose(x[1], RADIUS) & (r < RADIUS + 1e-9))
            return inside & (x[1] > 1e-9)

        facets = mesh.locate_entities_boundary(V.mesh, 1, held)
        self.dofs = fem.locate_dofs_topological(V, 1, facets)

    def move(self, right, down, angle):
        """By a translation, and clockwise by an angle."""
        c, s = np.cos(angle), np.sin(angle)
        arm = self.start - (0.0, RADIUS)
        turned = arm @ np.array([[c, -s], [s, c]])
        self.motion.x.array[:] = (turned - arm + (right, -down)).reshape(-1)


def problem(args, comm):
    domain = bodies(args, comm).mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    steel = NeoHookean(*lame(YOUNG, NU))
    dx = ufl.dx(domain, metadata={"quadrature_degree": 3})
    locate = mesh.locate_entities_boundary
    top = locate(domain, 1, lambda x: np.isclose(x[1], 0.0) & (abs(x[0]) <= 1.0 + 1e-9))
    bottom = locate(domain, 1, lambda x: np.isclose(x[1], -DEPTH))

    def on_tread(x):  # of the rail only the middle of its top is as far from the axis
        return np.isclose(np.hypot(x[0], x[1] - RADIUS), RADIUS, rtol=0, atol=1e-10)

    tread = locate(domain, 1, on_tread)
    hub = Hub(V)
    bcs = [
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V),
        fem.dirichletbc(hub.motion, hub.dofs),
    ]
    faces = dict(master_facets=top, sliding="large", search_distance=0.05)
    pair = ContactPair(u, tread, law=Coulomb(args.friction), **faces)
    return ContactProblem(steel.energy(u) * dx, u, [pair], bcs=bcs), hub


# Rolling.
#
# The hub comes down, turns on the spot until Q is almost what Carter has, and rolls. Without the
# second of these the steady state would be the same, but far away: Q shears the bodies as a whole,
# and each way changes that by no more than xi times itself.


class Rolling:
    """A wheel that is pressed, turned on the spot and rolled with a creepage.

    Args:
        args: options.
        creepage: xi.
        comm: communicator.

    Attributes:
        problem: wheel and rail.
        rows: way, P and Q on the wheel after each step of rolling.
    """

    def __init__(self, args, creepage, comm):
        self.problem, self.hub = problem(args, comm)
        self.rows = []
        self.friction = args.friction
        self.creepage = creepage
        self.facet = sizes(args)[0]
        self.facets = round(2 * HALF_WIDTH * args.way / self.facet)
        self.enough = PRELOAD * abs(tractive(creepage, args.friction))
        self.spot = SPOT * np.sign(-creepage)
        self.start_time = np.inf  # time at which it rolls, by a facet in a time of 1

    def placed(self, t):
        """The way and the angle of the hub."""
        way = self.facet * max(t - self.start_time, 0.0)
        spot = self.spot * np.clip(min(t, self.start_time) - 1.0, 0.0, 1.0)
        return way, spot + way * (1 - self.creepage) / RADIUS

    def load(self, t):
        way, angle = self.placed(t)
        self.hub.move(way, APPROACH * min(t, 1.0), angle)

    def turned_enough(self, step):
        Q, P = step.result.resultants["contact"]
        return "" if abs(Q) < self.enough * self.friction * P else "turned on the spot"

    def watch(self, step):
        Q, P = step.result.resultants["contact"]
        self.rows.append((self.placed(step.time)[0], P, Q))

    def run(self):
        """The last step."""
        history = QuasiStatic(self.problem, self.load)
        given = dict(halve_steps=True)
        history.run(np.linspace(0.0, 1.0, 5), **given)
        self.start_time = 1.0
        if self.creepage != 0:
            self.start_time = 2.0
            spot = np.linspace(1.0, 2.0, 41)
            turned = history.run(spot, stop=self.turned_enough, **given)
            self.start_time = turned.steps[-1].time
        times = self.start_time + np.arange(self.facets + 1)
        rolled = history.run(times, observer=self.watch, **given)
        return rolled.steps[-1]

    def along(self, table, time):
        """Places of the points of the wheel along the rail, from below the axis (n,)."""
        angle = np.arctan2(table.x[:, 0], RADIUS - table.x[:, 1])
        return RADIUS * (angle - self.placed(time)[1])


# Carter's theory.


def carter(q, friction, half_width):
    """Creepage at q = Q/(mu P), beyond that of a wheel that rolls freely."""
    return -friction * half_width / RADIUS * np.sign(q) * (1 - np.sqrt(1 - abs(q)))


def tractive(creepage, friction):
    """Q/(mu P) at a creepage."""
    c = creepage * RADIUS / (friction * HALF_WIDTH)
    return -np.sign(c) * (1 - (1 - abs(c)) ** 2)


def carter_shear(x, q, friction, load):
    """Shear on the wheel at places x before (positive) and behind the axis of the contact.

    Where it slips, behind, it is mu p; in front of that the same less a second ellipse.
    """
    a = HERTZ.radius(load)
    stick = np.sqrt(1 - abs(q))  # half of its width, over a
    second = 1 - ((x / a - (1 - stick)) / stick) ** 2
    ellipse = HERTZ.peak(load) * stick * np.sqrt(np.maximum(second, 0.0))
    return np.sign(q) * friction * (HERTZ.pressure(load, x) - ellipse)


def compared(args, creepage, rows):
    """Return the results of a run and those of Carter."""
    ways, P, Q = rows.T
    q = Q / (args.friction * P)
    a = HERTZ.radius(P[-1])
    unit = args.friction * a / RADIUS
    width = 2 * a
    late = np.interp(ways[-1] - width, ways, q)
    return {
        "creepage": creepage,
        "force": P[-1],
        "traction": q[-1],  # Q/(mu P)
        "change_over_last_width": q[-1] - late,
        "half_width": a,
        "facets_rolled": len(ways),
        "carter_creepage": carter(q[-1], args.friction, a),
        "unit": unit,
    }


def write(comm, folder, name, wheel, last, args):
    """Ways and forces of a run, and the shear of the wheel beside Carter's."""
    rows = np.array(wheel.rows)
    load, tractive_force = rows[-1, 1:]
    table = last.result.tables["contact"]
    x = wheel.along(table, last.time)
    shown = (abs(x) < 1.5 * HALF_WIDTH) & (table.area > 0)
    places = np.linspace(x[shown].min(), x[shown].max(), 401)
    q = tractive_force / (args.friction * load)
    if comm.rank > 0:
        return
    plot.draw_curves(
        folder / f"shear_{name}.png",
        {"Carter": (places, carter_shear(places, q, args.friction, load))},
        marks={"points of the wheel": (x[shown], table.rt[shown, 0] / table.area[shown])},
        labels=("before the axis", "shear on the wheel"),
    )
    header = "way,P,Q"
    np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="")


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    creepage = args.creepage * args.friction * HALF_WIDTH / RADIUS
    runs = {}
    for name, xi in (("held", 0.0), ("driven", -creepage), ("braked", creepage)):
        wheel = Rolling(args, xi, comm)
        last = wheel.run()
        table = last.result.tables["contact"]
        found = compared(args, xi, np.array(wheel.rows))
        runs[name] = found | {"closed": int((table.rn > 0).sum())}
        say(f"{name}, xi = {xi:.3e}: Q/(mu P) = {found['traction']:.4f}")
        write(comm, folder, name, wheel, last, args)
    summary = last.result.summary() | {"runs": runs}
    free = -runs["held"]["carter_creepage"]
    summary["free_creepage"] = free
    for name in ("driven", "braked"):
        run = runs[name]
        ratio = (run["creepage"] - free) / run["carter_creepage"]
        summary[f"creepage_{name}_ratio"] = ratio
        say(f"{name}: creepage over Carter's {ratio:.4f}")
    between = runs["braked"]["carter_creepage"] - runs["driven"]["carter_creepage"]
    summary["creepage_ratio"] = 2 * creepage / between
    say(f"braked less driven: creepage over Carter's {summary['creepage_ratio']:.4f}")
    io.write_contact_table(comm, folder, [table])
    plot.picture_of_body(folder / "wheel.png", wheel.problem)
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
