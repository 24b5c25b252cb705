"""Regression record: numbers that the package computes for many small problems.

The cases use public names only. Their results are stored in `data/golden.json`, by kind:

- *evaluated*: H, and J times a vector, at a state that is not a solution. They must agree to 1e-12,
  relative to the largest number of the list.
- *solved*: states, forces, branch points, eigenvalues. They must agree to 1e-10.
- *exact*: statuses, kinds and verdicts. They must be equal.
- *counts*: iterations, factorisations and assemblies. They must be equal on the same number of
  ranks, and are stored for 1, 2 and 3 ranks. The other kinds do not depend on the number of ranks.

The record contains no sentences, so that messages may be reworded. A change that should not change
numbers leaves the file as it is. A change of numbers rewrites the cases concerned on 1, 2 and 3
ranks, and its commit message names the cases and the reason::

    for n in 1 2 3; do
        docker/run mpirun -n $n python3 tests/golden.py --write NAME ...
    done
"""

import argparse
import json
import re
import tempfile
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from support.own_laws import Orthotropic
from support.record_bodies import (
    RUBBER,
    UNIT,
    bar,
    block,
    box,
    cracked,
    disc,
    displacement,
    elastic,
    facets,
    globe,
    hairpin,
    pair,
    polygon,
    prescribed,
    rubber,
    stack,
    triangle,
    two_blocks,
)

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    BilinearCohesive,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    Frictionless,
    HalfSpace,
    LevelSet,
    MaxwellLayer,
    NonlocalCoulomb,
    NormalCompliance,
    ParametricContact,
    Regularised,
    RigidBody,
    RigidSurface,
    Sphere,
    Tresca,
)
from dolfinx_contact.algorithms import ALGORITHMS, SemismoothNewton
from dolfinx_contact.analysis import (
    SteadySliding,
    contact_family,
    count_solutions,
    critical_friction,
    critical_friction_by_direction,
    event_curves,
    prove_counts,
    renard_criterion,
    shakedown,
    solution_regions,
    stability_at_rest,
    wedging_friction,
)
from dolfinx_contact.continuation import StepControl, explore, find_solutions, follow
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import CiarletGeymonat, LinearElastic, NeoHookean, StVenantKirchhoff
from dolfinx_contact.proofs import ReducedProblem, check, prove_solutions
from dolfinx_contact.records import (
    BranchRecord,
    EvolutionRecord,
    PathRecord,
    journal_of,
    read_journal,
    total,
)

COMM = MPI.COMM_WORLD
RECORD = Path(__file__).parent / "data" / "golden.json"
#: Largest difference, relative to the largest number of a list ...
TOLERANCES = {"evaluated": 1e-12, "solved": 1e-10}
#: ... or to this part of the largest number of a case, if that is more.
_LEAST = 1e-4
#: Krylov methods of other versions of PETSc than that of the record may take another step.
_OTHER_PETSC = PETSc.Sys.getVersion()[:2] != (3, 22)
TIGHT = {"snes_rtol": 1e-12}
#: Columns of tables of steps that are newer than the record.
NEWER = re.compile(r"inserted|support_\d+_.*|.*_(u|r)[xyz]")
#: Columns of tables that count work.
COUNTS = ("newton_iterations", "corrections")
_WAVES = ((2.1, 3.7, 1.3), (5.9, 1.7, 4.1), (11.3, 7.9, 2.3), (3.1, 13.7, 8.3))
#: Rotation by which the interface of a stack is tilted.
TILT = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


# -- laws ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    """Friction falling from a static to a kinetic coefficient with the distance slipped."""

    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        drop = self.static - self.kinetic
        return (self.kinetic + drop * ufl.exp(-a.slid / self.distance)) * p


# -- numbers of vectors that depend neither on ranks nor on numbering ------------------------------


def wave(x, phase, dim):
    """Vectors at points (3, n) without any symmetry of a mesh."""
    return np.array(
        [np.sin((17 + 3 * i) * x[0] + (5 + i) * x[1] + 3 * x[2] + phase + i) for i in range(dim)]
    )


def numbers_of(V, values):
    """Norm of the owned values at the dofs of a space, and their products with plane waves."""
    block_size = V.dofmap.index_map_bs
    n = V.dofmap.index_map.size_local
    x = V.tabulate_dof_coordinates()[:n]
    values = values[: n * block_size].reshape(n, block_size)
    phases = np.arange(block_size)
    sums = [np.sum(values**2)]
    sums += [np.sum(values * np.cos((x @ k)[:, None] + phases)) for k in _WAVES]
    found = V.mesh.comm.allreduce(np.array(sums))
    return [float(np.sqrt(found[0])), *found[1:].tolist()]


def vector(problem, x):
    """Numbers of a vector of unknowns, by field."""
    found = {}
    parts = problem.equations.unknowns.fields(x)
    for i, (f, values) in enumerate(zip(problem.fields, parts, strict=True)):
        found[f"field {i}"] = numbers_of(f.function_space, values)
    motions = problem.equations.unknowns.motions(x)
    if len(motions):
        found["rigid bodies"] = motions.tolist()
    return found


def unknowns(problem, displacement, traction, phase=0.3):
    """Unknowns in which contact points have all statuses; the Functions stay as they are."""
    dim = problem.V.mesh.geometry.dim
    x = problem.create_vector()
    values = []
    for f in problem.fields:
        size = displacement if f is problem.u else traction
        g = fem.Function(f.function_space)
        g.interpolate(lambda y, size=size: size * wave(y, phase, dim))
        values.append(g.x.array)
    problem.equations.unknowns.write(values, problem.equations.unknowns.motions(x), x)
    return x


def evaluated(problem, displacement=0.01, traction=10.0):
    """H and J times a vector at a state that is not a solution."""
    x = unknowns(problem, displacement, traction)
    d = unknowns(problem, displacement, traction, 2.9)
    b = problem.create_vector()
    product = problem.create_vector()
    evaluation = problem.residual(x, b)
    solver = problem.linear_solver
    solver.update(evaluation)
    solver.matrix.mult(d, product)
    return {"H": vector(problem, b), "J times a vector": vector(problem, product)}


def tables(result):
    """Numbers and statuses of contact points, by table."""
    numbers = {}
    statuses = {}
    for name, t in result.tables.items():
        statuses[name] = t.status
        for key in ("x", "area", "un", "ut", "force", "pressure", "shear"):
            numbers[f"{name} {key}"] = np.asarray(getattr(t, key)).ravel().tolist()
    return numbers, statuses


def more_of_tables(result):
    """Further columns of contact tables, and resultants."""
    numbers = columns_of(result.tables)
    # One list, since some of these forces vanish but for round-off.
    forces = [*result.resultants.values(), result.support, result.external]
    forces += [force for p in result.pairs.values() for force in (p.slave, p.master)]
    return numbers | {
        "resultants": np.concatenate(forces).tolist(),
        "rigid bodies": {
            k: [*b.contact, *b.load, *b.support] for k, b in result.rigid_bodies.items()
        },
    }


def columns_of(tables):
    """Further columns of contact tables, by name."""
    numbers = {}
    for name, t in tables.items():
        columns = {"increment": t.increment, "n": t.n, "bound": t.bound, "support": t.support}
        columns |= {"adhesion": t.adhesion, "slid": t.slid} | dict(t.internal)
        for key, values in columns.items():
            if values is not None:
                numbers[f"{name} {key}"] = np.asarray(values).ravel().tolist()
    return numbers


def fields(problem):
    """Numbers of the fields on contact surfaces."""
    found = {}
    for s in problem.surfaces:
        for name, f in problem.contact_fields(s).items():
            found[f"{s.name} {name}"] = numbers_of(f.function_space, f.x.array)
    return found


def state(problem):
    """The unknowns in the Functions."""
    x = problem.create_vector()
    problem.write(x)
    return vector(problem, x)


def counts(result):
    """Work of a solve."""
    steps = [s for attempt in result.attempts for s in attempt.steps]
    return {
        "strategies": [a.strategy for a in result.attempts],
        "newton": result.iterations,
        "krylov": int(sum(s.krylov or 0 for s in steps)),
        "evaluations": sum(a.evaluations for a in result.attempts),
    }


def static(problem, displacement=0.01, traction=10.0, **how):
    """A static problem: H, J, its solution and the work."""
    result = problem.solve(**how)
    numbers, statuses = tables(result)
    found = {
        "solved": {
            "state": state(problem),
            "tables": numbers,
            "more": more_of_tables(result),
            "fields": fields(problem),
            "energies": {k: float(v) for k, v in result.energies.items()},
        },
        "exact": {"statuses": statuses, "strategy": result.reason},
        # After the solve, since a hierarchy of multigrid depends on the states before it.
        "evaluated": evaluated(problem, displacement, traction),
    }
    assemblies = problem.equations.bulk.assemblies
    return found | {"counts": counts(result) | {"assemblies": assemblies}}


