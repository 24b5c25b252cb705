# SPDX-License-Identifier: LGPL-3.0-or-later
"""Examples of CONTACT: two elastic half-spaces in square or strip-like elements.

The compliance of constant tractions on rectangular elements (Boussinesq, Cerruti) makes a
`PointProblem`, which the package's semismooth Newton method solves. Discretisation and data are
those of the examples of CONTACT (open-source version, revision 2707), except for the elements of
`bentall`, which are twice as long. Results agree to the digits that CONTACT prints, up to its
tolerances and, in rolling, up to its step of distance:

- `cattaneo`: two polyethylene spheres, pressed and then sheared by 7/8 of the largest friction
  force;
- `carter2d`: cylinders of equal material roll with a creepage of -0.024 %;
- `bentall`: an aluminium cylinder rolls on a steel one with given tractive forces and friction
  coefficients.

Rolling is a sequence of steps, in each of which the surfaces move by one element. Friction
opposes the slip since the last step, as in `problem.step_from`.

    python3 benchmarks/public/half_space.py --output half_space.json
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.optimize

from dolfinx_contact.algorithms import GaussSeidel, Lemke, PointProblem, SemismoothNewton


@dataclass
class HalfSpaces:
    """Two half-spaces and a grid of elements in their common surface.

    Args:
        shear: shear moduli of the upper and the lower body.
        poisson: Poisson's ratios.
        number: number of elements along x and y.
        width: edges of an element along x and y.
        curvature: coefficients of the undeformed distance b1 x^2 + b3 y^2.
        friction: friction coefficient.
    """

    shear: tuple[float, float]
    poisson: tuple[float, float]
    number: tuple[int, int]
    width: tuple[float, float]
    curvature: tuple[float, float]
    friction: float

    def __post_init__(self):
        grid = zip(self.number, self.width, strict=True)
        x, y = ((np.arange(n) - (n - 1) / 2) * d for n, d in grid)
        self.x, self.y = (v.reshape(-1) for v in np.meshgrid(x, y, indexing="ij"))
        self.dim = 3 if self.number[1] > 1 else 2
        self.distance = self.curvature[0] * self.x**2 + self.curvature[1] * self.y**2
        self.W = self._compliance()
        self.S = np.linalg.inv(self.W)

    def _compliance(self):
        """Relative displacements (tangents, then the gap) under unit forces on the elements."""
        G = np.array(self.shear)
        nu = np.array(self.poisson)
        direct = ((1 - nu) / (2 * np.pi * G)).sum()
        shear = (nu / (2 * np.pi * G)).sum()
        coupling = np.diff((1 - 2 * nu) / (4 * np.pi * G))[0]
        dx = self.x[:, None] - self.x[None, :]
        dy = self.y[:, None] - self.y[None, :]
        along = {
            "xx": self._integral(dx, dy, lambda x, y, r: y * np.log(x + r)),
            "yy": self._integral(dx, dy, lambda x, y, r: x * np.log(y + r)),
            "xy": self._integral(dx, dy, lambda x, y, r: -r),
            "x": self._integral(dx, dy, lambda x, y, r: y * np.log(r) + x * np.arctan(y / x)),
            "y": self._integral(dx, dy, lambda x, y, r: x * np.log(r) + y * np.arctan(x / y)),
        }
        # The integral of 1 / r is the sum of those of x^2 / r^3 and y^2 / r^3.
        nn = direct * (along["xx"] + along["yy"])
        tx = nn + shear * along["xx"]
        ty = nn + shear * along["yy"]
        txy = shear * along["xy"]
        xn = coupling * along["x"]
        yn = coupling * along["y"]
        m = len(self.x)
        if self.dim == 2:
            blocks = [[tx, xn], [-xn, nn]]
        else:
            blocks = [[tx, txy, xn], [txy, ty, yn], [-xn, -yn, nn]]
        W = np.array(blocks).transpose(2, 0, 3, 1).reshape(self.dim * m, self.dim * m)
        return 0.5 * (W + W.T)

    def _integral(self, x, y, primitive):
        """Mean over an element of a kernel with the given primitive in x and y."""
        a, b = self.width
        total = 0.0
        for sx in (1, -1):
            for sy in (1, -1):
                cx = x + sx * a / 2
                cy = y + sy * b / 2
                total = total + sx * sy * primitive(cx, cy, np.hypot(cx, cy))
        return total / (a * b)

    def solve(self, approach, shift, previous, start=None):
        """Forces on the upper body and relative displacements by deformation, both (m, dim).

        Args:
            approach: approach of the bodies.
            shift: rigid tangential displacement of the step, shape (dim - 1,).
            previous: displacements by deformation before the step, shape (m, dim - 1).
            start: forces to start from, shape (m, dim).
        """
        m = len(self.x)
        free = np.column_stack([np.tile(shift, (m, 1)) - previous, self.distance - approach])
        problem = PointProblem(self.S, self.S @ free.reshape(-1), np.full(m, self.friction))
        outcome = SemismoothNewton(max_iterations=100).run(problem, start=start)
        if not outcome.converged:
            # Full steps may cycle. Lemke's method ends in a solution in 2D.
            other = Lemke() if self.dim == 2 else GaussSeidel(max_iterations=20000)
            outcome = other.run(problem, start=start)
        if not outcome.converged:
            raise RuntimeError(outcome.reason)
        return outcome.r, (self.W @ outcome.r.reshape(-1)).reshape(m, self.dim)


def root(function, start, increments, tolerance=1e-10, most=30):
    """Solve equations by Broyden's method with a first Jacobian by differences."""
    x = np.array(start, float)
    f = function(x)
    columns = []
    for k, increment in enumerate(increments):
        moved = x.copy()
        moved[k] += increment
        columns.append((function(moved) - f) / increment)
    J = np.array(columns).T
    for _ in range(most):
        if np.abs(f).max() <= tolerance:
            return x
        step = -np.linalg.solve(J, f)
        x = x + step
        new = function(x)
        J = J + np.outer(new - f - J @ step, step) / (step @ step)
        f = new
    raise RuntimeError(f"no root: {np.abs(f).max():.1e}")


