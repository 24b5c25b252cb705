# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two arcs pressed on a block.

Reference: a published curve.

Two half-rings, bonded, stand upside down on a block: radii 85, 90 and 95 mm, moduli 1e5 (inside)
and 1e3 MPa, on a block of 250 by 50 mm and 300 MPa, Poisson's ratio 0.3, in plane strain. Both
ends are pushed down by 70 mm and do not turn. Looked at is the middle of the arcs: it sinks into
the block, parts from it and buckles upwards. The published curve (after Drouet, 2015, and
Poulios and Renard, 2015, read off a plot) has the same course, and is not met:

| | sinks to | middle back at 0 | at 56.5 | at 69 mm |
|---|---|---|---|---|
| published, no friction | -5.9 mm | 49.5 | 17 mm | 55.4 mm |
| n = 60 | -3.05 mm | 37.3 | 48.7 mm | 60.9 mm |
| n = 120 | -2.56 mm | 35.4 | 50.4 mm | 62.1 mm |
| published, friction 0.5 | -5.9 mm | 56.5 | 0 mm | 10.2 mm |
| n = 60, friction 0.5 | -3.19 mm | 41.9 | 6.9 mm | 17.9 mm |
| n = 120, friction 0.5 | -2.70 mm | 40.0 | 7.0 mm | 15.5 mm |

The data decide, and not the mesh, which makes the difference larger. An arc clamped at both ends
that is pressed in its middle has the stiffness EI/(0.01166 R^3), 165 N/mm for these two layers;
found is 165 with n = 120, and 204 with n = 60, whose cells lock. The block gives way by 0.68 mm
under the first 134 N; a layer on a rigid base does by 0.60 (Johnson, Contact mechanics, section
5.6), without the soft layer of the arc. So both are what the stated moduli make of them, and at
the start the middle sinks by 0.46 of the way of the ends. The published curve has 0.61, for which
the block has to be half as stiff: with `--block 150` the middle sinks to -5.5 mm at n = 60. Three
sources give the block 300 MPa; one has three other numbers in its text. With radii of 90, 95 and
100 mm, as two sources have, it is -2.7 mm, and with the moduli of the arcs exchanged too.

Under the displacement of the ends the path is continuous, with and without friction, and nothing
snaps; the middle rises by 15 mm in 3 mm of the way. Under a force it would: without friction the
force has a peak and a valley, and in between three states of this path have one force. With
friction 0.5 the force rises to the end. The mesh is symmetric and so is the path; other states at
one displacement were not looked for, and nothing here proves that there are none.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.meshing import join

RADII = (85.0, 90.0, 95.0)  # mm
LENGTH, HEIGHT = 250.0, 50.0  # of the block, mm
INSIDE, OUTSIDE = 1e5, 1e3  # MPa
NU = 0.3
ARC, TOP = 1, 2
#: Height of the middle (mm) by the way of the ends after first contact, read off a plot.
PUBLISHED = {
    "0": {"5.4": -3.0, "19.5": -5.9, "34.2": -4.8, "48.7": -0.5, "56.2": 15.0, "66.7": 53.2},
    "0.5": {"6.5": -3.1, "18.9": -5.9, "35.6": -4.8, "49": -1.9, "56.5": 0.0, "68": 8.9},
}


def arguments(argv=None):
    parser = ScriptParser("Two arcs on a block", output="output/double_arc", n=60, friction=0.0)
    add = parser.add_argument
    add("--block", type=number(above=0), default=300.0, help="modulus of the block, MPa")
    add("--step", type=number(above=0), default=1.5, help="of the ends, mm")
    add("--until", type=number(above=0, most=75), default=70.0, help="way of the ends, mm")
    args = parser.parse(argv)
    if args.n % 30:
        parser.error("--n must be a multiple of 30")
    return args


# The bodies.
#
# Quadrilaterals, n along the arcs. The block, which is soft and flat, is the slave.