def branch(system, followed):
    """A branch: its points and special points."""
    points = followed.points
    return {
        "solved": {
            "gammas": [p.gamma for p in points],
            "special": [s.gamma for s in followed.special],
            "steps": [p.step for p in points],
            "last state": vector(system.problem, state_vector(system, points[-1])),
        },
        "exact": {
            "statuses": [system.letters(p.piece) for p in points],
            "kinds": [s.kind for s in followed.special],
            "special": [of_special(s) for s in followed.special],
            "ending": followed.ending.name,
        },
        "counts": {
            "factorisations": followed.factorisations,
            "solves": followed.solves,
            "corrections": [p.corrections for p in points],
        },
    }


def of_special(special):
    """Kind of a special point, with the changes of status there."""
    changes = COMM.bcast(sorted([c.before, c.after] for c in special.changes))
    flags = [special.smooth, special.located, special.complete]
    return {"parity": special.parity, "others": len(special.others), "changes": changes} | {
        "flags": list(map(bool, flags))
    }


def state_vector(system, point):
    """The unknowns of a point of a branch."""
    x = system.create_vector()
    x.array[:] = point.y.array_r[: len(x.array)]
    return x


def steps(history):
    """The table of a history, a path or a motion."""
    numbers = {}
    words = {}
    work = {}
    for row in history.rows()[1:]:
        for key, value in row.items():
            if NEWER.fullmatch(key):
                continue
            if isinstance(value, float):
                numbers.setdefault(key, []).append(value)
            elif key in COUNTS:
                work.setdefault(key, []).append(value)
            else:
                words.setdefault(key, []).append(value)
    words["ending"] = [history.ending.name, history.complete]
    return {"solved": numbers, "exact": words, "counts": work}


def with_journal(found, rows):
    """A case with the rows of its journal."""
    rows = [{k: v for k, v in r.items() if not NEWER.fullmatch(k)} for r in rows]
    found["solved"]["journal"] = [[v for v in r.values() if isinstance(v, float)] for r in rows]
    found["exact"]["journal"] = [
        {k: v for k, v in r.items() if not isinstance(v, float) and k not in COUNTS} for r in rows
    ]
    return found


@contextmanager
def new_folder():
    """The same temporary folder on every rank."""
    made = tempfile.TemporaryDirectory() if COMM.rank == 0 else None
    yield COMM.bcast(None if made is None else made.name)
    COMM.barrier()
    if made is not None:
        made.cleanup()


# -- static cases ----------------------------------------------------------------------------------


def oblique(dim):
    """A motion of the top with sticking and slipping points."""
    return (0.008, *[0.003] * (dim - 2), -0.01)


def of_a_law(law):
    """The block of 4 x 4 triangles with another law."""
    return lambda: static(block(law=law, motion=oblique(2), options=TIGHT).problem)


def of_a_mesh(cell, n, **given):
    """The block with another discretisation."""
    dim = 2 if cell in ("tri", "quad") else 3
    body = lambda: block(n, cell, motion=oblique(dim), options=TIGHT, **given)  # noqa: E731
    return lambda: static(body().problem)


def pressed_pair(dim, cell, n=2, **given):
    both = stack(cell, (n, n, UNIT), (n, n, UNIT), level=1.0)
    given = {"law": Coulomb(0.2), "slave": 2, "master": 3, "options": TIGHT} | given
    return static(pair(both, motion=oblique(dim), **given).problem)


def mortar_in_space():
    both = stack("tet", (2, 1, UNIT), (3, 1, UNIT), turn=TILT)
    motion = TILT @ np.array(oblique(3))
    return static(pair(both, law=Coulomb(0.2), motion=motion, options=TIGHT).problem)


def on_top(shape, cell, n, about, **given):
    """A rigid body on a block that is held at its lower face."""
    body = RigidBody(shape, about=about, name="punch", **given)
    how = {"obstacle": body, "name": "top 0", "flipped": True, "options": TIGHT}
    return static(block(n, cell, **how).problem)


def punch(dim, n, **given):
    """A flat punch on a block."""
    up = np.eye(dim)[-1]
    middle = 0.5 * np.ones(dim) + 0.5 * up
    return on_top(HalfSpace(up, -up), "tri" if dim == 2 else "tet", n, middle, **given)


def rolling_punch():
    motion = {"z": -0.02, "x": 0.002}
    held = ("y", "rx", "ry", "rz")
    shape = Sphere((0.5, 0.5, 1.5), 0.5)
    return on_top(shape, "tet", 3, (0.5, 0.5, 1.0), motion=motion, held=held)


def tool_under_a_moment():
    """A wheel of facets that is pressed down and turned."""
    wheel = RigidSurface(*polygon(24, (0.45, 2.0)), crease=30.0)
    load = {"x": 0.5, "y": -20.0}
    return on_top(wheel, "quad", 4, (0.45, 2.0), load=load, motion={"rz": 0.004})


def large_displacement():
    """A neo-Hookean block that is moved far over a curved floor."""
    floor = LevelSet(lambda x: x[1] + 0.1 * ufl.sin(4.0 * x[0]))

    def energy(u):
        return NeoHookean(600.0, 400.0).energy(u) * ufl.dx

    how = {"law": Frictionless(), "obstacle": floor, "energy": energy, "options": TIGHT}
    return static(block(4, "quad", motion=(0.05, -0.2), **how).problem)


def pressed_on(shape, cell, n, law, motion, **given):
    """A neo-Hookean block that is pressed on a rigid surface of facets."""
    how = {"law": law, "obstacle": shape, "energy": rubber, "options": TIGHT}
    return static(block(n, cell, motion=motion, **how | given).problem)


def nearly_incompressible(cell, n, material, motion):
    def energy(u):
        return material.mean_dilatation_energy(u)

    return static(block(n, cell, energy=energy, motion=motion, options=TIGHT).problem)


def stressed(stress):
    """A block with an initial stress, and whether its equilibrium is stable."""

    def energy(u):
        G = ufl.grad(u)
        strain = ufl.sym(G)
        initial = ufl.as_matrix(((stress, 1.0), (1.0, 2.0 * stress)))
        geometric = 0.5 * ufl.inner(initial, G.T * G)
        return elastic()(u) + (ufl.inner(initial, strain) + geometric) * ufl.dx

    problem = block(3, "quad", energy=energy, motion=oblique(2), options=TIGHT).problem
    found = static(problem)
    at_rest = stability_at_rest(problem, density=1.0)
    found["solved"]["growth"] = [at_rest.growth, at_rest.frequency]
    found["exact"]["stability"] = [at_rest.label, at_rest.border, at_rest.pieces]
    return found


def multigrid():
    given = {"linear_solver": "amg", "snes_rtol": 1e-12, "amg_pc_gamg_coarse_eq_limit": 50}
    return static(block(5, "tet", motion=oblique(3), options=given).problem)


def pair_by_multigrid():
    given = {"linear_solver": "amg", "snes_rtol": 1e-12, "amg_pc_gamg_coarse_eq_limit": 50}
    return pressed_pair(2, "quad", 8, options=given)


def by_algorithm(name):
    return static(block(4, motion=oblique(2)).problem, algorithm=ALGORITHMS[name])


def held_at_contact():
    """A block on a disc, with contact nodes that Dirichlet data hold."""
    domain = box(4, "quad")
    u = displacement(domain)
    V = u.function_space
    side = fem.Function(V)
    top = fem.Function(V)
    side.interpolate(lambda x: np.stack([0.01 + 0 * x[0], -0.02 * x[1]]))
    top.interpolate(lambda x: np.stack([0.01 + 0 * x[0], -0.1 + 0.08 * (1 - x[0])]))
    shape = Sphere((0.45, -1.0), 1.0)
    contact = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=shape, law=Coulomb(0.3), sliding="large"
    )
    bcs = [prescribed(u, facets(domain, 0, 0.0), side), prescribed(u, facets(domain, 1, 1.0), top)]
    return static(ContactProblem(rubber(u), u, [contact], bcs=bcs, petsc_options=TIGHT))


def press_fit():
    """Two blocks that overlap, and rub."""
    both = stack("quad", (3, 2, UNIT), (3, 2, UNIT), overlap=0.02)
    return static(
        pair(both, law=Coulomb(0.2), motion=(0.004, 0.0), interference=True, options=TIGHT).problem
    )


def with_a_gap():
    """Two blocks at a given distance."""
    both = stack("quad", (3, 2, UNIT), (3, 2, UNIT))
    given = {"gap": 0.004, "motion": oblique(2), "options": TIGHT}
    return static(pair(both, law=Coulomb(0.2), **given).problem)


