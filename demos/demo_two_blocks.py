# SPDX-License-Identifier: LGPL-3.0-or-later
# # Two elastic blocks, one on the other
#
# This demo illustrates how to:
#
# - put two bodies of different materials into one mesh (`meshing.join`);
# - let them touch each other (`ContactPair`), along faces with the same nodes or, with `--ratio 2`,
#   with others: the coupling is then a mortar;
# - compare with the same body on a rigid floor;
# - go through a history of loads (`QuasiStatic`), where friction depends on what was before.
#
# A unit square lies on a block of half its height, which is clamped below; plane strain. Its top is
# pressed down by 1 %, drawn to the right, back to the left as far, and lifted. Where both yield,
# the lower body gives way to shear as the upper does, and a part of the interface sticks that would
# slip on a rigid floor. What has slipped stays where it is until friction is overcome the other
# way: the force over the motion of the top is a loop, whose area is what friction dissipates.
#
# With `--static` the static law of Coulomb is solved for one state instead (total displacements, no
# history).

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join


def arguments(argv=None):
    parser = ScriptParser("Two blocks", output="output/two_blocks", n=8, friction=0.25)
    pair = dict(type=number(), nargs=2, metavar=("E", "NU"))
    parser.add_argument("--upper", default=[1000.0, 0.3], help="of the upper block", **pair)
    parser.add_argument("--lower", default=[300.0, 0.2], help="of the lower block", **pair)
    parser.add_argument("--rigid-floor", action="store_true", help="instead of the lower block")
    parser.add_argument("--static", action="store_true", help="the static law, one state")
    ratio = dict(type=number(int, above=0), default=1)
    parser.add_argument("--ratio", help="times as many elements along the lower face", **ratio)
    motion = dict(type=number(), nargs=2, metavar=("UX", "UY"))
    parser.add_argument("--top", default=[0.011, -0.01], help="motion of the top, static", **motion)
    return parser.parse(argv)


# ## The bodies
#
# Both have nodes of their own on y = 0. Cells of the first mesh that is joined get the tag 1, those
# of the second 2; the facets on the interface are found by the cell that they belong to.


def blocks(n, comm, *, ratio=1, rigid_floor=False):
    """Mesh, cell tags, and the facets of slave and master."""
    x, y = (np.linspace(0.0, 1.0, m * n + 1) for m in (ratio, 1))
    below = np.linspace(-0.5, 0.0, max(n // 2, 1) + 1)
    bodies = [(y, y)] if rigid_floor else [(y, y), (x, below)]
    both = join([create_grid(comm, axes, mesh.CellType.quadrilateral) for axes in bodies])
    domain, parts = both.mesh, both.cell_tags
    on_interface = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    to_cells = domain.topology.connectivity(1, 2)
    upper = np.isin(to_cells.array[to_cells.offsets[on_interface]], parts.find(1))
    return domain, parts, on_interface[upper], on_interface[~upper]


def problem(args, comm):
    return held_by_its_top(args, comm)[0]


def held_by_its_top(args, comm):
    """The problem, and the motion of the top."""
    domain, parts, slave, master = blocks(
        args.n, comm, ratio=args.ratio, rigid_floor=args.rigid_floor
    )
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dx = ufl.Measure("dx", domain, subdomain_data=parts)
    materials = [LinearElastic.from_young(*given) for given in (args.upper, args.lower)]
    energy = sum(m.energy(u) * dx(tag) for tag, m in enumerate(materials, 1))

    def line(y):
        facets = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], y))
        return fem.locate_dofs_topological(V, 1, facets)

    top = fem.Constant(domain, np.array(args.top))
    bcs = [fem.dirichletbc(top, line(1.0), V)]
    if args.rigid_floor:
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(u, slave, obstacle=floor, law=Coulomb(args.friction))
    else:
        bcs.append(fem.dirichletbc(np.zeros(2), line(-0.5), V))
        contact = ContactPair(u, slave, master_facets=master, law=Coulomb(args.friction))
    return ContactProblem(energy, u, [contact], bcs=bcs), top


# ## The history
#
# `QuasiStatic` asks for the load at a time, and solves for the equilibrium there with friction
# against the slip since the time before. Here a unit of time is a step.


DRAWN = 13  # the step at the end of the first shear


def path():
    """Motions of the top, step by step: press, draw to the right, back, lift; (37, 2)."""
    corners = [(0.0, 0.0), (0.0, -0.01), (0.011, -0.01), (-0.011, -0.01), (-0.004, 0.001)]
    found = []
    for a, b, n in zip(corners[:-1], corners[1:], (5, 8, 16, 8), strict=True):
        found += [np.array(a) + k / n * (np.array(b) - a) for k in range(1, n + 1)]
    return np.array(found)


def along_the_path(both, top, observer):
    motions = np.vstack([np.zeros(2), path()])

    def load(t):
        k = min(int(t), len(motions) - 2)
        top.value = motions[k] + (t - k) * (motions[k + 1] - motions[k])

    return QuasiStatic(both, load).run(np.arange(len(motions)), observer=observer)


def summary_of(table, dissipation):
    ut, rt = table.along(table.ut), table.along(table.rt)
    step = {"status": table.status, "ut": ut, "un": table.un, "rt": rt, "rn": table.rn}
    step = {k: v if isinstance(v, str) else v.tolist() for k, v in step.items()}
    step |= {"sum_rt": float(rt.sum()), "sum_rn": float(table.rn.sum())}
    return step | {"dissipation": dissipation}


def static(both, folder, say):
    result = both.solve()
    say.result(result)
    say(f"from left to right: {result.tables['contact'].status}")
    output.picture_of_contact(folder / "contact.png", both)
    output.picture_of_body(folder / "body.png", both, scale=10.0)
    output.write_fields(folder, both)
    return result, [summary_of(result.tables["contact"], 0.0)]


def evolution(both, top, folder, say):
    def observer(step):
        series(step)
        say(f"{step.number:3d}  {step.status}  dissipated {step.energies.dissipated:.6g}")
        if step.number == DRAWN:
            output.picture_of_contact(folder / "contact.png", both)
            output.picture_of_body(folder / "body.png", both, scale=10.0)

    with output.EvolutionSeries(folder, both) as series:
        history = along_the_path(both, top, observer)
    e = history.energies
    say(f"work {e.external:.6g}, stored {e.stored:.6g}, the steps' error {e.residue:.2g}")
    found = [summary_of(s.result.tables["contact"], s.energies.dissipated) for s in history.steps]
    if both.comm.rank == 0:
        loop = np.append(0.0, path()[:, 0]), np.append(0.0, [s["sum_rt"] for s in found])
        labels = "motion of the top to the right", "friction on the upper block"
        output.draw_curves(folder / "loop.png", {"_": loop}, labels=labels)
    return history.steps[DRAWN - 1].result, found


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    both, top = held_by_its_top(args, comm)
    run = static(both, folder, say) if args.static else evolution(both, top, folder, say)
    result, steps = run
    output.write_contact_table(comm, folder, [result.tables["contact"]])
    return output.write_summary(comm, folder, result.summary() | {"steps": steps})


if __name__ == "__main__":
    main()
