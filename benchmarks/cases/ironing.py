# SPDX-License-Identifier: LGPL-3.0-or-later
"""A die dragged over a slab, four elastic laws.

Reference: published forces. `demos/demo_ironing.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.meshing import join

YOUNG = {"slab": 689.6, "die": 6896.0}
NU = 0.32
LENGTH = 12.0
HEIGHT = 4.0
RADIUS = 0.75  # of the round edge of the die
SHOWN = (1.0, 1.05, 1.1, 1.2, 1.3, 1.4)  # times at which forces are reported
WINDOW = (1.48, 1.52)  # of the steady slide
#: V and H of published curves (N/mm) at some times, read off their plots. Their elastic laws
#: differ, and so do their contact conditions: penalties, mortar methods, nodes against facets.
PUBLISHED = {
    "code_aster": {
        "1": (332.0, 71.0),
        "1.05": (384.3, 139.3),
        "1.1": (405.0, 138.8),
        "1.5": (421.0, 143.3),
    },
    "Hartmann": {
        "1": (319.5, 67.2),
        "1.05": (372.1, 143.4),
        "1.1": (395.5, 149.6),
        "1.5": (408.4, 160.2),
    },
    "Fischer, Wriggers": {
        "1": (297.9, 62.1),
        "1.05": (342.4, 143.3),
        "1.1": (363.2, 172.6),
        "1.5": (365.1, 188.8),
    },
    "Yastrebov": {
        "1": (289.7, 58.5),
        "1.05": (326.6, 143.5),
        "1.1": (352.1, 167.4),
        "1.5": (359.5, 170.8),
    },
    "Poulios, Renard": {
        "1": (267.9, 55.3),
        "1.05": (307.9, 102.4),
        "1.1": (324.3, 99.4),
        "1.5": (337.4, 102.1),
    },
}
SIDES = {"slab": 2, "die": 3}
BELOW = 1
ABOVE = 4


def arguments(argv=None):
    parser = ScriptParser("Ironing", output="output/ironing", size=0.2, friction=0.3)
    add = parser.add_argument
    add("--law", choices=LAWS, default="iso", help="elastic law")
    add("--plane-stress-lame", action="store_true", help="2 lambda mu/(lambda + 2 mu) for lambda")
    add("--slave", choices=SIDES, default="slab", help="body whose nodes have the law")
    add("--until", type=number(above=0, most=2), default=1.1, help="time at which to stop")
    return parser.parse(argv)


def iso(first, J, lmbda, mu):
    bulk = lmbda + 2 * mu / 3
    return mu / 2 * (J ** (-2 / 3) * first - 3) + bulk / 2 * ((J**2 - 1) / 2 - ufl.ln(J))


def iso1(first, J, lmbda, mu):
    bulk = lmbda + 2 * mu / 3
    return mu / 2 * (J ** (-2 / 3) * first - 3) + bulk / 2 * (J - 1) ** 2


def log(first, J, lmbda, mu):
    return mu / 2 * (first - 3 - 2 * ufl.ln(J)) + lmbda / 2 * ufl.ln(J) ** 2


def quad(first, J, lmbda, mu):
    return mu / 2 * (first - 3 - 2 * ufl.ln(J)) + lmbda / 4 * (J**2 - 1 - 2 * ufl.ln(J))


LAWS = {"iso": iso, "iso1": iso1, "log": log, "quad": quad}


def stored(args, u, young):
    mu = young / (2 * (1 + NU))
    lmbda = young * NU / ((1 + NU) * (1 - 2 * NU))
    if args.plane_stress_lame:
        lmbda = 2 * lmbda * mu / (lmbda + 2 * mu)
    F = ufl.Identity(2) + ufl.grad(u)
    first = ufl.inner(F, F) + 1
    return LAWS[args.law](first, ufl.det(F), lmbda, mu)


def growing(length, size, largest, rate):
    """Places on an axis from 0 to a length, with cells of a size at its end."""
    places = [0.0]
    step = size
    while places[-1] < length:
        places.append(places[-1] + step)
        step = min(step * rate, largest)
    places = np.array(places) * length / places[-1]
    return (length - places)[::-1]


def bodies(args, comm):
    """Slab and die of quadrilaterals."""
    h = args.size
    x = np.linspace(0.0, LENGTH, round(LENGTH / h) + 1)
    slab = create_grid(comm, [x, growing(HEIGHT, h, 0.4, 1.12)], mesh.CellType.quadrilateral)
    across = np.linspace(0.0, 1.0, round(1.39 / h) + 1)
    up = np.linspace(0.0, 1.0, max(round(1.05 / h), 3) + 1)
    die = create_grid(comm, [across, up], mesh.CellType.quadrilateral)
    faces = [tagged(slab, {BELOW: (1, 0.0), SIDES["slab"]: (1, HEIGHT)})]
    faces.append(tagged(die, {SIDES["die"]: (1, 0.0), ABOVE: (1, 1.0)}, walls=SIDES["die"]))
    points = die.geometry.x
    angle = np.arcsin(0.8) * (2 * points[:, 0] - 1)
    arc = np.array([0.8 + RADIUS * np.sin(angle), 4.2 + RADIUS * (1 - np.cos(angle))])
    top = np.array([0.2 + 1.2 * points[:, 0], np.full(len(points), 5.4)])
    points[:, :2] = ((1 - points[:, 1]) * arc + points[:, 1] * top).T
    return join([slab, die], facet_tags=faces)


def tagged(body, planes, walls=None):
    """Facets on planes (axis, place), by their tags; those of both walls too."""
    values = {}
    if walls is not None:
        for place in (0.0, 1.0):
            found = mesh.locate_entities_boundary(body, 1, lambda x, p=place: np.isclose(x[0], p))
            values |= dict.fromkeys(found.tolist(), walls)
    for tag, (axis, place) in planes.items():

        def here(x, axis=axis, place=place):
            return np.isclose(x[axis], place)

        found = mesh.locate_entities_boundary(body, 1, here)
        values |= dict.fromkeys(found.tolist(), tag)
    facets = np.array(sorted(values), dtype=np.int32)
    tags = np.array([values[f] for f in facets], dtype=np.int32)
    return mesh.meshtags(body, 1, facets, tags)


def problem(args, comm):
    body = bodies(args, comm)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    energy = sum(
        stored(args, u, YOUNG[name]) * dx(tag) for tag, name in enumerate(("slab", "die"), 1)
    )
    motion = fem.Constant(body.mesh, np.zeros(2))
    bcs = []
    for tag, value in ((BELOW, np.zeros(2)), (ABOVE, motion)):
        dofs = fem.locate_dofs_topological(V, 1, body.facet_tags.find(tag))
        bcs.append(fem.dirichletbc(value, dofs, V))
    master = next(name for name in SIDES if name != args.slave)
    pair = ContactPair(
        u,
        body,
        slave=SIDES[args.slave],
        master=SIDES[master],
        law=Coulomb(args.friction),
        sliding="large",
    )
    return ContactProblem(energy, u, [pair], bcs=bcs), motion


def times(args):
    """Steps of a facet at most; in the window of the means of an eighth, which energies need."""
    press = np.linspace(0.0, 1.0, 21)
    facet = min(args.size, 0.1)
    slide = np.linspace(1.0, 2.0, round(10 / facet) + 1)
    fine = np.linspace(*WINDOW, round(80 * (WINDOW[1] - WINDOW[0]) / facet) + 1)
    every = np.union1d(np.round(np.concatenate([press, slide, fine]), 10), SHOWN)
    return every[every <= args.until + 1e-9]


def forces(args, step):
    """Vertical and horizontal force on the die, pressing and dragging positive."""
    force = step.result.resultants["contact"]
    on_slab = force if args.slave == "slab" else -force
    return -on_slab[1], on_slab[0]


def ripple(time, values):
    """Peak to peak, less a straight line."""
    return float(np.ptp(values - np.polyval(np.polyfit(time, values, 1), time)))


def energy_rest(steps, window):
    """External work less stored energy and friction, over the work, in a window of time."""
    inside = [s for s in steps if window[0] - 1e-9 <= s.time <= window[1] + 1e-9]
    first = inside[0].energies
    last = inside[-1].energies
    work = last.external - first.external
    return abs(last.residue - first.residue) / abs(work)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    pressed, motion = problem(args, comm)

    def load(t):
        motion.value[:] = 10 * max(t - 1, 0.0), -min(t, 1.0)

    def watch(step):
        vertical, horizontal = forces(args, step)
        say(f"t = {step.time:.4f}: V = {vertical:.2f}, H = {horizontal:.2f} N/mm")

    # Solves begin at what the last step leads to.
    evolution = QuasiStatic(pressed, load)
    history = evolution.run(times(args), halve_steps=True, extrapolate=True, observer=watch)
    steps = history.steps
    t = np.array([s.time for s in steps])
    V, H = np.array([forces(args, s) for s in steps]).T
    reached = [f"{time:g}" for time in SHOWN if t[-1] >= time - 1e-9]
    found = {
        f"{name}_at": {time: float(values[np.argmin(abs(t - float(time)))]) for time in reached}
        for name, values in (("V", V), ("H", H))
    }
    inside = (t >= WINDOW[0] - 1e-9) & (t <= WINDOW[1] + 1e-9)
    if t[-1] >= WINDOW[1] - 1e-9:
        found["middle"] = {"V": float(V[inside].mean()), "H": float(H[inside].mean())}
        found["middle"] |= {
            f"ripple_{name}": ripple(t[inside], values[inside])
            for name, values in (("V", V), ("H", H))
        }
        found["energy_rest"] = energy_rest(steps, WINDOW)
    iterations = [s.result.iterations for s in steps]
    found["newton_mean"] = float(np.mean(iterations))
    found["newton_worst"] = int(np.max(iterations))
    found["failed_steps"] = sum(s.rejected for s in steps)
    found["published"] = PUBLISHED
    for name, curve in PUBLISHED.items():
        at = ", ".join(f"t = {time}: {v:g}, {h:g}" for time, (v, h) in curve.items())
        say(f"{name}, V and H at {at}")
    rows = np.column_stack([t, V, H])
    if comm.rank == 0:
        np.savetxt(folder / "forces.csv", rows, delimiter=",", header="t,V,H", comments="")
    plot.picture_of_body(folder / "ironing.png", pressed)
    return io.write_summary(comm, folder, found)


if __name__ == "__main__":
    main()