def algorithms_on_points():
    """Where all algorithms end on the points of a condensed body, in 2D and 3D."""
    found = {"solved": {}, "exact": {}, "counts": {}}
    for cell, n in (("quad", 3), ("tet", 2)):
        domain = box(n, cell, MPI.COMM_SELF)
        points = block(domain=domain, motion=oblique(domain.geometry.dim)).problem.reduced()
        for algorithm in (*ALGORITHMS.values(), SemismoothNewton()):
            outcome = algorithm.run(points)
            name = f"{cell} {algorithm.name}"
            found["solved"][name] = [*outcome.a.ravel(), *outcome.r.ravel()]
            found["exact"][name] = outcome.converged
            found["counts"][name] = outcome.iterations
    return found


def distances():
    """Distances, normals and their derivatives of surfaces of facets."""
    rng = np.random.default_rng(1)
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
    hull = ConvexHull(corners).simplices
    a, b, c = (corners[hull[:, i]] for i in range(3))
    inward = np.sum(np.cross(b - a, c - a) * (a + b + c - 1.5), axis=1) < 0
    hull[inward] = hull[inward][:, ::-1]
    shapes = {
        "polygon": RigidSurface(*polygon(24, (0.2, 0.1))),
        "creased polygon": RigidSurface(*polygon(5, (0.2, 0.1)), crease=30.0),
        "globe": RigidSurface(*globe(6, (0.2, 0.1, 0.0)), crease=60.0),
        "cube": RigidSurface(corners, hull),
        "rounded plate": RigidSurface([[0.2, 0.0], [0.8, 0.1]], [[1, 0]], rounding=0.05),
    }
    found = {}
    for name, shape in shapes.items():
        x = 1.2 * rng.normal(size=(30, shape.points.shape[1]))
        d = shape.distances(x)
        for key in ("distance", "slope", "normal", "turn"):
            found[f"{name} {key}"] = np.ravel(getattr(d, key)).tolist()
    return {"solved": found}


def other_sections():
    """A disc of revolution by other methods."""
    found = {"evaluated": {}, "solved": {}, "exact": {}, "counts": {}}
    for method, degree in (("integral", 1), ("integral", 2), ("mixed", 1)):
        case = static(disc(3, Coulomb(0.1), method=method, degree=degree))
        for kind, values in case.items():
            found[kind][f"{method} {degree}"] = values
    return found


def step_by_step():
    """Steps that are made one by one, each from the state that the last one has left."""
    body = block(3, "quad", law=Coulomb(0.3))
    problem = body.problem
    found = {}
    before = problem.snapshot()
    for i, motion in enumerate([(0.0, -0.01), (0.008, -0.01), (0.002, -0.008), (-0.006, -0.009)]):
        body.move(motion)
        step = problem.step_from(before)
        result = step.solve()
        found[f"step {i}"] = tables(result)[0] | columns_of(result.tables)
        before = step.snapshot()
    problem.restore(before)
    found["last state"] = state(problem)
    return {"solved": found}


def stable_slip():
    """The stability of states with sticking and slipping points, in 2D and 3D."""
    found = {"solved": {}, "exact": {}}
    for cell, n in (("quad", 3), ("tet", 1)):
        problem = block(n, cell, motion=oblique(2 if cell == "quad" else 3)).problem
        problem.solve()
        for damping in (0.0, 0.1):
            at_rest = stability_at_rest(problem, density=1.0, damping=damping)
            found["solved"][f"{cell} {damping}"] = [at_rest.growth, at_rest.frequency]
            found["exact"][f"{cell} {damping}"] = [at_rest.label, at_rest.border, at_rest.pieces]
    return found


def rigid_history():
    """A punch on a block, whose force and moment change."""
    domain = box(3, "quad")
    names = ("x", "y", "rz")
    loads = {name: fem.Constant(domain, 0.0) for name in names}
    shape = HalfSpace((0.0, 1.0), (0.0, -1.0))
    body = RigidBody(shape, about=(0.5, 1.0), load=loads, name="punch")
    problem = block(law=Coulomb(0.3), obstacle=body, flipped=True, domain=domain).problem

    def load(time):
        corners = (0.0, 1.0, 2.0, 3.0)
        values = {"x": (0.0, 0.0, 2.0, -2.0), "y": (-1.0, -20.0, -20.0, -15.0)}
        values |= {"rz": (0.0, 0.0, 2.0, -1.0)}
        for name, constant in loads.items():
            constant.value = np.interp(time, corners, values[name])

    load(0.0)
    problem.solve()
    return QuasiStatic(problem, load)


def history_in_space():
    """A block in space that is pressed down, and drawn around a corner."""
    body = block(2, "hex", law=Coulomb(0.3))
    corners = (0.0, 1.0, 2.0, 3.0)
    path = [(0.0, 0.0, 0.0), (0.0, 0.0, -0.01), (0.012, 0.0, -0.01), (0.012, 0.012, -0.01)]
    return led(body, (corners, path), [0.0, 1.0, 1.5, 2.0, 2.5, 3.0])


def laws_in_histories():
    """A cycle of a block with laws having a memory or depending on rates."""
    laws = {
        "Tresca": Tresca(2.0),
        "compliance": NormalCompliance(1e5, 1.5, Coulomb(0.3)),
        "regularised": Regularised(Coulomb(0.3), speed=1e-3),
        "nonlocal": NonlocalCoulomb(0.3, radius=0.5),
        "slip weakening": SlipWeakening(0.5, 0.2, 0.01),
    }
    found = {"solved": {}, "exact": {}, "counts": {}}
    for name, law in laws.items():
        body = block(3, "quad", law=law)
        history = cycle(body).run(TIMES[:4], longest=1.5, progress=False)
        for kind, values in with_end(steps(history), history).items():
            found[kind][name] = values
    return found


def options_of_histories():
    """Histories that are stopped, or that count the rays."""
    kinds = {
        "stopped": {"stop": lambda step: "far" if step.time > 2.2 else ""},
        "rays": {"rays": True},
    }
    found = {"solved": {}, "exact": {}, "counts": {}}
    for name, given in kinds.items():
        body = block(3, "quad", law=Coulomb(0.3))
        history = cycle(body).run(
            TIMES[:3], longest=0.5, locate_jumps=True, progress=False, **given
        )
        for kind, values in with_end(steps(history), history).items():
            found[kind][name] = values
    return found


def settled():
    """A damped block falling on a floor and coming to rest."""

    def energy(u):
        return elastic()(u) + 5.0 * u[1] * ufl.dx

    floor = HalfSpace((0.0, -0.001), (0.0, 1.0))
    problem = block(1, "quad", obstacle=floor, energy=energy, loose=True).problem
    motion = NSCD(problem, 1.0, dt=0.05, damping=(5.0, 1e-2), mass="lumped")
    history = motion.settle(3.0, progress=False)
    return with_end(steps(history), history)


def materials_and_shapes():
    """H and J of all materials, in 2D and 3D."""
    found = {}
    materials = {
        "linear": LinearElastic.from_young(1000.0, 0.3),
        "plane stress": LinearElastic.from_young(1000.0, 0.3, plane_stress=True),
        "St. Venant-Kirchhoff": StVenantKirchhoff(600.0, 400.0),
        "Ciarlet-Geymonat": CiarletGeymonat(600.0, 400.0, 50.0),
        "neo-Hookean": NeoHookean(600.0, 400.0),
    }
    for name, material in materials.items():
        for cell in ("quad", "tet")[: 1 if name == "plane stress" else 2]:

            def energy(u, material=material):
                return material.energy(u) * ufl.dx(metadata={"quadrature_degree": 2})

            problem = block(2, cell, energy=energy).problem
            found[f"{name}, {cell}"] = evaluated(problem)
    return {"evaluated": found}


def laws_in_space():
    """Solutions of further laws in space."""
    laws = {
        "Tresca": Tresca(2.0),
        "compliance": NormalCompliance(1e5, 1.0, Coulomb(0.3)),
        "tanh": Regularised(Coulomb(0.3), 3e-3),
        "linear": Regularised(Coulomb(0.3), 1e-4, "linear"),
        "nonlocal": NonlocalCoulomb(0.3, radius=0.3),
        "slip weakening": SlipWeakening(0.5, 0.2, 0.01),
    }
    found = {"evaluated": {}, "solved": {}, "exact": {}, "counts": {}}
    for name, law in laws.items():
        case = static(block(2, "hex", law=law, motion=oblique(3), options=TIGHT).problem)
        for kind, values in case.items():
            found[kind][name] = values
    return found


