# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady sliding of a pad, 2D and 3D.

Reference: own code. `demos/demo_squeal.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import CELLS, ScriptParser, number

import ufl
from dolfinx import fem, mesh
from dolfinx.io import VTKFile

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.analysis import SteadySliding
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    pad = dict(dim=2, nx=4, ny=4, young=1.0, poisson=0.3, friction=0.5, cell=None)
    parser = ScriptParser("A pad on a floor that moves", output="output/squeal", **pad)
    size = number(above=0)
    some = number(least=0)
    parser.add_argument("--width", type=size, default=1.0, help="of the pad, along the motion")
    parser.add_argument("--height", type=size, default=1.0, help="of it")
    parser.add_argument("--depth", type=size, default=0.5, help="of it across the motion, in 3D")
    parser.add_argument("--density", type=size, default=1.0, help="mass over volume")
    parser.add_argument("--damping", type=some, default=0.02, help="over the stiffness, a time")
    parser.add_argument(
        "--slopes", type=some, nargs="*", default=[0.01, 0.1, 1.0], help="of regularised friction"
    )
    count = number(int, least=1)
    parser.add_argument("--frames", type=count, default=24, help="of the animation")
    return parser.parse(argv)


def pad(args, comm=MPI.COMM_WORLD):
    last = args.dim - 1
    cell = CELLS[args.cell]
    origin = np.zeros(args.dim)
    if args.dim == 2:
        corners = [origin, [args.width, args.height]]
        domain = mesh.create_rectangle(comm, corners, [args.nx, args.ny], cell)
    else:
        across = max(round(args.nx * args.depth / args.width), 1)
        corners = [origin, [args.width, args.depth, args.height]]
        domain = mesh.create_box(comm, corners, [args.nx, across, args.ny], cell)

    def at_height(z):
        return mesh.locate_entities_boundary(domain, last, lambda x: np.isclose(x[last], z))

    bottom = at_height(0.0)
    top = at_height(args.height)
    V = fem.functionspace(domain, ("Lagrange", 1, (args.dim,)))
    u = fem.Function(V, name="displacement")
    dofs = fem.locate_dofs_topological(V, last, top)
    clamped = fem.dirichletbc(np.zeros(args.dim), dofs, V)
    upwards = np.eye(args.dim)[last]
    floor = HalfSpace(origin, upwards)
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(args.friction))
    material = LinearElastic.from_young(args.young, args.poisson)
    energy = material.energy(u) * ufl.dx
    ones = np.ones(len(bottom), dtype=np.int32)
    tags = mesh.meshtags(domain, last, np.sort(bottom), ones)
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    problem = ContactProblem(energy, u, [surface], bcs=[clamped])
    return problem, energy, ds


def regularised(problem, energy, ds, args, slope):
    u = problem.u
    v = ufl.TrialFunction(problem.V)
    w = ufl.TestFunction(problem.V)
    forces = ufl.derivative(energy, u, w)
    stiffness = ufl.derivative(forces, u, v)
    c = fem.Constant(problem.V.mesh, float(slope))
    eta = fem.Constant(problem.V.mesh, float(args.damping))
    damper = c * v[0] * w[0] * ds
    return eta * stiffness + damper


def period(problem, modes, size, frames):
    """Put state by state into the problem, with the largest component of the given size."""
    mode = modes.real.x.array + 1j * modes.imaginary.x.array
    largest = problem.comm.allreduce(np.abs(mode).max(initial=0.0), op=MPI.MAX)
    for part in np.arange(frames) / frames:
        problem.u.x.array[:] = size / largest * (mode * np.exp(2j * np.pi * part)).real
        yield f"{part:.2f} of a period"


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, energy, ds = pad(args)
    against = -np.eye(args.dim)[0]  # slip of the pad
    sliding = SteadySliding(problem, against, density=args.density, damping=args.damping)
    modes = sliding.modes(args.friction)
    onset = sliding.onset()
    say(f"F = {args.friction:g}: growth {modes.growth:.10g}, frequency {modes.frequency:.10g}")
    if onset is None:
        say("nothing grows up to F = 5")
    else:
        say(f"onset: {onset}")

    most = 2.0 * args.friction or 1.0
    frictions = np.linspace(0.0, most, 13)
    growing = [sliding.modes(F).growth for F in frictions]
    curves = {"Coulomb": (frictions, growing)}
    growths = {}
    for slope in args.slopes:
        damping = regularised(problem, energy, ds, args, slope)
        rubbing = SteadySliding(problem, against, density=args.density, damping=damping)
        growth = rubbing.modes(args.friction).growth
        growths[f"{slope:g}"] = growth
        growing = [rubbing.modes(F).growth for F in frictions]
        curves[f"slope {slope:g}"] = (frictions, growing)
        say(f"regularised, slope {slope:g}: growth {growth:.6g}")

    picture = folder / "growth.png"
    if comm.rank == 0:
        plot.draw_curves(picture, curves, labels=("friction $F$", "largest growth"))
    size = 0.1 * args.height
    file = folder / "vibration.pvd"
    with VTKFile(comm, file, "w") as vtk:
        for frame, _ in enumerate(period(problem, modes, size, args.frames)):
            vtk.write_function(problem.u, frame / args.frames)
    title = f"F = {args.friction:g}, frequency {modes.frequency:.4g}"
    states = period(problem, modes, size, args.frames)
    gif = plot.film(folder / "mode.gif", problem, states, title=title)
    say(f"files: {picture}, {file}, {gif}")
    summary = {
        "converged": True,
        "newton_iterations": 0,
        "dofs": problem.create_vector().getSize(),
        "growth": modes.growth,
        "frequency": modes.frequency,
        "regularised": growths,
        "onset": None,
        "onset_frequency": None,
        "known_up_to": None,
    }
    if onset is not None:
        summary["onset"] = onset.friction
        summary["onset_frequency"] = onset.frequency
    if not np.isinf(modes.known_up_to):
        summary["known_up_to"] = modes.known_up_to
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
