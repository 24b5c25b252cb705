"""Arguments that histories, motions, paths and branches refuse: one table for each function."""

import math

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets
from support.bonds import C, W, bar
from support.histories import cycle, dragged
from support.histories import falling_block as block
from support.textbook import one_node, pitchfork, smooth, start

import ufl

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NormalCompliance,
    Regularised,
    io,
)
from dolfinx_contact.continuation import (
    Ending,
    Follower,
    StepControl,
    explore,
    follow,
)
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
ENDS = (0.0, 8 * np.sqrt(W / C))


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("law", "message"),
    [
        (
            RCCM(C, C, W, viscosity=0.1),
            "RCCM answers to the time or length of a step, by its vis",
        ),
        (Regularised(Coulomb(0.3), 0.1), "length of a step, by its width; a path"),
        (
            NormalCompliance(1e3, friction=Regularised(Coulomb(0.3), 0.1)),
            "length of a step, by its friction.width; a path",
        ),
    ],
)
def test_arc_length_refuses_laws_that_depend_on_the_step(law, message):
    with pytest.raises(ValueError, match=message):
        ArcLength(bar(1.0, 1, law=law, comm=MPI.COMM_SELF))


def test_arc_length_takes_normal_compliance():
    ArcLength(bar(1.0, 1, law=NormalCompliance(1e3, friction=Coulomb(0.3)), comm=MPI.COMM_SELF))


def test_arc_length_refuses_a_number_for_the_system():
    with pytest.raises(ValueError, match="parametric must be a ParametricContact, got int"):
        ArcLength(3)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gamma_range": (0.1, 0.2)}, "must lie in the range"),
        ({"gamma_range": (0.0, np.nan)}, "finite number"),
        ({"direction": "back"}, "the direction of the first run must be one of"),
        ({"control": StepControl(kinks="batched")}, "requires kinks='exact', got 'batched'"),
        ({"max_steps": 0}, "max_steps must be a whole number"),
        ({"rays": "all"}, "rays must be one of True, False, None; got 'all'"),
        ({"stop": 3}, "stop must be a function"),
        ({"observer": 3}, "or a function of a step; got 3"),
    ],
)
def test_arc_length_run_refuses_arguments(arguments, message):
    system = bar(1.0, 1)
    before = system.problem.u.x.array.copy()
    with pytest.raises(ValueError, match=message):
        ArcLength(system).run(**({"gamma_range": ENDS} | arguments))
    np.testing.assert_array_equal(system.problem.u.x.array, before)


@pytest.mark.ranks(2)
def test_arc_length_run_refuses_answers_directions_and_laws_on_the_way():
    system = bar(1.0, 1)
    path = ArcLength(system)
    with pytest.raises(ValueError, match="stop must return the reason"):
        path.run(gamma_range=ENDS, stop=lambda s: None)
    with pytest.raises(ValueError, match="the direction of a later run must be one of"):
        path.run(gamma_range=ENDS, direction="decreasing")
    system.problem.surfaces[0].law.viscosity.value = 1.0
    with pytest.raises(ValueError, match="answers to the time or length of a step"):
        path.run(gamma_range=ENDS)


@pytest.fixture(scope="module")
def history():
    problem, top = dragged(n=2)
    return QuasiStatic(problem, cycle(top))


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "times", [[0.0], [0.0, math.nan], [0.0, 1.0, 1.0], [0.0, 1.0, 0.5], ["a", "b"], None]
)
def test_history_refuses_times(history, times):
    with pytest.raises(ValueError, match=r"times|convert"):
        history.run(times)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("keyword", "value"),
    [
        ("longest", 1.0 + COMM.rank if COMM.size > 1 else math.nan),
        ("longest", 0.0),
        ("longest", math.nan),
        ("longest", "a"),
        ("shortest", 0.0),
        ("shortest", math.nan),
        ("shortest", "a"),
        ("observer", "x"),
        ("at_jump", "ignore"),
        ("at_jump", "jump"),
        ("rays", "all"),
        ("extrapolate", True),
    ],
)
def test_history_refuses_options(history, keyword, value):
    with pytest.raises(ValueError, match=keyword):
        history.run([0.0, 1.0], **{keyword: value})


@pytest.mark.ranks(2)
@pytest.mark.parametrize("every", [0, 1.5, True, "2", *([1 + COMM.rank] if COMM.size > 1 else [])])
def test_evolution_series_refuses_intervals(history, every):
    with pytest.raises(ValueError, match="every"):
        io.EvolutionSeries("unwritten", history.problem, every=every)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("problem", "load", "message"),
    [
        (lambda: None, lambda _: None, "problem must be a ContactProblem"),
        (lambda: dragged(n=2)[0], 1.0, "a function of the time"),
    ],
)
def test_history_refuses_problems_and_loads(problem, load, message):
    with pytest.raises(ValueError, match=message):
        QuasiStatic(problem(), load)


@pytest.mark.ranks(2)
def test_history_goes_on_from_its_last_time_only():
    problem, top = dragged(n=2)
    evolution = QuasiStatic(problem, cycle(top))
    history = evolution.run([0.0, 1.0])
    with pytest.raises(ValueError, match=r"the evolution is at the time 1\.0"):
        evolution.run([0.0, 2.0])
    assert evolution.run([1.0, 1.5]).complete
    assert history.at(1.0).number == 1


@pytest.mark.ranks(2)
def test_problems_refuse_memory_and_statuses_of_other_meshes():
    problem, top = dragged(n=2)
    evolution = QuasiStatic(problem, cycle(top))
    evolution.run([0.0, 1.0])
    other, _ = dragged(n=3)
    for memory in (evolution.memory, []):
        with pytest.raises(ValueError, match="another law, sliding or mesh"):
            other.with_memory(memory)
    with pytest.raises(ValueError, match="expected statuses"):
        other.solve(expected=[problem.statuses])


