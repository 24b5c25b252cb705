# SPDX-License-Identifier: LGPL-3.0-or-later
"""Self-contact of a ring, with friction.

Reference: its half on a plane. `demos/demo_flattened_ring.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    SelfContact,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame

INNER, OUTER = 0.8, 1.0  # radii
RUBBER = NeoHookean(*lame(1.0, 0.4))
TURNED = 0.3  # by which the mesh of the whole ring is turned, over a cell
AWAY = 0.1  # from the middle, facets that no plate reaches


def arguments(argv=None):
    parser = ScriptParser("A flattened ring", output="output/ring", n=128, friction=0.0)
    add = parser.add_argument
    add("--press", type=number(above=0, below=1.8), default=1.7, help="way of the upper plate")
    add("--steps", type=number(int, least=1), default=34, help="of the upper plate")
    args = parser.parse(argv)
    if args.n % 4:
        parser.error("--n must be a multiple of 4")
    return args


def ring(args, comm, *, whole):
    """The ring, or its upper half."""
    layers = max(round(args.n * (OUTER - INNER) / (2 * np.pi * INNER)), 2)
    count = args.n if whole else args.n // 2
    places = count if whole else count + 1
    shift = TURNED if whole else 0.0
    angle = 2 * np.pi * (np.arange(places) + shift) / args.n
    r = np.linspace(INNER, OUTER, layers + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.multiply.outer(r, around).reshape(-1, 2)
    i, j = (v.reshape(-1) for v in np.meshgrid(np.arange(count), np.arange(layers)))
    after = (i + 1) % places
    up = j + 1
    corners = [j * places + i, j * places + after, up * places + i, up * places + after]
    cells = np.stack(corners, axis=1).astype(np.int64)
    if comm.rank > 0:
        points, cells = points[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=points, e=ufl.Mesh(element))


def on_circle(domain, radius):
    def here(x):
        return np.isclose(np.hypot(x[0], x[1]), radius)

    return mesh.locate_entities_boundary(domain, 1, here)


class Ring:
    """A ring between plates, or its upper half below one.

    Args:
        args: options.
        comm: communicator.
        whole: or half.
    """

    def __init__(self, args, comm, *, whole):
        domain = ring(args, comm, whole=whole)
        self.parts = 1 if whole else 2
        self.V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        self.u = fem.Function(self.V, name="displacement")
        self.plate = fem.Constant(domain, (0.0, OUTER))
        inside = on_circle(domain, INNER)
        outside = on_circle(domain, OUTER)
        if whole:
            surfaces, bcs = self.whole(args, inside, outside)
        else:
            surfaces, bcs = self.half(inside, outside)
        energy = RUBBER.energy(self.u) * ufl.dx(metadata={"quadrature_degree": 4})
        self.problem = ContactProblem(energy, self.u, surfaces, bcs=bcs)
        self.forces = []

    def below_plate(self, facets):
        """The upper plate, which comes down."""
        plate = HalfSpace(self.plate, (0.0, -1.0))
        law = Frictionless()
        return ContactSurface(self.u, facets, obstacle=plate, law=law, name="plate")

    def whole(self, args, inside, outside):
        middles = mesh.compute_midpoints(self.V.mesh, 1, outside)[:, 1]
        floor = HalfSpace((0.0, -OUTER), (0.0, 1.0))
        law = Frictionless()
        below = outside[middles < -AWAY]
        surfaces = [
            SelfContact(
                self.u, inside, law=Coulomb(args.friction), name="inside", search_distance=0.3
            ),
            self.below_plate(outside[middles > AWAY]),
            ContactSurface(self.u, below, obstacle=floor, law=law, name="floor"),
        ]
        # Nothing pushes it sideways, so that one node may be held.
        angle = 2 * np.pi * (round(0.75 * args.n) + TURNED) / args.n
        place = np.array([OUTER * np.cos(angle), OUTER * np.sin(angle)])

        def lowest(x):
            return np.hypot(x[0] - place[0], x[1] - place[1]) < 1e-8

        W = self.V.sub(0)
        vertex = mesh.locate_entities_boundary(self.V.mesh, 0, lowest)
        held = fem.locate_dofs_topological(W, 0, vertex)
        zero = fem.Constant(self.V.mesh, 0.0)
        return surfaces, [fem.dirichletbc(zero, held, W)]

    def half(self, inside, outside):
        plane = HalfSpace((0.0, 0.0), (0.0, 1.0))
        law = Frictionless()
        surfaces = [
            ContactSurface(self.u, inside, obstacle=plane, law=law, name="inside"),
            self.below_plate(outside),
        ]
        domain = self.V.mesh
        zero = fem.Constant(domain, 0.0)
        W = self.V.sub(1)
        cut = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
        bcs = [fem.dirichletbc(zero, fem.locate_dofs_topological(W, 1, cut), W)]
        top = mesh.locate_entities_boundary(
            domain, 0, lambda x: np.hypot(x[0], x[1] - OUTER) < 1e-8
        )
        H = self.V.sub(0)
        bcs.append(fem.dirichletbc(zero, fem.locate_dofs_topological(H, 0, top), H))
        return surfaces, bcs

    def press(self, args, say):
        """Press it; force of the plate and of the inner face at the times asked for (steps, 2)."""
        times = np.linspace(0.0, args.press, args.steps + 1)
        found = []

        def load(t):
            self.plate.value[1] = OUTER - t / self.parts

        def watch(step):
            if step.time not in times:
                return  # a part of a step
            forces = step.result.resultants
            inner = abs(step.result.tables["inside"].rn).sum()
            found.append((-forces["plate"][1], inner))
            say(f"plate down by {step.time:.3f}: {found[-1][0]:.5f}, inside {found[-1][1]:.5f}")

        history = QuasiStatic(self.problem, load)
        done = history.run(times, halve_steps=True, observer=watch)
        return done, times[1:], np.array(found)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    pressed = {}
    for name, whole in (("half", False), ("whole", True)):
        say(f"the {name} ring")
        body = Ring(args, comm, whole=whole)
        history, ways, forces = body.press(args, say)
        pressed[name] = forces
        plot.picture_of_body(folder / f"{name}.png", body.problem)
    last = history.steps[-1].result
    summary = last.summary()
    for k, what in enumerate(("plate", "inside")):
        whole = pressed["whole"][:, k]
        half = pressed["half"][:, k]
        summary[f"{what}_force"] = whole[-1]
        summary[f"{what}_half_ratio"] = whole[-1] / half[-1]
        summary[f"{what}_worst"] = abs(whole - half).max() / half.max()
        say(f"{what}: {whole[-1]:.6g}, of the half ring {half[-1]:.6g}")
    iterations = [step.result.iterations for step in history.steps]
    summary["newton_mean"] = float(np.mean(iterations))
    summary["failed_steps"] = sum(step.rejected for step in history.steps)
    summary["imbalance"] = last.pairs["inside"].imbalance
    if comm.rank == 0:
        rows = np.column_stack([ways, pressed["whole"], pressed["half"]])
        header = "way,plate,inside,plate of the half,inside of the half"
        np.savetxt(folder / "forces.csv", rows, delimiter=",", header=header, comments="")
    io.write_contact_table(comm, folder, [last.tables["inside"]])
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
