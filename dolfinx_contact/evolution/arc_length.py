# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Arc length with memory: an evolution whose load is unknown, as where a structure snaps back.

A state x_n under the load gamma_n has left a memory m_n (slip so far, intensity of bonds). The next
one is a point (x, gamma) of the curve

    H(x, gamma; m_n) = 0,        <(x - x_n, gamma - gamma_n), t_n> = h,

of given arc length h beyond it, t_n a solution of the rate problem at x_n. Once it is accepted it
makes a new memory m_n+1, and the next step begins there. So the path is that of a quasi-static
evolution whose load (or imposed displacement) rises and falls as it must for the state to change
slowly: friction acts against slip as it happens, and what is damaged stays damaged. The control is
that of Riks (Int. J. Solids Struct. 15, 1979), on the pieces of H.

Time has no meaning on such a path: laws must not depend on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np

from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.continuation.arguments import check_listeners, checked_range
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import AT_END, BranchPoint
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.evolution.arc_steps import ArcSteps, Arrival
from dolfinx_contact.evolution.energy import Energies, forces_at
from dolfinx_contact.evolution.moment import AtRest, Stepper, Taken
from dolfinx_contact.evolution.path import PathEvent, PathHistory, PathStep
from dolfinx_contact.evolution.rate_problem import Ways
from dolfinx_contact.evolution.said import SaidOfPath
from dolfinx_contact.parametric import ParametricContact

__all__ = ["ArcLength", "Direction"]

#: By which way a path leaves its state: that with more load or less, or, later, on or back.
Direction: TypeAlias = Literal["increasing", "decreasing", "onwards", "back"]

#: Told of every accepted point.
Observer: TypeAlias = Callable[[PathStep], object]
#: Asked at every accepted point; answers with the reason to end the path there, or "".
Stop: TypeAlias = Callable[[PathStep], str]

_LONGEST = 0.005  # of the range of gamma and the first tangent
_VIOLATION = 1e-6  # of the law, beyond which a point was come to in the wrong statuses
_NOWHERE = 1e-6  # mean length of steps that lead nowhere
_PATIENT = 10  # such steps, and two for each contact point, are allowed