def questions():
    """Return answers of theorems and proofs for some problems."""
    found = {}
    bodies = {
        "slight friction": block(2, "quad", law=Coulomb(0.1), motion=oblique(2)),
        "friction": block(2, "quad", law=Coulomb(0.9), motion=oblique(2)),
        "no friction": block(2, "tet", law=Frictionless(), motion=oblique(3)),
        "given bound": block(2, "quad", law=Tresca(2.0), motion=oblique(2)),
        "friction in space": block(1, "tet", law=Coulomb(0.9), motion=oblique(3)),
    }
    for name, body in bodies.items():
        problem = body.problem
        problem.solve()
        theory = problem.theory()
        verdicts = [problem.uniqueness(proof_seconds=s).verdict for s in (0.0, 30.0)]
        found[name] = [theory.exists, theory.unique, *verdicts]
    system = triangle(2)
    system.set_parameter(1.0)
    system.problem.solve()
    found["several solutions"] = [system.problem.uniqueness(proof_seconds=30.0).verdict]
    return {"exact": found}


# -- histories, paths and motions ------------------------------------------------------------------

#: Down in the first unit of time, then to the right, to the left, and up.
TIMES = (0.0, 1.0, 3.0, 6.0, 7.0)


def there_and_back(time):
    """The displacement of the moved end in a cycle."""
    across = (0.0, 0.0, 0.012, -0.012, -0.0036)
    up = (0.0, -0.01, -0.01, -0.01, -0.002)
    return [np.interp(time, TIMES, values) for values in (across, up)]


def cycle(body):
    """The quasi-static evolution of two bodies in a cycle."""
    return QuasiStatic(body.problem, lambda time: body.move(there_and_back(time)))


def shaken(body):
    """The motion of two bodies with mass, in steps longer than their waves take."""
    load = lambda time: body.move(there_and_back(time))  # noqa: E731
    return NSCD(body.problem, 1.0, dt=0.25, load=load)


class Interrupted(Exception):
    """Raised by an observer in order to interrupt a run."""


def interrupt_at(number):
    """An observer interrupting a run after a step."""

    def observer(step):
        if step.number == number:
            raise Interrupted

    return observer


def recorded(make, times, interrupted=0, **how):
    """A history with its record; if required, it is interrupted after a step and resumed."""
    with new_folder() as folder:
        evolution = make()
        observer = interrupt_at(interrupted) if interrupted else None
        try:
            with EvolutionRecord(folder, evolution) as kept:
                history = evolution.run(
                    times, record=kept, observer=observer, progress=False, **how
                )
        except Interrupted:
            with EvolutionRecord(folder, make(), resume=True) as kept:
                history = kept.go_on(progress=False)
                kept.problem.restore(kept.state(1))
                shown = state(kept.problem)
        found = with_journal(steps(history), read_journal(folder).rows()[1:])
    if interrupted:
        found["solved"]["shown"] = shown
    return with_end(found, history)


def with_end(found, history):
    """A case with the contact points at the end of a history."""
    result = history.steps[-1].result
    numbers, statuses = tables(result)
    found["solved"]["tables"] = numbers
    found["solved"]["more"] = more_of_tables(result)
    found["exact"]["statuses"] = statuses
    return found


def bonded_block(law, young=30.0, pull=0.1):
    """A block on bonds, pulled up and sideways, and released."""
    body = block(3, "quad", law=law, energy=elastic(young))
    before = evaluated(body.problem, 0.05, 1.0)

    def load(time):
        part = pull * min(time, 2 - time)
        body.move(lambda x: np.array([part + 0 * x[0], part * (x[0] - 0.3)]))

    history = QuasiStatic(body.problem, load).run([0.0, 1.0, 1.8], longest=0.25, progress=False)
    now = evaluated(body.problem.step_from(history.steps[-1].state), 0.05, 1.0)
    found = steps(history) | {"evaluated": now | {"at the start": before}}
    return with_end(found, history)


def glued_path(law):
    """A path by arc length of a soft block on worn bonds, whose lid tilts."""
    body = block(2, "quad", law=law, energy=elastic(30.0))
    x = ufl.SpatialCoordinate(body.problem.V.mesh)
    return ArcLength(body.driven(lambda gamma: (0.8 * gamma, gamma * (x[0] - 0.3))))


def broken(limit):
    """A stop condition: a bond is weaker than a limit."""

    def stop(step):
        beta = step.result.tables["contact"].beta
        return "broken" if beta is not None and beta.min() < limit else ""

    return stop


def recorded_path(interrupted=0):
    """A path there and back with its record; if required, it is interrupted and resumed."""
    law = RCCM(100.0, 100.0, 1.0, friction=0.5, beta=0.6)
    control = StepControl(initial=0.05, maximum=0.1)
    how = {"control": control, "progress": False}
    with new_folder() as folder:
        path = glued_path(law)
        observer = interrupt_at(interrupted) if interrupted else None
        there = {"gamma_range": (0.0, 0.7), "stop": broken(0.1), "observer": observer}
        back = {"gamma_range": (0.02, 0.7), "direction": "back"}
        try:
            with PathRecord(folder, path) as kept:
                path.run(record=kept, **there, **how)
                path.run(record=kept, **back, **how)
        except Interrupted:
            path = glued_path(law)
            with PathRecord(folder, path, resume=True) as kept:
                kept.go_on(stop=broken(0.1), progress=False)
                path.run(record=kept, **back, **how)
        journal = read_journal(folder)
    found = {
        "solved": {"gammas": journal.gammas},
        "exact": {"folds": len(journal.folds), "kinks": len(journal.kinks)},
    }
    return with_journal(found, journal.rows()[1:])


def snapping_bar():
    """A bar snapping back on a bond, by arc length."""
    system = bar(1, 50.0, RCCM(100.0, 100.0, 1.0))
    history = ArcLength(system).run(
        gamma_range=(0.0, 0.4), control=StepControl(maximum=0.05), stop=broken(0.4)
    )
    return with_end(steps(history), history)


