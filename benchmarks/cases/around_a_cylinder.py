# SPDX-License-Identifier: LGPL-3.0-or-later
"""A band led around a drum.

Reference: the equation of a ring.

A neo-Hookean band lies on a rigid drum of radius 1, plane strain, no friction. Its ends are bent
down and stretched until it is wrapped around the drum, and are then led around the axis by more
than the contact is long. There the band is a part of a ring, for which an ordinary equation has
the pressure; and as nothing but the frame changes on the way around, the pressure stays.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from scipy.integrate import solve_bvp

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, Sphere, io, plot
from dolfinx_contact.materials import NeoHookean, lame

HALF = 1.2  # of the length of the band
THICKNESS = 0.2
STRETCH = 1.1  # on the drum
MODULI = lame(1.0, 0.3)  # lambda and mu
RUBBER = NeoHookean(*MODULI)


def arguments(argv=None):
    parser = ScriptParser("A band around a drum", output="output/around_a_cylinder")
    parser.add_argument("--n", type=number(int, least=2), default=4, help="cells across the band")
    parser.add_argument("--angle", type=number(), default=180.0, help="led around by, degrees")
    parser.add_argument("--steps", type=number(int, least=1), default=10, help="of both ways")
    return parser.parse(argv)


# The band and where its ends go.
#
# Bent to the curvature k, a straight band becomes an arc that touches the drum at its top.


def band(args, comm):
    lower = np.array([-HALF, 1.0])
    upper = np.array([HALF, 1.0 + THICKNESS])
    along = round(2 * HALF / THICKNESS) * args.n
    cell = mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, [lower, upper], [along, args.n], cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    moved = fem.Function(V)

    def on_drum(x):
        return np.isclose(x[1], 1.0)

    def at_ends(x):
        return np.isclose(abs(x[0]), HALF)

    below = mesh.locate_entities_boundary(domain, 1, on_drum)
    ends = mesh.locate_entities_boundary(domain, 1, at_ends)
    drum = Sphere((0.0, 0.0), 1.0)
    contact = ContactSurface(u, below, obstacle=drum, law=Frictionless())
    dofs = fem.locate_dofs_topological(V, 1, ends)
    held = fem.dirichletbc(moved, dofs)
    energy = RUBBER.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [contact], bcs=[held])
    return problem, moved


def way(part, angle, ring):
    """Displacements of the ends, bent to a part of the drum's curvature and led around."""

    def value(x):
        stretch = 1 + part * (STRETCH - 1)
        phi = x[0] * stretch * part
        in_ring = ring.sol(x[1] - 1)[0]
        r = 1 / part - 1 + in_ring
        across = r * np.sin(phi)
        up = r * np.cos(phi) + 1 - 1 / part
        turn = np.exp(-1j * angle)
        place = (across + 1j * up) * turn
        return np.array([place.real, place.imag]) - x[:2]

    return value


# A ring.
#
# Layers at Y go to the radius r(Y), with the stretches a = r' and b = w r, w the angle per length.
# The radial stress P(a, b) balances: P' = w P(b, a), r = 1 on the drum and P = 0 at the outer face.


def ring_of(lam, mu):
    def stress(a, b):
        volume = np.log(a * b)
        return mu * (a - 1 / a) + lam * volume / a

    def slope(_, y):
        a = y[1]
        b = STRETCH * y[0]
        volume = np.log(a * b)
        shear = mu * (1 + 1 / a**2)
        bulk = lam * (1 - volume) / a**2
        hoop = stress(b, a)
        rise = STRETCH * (hoop - lam / b)
        return np.array([a, rise / (shear + bulk)])

    def ends(below, above):
        on_drum = below[0] - 1
        outside = stress(above[1], STRETCH * above[0])
        return np.array([on_drum, outside])

    layers = np.linspace(0.0, THICKNESS, 21)
    straight = [1 + layers, np.ones(21)]
    ring = solve_bvp(slope, ends, layers, straight, tol=1e-10)
    r, a = ring.y[:, 0]
    pressure = -stress(a, STRETCH * r)
    return ring, float(pressure)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    say = io.Report(comm)
    folder = io.output_folder(comm, args.output)
    problem, moved = band(args, comm)
    ring, pressure = ring_of(*MODULI)
    parts = np.arange(1, args.steps + 1) / args.steps
    around = np.radians(args.angle)
    bending = [(part, 0.0) for part in parts]
    leading = [(1.0, around * part) for part in parts]
    found = []
    for part, turn in bending + leading:
        displacement = way(part, turn, ring)
        moved.interpolate(displacement)
        result = problem.solve()
        table = result.tables["contact"]
        middle = len(table.x) // 2
        found.append(float(table.pressure[middle]))
        say(f"bent {part:.3f}, led around by {turn:.3f}: {result.iterations} steps of Newton")
    stress = RUBBER.full_stress(problem.u)
    plot.picture_of_body(folder / "body.png", problem, stress=stress)
    io.write_contact_table(comm, folder, [table])
    bent = found[args.steps - 1]
    led = found[args.steps :]
    drift = max(abs(p / bent - 1) for p in led)
    touching = table.rn > 0
    length = float(table.area[touching].sum())  # before the stretch
    say(f"pressure {found[-1]:.6g}, in a ring {pressure:.6g}, drift {drift:.1e}")
    summary = result.summary()
    summary["pressure"] = found[-1]
    summary["pressure_closed_form"] = pressure
    summary["pressure_drift"] = drift
    summary["contact_length"] = length * STRETCH
    summary["way"] = float(around)
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