class ArcLength:
    """The path of a contact problem with a memory under a load that is unknown.

    It begins with the state in the problem's Functions, a solution under the load at which the
    parameter stands, and with the memory that stands in the surfaces, as a `QuasiStatic` run leaves
    it; without one, points slip from where they are, and bonds have the intensity of their law.
    Functions, statuses, parameter and memory follow the accepted points.

    Args:
        parametric: the contact problem and its load or imposed displacement gamma.

    Raises:
        ValueError: on every rank, if that is none, or a law depends on the time or length of a
            step, or on the distance slipped.

    Example:
        ::

            path = ArcLength(ParametricContact(problem, lift, driven=[(top, as_vector((0, lift)))]))
            history = path.run((0.0, 1.0))
            print([(p.gamma, p.event) for p in history.folds], history.reason)
            back = path.run((0.0, 1.0), direction="back")
    """

    def __init__(self, parametric: ParametricContact):
        if not isinstance(parametric, ParametricContact):
            raise ValueError(f"a ParametricContact is needed, got {type(parametric).__name__}")
        self.parametric, self.problem = parametric, parametric.problem
        self._stepper = Stepper(self.problem, lambda _: None, None)
        self._require_no_time()
        self._moment: AtRest | None = None
        self._last: BranchPoint | None = None
        self._number, self._x_scale = 0, 0.0

    def _require_no_time(self) -> None:
        for s in self.problem.surfaces:
            s.update_geometry()
            fields = s.points.data.fields
            slow = [n for n in s.law.needs_time if np.any(fields[n] != 0)]
            require(
                self.problem.comm,
                not slow,
                f"{s.name}: the law {s.law.name} answers to the time or length of a step, by its "
                f"{' and '.join(slow)}; a path by arc length has none: use QuasiStatic",
            )
            slip = s.law_at_points.compiled.knows_slip
            require(
                self.problem.comm,
                not slip,
                f"{s.name}: friction of the law {s.law.name} depends on the distance slipped "
                "(a.slid), of which an evolution has no memory yet",
            )

    def run(
        self,
        gamma_range: tuple[float, float],
        *,
        direction: Direction | None = None,
        control: StepControl | None = None,
        max_steps: int = 1000,
        rays: bool = False,
        stop: Stop | None = None,
        observer: Observer | None = None,
        progress: bool | None = None,
    ) -> PathHistory:
        """Follow the path until the load leaves a range. Collective.

        Args:
            gamma_range: the path ends where the load reaches either end.
            direction: of the first run ``"increasing"``, the default, or ``"decreasing"``, the load
                at the start; of a later one ``"onwards"``, the default, or ``"back"``, by which the
                state unloads and nothing heals.
            control: step lengths, in units in which the first tangent and the range of gamma have
                size 1; by default up to 0.005. Longer ones may pass a fold of many bonds unseen.
            max_steps: budget.
            rays: whether all statuses that meet are tried at every kink and nonsmooth fold, up to
                256, so that `PathStep.ways` counts the solutions of the rate problem there; else
                they are where no way on is found otherwise.
            stop: asked at every accepted point, on every rank, whether the path ends there: with
                the reason, or "" to go on.
            observer: told of every accepted point while it stands in the problem.
            progress: whether rank 0 says on the standard error stream where it is; by default once
                it takes more than some seconds.

        Returns:
            The accepted points, and in words why the path ended. It never jumps: where no way leads
            on it ends, and `complete` is False.

        Raises:
            ValueError: on every rank, for arguments that do not fit, a law that depends on the
                time, or a start that is no solution; what ``stop`` or ``observer`` raises.
        """
        comm, gamma = self.problem.comm, float(self.parametric.constant.value)
        first = self._last is None
        with everywhere(comm, "a path by arc length"):
            limits = checked_range(gamma_range, [gamma])
            check_listeners(None, stop, control, max_steps)
            if observer is not None and not callable(observer):
                raise ValueError(f"observer must be a function of a point, got {observer!r}")
            control = control or StepControl(kinks="exact", initial=_LONGEST, maximum=_LONGEST)
            if control.kinks not in (None, "exact"):
                raise ValueError(f"a path with memory passes kinks exactly, not {control.kinks!r}")
            direction = direction or ("increasing" if first else "onwards")
            known = get_args(Direction)[:2] if first else get_args(Direction)[2:]
            if direction not in known:
                run = "the first run" if first else "a later run"
                raise ValueError(f"the direction of {run} must be one of {known}: {direction!r}")
        same_everywhere(
            comm, gamma_range=limits, direction=direction, control=control, max_steps=max_steps
        )
        same_everywhere(comm, stop_condition=stop is not None, rays=bool(rays))
        self._require_no_time()
        self.parametric.check_parameter(limits)
        if self._moment is None:
            self._moment = self._begin()
        found = limits, direction, control, max_steps, bool(rays)
        return self._follow(*found, stop, observer, progress)

    def _follow(
        self,
        limits: tuple[float, float],
        direction: Direction,
        control: StepControl,
        max_steps: int,
        rays: bool,
        stop: Stop | None,
        observer: Observer | None,
        progress: bool | None,
    ) -> PathHistory:
        """A run whose arguments fit. Collective."""
        gamma = float(self.parametric.constant.value)
        if self._moment is None:
            self._moment = self._begin()
        bordered = Bordered(self.parametric, gamma_scale=limits[1] - limits[0])
        bordered.x_scale = self._x_scale * bordered.gamma_scale**2
        steps = ArcSteps(Corrector(bordered, control))
        run = _Run(self.parametric, self._stepper, steps, self._moment, self._last, limits, rays)
        said = SaidOfPath(self.problem.comm, progress, limits)
        history = PathHistory(self._moment.time, self._moment.energies, gamma=gamma)
        try:
            run.put(self._moment, gamma)
            run.leave(direction)
            while not run.reason and len(history.steps) < max_steps:
                taken = run.step(self._number + 1)
                if taken is None:
                    break
                step, whole = taken
                history.steps.append(step)
                self._moment, self._last = run.moment, run.arrived
                self._number, gamma = step.number, step.gamma
                self._tell(whole, step, observer)
                run.put(run.moment, gamma)
                run.reason = run.reason or self._asked(stop, step) or self._stuck(history.steps)
                said.step(step)
            exhausted = f"the budget of {max_steps} steps is exhausted"
            history.reason = run.reason or exhausted
            history.complete = run.reason == AT_END
        finally:
            run.put(self._moment, gamma)
            self._x_scale = bordered.x_scale / bordered.gamma_scale**2
            for thing in (steps, steps.corrector, bordered):
                thing.destroy()
            said.end(history)
        return history

    def _begin(self) -> AtRest:
        """The state in the Functions as a moment. Collective."""
        eq = self.problem.equations
        self.parametric.set(float(self.parametric.constant.value))
        if all(m is None for m in eq.memory):
            moment = self._stepper.start(0.0)
            assert isinstance(moment, AtRest)
            return moment
        state = self.problem.state()
        forces = forces_at(eq, state)
        return self._stepper.moment(0.0, state.statuses, eq.memory, forces, Energies())

    def _tell(self, taken: Taken, step: PathStep, observer: Observer | None) -> None:
        comm = self.problem.comm
        if not comm.allreduce(int(observer is not None)):
            return
        self._stepper.show(taken)
        self.parametric.set(step.gamma)
        with everywhere(comm, "the observer"):
            if observer is not None:
                observer(step)

    def _stuck(self, steps: Sequence[PathStep]) -> str:
        """Why the path gets nowhere; "" if it does."""
        points = sum(s.points.number for s in self.problem.surfaces)
        number = 2 * self.problem.comm.allreduce(points) + _PATIENT
        last = steps[-number:]
        if len(last) < number or last[-1].time - last[0].start > number * _NOWHERE:
            return ""
        return (
            f"statuses change without end at gamma = {last[-1].gamma:.10g}, where no step of more "
            f"than {_NOWHERE:g} succeeds"
        )

    def _asked(self, stop: Stop | None, step: PathStep) -> str:
        if stop is None:
            return ""
        with everywhere(self.problem.comm, "stop"):
            answer = stop(step)
            if not isinstance(answer, str):
                raise ValueError(
                    "stop must answer with the reason to end the path, a str, or with '' to go on; "
                    f"it answered {answer!r}"
                )
        same_everywhere(self.problem.comm, the_answer_of_stop=answer)
        return answer