def falling_block(cell="tri", n=2, law=Coulomb(0.3), end=0.1, **given):  # noqa: B008
    """A block falling on a floor, with friction."""

    def energy(u):
        dim = u.function_space.mesh.geometry.dim
        return elastic()(u) + 5.0 * u[dim - 1] * ufl.dx

    dim = 2 if cell in ("tri", "quad") else 3
    up = np.eye(dim)[-1]
    floor = HalfSpace(-0.01 * up, up)
    problem = block(n, cell, law=law, obstacle=floor, energy=energy, loose=True).problem
    velocity = fem.Function(problem.V)
    speed = (0.5, *[0.0] * (dim - 2), -1.0)
    velocity.x.array[:] = np.tile(speed, len(velocity.x.array) // dim)
    motion = NSCD(problem, 1.0, dt=0.01, velocity=velocity, **given)
    history = motion.run([0.0, end], progress=False)
    found = steps(history)
    found["solved"]["last state"] = state(problem)
    found["solved"]["velocity"] = numbers_of(problem.V, velocity.x.array)
    return with_end(found, history)


def schemes():
    """A few steps of a block hitting a floor, by all schemes of integration."""
    kinds = {
        "theta": {"theta": 0.6, "mass": "lumped"},
        "theta-euler": {"scheme": "theta-euler", "theta": 0.7},
        "modified-theta": {"scheme": "modified-theta", "theta": 0.55, "mass": "consistent"},
        "velocity": {"level": "velocity", "mass": "lumped", "restitution": 0.5},
        "damped": {"damping": (0.3, 1e-3)},
    }
    found = {"solved": {}, "exact": {}, "counts": {}}
    for name, given in kinds.items():
        case = falling_block("quad", 2, end=0.04, **given)
        for kind, values in case.items():
            found[kind][name] = values
    return found


def jumping():
    """A triangle that cannot stick any longer and jumps to another solution."""
    system = triangle(1, 3.0, load=(2.0, 0.0), lame=(1.0, 1.0), preload=_pressed)

    def load(time):
        system.set_parameter(time)

    system.set_parameter(0.0)
    problem = system.problem
    problem.solve()
    history = QuasiStatic(problem, load).run(
        [0.0, 1.5, 2.5, 3.6, 4.0], locate_jumps=True, at_jump="jump", shortest=0.01, progress=False
    )
    return with_end(steps(history), history)


def _pressed(domain):
    return fem.Constant(domain, (0.0, -2.0))


# -- large sliding ---------------------------------------------------------------------------------


def led(body, path, times, **how):
    """A history along a path of the moved end, with H and J at its start and its last state.

    Args:
        body: problem and moved end.
        path: displacement by time, as lists of times and of displacements.
        times: times of the history.
        how: further arguments of `QuasiStatic.run`.
    """
    corners, displacements = path

    def load(time):
        body.move([np.interp(time, corners, column) for column in zip(*displacements, strict=True)])

    problem = body.problem
    before = evaluated(problem)
    how = {"halve_steps": True, "progress": False} | how
    history = QuasiStatic(problem, load).run(times, **how)
    found = steps(history) | {"evaluated": before}
    found["solved"]["last state"] = state(problem)
    return with_end(found, history)


def sliding_pair(cell, lower, upper, slave, law, drawn=0.3, **given):
    """Two neo-Hookean bodies, one pressed on the other and drawn over it by more than a facet."""
    both = stack(cell, lower, upper)
    how = {"slave": slave, "master": 5 - slave, "energy": rubber, "sliding": "large"}
    body = pair(both, law=law, options={"snes_rtol": 1e-11}, **how | given)
    dim = both.mesh.geometry.dim
    aside = [0.02] * (dim - 2)
    still = [0.0] * (dim - 1)
    path = [0.0, 1.0, 2.0], [[0.0] * dim, [*still, -0.06], [drawn, *aside, -0.06]]
    return led(body, path, [0.0, 1.0, 1.5, 2.0])


def self_contact(dim, law):
    """A U whose arms are pressed together and rub."""
    body = hairpin(dim, 0.25, law)
    path = [0.0, 1.0], [[0.0] * dim, [*[0.0] * (dim - 1), -0.6]]
    return led(body, path, [0.0, 0.5, 1.0])


def over_a_surface(shape, cell, n, law=Coulomb(0.3), **run):  # noqa: B008
    """A block that is pressed on a curved rigid surface and drawn over it."""
    how = {"obstacle": shape, "energy": rubber, "options": {"snes_rtol": 1e-11}}
    body = block(n, cell, law=law, sliding="large", **how)
    dim = body.problem.V.mesh.geometry.dim
    still = [0.0] * (dim - 1)
    aside = [0.03] * (dim - 2)
    path = [0.0, 1.0, 2.0], [[0.0] * dim, [*still, -0.06], [0.2, *aside, -0.06]]
    return led(body, path, [0.0, 1.0, 1.5, 2.0], **run)


def drum():
    """A block that is pressed on a drum, which then turns under it."""
    domain = box(3, "quad")
    angle = fem.Constant(domain, 0.0)
    wheel = RigidBody(
        Sphere((0.4, -1.0), 1.0), about=(0.4, -1.0), motion={"rz": angle}, held=("x", "y")
    )
    how = {"obstacle": wheel, "energy": rubber, "options": {"snes_rtol": 1e-11}}
    body = block(law=Coulomb(0.3), sliding="large", domain=domain, **how)

    def load(time):
        angle.value = 0.1 * max(time - 1.0, 0.0)
        body.move((0.0, -0.06 * min(time, 1.0)))

    # A start that does not satisfy the Dirichlet data.
    load(3.0)
    before = evaluated(body.problem)
    load(0.0)
    how = {"halve_steps": True, "progress": False}
    history = QuasiStatic(body.problem, load).run([0.0, 1.0, 1.5, 2.0, 3.0], **how)
    found = steps(history) | {"evaluated": before}
    found["solved"]["last state"] = state(body.problem)
    return with_end(found, history)


# -- branches, all solutions, proofs ---------------------------------------------------------------


def started(system, gamma):
    """The unknowns of a solution for gamma."""
    system.set_parameter(gamma)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    return x


def branch_of(system, gamma=-1.0, gamma_range=(-1.0, 1.0), **how):
    """A branch from a solution."""
    x = started(system, gamma)
    followed = follow(system, x, gamma, gamma_range=gamma_range, **how)
    found = branch(system, followed)
    return with_journal(found, journal_of(system, [followed]).rows())


def dragged(law, cell="tri"):
    """A block whose top is pressed down, and drawn aside by gamma."""
    return block(4, cell, law=law).driven(lambda gamma: (0.012 * gamma, -0.01))


def sheared_pair():
    """Two blocks of different meshes, pressed, and drawn aside and released by gamma."""
    both = stack("quad", (9, 4, UNIT), (6, 3, UNIT))
    body = pair(both, law=Coulomb(0.15), slave=2, master=3)
    return body.driven(lambda gamma: (0.02 * gamma, -0.02 + 0.012 * gamma))


def pressed_rubber(cell="quad", n=4):
    """A hyperelastic block that is moved down and sideways by gamma until all of it slips."""

    def motion(gamma):
        return (0.02 * gamma**2, -0.02 * gamma)

    def energy(u):
        return NeoHookean(600.0, 400.0).energy(u) * ufl.dx

    floor = HalfSpace((0.0, -0.002), (0.0, 1.0))
    return block(n, cell, obstacle=floor, energy=energy).driven(motion)


def pressed_on_a_disc(dim):
    """A block that is pressed on a disc or ball and drawn aside: points close one by one."""
    if dim == 2:
        body = block(4, "quad", obstacle=Sphere((0.45, -3.0), 3.0))
        return body.driven(lambda gamma: (0.01 * gamma, -0.05 * gamma))
    body = block(2, "hex", obstacle=Sphere((0.45, 0.4, -3.0), 3.0))
    return body.driven(lambda gamma: (0.02 * gamma, 0.005 * gamma, -0.1 * gamma))


def branches_by_kinks():
    """Branches passing kinks in batches, or by steps."""
    found = {"solved": {}, "exact": {}, "counts": {}}
    kinds = {
        "batched": (pressed_on_a_disc(2), {"control": StepControl(kinks="batched")}),
        "stepping": (pressed_on_a_disc(2), {"control": StepControl(kinks="stepping")}),
    }
    for name, (system, how) in kinds.items():
        case = branch_of(system, 0.0, (0.0, 1.0), route="steps", **how)
        for kind, values in case.items():
            found[kind][name] = values
    return found


def branch_by_multigrid():
    given = {"linear_solver": "amg", "amg_pc_gamg_coarse_eq_limit": 50}
    body = block(6, "quad", options=given, law=Coulomb(0.3))
    system = body.driven(lambda gamma: (0.012 * gamma, -0.01))
    found = branch_of(system, 0.0, (0.0, 1.0), route="steps")
    # Steps and states have the accuracy of iterations.
    special = [round(gamma, 7) for gamma in found["solved"]["special"]]
    return {"exact": found["exact"] | {"gammas": special}}


def deflated():
    """Solutions that are found one after another by deflation."""
    system = triangle(2)
    x = started(system, 1.0)
    solutions = find_solutions(system, [x], 1.0, deflation=True, lengths=(0.5,), max_iterations=20)
    points = sorted(solutions.points(system), key=lambda p: system.letters(p.piece))
    return {
        "solved": {
            f"solution {i}": vector(system.problem, state_vector(system, p))
            for i, p in enumerate(points)
        },
        "exact": {"statuses": [system.letters(p.piece) for p in points]},
    }


def recorded_diagram():
    """All branches from a start, with their record."""
    system = pressed_on_a_disc(2)
    x = started(system, 0.0)
    with new_folder() as folder:
        with BranchRecord(folder, system) as kept:
            explore(system, [(x, 0.0)], gamma_range=(-0.2, 1.0), record=kept)
        journal = read_journal(folder)
    special = journal.special().to_dict("records")
    return {
        "solved": {"gammas": sorted(s["gamma"] for s in special)},
        "exact": {
            "kinds": sorted(s["kind"] for s in special),
            "rows": sorted(r["status"] for r in journal.rows()),
            "complete": journal.explored.complete,
        },
    }


def recorded_branch():
    """A branch with its record."""
    system = dragged(Coulomb(0.3), cell="quad")
    x = started(system, 0.0)
    with new_folder() as folder:
        with BranchRecord(folder, system) as kept:
            followed = follow(system, x, 0.0, gamma_range=(0.0, 1.0), record=kept)
        return with_journal(branch(system, followed), read_journal(folder).rows())


def resumed_branch(make, **how):
    """A recorded branch with functionals, ended by its budget and resumed."""
    system = make()
    x = started(system, 0.0)

    def functionals(system):
        form = fem.form(system.problem.energy)
        energy = lambda problem: problem.comm.allreduce(fem.assemble_scalar(form))  # noqa: E731
        return {"energy": energy, "force": total("rn"), "shear": total("rt")}

    with new_folder() as folder:
        with BranchRecord(folder, system, functionals(system), every=2) as kept:
            how = {"gamma_range": (0.0, 1.0)} | how
            follow(system, x, 0.0, record=kept, max_steps=4, **how)
        system = make()
        with BranchRecord(folder, system, functionals(system), every=2, resume=True) as kept:
            followed = kept.go_on(max_steps=200)
        journal = read_journal(folder)
        with BranchRecord(folder, system, functionals(system), every=2, resume=True) as kept:
            states = [vector(system.problem, state_vector(system, p)) for p in kept.points()]
    found = with_journal(branch(system, followed), journal.rows())
    found["solved"]["kept states"] = {f"point {i}": s for i, s in enumerate(states)}
    special = journal.special().to_dict("records")
    found["exact"]["events"] = [
        [s["kind"], [[c["before"], c["after"]] for c in s["changes"]]] for s in special
    ]
    return found


def all_branches():
    system = triangle(4)
    x = started(system, -1.0)
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0))
    points = [p for b in diagram.branches for p in b.points]
    return {
        "solved": {"gammas": sorted(p.gamma for p in points)},
        "exact": {
            "branches": len(diagram.branches),
            "complete": diagram.complete,
            "nodes": sorted(len(node.rays) for node in diagram.nodes),
            "statuses": sorted(system.letters(p.piece) for b in diagram.branches for p in b.points),
        },
    }


