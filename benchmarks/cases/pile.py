# SPDX-License-Identifier: LGPL-3.0-or-later
"""A pile drawn out of soil, with earth pressure at rest.

Reference: cylinders of soil.

A concrete pile of the radius a stands in soil of the weight g down to L. At rest the soil is, at
y < 0, under the stresses g y along the axis and K0 g y across it, the pile under the latter (its
own weight, one load more, is left out). The energy has them as sigma0 : eps(u), with the weight
and the pressure from under L; -K0 g y presses on the shaft. The base has no contact: it is free.

The soil is held at r = R, and shears like the cylinders of Randolph and Wroth (J. Geotech. Eng.
Div. ASCE 104, 1978): a shear t of the shaft lifts it by t a/G ln(R/a). With one slip u all along
a bond of the stiffness C and the work w = C u0^2 the pile is drawn by
    P = 2 pi a L C u  up to u0,   then   2 pi a L C u0^4/u^3 + pi a mu K0 g L^2 (1 - (u0/u)^2),
and its head, L0 above ground, lifted by u + P (ln(R/a)/(2 pi G L) + (L/3 + L0)/EA). In a soil
softer than 3 C the curve could turn back. The ends of the soil are free, as no cylinders' are: it
gives way by a part of the order R/L more, and bends, which presses at the base and frees the top.
Units are m, kN and kPa; the parameters are our own choice, of a plausible order.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactPair, ContactProblem, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.meshing import join

A = 0.3  # a
FREE = 0.5  # L0
PILE = (30e6, 0.2)  # E and nu
SOIL = (40e3, 0.3)
WEIGHT = 10.0  # g (under water)
REST = 0.5  # K0
BOND = 4e3  # C
U0 = 7.5e-3  # u0


def arguments(argv=None):
    parser = ScriptParser("A pile drawn out of soil", output="output/pile", n=20, friction=0.5)
    positive = number(above=0)
    beyond = number(above=A)
    count = number(int, above=0)
    parser.add_argument("--depth", type=positive, default=10.0, help="of the base, L, m")
    parser.add_argument("--radius", type=beyond, default=5.0, help="of held soil, R, m")
    parser.add_argument("--steps", type=count, default=16, help="up to the peak")
    return parser.parse(argv)


def pile_in_soil(args, comm):
    """The problem, and the Constant by which the head of the pile is drawn."""
    L = args.depth
    R = args.radius
    square = mesh.CellType.quadrilateral
    shaft = np.linspace(-L, 0.0, args.n + 1)
    pile_r = np.array([0, A])
    pile_y = np.append(shaft, FREE)
    soil_r = np.geomspace(A, R, args.n + 1)
    pile = create_grid(comm, (pile_r, pile_y), square)
    soil = create_grid(comm, (soil_r, shaft), square)

    def tagged(domain, where, tag=1):
        found = mesh.locate_entities_boundary(domain, 1, where)
        return mesh.meshtags(domain, 1, np.sort(found), tag)

    def on_shaft(x):
        return np.isclose(x[0], A) & (x[1] < FREE / 2)

    def on_base(x):
        return np.isclose(x[1], -L) & (x[0] > 0.9 * A)

    pile_face = tagged(pile, on_shaft, 1)
    soil_face = tagged(soil, on_shaft, 2)
    both = join([pile, soil], facet_tags=[pile_face, soil_face])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")

    # The head is drawn along the axis, and the soil is held at R.
    drawn = fem.Constant(domain, 0.0)
    head = tagged(domain, lambda x: np.isclose(x[1], FREE))
    held = tagged(domain, lambda x: np.isclose(x[0], R))
    bcs = []
    for i, value, facets in ((1, drawn, head), (0, 0.0, held), (1, 0.0, held)):
        W = V.sub(i)
        dofs = fem.locate_dofs_topological(W, 1, facets.indices)
        bcs.append(fem.dirichletbc(value, dofs, W))

    r, y = ufl.SpatialCoordinate(domain)
    strain = ufl.grad(u)
    dx = ufl.Measure("dx", subdomain_data=both.cell_tags)
    ds = ufl.ds(subdomain_data=tagged(domain, on_base))
    elastic_pile = Axisymmetric(LinearElastic.from_young(*PILE))
    elastic_soil = Axisymmetric(LinearElastic.from_young(*SOIL))

    # The stresses at rest: across the axis in both, along it in the soil, with the weight.
    across = REST * WEIGHT * ufl.min_value(y, 0.0) * (strain[0, 0] + u[0] / r)
    along = WEIGHT * (y * strain[1, 1] + u[1])
    energy = (elastic_pile.energy(u) + across) * dx(1)
    energy -= WEIGHT * L * u[1] * ds(1)
    energy += (elastic_soil.energy(u) + across + along) * dx(2)

    law = RCCM(BOND, BOND, BOND * U0**2, args.friction)
    bond = ContactPair(u, both, slave=1, master=2, law=law, axisymmetric=True)
    problem = ContactProblem(energy, u, [bond], bcs=bcs)
    return problem, drawn


def closed_form(args, u):
    """Return force, displacement of the head, compliance and remaining friction."""
    L = args.depth
    EA = np.pi * A**2 * PILE[0]
    G = SOIL[0] / 2 / (1 + SOIL[1])
    left = U0 / np.maximum(u, U0)
    friction = np.pi * A * args.friction * REST * WEIGHT * L**2
    bonded = 2 * np.pi * A * L * BOND * left**4 * u
    rubbed = friction * (1 - left**2)
    force = bonded + rubbed
    soil_gives = np.log(args.radius / A) / (2 * np.pi * G * L)
    pile_gives = (L / 3 + FREE) / EA
    gives = soil_gives + pile_gives
    return force, u + force * gives, gives, friction


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, drawn = pile_in_soil(args, comm)
    at_rest = problem.solve().tables["contact"]

    up_to_2 = np.linspace(0.0, 2.0, 200)
    beyond = np.geomspace(2.0, 10.0, 100)[1:]
    u = np.append(up_to_2, beyond) * U0
    force, lift, gives, friction = closed_form(args, u)
    peak, head_at_peak, _, _ = closed_form(args, U0)

    # Equal steps up to twice the peak, growing ones after.
    n = args.steps
    twice = 2 * head_at_peak
    near = np.linspace(0, twice, 2 * n + 1)
    far = np.geomspace(twice, lift[-1], n + 1)
    times = np.append(near, far[1:])

    def draw(t):
        drawn.value = t

    evolution = QuasiStatic(problem, draw)
    with io.EvolutionSeries(folder, problem, every=n) as series:
        run = evolution.run(times, observer=series)

    tables = [at_rest]
    tables += [step.result.tables["contact"] for step in run.steps]
    head = np.array([0.0, *(step.time for step in run.steps)])
    pulls = []
    slips = []
    for table in tables:
        area = table.area
        pulls.append(-table.force[:, 1].sum())
        slips.append(area @ table.ut[:, 1] / area.sum())
    pull = np.array(pulls)
    slip = np.array(slips)
    gone = head - slip
    mean_pull = (pull[1:] + pull[:-1]) / 2
    found = {
        "peak": pull.max(),
        "peak_closed_form": peak,
        "plateau": pull[-1],
        "friction_limit": friction,
        "plateau_closed_form": force[-1],
        "at_rest": args.friction * at_rest.rn.sum(),
        "gives": gone[1] / pull[1],
        "gives_closed_form": gives,
    }
    found |= run.energies.row()
    found["work_of_pull"] = mean_pull @ np.diff(head)
    lines = [f"{name}: {value:.6g}" for name, value in found.items()]
    say("\n".join(lines))
    found["head"] = head
    found["force"] = pull
    found["closed_form"] = np.interp(head, lift, force)

    if comm.rank == 0:
        names = ("head, m", "load, kN")
        solid = {"pile": (head, pull)}
        dotted = {"one slip, cylinders": (lift, force)}
        plot.draw_curves(folder / "load.png", solid, dotted=dotted, labels=names)
        shear = {}
        for i in (n // 2, n, 5 * n // 4, -1):
            table = tables[i]
            y = table.x[:, 1]
            label = f"head at {1e3 * head[i]:.3g} mm"
            shear[label] = (table.shear[:, 1], y)
        names = ("shear on the pile, kPa", "y, m")
        plot.draw_curves(folder / "shear.png", shear, labels=names)
    plot.picture_of_body(folder / "body.png", problem)
    summary = run.steps[-1].result.summary()
    return io.write_summary(comm, folder, summary | found)


if __name__ == "__main__":
    main()
