"""The golden record: what the package computes, to the last digits.

Every case is a small problem of another kind. What it gives is kept in `data/golden.json`:
*evaluated* (H, J times a vector) is to be equal to 1e-12 of the largest number beside it, *solved*
(states, forces, branch points) to 1e-10, *exact* (statuses, words, kinds) as it is, and *counts*
(iterations, factorisations, assemblies) for the same number of ranks.

A change that is meant to change no number leaves the record as it is. One that changes numbers
writes it anew, on 1, 2 and 3 ranks, and says which and why::

    for n in 1 2 3; do
        docker/run env PYTHONPATH=.:demos mpirun -n $n python3 tests/golden.py --write
    done
"""

import argparse
import json
import tempfile
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI

import demo_regions
import numpy as np
import recorded_evolution
import recorded_path
import test_arc_length
import test_axisymmetric
import test_mortar
import test_motion
import test_pair
import test_rigid_body
import test_steady_sliding
from _triangle import element, linear_triangle
from blocks import block, box, facets
from demo_own_law import SlipWeakening

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    BilinearCohesive,
    ContactPair,
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
    Sphere,
    Tresca,
    materials,
)
from dolfinx_contact.algorithms import ALGORITHMS
from dolfinx_contact.analysis import (
    ReducedProblem,
    SteadySliding,
    count_solutions,
    critical_friction,
    event_curves,
    prove_solutions,
    renard_criterion,
    solution_regions,
    stability_at_rest,
)
from dolfinx_contact.analysis.two_parameters import contact_family
from dolfinx_contact.continuation import StepControl, explore, find_solutions, follow
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import (
    BranchRecord,
    EvolutionRecord,
    journal_of,
    read_journal,
)

COMM = MPI.COMM_WORLD
RECORD = Path(__file__).parent / "data" / "golden.json"
#: Largest difference, over the largest number of a list ...
TOLERANCES = {"evaluated": 1e-12, "solved": 1e-10}
#: ... or over this part of the largest number of a case, where a list is round-off.
_LEAST = 1e-4
TIGHT = {"snes_rtol": 1e-12}
#: Columns of tables that say what a step took.
COUNTS = ("newton_iterations", "corrections")
_WAVES = ((2.1, 3.7, 1.3), (5.9, 1.7, 4.1), (11.3, 7.9, 2.3), (3.1, 13.7, 8.3))


# -- numbers of vectors that depend neither on ranks nor on numbering ------------------------------


def wave(x, phase, dim):
    """Vectors at points (3, n) that no symmetry of a mesh keeps."""
    return np.array(
        [np.sin((17 + 3 * i) * x[0] + (5 + i) * x[1] + 3 * x[2] + phase + i) for i in range(dim)]
    )


def numbers_of(V, values):
    """Norm of owned values at the dofs of a space, and their products with waves."""
    block_size = V.dofmap.index_map_bs
    n = V.dofmap.index_map.size_local
    x = V.tabulate_dof_coordinates()[:n]
    values = values[: n * block_size].reshape(n, block_size)
    phases = np.arange(block_size)
    sums = [np.sum(values**2)]
    sums += [np.sum(values * np.cos((x @ k)[:, None] + phases)) for k in _WAVES]
    found = COMM.allreduce(np.array(sums))
    return [float(np.sqrt(found[0])), *found[1:].tolist()]


def vector(problem, x):
    """Numbers of a vector of unknowns, field by field."""
    found = {}
    parts = problem.equations.fields(x)
    for i, (f, values) in enumerate(zip(problem.fields, parts, strict=True)):
        found[f"field {i}"] = numbers_of(f.function_space, values)
    motions = problem.equations.motions(x)
    if len(motions):
        found["rigid bodies"] = motions.tolist()
    return found


def unknowns(problem, displacement, traction, phase=0.3):
    """A vector of unknowns with points of all statuses."""
    dim = problem.V.mesh.geometry.dim
    x = problem.create_vector()
    for f in problem.fields:
        size = displacement if f is problem.u else traction
        f.interpolate(lambda y, size=size: size * wave(y, phase, dim))
    problem.write(x)
    return x