def branch_counts():
    """Numbers of solutions along all branches, with proofs."""
    system = triangle(2)
    diagram = explore(system, [(started(system, -1.0), -1.0)], gamma_range=(-1.0, 1.0))
    found = prove_counts(system, diagram)
    return {
        "solved": {"gammas": [c.gamma for c in found]},
        "exact": {
            "numbers": [c.number for c in found],
            "statuses": [sorted(c.statuses) for c in found],
            "proved": [c.proved for c in found],
            "verdicts": [c.certificate and check(c.certificate).verdict for c in found],
            "branches": [sorted(c.branches) for c in found],
            "whole": [found.proved, found.followed, found.missed],
        },
    }


def all_solutions(system):
    """All solutions at gamma = 1."""
    x = system.create_vector()
    found = find_solutions(system, [x], 1.0)
    points = sorted(found.points(system), key=lambda p: system.letters(p.piece))
    return {
        "solved": {
            f"solution {i}": vector(system.problem, state_vector(system, p))
            for i, p in enumerate(points)
        },
        "exact": {
            "statuses": [system.letters(p.piece) for p in points],
            "complete": found.complete,
        },
    }


def body_in_space():
    """A leaning cube of tetrahedra on a floor under a force by volume, with three solutions."""
    domain = leaned(1, "tet", (0.8, 0.0))
    gamma = fem.Constant(domain, 1.0)
    force = fem.Constant(domain, (1.0, 0.1, -0.2))

    def energy(u):
        return LinearElastic(1.0, 1.0).energy(u) * ufl.dx - gamma * ufl.dot(force, u) * ufl.dx

    problem = block(law=Coulomb(3.0), energy=energy, domain=domain).problem
    return ParametricContact(problem, gamma)


def certificate():
    """Proved solutions of two points in the plane."""
    rng = np.random.default_rng(3)
    S = rng.normal(size=(6, 6))
    S = S @ S.T + 0.3 * np.eye(6)
    return proved(ReducedProblem(S, rng.normal(size=6), np.array([3.0, 0.5, 1.0])))


def certificate_in_space(apart=1.0, points=1, bound=0.0):
    """Proved solutions of points in space whose slip lifts them."""
    one = np.array([[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]])
    S = np.kron(np.eye(points), one)
    S += 0.05 * (np.ones_like(S) - np.kron(np.eye(points), np.ones((3, 3))))
    p = np.concatenate([np.array([-2.5, 0.1, -1.0]) * apart**i for i in range(points)])
    friction = np.full(points, 3.0)
    bounds = np.zeros(points)
    if bound:
        friction[-1], bounds[-1] = 0.0, bound
    return proved(ReducedProblem(S, p, friction, bounds))


def proved(problem):
    """Solutions of a reduced problem, with the verdict of the search and of the checker."""
    found = prove_solutions(problem)
    return {
        "solved": {
            "solutions": sorted(np.abs(s.state).sum() for s in found.solutions),
            "states": [s.state.tolist() for s in sorted(found.solutions, key=_codes)],
        },
        "exact": {
            "verdict": found.verdict,
            "checked": check(found.certificate).verdict,
            "solutions": len(found.solutions),
            "codes": sorted(map(_codes, [*found.solutions])),
            "leaves": len(found.certificate.steps),
        },
    }


def _codes(solution):
    return [*map(int, solution.codes)], [round(v, 6) for v in solution.state.ravel().tolist()]


def chart():
    system = triangle(2)
    F = system.problem.surfaces[0].law.friction
    family = contact_family(system, F, mu_range=(1.0, 4.0))
    found = count_solutions(
        family, mu_range=(1.0, 4.0), gamma_range=(-1.0, 1.0), cells=(3, 3), depth=1
    )
    return {
        "exact": {
            "cells": [[str(c.mu), str(c.gamma), str(c.count), c.proved] for c in found.cells],
        }
    }


def regions():
    """Regions of two loads with the same solutions, and the curves between them."""
    others = []

    def preload(domain):
        others.append(fem.Constant(domain, 1.0))
        return ufl.as_vector([others[0], 0.0])

    system = triangle(1, 3.0, load=(0.0, -1.0), lame=(1.0, 1.0), preload=preload)
    (other,) = others
    span = (-3.0, 3.0)
    branches = []
    for value in (-0.3, 0.3):
        other.value = value
        x = started(system, -3.0)
        branches.append((value, follow(system, x, -3.0, gamma_range=span)))
    curves = event_curves(
        system, other, branches, mu_range=span, gamma_range=span, folds_only=False
    )
    family = contact_family(system, other, mu_range=span)
    found = solution_regions(family, curves, mu_range=span, gamma_range=span)
    return {
        "solved": {"crossings": np.asarray(curves.crossings).ravel().tolist()},
        "exact": {"counts": [r.count for r in found.cells], "proved": found.proved},
    }


def folds_with_friction():
    preload = lambda domain: fem.Constant(domain, (0.0, -2.0))  # noqa: E731
    given = {"load": (2.0, 0.0), "lame": (1.0, 1.0), "preload": preload, "comm": MPI.COMM_SELF}
    system = triangle(1, 3.0, **given)
    followed = follow(system, started(system, 0.0), 0.0, gamma_range=(0.0, 10.0))
    F = system.problem.surfaces[0].law.friction
    curves = event_curves(
        system, F, [(3.0, followed)], mu_range=(1.0, 4.0), gamma_range=(0.1, 10.0), folds_only=False
    )
    return {
        "solved": {
            "folds": list(curves.folds_at(2.7)),
            "crossings": np.ravel(curves.crossings).tolist(),
        },
        "exact": {"kinds": [c.kind for c in curves.curves]},
    }


def critical_coefficients():
    problem = triangle(4).problem
    found = critical_friction(problem)
    renard = renard_criterion(problem, lambda x: np.tile([1.0, 0.0], (len(x), 1)))
    return {
        "solved": {"critical": found.one_signed[:3], "renard": [renard.friction]},
        "exact": {"unique": renard.unique},
    }


def leaned(n, cell, lean):
    """The mesh of a block whose upper face is displaced sideways."""
    domain = box(n, cell)
    x = domain.geometry.x
    last = domain.geometry.dim - 1
    x[:, :last] += np.outer(x[:, last], lean)
    return domain


def leaning(n, cell, lean):
    """The problem of such a block."""
    return block(domain=leaned(n, cell, lean), energy=elastic(1.0)).problem


def more_critical_coefficients():
    """Critical friction along other directions, of pairs, and by a search of few eigenvalues."""
    found = {}
    bodies = {
        "pair": two_blocks(3).problem,
        "other meshes": two_blocks(2, ratio=2).problem,
        "disc": block(3, "quad", obstacle=Sphere((0.4, -3.0), 3.0), energy=elastic(1.0)).problem,
    }
    for name, problem in bodies.items():
        result = critical_friction(problem)
        listed = sorted(abs(v) for v in [*result.one_signed, *result.others])
        found[name] = [abs(result.friction or 0.0), *listed[:2]]
    tilted = pair(stack("tet", (2, 1, UNIT), (3, 1, UNIT), turn=TILT)).problem
    found["tilted"] = [abs(critical_friction(tilted, TILT[:, 0]).one_signed[0])]
    few = critical_friction(leaning(4, "quad", (0.6,)), dense=False, solver="direct")
    found["few"] = [few.friction]
    solved = block(3, "quad", motion=(0.03, -0.01)).problem
    solved.solve()
    found["solution"] = [critical_friction(solved, "solution").friction]
    renard = renard_criterion(solved, lambda x: np.tile([1.0, 0.0], (len(x), 1)))
    found["renard"] = [renard.friction]
    return {"solved": found}