def arcs(args, comm):
    """The lower half of a ring, which touches y = 0."""
    places, layers = args.n + 1, 2 * args.n // 30
    angle = np.pi * (1 + np.arange(places) / args.n)
    r = np.linspace(RADII[0], RADII[2], layers + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.multiply.outer(r, around).reshape(-1, 2) + np.array([0.0, RADII[2]])
    i, j = (v.reshape(-1) for v in np.meshgrid(np.arange(args.n), np.arange(layers)))
    first = j * places + i
    above = first + places
    cells = np.stack([first, first + 1, above, above + 1], axis=1).astype(np.int64)
    if comm.rank > 0:
        points, cells = points[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=points, e=ufl.Mesh(element))


def tagged(body, tag, here):
    """Facets at a place, with a tag."""
    facets = np.sort(mesh.locate_entities_boundary(body, 1, here))
    return mesh.meshtags(body, 1, facets, np.full(len(facets), tag, dtype=np.int32))


def bodies(args, comm):
    ring = arcs(args, comm)
    x = np.linspace(-LENGTH / 2, LENGTH / 2, args.n * 5 // 6 + 1)
    y = np.linspace(-HEIGHT, 0.0, args.n * 2 // 15 + 1)
    block = create_grid(comm, [x, y], mesh.CellType.quadrilateral)

    def on_arc(x):
        return np.isclose(np.hypot(x[0], x[1] - RADII[2]), RADII[2])

    faces = [tagged(ring, ARC, on_arc), tagged(block, TOP, lambda x: np.isclose(x[1], 0.0))]
    return join([ring, block], facet_tags=faces)


def moduli(args, domain):
    """Young's modulus of every cell."""
    E = fem.Function(fem.functionspace(domain, ("DG", 0)))

    def young(x):
        radius = np.hypot(x[0], x[1] - RADII[2])
        of_arc = np.where(radius < RADII[1], INSIDE, OUTSIDE)
        return np.where(x[1] > 0, of_arc, args.block)

    E.interpolate(young)
    return E


def problem(args, comm):
    """The contact problem, and the displacement of the ends."""
    body = bodies(args, comm)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    ends = fem.Constant(domain, (0.0, 0.0))
    bcs = []
    for height, value in ((RADII[2], ends), (-HEIGHT, np.zeros(2))):
        facets = mesh.locate_entities_boundary(domain, 1, lambda x, h=height: np.isclose(x[1], h))
        bcs.append(fem.dirichletbc(value, fem.locate_dofs_topological(V, 1, facets), V))
    law = Coulomb(args.friction) if args.friction else Frictionless()
    faces = dict(slave=TOP, master=ARC, sliding="large", search_distance=12.0)
    pair = ContactPair(u, body.facet_tags, law=law, **faces)
    rubber = NeoHookean(*lame(1.0, NU))
    energy = moduli(args, domain) * rubber.energy(u) * ufl.dx(metadata={"quadrature_degree": 4})
    return ContactProblem(energy, u, [pair], bcs=bcs), ends


# A closed form of the arcs.


def stiffness():
    """Of the arcs, clamped at both ends, in their middle: EI/(0.01166 R^3), N/mm."""
    thick = RADII[1] - RADII[0]
    ratio = OUTSIDE / INSIDE
    centre = thick * (0.5 + 1.5 * ratio) / (1 + ratio)  # from inside, of the neutral fibre
    own = thick**3 / 12 * (1 + ratio)
    offset = thick * ((centre - 0.5 * thick) ** 2 + ratio * (1.5 * thick - centre) ** 2)
    bending = INSIDE / (1 - NU**2) * (own + offset)
    return bending / (0.011662 * (RADII[0] + centre) ** 3)


def height_of_middle(u):
    """How far the point between the arcs in the middle has risen, on every rank."""
    V = u.function_space

    def here(x):
        return np.hypot(x[0], x[1] - RADII[2] + RADII[1]) < 1e-6

    n = V.dofmap.index_map.size_local
    found = [d for d in fem.locate_dofs_geometrical(V, here) if d < n]
    mine = [float(u.x.array[2 * d + 1]) for d in found]
    return next(v for values in V.mesh.comm.allgather(mine) for v in values)


def peak_and_valley(force):
    """The first peak of a force and the least one after it, or None where it does not fall."""
    falls = np.flatnonzero(np.diff(force) < 0)
    if not len(falls):
        return None
    return [float(force[falls[0]]), float(force[falls[0] :].min())]


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    pressed, ends = problem(args, comm)
    rows = []

    def load(t):
        ends.value[1] = -t

    def watch(step):
        middle = height_of_middle(pressed.u)
        rows.append((step.time, middle, -step.result.resultants["contact"][1]))
        say(f"ends down by {step.time:.3f}: middle {middle:.3f} mm, {rows[-1][2]:.1f} N/mm")

    times = np.append(np.arange(0.0, args.until - 1e-9, args.step), args.until)
    history = QuasiStatic(pressed, load).run(
        times, halve_steps=True, at_jump="stop", extrapolate=True, observer=watch
    )
    say(history.reason)
    last = history.steps[-1].result
    way, middle, force = np.array(rows).T
    summary = last.summary()
    published = PUBLISHED.get(f"{args.friction:g}", {})
    summary["published"] = published
    reached = [w for w in published if float(w) <= way[-1]]
    summary["middle_at"] = {w: float(np.interp(float(w), way, middle)) for w in reached}
    summary["lowest"] = float(middle.min())
    summary["lowest_at"] = float(way[middle.argmin()])
    summary["highest"] = float(middle.max())
    summary["peak_and_valley"] = peak_and_valley(force)
    summary["arc_stiffness_ratio"] = float(force[0] / (way[0] + middle[0]) / stiffness())
    summary["reason"] = history.reason
    summary["failed_steps"] = sum(step.rejected for step in history.steps)
    if comm.rank == 0:
        header = "way,middle,force"
        np.savetxt(folder / "middle.csv", rows, delimiter=",", header=header, comments="")
    plot.picture_of_body(folder / "double_arc.png", pressed)
    io.write_contact_table(comm, folder, [last.tables["contact"]])
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