def evaluated(problem, displacement=0.01, traction=10.0):
    """H and J times a vector, at a state that is no solution; the Functions stay."""
    with problem.restored(always=True):
        x = unknowns(problem, displacement, traction)
        d = unknowns(problem, displacement, traction, 2.9)
        b = problem.create_vector()
        product = problem.create_vector()
        state = problem.residual(x, b)
        jacobian = Jacobian(problem.equations)
        jacobian.update(state)
        jacobian.matrix.mult(d, product)
        return {"H": vector(problem, b), "J times a vector": vector(problem, product)}


def tables(result):
    """What contact tables say, point by point."""
    numbers = {}
    words = {}
    for name, t in result.tables.items():
        words[name] = t.status
        for key in ("x", "area", "un", "ut", "force", "pressure", "shear"):
            numbers[f"{name} {key}"] = np.asarray(getattr(t, key)).ravel().tolist()
    return numbers, words


def state(problem):
    """The unknowns in the Functions."""
    x = problem.create_vector()
    problem.write(x)
    return vector(problem, x)


def counts(result):
    """What a solve took."""
    steps = [s for attempt in result.attempts for s in attempt.steps]
    return {
        "strategies": [a.strategy for a in result.attempts],
        "newton": result.iterations,
        "krylov": int(sum(s.krylov or 0 for s in steps)),
        "evaluations": sum(a.evaluations for a in result.attempts),
    }


def static(problem, displacement=0.01, traction=10.0, **how):
    """A static problem: H, J, its solution and what that took."""
    found = {"evaluated": evaluated(problem, displacement, traction)}
    result = problem.solve(**how)
    numbers, words = tables(result)
    energies = {k: float(v) for k, v in result.energies.items()}
    found["solved"] = {"state": state(problem), "tables": numbers, "energies": energies}
    found["exact"] = {"statuses": words, "strategy": result.reason}
    assemblies = problem.equations.bulk.assemblies
    found["counts"] = counts(result) | {"assemblies": assemblies}
    return found


def branch(system, followed):
    """A branch: its points and what is special about them."""
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
            "end": followed.reason,
        },
        "counts": {
            "factorisations": followed.factorisations,
            "solves": followed.solves,
            "corrections": [p.corrections for p in points],
        },
    }


def state_vector(system, point):
    """The unknowns of a point of a branch."""
    x = system.create_vector()
    x.array[:] = point.y.array_r[: len(x.array)]
    return x


def in_names_of_the_record(row):
    """A row with the names of its keys when the record was made."""
    return {{"directions": "ways"}.get(key, key): value for key, value in row.items()}


def steps(history):
    """The rows of a history, a path or a motion."""
    numbers = {}
    words = {}
    number_of = {}
    for row in history.rows():
        for key, value in in_names_of_the_record(row).items():
            if isinstance(value, float):
                numbers.setdefault(key, []).append(value)
            elif key in COUNTS:
                number_of.setdefault(key, []).append(value)
            else:
                words.setdefault(key, []).append(value)
    words["end"] = [history.reason, history.complete]
    return {"solved": numbers, "exact": words, "counts": number_of}


@contextmanager
def new_folder():
    """The same new folder on every rank, which is removed in the end."""
    made = tempfile.TemporaryDirectory() if COMM.rank == 0 else None
    yield COMM.bcast(None if made is None else made.name)
    COMM.barrier()
    if made is not None:
        made.cleanup()


def with_journal(found, rows):
    """The same with the entries of a journal, as it is read."""
    found["solved"]["journal"] = [[v for v in r.values() if isinstance(v, float)] for r in rows]
    found["exact"]["journal"] = [
        {k: v for k, v in row.items() if not isinstance(v, float) and k not in COUNTS}
        for row in map(in_names_of_the_record, rows)
    ]
    return found


# -- static cases ----------------------------------------------------------------------------------


def oblique(dim):
    """A motion of the top under which points stick and slip."""
    return (0.008, *[0.003] * (dim - 2), -0.01)


def of_a_law(law, **given):
    """The block of 4 x 4 triangles with another law."""
    return lambda: static(block(law=law, top=oblique(2), options=TIGHT, **given))