def critical_by_multigrid():
    found = critical_friction(leaning(8, "quad", (0.6,)), dense=False, solver="amg")
    return {
        "solved": {
            "critical": [found.friction],
            "positions": found.positions.ravel().tolist(),
        },
        # Slips are vectors of an iteration that ends at a residual of 1e-7.
        "exact": {
            "slips": [round(v, 5) for v in found.slips.tolist()],
            "solver": found.solver,
            "complete": found.complete,
        },
        "counts": {"solves": found.solves, "iterations": found.iterations},
    }


def critical_by_direction():
    found = critical_friction_by_direction(leaning(2, "hex", (0.5, 0.2)), number=6)
    return {
        "solved": {
            "angles": found.angles.tolist(),
            "friction": found.friction.tolist(),
            "smallest": [found.smallest, *found.direction],
        },
        "exact": {"all": bool(np.isinf(found.known_up_to).all())},
    }


def wedging(problem, **how):
    found = wedging_friction(problem, **how)
    return {
        "solved": {
            "friction": [found.friction, found.lower],
            "state": found.state.ravel().tolist(),
        },
        "exact": {"statuses": found.statuses, "complete": found.complete},
        "counts": {"regions": found.regions},
    }


def shaken_down(factor=None):
    """A block that is pressed down by its top, which moves to and fro."""
    body = block(2, "quad", law=Coulomb(0.3))
    loads = [lambda x=x: body.move((x, -0.01)) for x in (0.002, -0.002)]
    steady = lambda: body.move((0.0, -0.01))  # noqa: E731
    found = shakedown(body.problem, loads, steady=steady, factor=factor, cycles=4, starts=2)
    return {
        "solved": {
            "factor": [found.factor, found.upper],
            "ranges": np.ravel(found.ranges).tolist(),
            "slip": found.slip.ravel().tolist(),
            "forces": found.forces.ravel().tolist(),
            "dissipation": [list(c.dissipation) for c in found.cycles],
            "displacements": [c.displacements.ravel().tolist() for c in found.cycles],
            "cycle forces": [c.forces.ravel().tolist() for c in found.cycles],
            "slid": [c.slid for c in found.cycles],
        },
        "exact": {
            "complete": found.complete,
            "theorem": bool(found.theorem_holds),
            "opened": found.opened.tolist(),
            "endings": [c.ending for c in found.cycles],
            "lifts": [bool(c.lifts) for c in found.cycles],
        },
    }


def shaken_down_in_space():
    """The same in space, where the bound lies between polygons and tangents."""
    body = block(1, "tet", law=Coulomb(0.3))
    loads = [lambda x=x: body.move((x, 0.001, -0.01)) for x in (0.002, -0.002)]
    steady = lambda: body.move((0.0, 0.0, -0.01))  # noqa: E731
    found = shakedown(body.problem, loads, steady=steady, cycles=3, starts=1)
    # The bound is that of an iteration.
    return {
        "exact": {
            "factor": round(found.factor, 6),
            "endings": [c.ending for c in found.cycles],
            "opened": found.opened.tolist(),
        },
        "solved": {"dissipation": [v for c in found.cycles for v in c.dissipation]},
    }


def sliding_and_rest():
    pad = block(4, "quad", energy=elastic(1.0)).problem
    sliding = SteadySliding(pad, (-1.0, 0.0), density=1.0)
    modes = sliding.modes(0.3).eigenvalues
    modes = modes[np.argsort(modes.imag.round(9), kind="stable")]
    problem = block(3, motion=(0.004, -0.01), options=TIGHT).problem
    problem.solve()
    at_rest = stability_at_rest(problem, density=1.0)
    return {
        "solved": {"real": modes.real.tolist(), "imaginary": modes.imag.tolist()},
        "exact": {"label": at_rest.label},
    }


def onset():
    """The friction at which steady sliding begins to vibrate."""
    pad = block(2, "quad", energy=elastic(1.0)).problem
    found = SteadySliding(pad, (-1.0, 0.0), density=1.0, damping=0.02).onset()
    # It is found by bisection.
    return {"exact": {"friction": round(found.friction, 6), "frequency": round(found.frequency, 5)}}