def pressed(bodies, force, approach):
    """Approach under a normal force without shear, and the forces on the elements."""
    m = len(bodies.x)
    none = np.zeros((m, bodies.dim - 1))
    shift = np.zeros(bodies.dim - 1)

    def excess(x):
        r, _ = bodies.solve(x[0], shift, none)
        return np.array([r[:, -1].sum() / force - 1])

    return root(excess, [approach], [1e-3 * approach])[0]


def cattaneo():
    bodies = HalfSpaces((200.0, 200.0), (0.42, 0.42), (19, 19), (0.13333,) * 2, (0.01, 0.01), 0.4)
    force = 9.1954
    approach = pressed(bodies, force, 0.02)
    m = len(bodies.x)
    none = np.zeros((m, 2))
    r, _ = bodies.solve(approach, np.zeros(2), none)
    area = np.prod(bodies.width)

    def excess(x):
        forces, _ = bodies.solve(approach, [x[0], 0.0], none, r)
        return np.array([forces[:, 0].sum() / (bodies.friction * force) + 0.875])

    shift = root(excess, [0.008], [1e-5])[0]
    return {
        "pressure": (r[:, -1].max() / area, 4.393),
        "approach": (approach, 1.998e-2),
        "shift": (shift, 8.155e-3),
    }


def rolled(bodies, direction, force, traction, steps, approach):
    """Creepage and approach of steady rolling along x under a normal and a tractive force.

    Args:
        bodies: half-spaces.
        direction: direction of rolling, 1 or -1.
        force: normal force.
        traction: tractive force on the upper body over the largest friction force.
        steps: number of elements to roll over.
        approach: approach to begin with.
    """
    dx = bodies.width[0]
    edge = -1 if direction > 0 else 0
    u = np.zeros((len(bodies.x), bodies.dim))
    r = None
    shift = 0.0
    for _ in range(steps):
        before = np.roll(u[:, :1], -direction, axis=0)
        # Upstream of the grid the displacement is extrapolated.
        before[edge] = 2 * u[edge, :1] - u[edge - direction, :1]

        def excess(shift, approach=approach, before=before, start=r):
            forces, _ = bodies.solve(approach, [shift], before, start)
            return forces[:, 0].sum() / (bodies.friction * force) - traction

        reach = 1e-4 * dx
        while excess(shift - reach) * excess(shift + reach) > 0:
            reach *= 4
        shift = scipy.optimize.brentq(excess, shift - reach, shift + reach, xtol=1e-8 * dx)
        r, u = bodies.solve(approach, [shift], before, r)
        # In the steady state the normal force is the given one.
        approach *= 1 - 0.8 * (r[:, -1].sum() / force - 1)
    return shift / dx, approach


def carter():
    bodies = HalfSpaces((82e3, 82e3), (0.28, 0.28), (55, 1), (0.04, 200.0), (0.001, 0.0), 0.3)
    creepage, approach = rolled(bodies, 1, 35780.0, 0.6480, 120, 6.5e-3)
    return {"creepage": (creepage, -2.4e-4), "approach": (approach, 6.492e-3)}


def bentall(friction, traction, expected):
    """Cylinders of different materials, with elements twice as long as those of CONTACT."""
    element = (0.002, 1000.0)
    bodies = HalfSpaces((23e3, 82e3), (0.31, 0.28), (108, 1), element, (0.02, 0.0), friction)
    creepage, approach = rolled(bodies, -1, 16201.9, traction, 220, 2.08e-3)
    return {"creepage": (creepage, expected), "approach": (approach, 2.08e-3)}


CASES = {
    "cattaneo": cattaneo,
    "carter2d": carter,
    "bentall, full slip": lambda: bentall(1e-4, 0.0, 5.260e-4),
    "bentall, full stick": lambda: bentall(1.0, 0.0, 3.591e-4),
    "bentall, F = 0.05": lambda: bentall(0.05, 0.0, 4.294e-4),
    "bentall, driven": lambda: bentall(0.05, 0.75, 2.108e-4),
    "bentall, braked": lambda: bentall(0.05, -0.75, 5.392e-4),
}


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--output", type=Path)
    args = parser.parse_args(argv)
    records = {}
    for name in args.only:
        found = CASES[name]()
        records[name] = {
            key: {"ours": ours, "CONTACT": theirs, "difference": ours / theirs - 1}
            for key, (ours, theirs) in found.items()
        }
        for key, (ours, theirs) in found.items():
            difference = ours / theirs - 1
            print(f"{name}: {key} {ours:.6g}, CONTACT {theirs:.6g} ({difference:+.2%})", flush=True)
    if args.output:
        args.output.write_text(json.dumps(records, indent=1))
    return records


if __name__ == "__main__":
    main()