def of_a_mesh(cell, n, **given):
    """The block of another discretisation."""
    dim = 2 if cell in ("tri", "quad") else 3
    return lambda: static(block(n=n, cell=cell, top=oblique(dim), options=TIGHT, **given))


def pressed_pair(dim, cell, method, degree=1, n=2):
    both = test_pair.stacked(dim, cell, n)
    u = test_pair.displacement(both.mesh, degree)
    pair = ContactPair(u, both, slave=2, master=3, law=Coulomb(0.2), method=method)
    bcs = [
        test_pair.held(u, both.facet_tags, 1, np.zeros(dim)),
        test_pair.held(u, both.facet_tags, 4, oblique(dim)),
    ]
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return static(ContactProblem(energy, u, [pair], bcs=bcs, petsc_options=TIGHT))


def mortar_in_space():
    cells = (2, 3, (0.0, 1.0), (0.0, 1.0))
    both = test_mortar.solids(*cells, "tet")
    u = test_pair.displacement(both.mesh)
    pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(0.2))
    motion = test_mortar.TILT @ np.array(oblique(3))
    bcs = [
        test_pair.held(u, both.facet_tags, 1, np.zeros(3)),
        test_pair.held(u, both.facet_tags, 4, motion),
    ]
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return static(ContactProblem(energy, u, [pair], bcs=bcs, petsc_options=TIGHT))


def punch():
    load = {"y": -3.0, "x": 0.4}
    body = test_rigid_body.punch(load=load, held=("rz",))
    return static(test_rigid_body.block(body, n=4, options=TIGHT))


def rolling_punch():
    body = RigidBody(
        Sphere((0.5, 0.5, 1.5), 0.5), about=(0.5, 0.5, 1.0), motion={"z": -0.02, "x": 0.002},
        held=("y", "rx", "ry", "rz"),
    )  # fmt: skip
    return static(test_rigid_body.block(body, dim=3, n=3, options=TIGHT))


def large_displacement():
    """A Neo-Hookean block that goes far over a curved floor."""
    floor = LevelSet(lambda x: x[1] + 0.1 * ufl.sin(4.0 * x[0]))
    given = dict(material=materials.NeoHookean(600.0, 400.0), obstacle=floor, law=Frictionless())
    return static(block(n=4, cell="quad", top=(0.05, -0.2), options=TIGHT, **given))


def multigrid():
    given = {"linear_solver": "amg", "snes_rtol": 1e-12, "amg_pc_gamg_coarse_eq_limit": 50}
    return static(block(n=5, cell="tet", top=oblique(3), options=given))


def by_algorithm(name):
    problem = block(n=4, top=oblique(2))
    return static(problem, algorithm=ALGORITHMS[name])


# -- histories, paths and motions ------------------------------------------------------------------


def bonded_block(law):
    """A block on bonds, pulled up and aside, and released."""
    domain = box(COMM, 3, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    bond = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=law)
    energy = LinearElastic.from_young(30.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [bond], bcs=[fem.dirichletbc(top, held)])

    def load(time):
        part = 0.1 * min(time, 2 - time)
        top.interpolate(lambda x: np.array([part + 0 * x[0], part * (x[0] - 0.3)]))

    evolution = QuasiStatic(problem, load)
    history = evolution.run([0.0, 1.0, 1.8], longest=0.25, progress=False)
    step = problem.with_memory(evolution.memory)
    return steps(history) | {"evaluated": evaluated(step, 0.05, 1.0)}


def cycle(case):
    """A history of `recorded_evolution`, with the journal of its record."""
    evolution = recorded_evolution.CASES[case](COMM)
    times = recorded_evolution.TIMES
    steps_of = {"longest": 0.5}
    if case == "motion":
        times = times[:2]
        steps_of = {}
    with new_folder() as folder:
        with EvolutionRecord(folder, evolution) as kept:
            history = evolution.run(times, record=kept, progress=False, **steps_of)
        return with_journal(steps(history), read_journal(folder).rows())


def path():
    """A path by arc length there and back, with its record."""
    with new_folder() as folder:
        recorded_path.record("bonds", folder, COMM)
        journal = read_journal(folder)
    found = {
        "solved": {"gammas": journal.gammas},
        "exact": {"folds": len(journal.folds), "kinks": len(journal.kinks)},
    }
    return with_journal(found, journal.rows())