CASES: dict[str, Callable[[], dict[str, Any]]] = {
    "triangles": of_a_mesh("tri", 4),
    "quadrilaterals, P2": of_a_mesh("quad", 3, degree=2),
    "tetrahedra": of_a_mesh("tet", 3),
    "hexahedra": of_a_mesh("hex", 3),
    "integral, P2": of_a_mesh("tri", 3, degree=2, method="integral"),
    "integral in space": of_a_mesh("tet", 2, method="integral"),
    "mixed": of_a_mesh("quad", 4, method="mixed"),
    "sphere": of_a_mesh("hex", 3, obstacle=Sphere((0.5, 0.5, -5.0), 5.0)),
    "cylinder": of_a_mesh("tet", 3, obstacle=Cylinder((0.5, 0.5, -5.0), (0.0, 1.0, 0.0), 5.0)),
    "Frictionless": of_a_law(Frictionless()),
    "Tresca": of_a_law(Tresca(2.0)),
    "Regularised": of_a_law(Regularised(Coulomb(0.3), 1e-4, "polynomial")),
    "NormalCompliance": of_a_law(NormalCompliance(1e5, 2.0, Coulomb(0.3))),
    "NonlocalCoulomb": of_a_law(NonlocalCoulomb(0.3, radius=0.3)),
    "slip weakening": of_a_law(SlipWeakening(0.5, 0.2, 0.01)),
    "orthotropic": lambda: static(
        block(
            3, "hex", law=Orthotropic(0.1, 0.4, 0.5), motion=(0.01, 0.0, -0.01), options=TIGHT
        ).problem
    ),
    "pair": lambda: pressed_pair(2, "quad", 3, method="nodal"),
    "pair, integral, P2": lambda: pressed_pair(2, "tri", method="integral", degree=2),
    "pair in space": lambda: pressed_pair(3, "hex", method="nodal"),
    "mortar in space": mortar_in_space,
    "punch": lambda: punch(2, 4, load={"y": -3.0, "x": 0.4}, held=("rz",)),
    "punch under a moment": lambda: punch(2, 4, load={"y": -10.0, "rz": 2.5, "x": 0.4}),
    "punch under moments in space": lambda: punch(
        3, 3, load={"x": 1.0, "y": -0.5, "z": -20.0, "rx": -2.0, "ry": 3.0, "rz": 0.2}
    ),
    "sphere that rolls": rolling_punch,
    "tool under a moment": tool_under_a_moment,
    "disc": lambda: static(disc(4, Coulomb(0.1))),
    "large displacement": large_displacement,
    "surface of facets": lambda: pressed_on(
        RigidSurface(*polygon(24, (0.45, -1.0)), crease=30.0), "quad", 4, Coulomb(0.3), (0.02, -0.1)
    ),
    "surface of facets in space": lambda: pressed_on(
        RigidSurface(*globe(8, (0.45, 0.4, -1.0)), crease=60.0),
        "hex",
        2,
        Frictionless(),
        (0.02, 0.01, -0.1),
    ),
    "mean dilatation": lambda: nearly_incompressible(
        "quad", 4, LinearElastic.from_young(1000.0, 0.4999), oblique(2)
    ),
    "mean dilatation in space": lambda: nearly_incompressible(
        "hex", 2, LinearElastic.from_young(1000.0, 0.4999), oblique(3)
    ),
    "mean dilatation of rubber": lambda: nearly_incompressible("quad", 3, RUBBER, (0.02, -0.1)),
    "initial stress": lambda: stressed(-20.0),
    "unstable initial stress": lambda: stressed(-200.0),
    "multigrid": multigrid,
    "pair by multigrid": pair_by_multigrid,
    "contact nodes that are held": held_at_contact,
    "press fit": press_fit,
    "given gap": with_a_gap,
    "laws in space": laws_in_space,
    "materials": materials_and_shapes,
    "algorithms on points": algorithms_on_points,
    "distances from facets": distances,
    "disc by other methods": other_sections,
    "Lemke": lambda: by_algorithm("lemke"),
    "RCCM": lambda: bonded_block(RCCM(100.0, 100.0, 0.1, friction=0.3)),
    "RCCM that breaks": lambda: bonded_block(
        RCCM(100.0, 100.0, 0.1, friction=0.3), young=3000.0, pull=0.045
    ),
    "worn RCCM that breaks": lambda: bonded_block(
        RCCM(100.0, 80.0, 0.1, friction=0.3, beta=0.7), young=3000.0, pull=0.045
    ),
    "BilinearCohesive that breaks": lambda: bonded_block(
        BilinearCohesive(4.0, 0.004, 0.2, 0.5), young=1000.0, pull=0.04
    ),
    "history of a punch": lambda: recorded(
        rigid_history, (0.0, 1.0, 2.0, 3.0), longest=0.5, locate_jumps=True
    ),
    "history of a punch that is resumed": lambda: recorded(
        rigid_history, (0.0, 1.0, 2.0, 3.0), 3, longest=0.5, locate_jumps=True
    ),
    "history in space": history_in_space,
    "MaxwellLayer": lambda: bonded_block(MaxwellLayer(50.0, 10.0, 2.0)),
    "BilinearCohesive": lambda: bonded_block(BilinearCohesive(4.0, 0.004, 0.06, 0.5)),
    "history": lambda: recorded(lambda: cycle(two_blocks()), TIMES, longest=0.5, locate_jumps=True),
    "history of a crack": lambda: recorded(
        lambda: cycle(cracked(4, Coulomb(0.25))), TIMES, longest=0.5, locate_jumps=True
    ),
    "history that is resumed": lambda: recorded(
        lambda: cycle(two_blocks(3)), TIMES[:3], 2, longest=0.5, locate_jumps=True
    ),
    "motion with a record": lambda: recorded(lambda: shaken(two_blocks()), TIMES[:2]),
    "motion that is resumed": lambda: recorded(lambda: shaken(two_blocks(3)), TIMES[:2], 2),
    "motion": falling_block,
    "laws in histories": laws_in_histories,
    "options of histories": options_of_histories,
    "step by step": step_by_step,
    "schemes of motion": schemes,
    "settled motion": settled,
    "history with a jump": jumping,
    "path with a record": recorded_path,
    "path that is resumed": lambda: recorded_path(3),
    "path that snaps back": snapping_bar,
    # With 0.3 the processor decides whether the last step takes 9, 10 or 11 iterations.
    "sliding pair": lambda: sliding_pair(
        "quad", (5, 2, UNIT), (7, 3, (-0.2, 1.2)), 3, Coulomb(0.3), drawn=0.25
    ),
    "sliding pair of triangles": lambda: sliding_pair(
        "tri", (5, 2, UNIT), (4, 2, (0.1, 0.9)), 2, Frictionless()
    ),
    "sliding pair with held nodes": lambda: sliding_pair(
        "quad", (5, 2, UNIT), (4, 2, (0.1, 0.9)), 3, Coulomb(0.3), sides=True
    ),
    "sliding pair in space": lambda: sliding_pair(
        "hex", (2, 1, UNIT), (3, 1, (0.1, 1.1)), 3, Coulomb(0.3)
    ),
    "self-contact": lambda: self_contact(2, Coulomb(0.3)),
    "self-contact in space": lambda: self_contact(3, Frictionless()),
    "over a disc": lambda: over_a_surface(Sphere((0.4, -1.0), 1.0), "quad", 3),
    "over a surface of facets": lambda: over_a_surface(
        RigidSurface(*polygon(24, (0.4, -1.0)), crease=30.0), "quad", 3
    ),
    "over a disc with rays": lambda: over_a_surface(
        Sphere((0.4, -1.0), 1.0), "quad", 3, rays=True, locate_jumps=True
    ),
    "over a ball": lambda: over_a_surface(Sphere((0.45, 0.4, -1.0), 1.0), "tet", 2),
    "drum that turns": drum,
    "branch by pivoting": lambda: branch_of(triangle(4)),
    "branch by steps": lambda: branch_of(dragged(Coulomb(0.3)), 0.0, (0.0, 1.0), route="steps"),
    "branch with a record": recorded_branch,
    "branch that is resumed": lambda: resumed_branch(pressed_rubber),
    "branch by pivoting that is resumed": lambda: resumed_branch(lambda: dragged(Coulomb(0.3))),
    "branch of a mortar": lambda: branch_of(sheared_pair(), 0.0, (0.0, 1.0)),
    "branch of a law": lambda: branch_of(dragged(SlipWeakening(0.5, 0.2, 0.01)), 0.0, (0.0, 1.0)),
    "diagram": all_branches,
    "branch that closes": lambda: branch_of(pressed_on_a_disc(2), 0.0, (0.0, 1.0), route="steps"),
    "branch that closes by pivoting": lambda: branch_of(pressed_on_a_disc(2), 0.0, (0.0, 1.0)),
    "branch in space": lambda: branch_of(pressed_on_a_disc(3), 0.0, (0.0, 1.0)),
    "branch by other kinks": branches_by_kinks,
    "branch by multigrid": branch_by_multigrid,
    "deflation": deflated,
    "diagram with a record": recorded_diagram,
    "branch counts": branch_counts,
    "all solutions": lambda: all_solutions(triangle(4)),
    "all solutions in space": lambda: all_solutions(body_in_space()),
    "certificate": certificate,
    "certificate in space": certificate_in_space,
    "certificate of two points in space": lambda: certificate_in_space(1.02, 2),
    "certificate of a given bound in space": lambda: certificate_in_space(1.02, 2, 0.3),
    "chart": chart,
    "regions": regions,
    "folds": folds_with_friction,
    "questions": questions,
    "more critical friction": more_critical_coefficients,
    "stability of slip": stable_slip,
    "shakedown in space": shaken_down_in_space,
    "critical friction": critical_coefficients,
    "critical friction by multigrid": critical_by_multigrid,
    "critical friction by direction": critical_by_direction,
    "wedging": lambda: wedging(triangle(4, 0.5).problem),
    "wedging in space": lambda: wedging(block(1, "tet").problem, sides=8),
    "shakedown": shaken_down,
    "shakedown that fails": lambda: shaken_down(3.0),
    "steady sliding": sliding_and_rest,
    "onset of vibrations": onset,
}


# -- the record ------------------------------------------------------------------------------------


def plain(value):
    """A value as JSON keeps it."""
    return json.loads(json.dumps(value, default=lambda v: v.tolist()))


def computed(name):
    """Return the numbers of a case."""
    return plain(CASES[name]())


def lists_in(value, path=()):
    """Lists of numbers in nested dictionaries, with where they are."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from lists_in(part, (*path, key))
    else:
        yield "/".join(path), np.atleast_1d(np.array(value, dtype=float))


def differences(found, kept):
    """Return messages about numbers that differ from the record."""
    if set(found) != set(kept):
        return [f"parts {sorted(found)}, in the record {sorted(kept)}"]
    words = []
    for part, tolerance in TOLERANCES.items():
        now, before = (dict(lists_in(v.get(part, {}))) for v in (found, kept))
        if set(now) != set(before):
            words.append(f"{part}: {sorted(set(now) ^ set(before))} only in one of them")
            continue
        least = _LEAST * max(
            (np.nanmax(np.abs(v), initial=0.0) for v in before.values()), default=0.0
        )
        for key, values in now.items():
            if values.shape != before[key].shape:
                words.append(f"{part} {key}: {values.size} numbers, were {before[key].size}")
                continue
            size = max(least, np.nanmax(np.abs(before[key]), initial=0.0))
            same = np.isclose(values, before[key], rtol=0, atol=tolerance * size, equal_nan=True)
            if not same.all():
                i = int(np.argmin(same))
                now_, before_ = values.flat[i], before[key].flat[i]
                words.append(f"{part} {key}[{i}]: {now_!r}, was {before_!r}")
    for part in ("exact", "counts"):
        now = found.get(part, {})
        before = kept.get(part, {})
        words += [
            f"{part} {key}: {now.get(key)!r}, was {before.get(key)!r}"
            for key in sorted({*now, *before})
            if now.get(key) != before.get(key) and not (key == "krylov" and _OTHER_PETSC)
        ]
    return words


def in_record(record, name, ranks):
    """A case of the record as it is on a number of ranks."""
    kept = dict(record[name])
    if "counts" in kept:
        kept["counts"] = kept["counts"][str(ranks)]
    return kept


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", help="cases, by default all")
    parser.add_argument("--write", action="store_true", help="write the record again")
    args = parser.parse_args()
    record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    ranks = str(COMM.size)
    for name in args.names or CASES:
        found = computed(name)
        known = record.get(name, {})
        if args.write:
            if "counts" in found:
                counts = known.get("counts", {}) | {ranks: found["counts"]}
                found["counts"] = dict(sorted(counts.items()))
                if known and COMM.size > 1:
                    known["counts"] = found["counts"]
            if COMM.size == 1 or not known:
                known = record[name] = found
            found = {**found, "counts": known.get("counts", {})}
            words = differences(found, {"counts": {}, **known})
        else:
            words = differences(found, in_record(record, name, COMM.size))
        if COMM.rank == 0:
            same = "written" if args.write else "the same"
            print(f"{name}: {'; '.join(words) or same}", flush=True)
    if args.write and COMM.rank == 0:
        lines = [f"{json.dumps(name)}: {json.dumps(kept)}" for name, kept in record.items()]
        RECORD.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