NSCD_ARGUMENTS = [
    ({"density": 0.0}, "density must be positive"),
    ({"density": -1.0}, "density must be positive"),
    ({"density": np.nan}, "density must be positive"),
    ({"density": "negative in a half"}, "density must be positive everywhere"),
    ({"dt": 0.0}, "dt must be a positive time"),
    ({"dt": -1.0}, "dt must be a positive time"),
    ({"dt": np.nan}, "dt must be a positive time"),
    ({"theta": 0.49}, "theta must be between 0.5 and 1"),
    ({"theta": 1.01}, "theta must be between 0.5 and 1"),
    ({"theta": np.nan}, "theta must be between 0.5 and 1"),
    ({"restitution": 1.1, "level": "velocity"}, "restitution must be between 0 and 1"),
    ({"restitution": -0.1, "level": "velocity"}, "restitution must be between 0 and 1"),
    ({"restitution": 0.5}, "level='velocity'"),
    ({"level": "velocity", "mass": "redistributed"}, "a node needs mass"),
    (
        {"scheme": "newmark"},
        "scheme must be one of theta, theta-euler, modified-theta; got 'newmark'",
    ),
    ({"level": "speed"}, "level must be one of position, velocity; got 'speed'"),
    ({"mass": "none"}, "mass must be one of consistent, lumped, redistributed; got 'none'"),
    ({"damping": (-1.0, 0.0)}, "numbers that are not negative"),
    ({"damping": 1.0}, "a form or a pair"),
]


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("arguments", "message"), NSCD_ARGUMENTS)
def test_nscd_refuses_arguments(arguments, message):
    problem, _ = block("tri", 2)
    if arguments.get("density") == "negative in a half":
        arguments = {"density": ufl.SpatialCoordinate(problem.V.mesh)[0] - 0.5}
    with pytest.raises(ValueError, match=message) as info:
        NSCD(problem, **({"density": 1.0, "dt": 0.1, "mass": "lumped"} | arguments))
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"max_time": 0.0}, "max_time must be a positive time"),
        ({"rest": 1.0}, "rest must be between 0 and 1"),
        ({"observer": 3}, "observer must be"),
        ({"progress": 3}, "progress must be"),
    ],
)
def test_settle_refuses_arguments(arguments, message):
    problem, _ = block("tri", 2)
    motion = NSCD(problem, 1.0, dt=0.1)
    with pytest.raises(ValueError, match=message):
        motion.settle(**({"max_time": 1.0} | arguments))


def test_steps_below_the_round_off_of_the_time_are_refused():
    problem, _ = block("tri", 2)
    motion = NSCD(problem, 1.0, dt=1e-17)
    for run in (lambda: motion.settle(1.0), lambda: motion.run([0.0, 1.0])):
        with pytest.raises(ValueError, match="below the round-off of the times up to 1: take long"):
            run()


@pytest.mark.ranks(2)
def test_velocity_level_refuses_laws():
    problem, _ = block("tri", 2)
    u = problem.u
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    below = facets(problem.V.mesh, 1, 0.0)
    glued = ContactSurface(u, below, obstacle=floor, law=RCCM(10.0, 10.0, 1.0))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    with pytest.raises(ValueError, match="adhesion is about positions"):
        NSCD(ContactProblem(energy, u, [glued]), 1.0, dt=0.1, level="velocity", mass="lumped")


def without_load():
    return one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (0.0, 0.0))


def without_solution():
    return smooth(
        1, lambda x, g: x**2 + 1 + g**2, lambda x, g: [[2 * x[0]]], lambda x, g: [2 * g + 1e-3]
    )


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (without_load, [0, 0, 0, 1.0], "gamma does not appear in H"),
        (without_solution, [1.0], "no solution near"),
    ],
)
def test_follow_refuses_systems(make, values, message):
    system = make()
    with pytest.raises(ValueError, match=message):
        follow(system, start(system, values), 0.0, gamma_range=(-1.0, 5.0))


@pytest.mark.parametrize(
    ("keyword", "value"),
    [
        ("initial", 1.0),
        ("minimum", 0.0),
        ("increase", 0.5),
        ("decrease", 2.0),
        ("cosine", 1.0),
        ("tolerance", 0.0),
        ("kinks", "somehow"),
    ],
)
def test_step_control_refuses_values(keyword, value):
    with pytest.raises(ValueError, match=keyword):
        StepControl(**{keyword: value})


def test_follower_refuses_a_search_without_exact_kinks():
    with pytest.raises(ValueError, match="nothing to locate"):
        Follower(without_load(), StepControl(), gamma_scale=1.0, locate=lambda change: True)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("gamma", "arguments", "message"),
    [
        (3.0, {}, "must lie in the range"),
        (0.5, {"route": "pivoting"}, "not affine"),
    ],
)
def test_explore_refuses_arguments(gamma, arguments, message):
    system = pitchfork()
    with pytest.raises(ValueError, match=message):
        explore(system, [(start(system, [0.0]), gamma)], gamma_range=(-1.0, 1.0), **arguments)


@pytest.mark.ranks(2)
def test_explore_names_an_exhausted_budget():
    system = pitchfork()
    starts = [(start(system, [0.0]), -1.0)]
    diagram = explore(system, starts, gamma_range=(-1.0, 1.0), max_branches=2)
    assert diagram.reason == "the budget of 2 branches is exhausted"
    assert diagram.ending is Ending.BUDGET
    assert not diagram.complete
    assert len(diagram.edges) == 2