def snapping_bar():
    """A bar that snaps back on a bond, by arc length."""
    system = test_arc_length.bar(0.5, 2, free=True)
    history = recorded_path.ArcLength(system).run(
        gamma_range=(0.0, 0.4),
        control=StepControl(maximum=0.05),
        stop=test_arc_length.broken_by_half,
    )
    return steps(history)


def block_in_motion():
    """A block that falls on a floor, with friction."""
    problem, _ = test_motion.block("tri", 2, weight=5.0, friction=0.3, height=0.01)
    motion = NSCD(problem, 1.0, dt=0.01, velocity=test_motion.at_speed(problem, 0.5, -1.0))
    return steps(motion.run([0.0, 0.1], progress=False))


# -- branches, all solutions, proofs ---------------------------------------------------------------


def triangle(n=4):
    return linear_triangle(n, 3.0)


def started(system, gamma):
    """The system at a solution for gamma, and the unknowns there."""
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


def dragged(law, **given):
    """A block whose top is pressed down and drawn aside by gamma."""
    domain = box(COMM, 4, given.pop("cell", "tri"))
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    gamma = fem.Constant(domain, 0.0)
    u = fem.Function(V)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=law, **given)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
    motion = ufl.as_vector((0.012 * gamma, -0.01))
    return ParametricContact(problem, gamma, driven=[(top, motion)])


def recorded_branch():
    """A branch with its record, as it is read again."""
    system = dragged(Coulomb(0.3), cell="quad")
    x = started(system, 0.0)
    with new_folder() as folder:
        with BranchRecord(folder, system) as kept:
            followed = follow(system, x, 0.0, gamma_range=(0.0, 1.0), record=kept)
        return with_journal(branch(system, followed), read_journal(folder).rows())


def all_branches():
    system = triangle()
    x = started(system, -1.0)
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0))
    points = [p for b in diagram.branches for p in b.points]
    return {
        "solved": {"gammas": sorted(p.gamma for p in points)},
        "exact": {
            "branches": len(diagram.branches),
            "complete": diagram.complete,
            "statuses": sorted(system.letters(p.piece) for b in diagram.branches for p in b.points),
        },
    }


def all_solutions():
    system = triangle(4)
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
            "method": found.method,
        },
    }


def certificate():
    rng = np.random.default_rng(3)
    S = rng.normal(size=(6, 6))
    S = S @ S.T + 0.3 * np.eye(6)
    proved = prove_solutions(ReducedProblem(S, rng.normal(size=6), np.array([3.0, 0.5, 1.0])))
    certificate = proved.certificate
    return {
        "solved": {
            "solutions": sorted(np.abs(s.state).sum() for s in proved.solutions),
        },
        "exact": {
            "verdict": proved.verdict,
            "solutions": len(proved.solutions),
            "leaves": len(certificate.steps),
        },
    }


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
    system, other = demo_regions.loaded(1, 3.0, (1.0, 1.0), 1.0)
    span = (-3.0, 3.0)
    curves, _ = demo_regions.curves_of(system, other, 3.0)
    family = contact_family(system, other, mu_range=span)
    found = solution_regions(family, curves, mu_range=span, gamma_range=span)
    return {
        "solved": {"crossings": np.asarray(curves.crossings).ravel().tolist()},
        "exact": {"counts": [r.count for r in found.cells], "proved": found.proved},
    }


def folds_with_friction():
    system = element((1.0, 1.0), 3.0, 1.0, (-2.0, 0.0), (0.0, -2.0))
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


def sliding_and_rest():
    sliding = SteadySliding(test_steady_sliding.pad(4), (-1.0, 0.0), density=1.0)
    modes = sliding.modes(0.3).eigenvalues
    modes = modes[np.argsort(modes.imag.round(9), kind="stable")]
    at_rest = stability_at_rest(block(n=3, options=TIGHT), density=1.0)
    return {
        "solved": {"real": modes.real.tolist(), "imaginary": modes.imag.tolist()},
        "exact": {"label": at_rest.label},
    }


def disc():
    domain = test_axisymmetric.section(4, "quad")
    return static(test_axisymmetric.disc(domain, law=Coulomb(0.1)))


