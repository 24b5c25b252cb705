# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rubber band around a drum
#
# This demo illustrates how to:
#
# - let a body slide around a curved obstacle as far as it likes: gap and normal are those where its
#   points are now, which is the default for bodies that are not linear (`sliding="large"`);
# - lead the ends of a body along any path by the values of Dirichlet data, solve after solve.
#
# A neo-Hookean band lies on a rigid drum of radius 1, plane strain, no friction. Its ends are bent
# down and stretched until it is wrapped around the drum, and are then led around the axis by more
# than the contact is long. There the band is a part of a ring, for which an ordinary equation has
# the pressure; and as nothing but the frame changes on the way around, the pressure stays.

from mpi4py import MPI

import numpy as np
from scipy.integrate import solve_bvp

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, Sphere, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.materials import NeoHookean, lame

HALF, THICKNESS, STRETCH = 1.2, 0.2, 1.1  # of the band, half its length, and on the drum
MODULI = lame(1.0, 0.3)  # lambda and mu
RUBBER = NeoHookean(*MODULI)


def arguments(argv=None):
    parser = ScriptParser("A band around a drum", output="output/around_a_cylinder")
    parser.add_argument("--n", type=number(int, least=2), default=4, help="cells across the band")
    parser.add_argument("--angle", type=number(), default=180.0, help="led around by, degrees")
    parser.add_argument("--steps", type=number(int, least=1), default=10, help="of both ways")
    return parser.parse(argv)


# ## The band and where its ends go
#
# Bent to the curvature k, a straight band becomes an arc that touches the drum at its top.


def band(args, comm):
    corners = [np.array([-HALF, 1.0]), np.array([HALF, 1.0 + THICKNESS])]
    cells = round(2 * HALF / THICKNESS) * args.n, args.n
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V, name="displacement"), fem.Function(V)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1.0))
    ends = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(abs(x[0]), HALF))
    contact = ContactSurface(u, below, obstacle=Sphere((0.0, 0.0), 1.0), law=Frictionless())
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, ends))
    return ContactProblem(RUBBER.energy(u) * ufl.dx, u, [contact], bcs=[held]), moved


def way(part, angle, ring):
    """Displacements of the ends, bent to a part of the drum's curvature and led around."""

    def value(x):
        phi = x[0] * (1 + part * (STRETCH - 1)) * part
        r = 1 / part - 1 + ring.sol(x[1] - 1)[0]
        place = (r * np.sin(phi) + 1j * (r * np.cos(phi) + 1 - 1 / part)) * np.exp(-1j * angle)
        return np.array([place.real, place.imag]) - x[:2]

    return value


# ## A ring
#
# Layers at Y go to the radius r(Y), with the stretches a = r' and b = w r, w the angle per length.
# The radial stress P(a, b) balances: P' = w P(b, a), r = 1 on the drum and P = 0 at the outer face.


def ring_of(lam, mu):
    def stress(a, b):
        return mu * (a - 1 / a) + lam * np.log(a * b) / a

    def slope(_, y):
        a, b = y[1], STRETCH * y[0]
        stiffness = mu * (1 + 1 / a**2) + lam * (1 - np.log(a * b)) / a**2
        return np.array([a, STRETCH * (stress(b, a) - lam / b) / stiffness])

    def ends(below, above):
        return np.array([below[0] - 1, stress(above[1], STRETCH * above[0])])

    layers = np.linspace(0.0, THICKNESS, 21)
    ring = solve_bvp(slope, ends, layers, [1 + layers, np.ones(21)], tol=1e-10)
    return ring, float(-stress(ring.y[1, 0], STRETCH * ring.y[0, 0]))


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    say, folder = output.Report(comm), output.output_folder(comm, args.output)
    (problem, moved), (ring, pressure) = band(args, comm), ring_of(*MODULI)
    parts, around = np.arange(1, args.steps + 1) / args.steps, np.radians(args.angle)
    found = []
    for part, turn in [*((part, 0.0) for part in parts), *((1.0, around * p) for p in parts)]:
        moved.interpolate(way(part, turn, ring))
        result = problem.solve()
        table = result.tables["contact"]
        found.append(float(table.pressure[len(table.x) // 2]))
        say(f"bent {part:.3f}, led around by {turn:.3f}: {result.iterations} steps of Newton")
    output.picture_of_body(folder / "body.png", problem, stress=RUBBER.full_stress(problem.u))
    output.write_contact_table(comm, folder, [table])
    drift = max(abs(p / found[args.steps - 1] - 1) for p in found[args.steps :])
    summary = result.summary() | {
        "pressure": found[-1],
        "pressure_closed_form": pressure,
        "pressure_drift": drift,
        "contact_length": float(table.area[table.rn > 0].sum()) * STRETCH,
        "way": float(around),
    }
    say(f"pressure {found[-1]:.6g}, in a ring {pressure:.6g}, drift {drift:.1e}")
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
