# SPDX-License-Identifier: LGPL-3.0-or-later
"""A belt on a drum.

Reference: Euler. `demos/demo_belt.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, Sphere, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame

RADIUS = 1.0
WEIGHT = 1.0
STIFFNESS = 50.0  # E h, over the weight
STRAIGHT = (0.4, 0.2)  # lengths of the straight parts: of the weight, of the hand
ALPHA = np.pi


def arguments(argv=None):
    parser = ScriptParser("A belt over a drum", output="output/belt", friction=0.3)
    parser.add_argument("--n", type=number(int, least=8), default=64, help="cells around the drum")
    parser.add_argument(
        "--thickness", type=number(above=0, below=0.5), default=0.005, help="over the radius"
    )
    parser.add_argument("--pull", type=number(above=0), default=0.25, help="way of the pulled end")
    parser.add_argument("--steps", type=number(int, least=1), default=32, help="of the pull")
    return parser.parse(argv)


def belt(args, comm):
    h = args.thickness
    size = ALPHA * RADIUS / args.n
    cells = [round(length / size) for length in STRAIGHT]
    length = (sum(cells) + args.n) * size
    lower = np.array([-cells[0] * size, 0.0])
    upper = lower + np.array([length, h])
    shape = [sum(cells) + args.n, 1]
    domain = mesh.create_rectangle(comm, [lower, upper], shape, mesh.CellType.quadrilateral)
    tdim = domain.topology.dim
    domain.topology.create_connectivity(tdim - 1, tdim)
    faces = [
        mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0)),
        mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], lower[0])),
        mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], upper[0])),
    ]
    s, across = domain.geometry.x[:, :2].T.copy()
    on_drum = np.clip(s, 0.0, ALPHA * RADIUS)
    angle = np.pi - on_drum / RADIUS
    down = np.abs(s - on_drum)
    r = RADIUS + across
    domain.geometry.x[:, 0] = r * np.cos(angle)
    domain.geometry.x[:, 1] = r * np.sin(angle) - down
    return domain, faces


def hung(args, comm):
    """The problem, the weight and the way of the pulled end."""
    domain, (inner, weighted, pulled) = belt(args, comm)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    drum = Sphere((0.0, 0.0), RADIUS)
    contact = ContactSurface(u, inner, obstacle=drum, law=Coulomb(args.friction), name="drum")
    rubber = NeoHookean(*lame(STIFFNESS * WEIGHT / args.thickness, 0.0))
    weight = fem.Constant(domain, 0.0)
    tags = mesh.meshtags(domain, 1, np.sort(weighted), np.full(len(weighted), 1, dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    energy = rubber.energy(u) * ufl.dx + weight / args.thickness * u[1] * ds
    way = fem.Constant(domain, np.zeros(2))
    held = fem.dirichletbc(way, fem.locate_dofs_topological(V, 1, pulled), V)
    return ContactProblem(energy, u, [contact], bcs=[held]), weight, way


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    say = io.Report(comm)
    folder = io.output_folder(comm, args.output)
    problem, weight, way = hung(args, comm)

    def load(t):
        weight.value = WEIGHT * min(t, 1.0)
        way.value[1] = -args.pull * max(t - 1.0, 0.0)

    def ratio(step):
        return -float(step.result.support[1]) / WEIGHT

    def watch(step):
        say(f"pulled by {-way.value[1]:.4f}: T2/T1 = {ratio(step):.6f}")

    hang = np.linspace(0.0, 1.0, 3)
    pull = 1.0 + np.arange(1, args.steps + 1) / args.steps
    times = [*hang, *pull]
    history = QuasiStatic(problem, load).run(times, observer=watch)
    last = history.steps[-1]
    table = last.result.tables["drum"]
    plot.picture_of_body(folder / "belt.png", problem)
    io.write_contact_table(comm, folder, [table])
    touching = table.rn > 0
    exact = float(np.exp(args.friction * ALPHA))
    thick = float(np.exp(args.friction * ALPHA / (1 + args.thickness / (2 * RADIUS))))
    say(f"T2/T1 = {ratio(last):.6f}, without thickness {exact:.6f}, with it {thick:.6f}")
    summary = last.result.summary()
    summary["ratio"] = ratio(last)
    summary["ratio_closed_form"] = exact
    summary["ratio_of_thickness"] = thick
    summary["way"] = args.pull
    summary["cell"] = ALPHA * RADIUS / args.n
    summary["slid"] = float(np.linalg.norm(table.ut[touching], axis=1).max())
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