class _Run:
    """A run: where it is, and how it goes on."""

    def __init__(
        self,
        system: ParametricContact,
        stepper: Stepper,
        steps: ArcSteps,
        moment: AtRest,
        arrived: BranchPoint | None,
        limits: tuple[float, float],
        rays: bool,
    ):
        self._rays = rays
        self._system, self._stepper, self._steps, self._limits = system, stepper, steps, limits
        #: Accepted state; the point of the path there, as it was come to; why the run ends.
        self.moment, self.arrived, self.reason = moment, arrived, ""
        self._leaves: BranchPoint | None = None
        self._h = steps.control.initial

    def put(self, moment: AtRest, gamma: float) -> None:
        """Put an accepted state into the problem. Collective."""
        self._stepper.put(moment)
        self._system.set(gamma)

    def leave(self, direction: Direction) -> None:
        """Find the way by which the path leaves its state. Collective."""
        steps = self._steps
        if self.arrived is None:
            point = self._start(1.0 if direction == "increasing" else -1.0)
            ways = steps.rate_problem(point.y, point.piece).begun(point.piece, point.tangent)
        else:
            point = self.arrived
            rates = steps.rate_problem(point.y, point.piece)
            way_on = rates.back if direction == "back" else rates.onwards
            ways = way_on(point.piece, point.tangent)
        self._take(point, ways)

    def _start(self, sense: float) -> BranchPoint:
        """The point at the state of the start, with the rate of the load as its tangent."""
        b, problem, known = self._steps.bordered, self._stepper.problem, self.moment.statuses
        y, gamma = b.vector(), float(self._system.constant.value)
        x = problem.create_vector()
        problem.write(x)
        b.join(x, gamma, y)
        piece = self._system.piece_at(x, gamma) if known is None else self._system.piece(known)
        x.destroy()
        if not self._steps.corrector.natural(y, gamma, piece):
            raise ValueError(f"the start is no solution at gamma = {gamma:g}; solve() first")
        t = b.last_unit()
        t.scale(sense * b.gamma_scale)
        return BranchPoint(y, t, piece, b.gamma(y), 0.0, 0)

    def _take(self, point: BranchPoint, ways: Ways) -> None:
        self._leaves = None
        if ways.onwards is not None:
            self._leaves = self._steps.go_on(point, ways.onwards)
            return
        self.reason = (
            f"no way on was found from gamma = {point.gamma:.10g}, by {ways.method}: the evolution "
            "jumps there, or statuses change that were not found together"
        )

    def step(self, number: int) -> tuple[PathStep, Taken] | None:
        """The next accepted point; None, with a reason, where there is none. Collective."""
        assert self._leaves is not None
        system, weak = (
            self._system,
            any(s.points.E is not None for s in self._stepper.problem.surfaces),
        )
        while True:
            found = self._steps.arrive(self._leaves, self._h, self._limits)
            if found is None:
                self.reason = (
                    f"no step of at least {self._steps.control.minimum:g} succeeds beyond "
                    f"gamma = {self._leaves.gamma:.10g}"
                )
                return None
            before, point = self.moment, found.point
            result = system.result_at(point)
            if weak or result.kkt_violation <= _VIOLATION:
                break
            # Bonds were taken for damaging that are not, or the other way round, within the step.
            self._h = 0.5 * min(self._h, point.step)
        self._h = found.next_h
        eq, state = system.equations, self._stepper.problem.state()
        energies = before.energies.advanced(
            before.forces, forces := forces_at(eq, state), result.energies["friction"]
        )
        self.moment = self._stepper.moment(
            before.time + point.step, state.statuses, eq.advanced(state), forces, energies
        )
        self.arrived = point
        eq.remember(self.moment.memory)
        ways = Ways(None)
        event: PathEvent = ""
        if found.at == "end":
            self.reason = AT_END
        else:
            rates = self._steps.rate_problem(point.y, point.piece)
            ways = rates.onwards(point.piece, point.tangent, every=self._rays)
            self._take(point, ways)
            event = self._event(found)
        letters = system.letters(point.piece)
        after = letters if self._leaves is None else system.letters(self._leaves.piece)
        step = PathStep(
            number,
            before.time,
            self.moment.time,
            result,
            energies,
            gamma=point.gamma,
            event=event,
            before=letters,
            after=after,
            ways=1 + 2 * len(found.bifurcations) if found.bifurcations else ways.number,
            method="a bifurcation of one piece" if found.bifurcations else ways.method,
            corrections=point.corrections,
        )
        return step, Taken(before, self.moment, result)

    def _event(self, found: Arrival) -> PathEvent:
        """What happens at an accepted point."""
        if found.at == "fold":
            return "smooth fold"
        a, b = found.point, self._leaves
        if b is None:
            return "kink"
        comm = self._system.comm
        if not comm.allreduce(int(np.any(a.piece.codes != b.piece.codes))):
            return ""
        return "nonsmooth fold" if self._steps.turned(a.tangent, b.tangent) else "kink"
