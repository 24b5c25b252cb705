# SPDX-License-Identifier: LGPL-3.0-or-later
# # Squeal: vibrations that friction feeds
#
# This demo illustrates how to:
#
# - find the vibrations of a body that slides steadily, and which of them grow;
# - find the friction coefficient at which growth begins;
# - see what a regularised friction law makes of them, and animate the vibration.
#
# A pad, clamped at its top, is pressed on a floor that moves to the right. Coulomb's coefficient
# does not depend on the velocity, but the pressure rises and falls with a vibration, and friction
# with it: where two modes have met, one of them takes energy from the floor in every period.
# Without damping those that meet first are the finest of the mesh, and the onset falls to zero as
# it is refined; a damped pad has an onset of its own. A regularised law, whose friction still rises
# with the velocity at the speed of sliding, is a damper at the floor, and may hide the squeal.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, output
from dolfinx_contact.analysis import SteadySliding
from dolfinx_contact.command_line import CELLS, ScriptParser, number
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    pad = dict(dim=2, nx=4, ny=4, young=1.0, poisson=0.3, friction=0.5, cell=None)
    parser = ScriptParser("A pad on a floor that moves", output="output/squeal", **pad)
    size, some = number(above=0), number(least=0)
    parser.add_argument("--width", type=size, default=1.0, help="of the pad, along the motion")
    parser.add_argument("--height", type=size, default=1.0, help="of it")
    parser.add_argument("--depth", type=size, default=0.5, help="of it across the motion, in 3D")
    parser.add_argument("--density", type=size, default=1.0, help="mass over volume")
    parser.add_argument("--damping", type=some, default=0.02, help="over the stiffness, a time")
    parser.add_argument(
        "--slopes", type=some, nargs="*", default=[0.01, 0.1, 1.0], help="of regularised friction"
    )
    return parser.parse(argv)


# ## The pad
#
# Of `ny` cells over the height; in 3D as many across the motion as fit.


def pad(args, comm=MPI.COMM_WORLD):
    last, cell = args.dim - 1, CELLS[args.cell]
    sizes, cells = [args.width, args.height], [args.nx, args.ny]
    if args.dim == 3:
        sizes.insert(1, args.depth)
        cells.insert(1, max(round(args.nx * args.depth / args.width), 1))
    box, create = [[0.0] * args.dim, sizes], (mesh.create_rectangle, mesh.create_box)[last - 1]
    domain = create(comm, box, cells, cell)
    bottom, top = (
        mesh.locate_entities_boundary(domain, last, lambda x, z=z: np.isclose(x[last], z))
        for z in (0.0, args.height)
    )
    V = fem.functionspace(domain, ("Lagrange", 1, (args.dim,)))
    u = fem.Function(V, name="displacement")
    dofs = fem.locate_dofs_topological(V, last, top)
    clamped = fem.dirichletbc(np.zeros(args.dim), dofs, V)
    floor = HalfSpace(np.zeros(args.dim), np.eye(args.dim)[last])
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(args.friction))
    energy = LinearElastic.from_young(args.young, args.poisson).energy(u) * ufl.dx
    tags = mesh.meshtags(domain, last, np.sort(bottom), np.ones(len(bottom), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    return ContactProblem(energy, u, [surface], bcs=[clamped]), energy, ds


# ## Damping by a regularised law
#
# At the speed V of sliding the law F p tanh(v/e) has the slope F p (1 - tanh^2(V/e))/e, a damper
# per area of the floor. A form of damping is given as UFL, and may be any other.


def regularised(problem, energy, ds, args, slope):
    u, v, w = problem.u, ufl.TrialFunction(problem.V), ufl.TestFunction(problem.V)
    stiffness = ufl.derivative(ufl.derivative(energy, u, w), u, v)
    c, eta = (fem.Constant(problem.V.mesh, float(x)) for x in (slope, args.damping))
    return eta * stiffness + c * v[0] * w[0] * ds


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    (problem, energy, ds), against = pad(args), -np.eye(args.dim)[0]  # slip of the pad
    sliding = SteadySliding(problem, against, density=args.density, damping=args.damping)
    modes, onset = sliding.modes(args.friction), sliding.onset()
    say(f"F = {args.friction:g}: growth {modes.growth:.10g}, frequency {modes.frequency:.10g}")
    say("nothing grows up to F = 5" if onset is None else f"onset: {onset}")
    frictions = np.linspace(0.0, 2.0 * args.friction or 1.0, 13)
    curves = {"Coulomb": (frictions, [sliding.modes(F).growth for F in frictions])}
    growths = {}
    for slope in args.slopes:
        damping = regularised(problem, energy, ds, args, slope)
        rubbing = SteadySliding(problem, against, density=args.density, damping=damping)
        growths[f"{slope:g}"] = rubbing.modes(args.friction).growth
        curves[f"slope {slope:g}"] = frictions, [rubbing.modes(F).growth for F in frictions]
        say(f"regularised, slope {slope:g}: growth {growths[f'{slope:g}']:.6g}")
    if comm.rank == 0:
        look = dict(labels=("friction $F$", "largest growth"))
        output.draw_curves(folder / "growth.png", curves, **look)
    size, parts = 0.1 * args.height, (modes.real, modes.imaginary)
    file = output.write_vibration(folder, *parts, size=size)
    look = dict(size=size, title=f"F = {args.friction:g}, frequency {modes.frequency:.4g}")
    gif = output.picture_of_vibration(folder / "mode.gif", *parts, **look)
    say.files([folder / "growth.png", file, gif])
    summary = {"converged": True, "newton_iterations": 0, "dofs": problem.create_vector().getSize()}
    summary |= {"growth": modes.growth, "frequency": modes.frequency, "regularised": growths}
    summary |= {"onset": onset and onset.friction, "onset_frequency": onset and onset.frequency}
    summary["known_up_to"] = None if np.isinf(modes.known_up_to) else modes.known_up_to
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