CASES = {
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
    "pair": lambda: pressed_pair(2, "quad", "nodal", n=3),
    "pair, integral, P2": lambda: pressed_pair(2, "tri", "integral", 2),
    "pair in space": lambda: pressed_pair(3, "hex", "nodal"),
    "mortar in space": mortar_in_space,
    "punch": punch,
    "sphere that rolls": rolling_punch,
    "disc": disc,
    "large displacement": large_displacement,
    "multigrid": multigrid,
    "Uzawa": lambda: by_algorithm("uzawa"),
    "Lemke": lambda: by_algorithm("lemke"),
    "RCCM": lambda: bonded_block(RCCM(100.0, 100.0, 0.1, friction=0.3)),
    "MaxwellLayer": lambda: bonded_block(MaxwellLayer(50.0, 10.0, 2.0)),
    "BilinearCohesive": lambda: bonded_block(BilinearCohesive(4.0, 0.004, 0.06, 0.5)),
    "history": lambda: cycle("pair"),
    "history of a crack": lambda: cycle("crack"),
    "motion with a record": lambda: cycle("motion"),
    "motion": block_in_motion,
    "path with a record": path,
    "path that snaps back": snapping_bar,
    "branch by pivoting": lambda: branch_of(triangle()),
    "branch by steps": lambda: branch_of(dragged(Coulomb(0.3)), 0.0, (0.0, 1.0), route="steps"),
    "branch with a record": recorded_branch,
    "branch of a mortar": lambda: branch_of(test_mortar.sheared()[0], 0.0, (0.0, 1.0)),
    "branch of a law": lambda: branch_of(dragged(SlipWeakening(0.5, 0.2, 0.01)), 0.0, (0.0, 1.0)),
    "diagram": all_branches,
    "all solutions": all_solutions,
    "certificate": certificate,
    "chart": chart,
    "regions": regions,
    "folds": folds_with_friction,
    "critical friction": critical_coefficients,
    "steady sliding": sliding_and_rest,
}


# -- the record ------------------------------------------------------------------------------------


def plain(value):
    """A value as JSON keeps it."""
    return json.loads(json.dumps(value, default=lambda v: v.tolist()))


def computed(name):
    """What a case gives."""
    return plain(CASES[name]())


def lists_in(value, path=()):
    """Lists of numbers in nested dictionaries, with where they are."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from lists_in(part, (*path, key))
    else:
        yield "/".join(path), np.atleast_1d(np.array(value, dtype=float))


def differences(found, kept):
    """In words, where what is computed is not what the record has."""
    if set(found) != set(kept):
        return [f"parts {sorted(found)}, in the record {sorted(kept)}"]
    words = []
    for part, tolerance in TOLERANCES.items():
        now, before = (dict(lists_in(v.get(part, {}))) for v in (found, kept))
        if set(now) != set(before):
            words.append(f"{part}: {sorted(set(now) ^ set(before))} in one of them alone")
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
                words.append(f"{part} {key}[{i}]: {values[i]!r}, was {before[key][i]!r}")
    for part in ("exact", "counts"):
        now = found.get(part, {})
        before = kept.get(part, {})
        words += [
            f"{part} {key}: {now.get(key)!r}, was {before.get(key)!r}"
            for key in sorted({*now, *before})
            if now.get(key) != before.get(key)
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
    parser.add_argument("--write", action="store_true", help="write the record anew")
    args = parser.parse_args()
    record = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    for name in args.names or CASES:
        found = computed(name)
        if args.write:
            counts = found.get("counts")
            if counts is not None:
                counts = record.get(name, {}).get("counts", {}) | {str(COMM.size): counts}
                found["counts"] = dict(sorted(counts.items()))
            if COMM.size == 1 or name not in record:
                record[name] = found
            elif counts is not None:
                record[name]["counts"] = found["counts"]
            word = "written"
        else:
            words = differences(found, in_record(record, name, COMM.size))
            word = "; ".join(words) or "the same"
        if COMM.rank == 0:
            print(f"{name}: {word}", flush=True)
    if args.write and COMM.rank == 0:
        lines = [f"{json.dumps(name)}: {json.dumps(kept)}" for name, kept in record.items()]
        RECORD.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
