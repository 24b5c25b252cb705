# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command line of a case: common options with their validation.

Words with one leading dash, such as ``-contact_snes_monitor``, are passed to PETSc.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, get_args

from mpi4py import MPI

from dolfinx import mesh

from dolfinx_contact._petsc import parse_arguments
from dolfinx_contact.continuation import Kinks, Route

__all__ = ["CELLS", "MOTION", "ScriptParser", "motion_of", "number"]

#: Kinds of cells by the word of an option.
CELLS = {
    "tri": mesh.CellType.triangle,
    "quad": mesh.CellType.quadrilateral,
    "tet": mesh.CellType.tetrahedron,
    "hex": mesh.CellType.hexahedron,
}
#: Defaults of `NSCD` as options of a case: ``ScriptParser(..., **MOTION)``.
MOTION: dict[str, Any] = {
    "scheme": "theta",
    "level": "position",
    "theta": 0.5,
    "mass": "redistributed",
    "restitution": 0.0,
}


def number(
    kind: Callable[[str], Any] = float,
    *,
    least: float | None = None,
    above: float | None = None,
    most: float | None = None,
    below: float | None = None,
) -> Callable[[str], Any]:
    """Return the ``type`` of an option that is a finite number.

    Args:
        kind: ``float`` or ``int``.
        least: smallest admissible value.
        above: lower bound, which is excluded.
        most: largest admissible value.
        below: upper bound, which is excluded.
    """

    def convert(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            what = "a whole number" if kind is int else "a number"
            raise argparse.ArgumentTypeError(f"must be {what}, got {text!r}") from None
        objections = [
            ("finite", not isfinite(value)),
            (f"at least {least}", least is not None and not value >= least),
            ("positive" if above == 0 else f"above {above}", above is not None and value <= above),
            (f"at most {most}", most is not None and not value <= most),
            (f"below {below}", below is not None and not value < below),
        ]
        for must_be, fails in objections:
            if fails:
                raise argparse.ArgumentTypeError(f"must be {must_be}, got {text}")
        return value

    return convert


#: Common options in the form of `argparse`.
_RECURRING: dict[str, dict[str, Any]] = {
    "dim": dict(type=int, choices=(2, 3), help="dimension of the body"),
    "n": dict(type=number(int, above=0), help="cells along an edge"),
    "nx": dict(type=number(int, above=0), help="cells from left to right"),
    "ny": dict(type=number(int, above=0), help="cells from below to above"),
    "size": dict(type=number(above=0), help="of cells"),
    "cell": dict(choices=CELLS, help="kind of cells (default: quad in 2D, hex in 3D)"),
    "degree": dict(type=int, choices=(1, 2), help="of the displacement"),
    "mesh": dict(help="a .msh file of gmsh with named physical groups"),
    "length": dict(type=number(above=0), help="by which coordinates are multiplied"),
    "young": dict(type=number(above=0), help="Young's modulus"),
    "poisson": dict(type=number(above=-1, below=0.5), help="Poisson's ratio"),
    "lame": dict(type=number(), nargs=2, metavar=("LAMBDA", "MU"), help="Lame's coefficients"),
    "friction": dict(type=number(least=0), help="friction coefficient"),
    "load": dict(type=number(), nargs=2, metavar=("F1", "F2"), help="traction"),
    "press": dict(type=number(), help="downward displacement of the top"),
    "shift": dict(type=number(), help="sideways displacement of it"),
    "route": dict(choices=get_args(Route), help="how branches are followed"),
    "kinks": dict(choices=get_args(Kinks), help="how kinks are passed, see StepControl"),
    "max_steps": dict(type=number(int, above=0), help="along a branch"),
    "solutions_at": dict(
        type=number(least=0, most=1), metavar="GAMMA", help="list the solutions at this gamma"
    ),
    "scheme": dict(choices=("theta", "theta-euler", "modified-theta"), help="of steps"),
    "level": dict(choices=("position", "velocity"), help="of the law"),
    "theta": dict(type=number(least=0, most=1), help="weight of a step's end"),
    "mass": dict(choices=("redistributed", "lumped", "consistent"), help="matrix"),
    "restitution": dict(type=number(least=0, most=1), help="at the velocity level"),
}


class ScriptParser(argparse.ArgumentParser):
    """Parser of the options of a script; only rank 0 prints.

    Args:
        description: description of the script.
        output: default of ``--output``.
        defaults: defaults of common options by name: ``n=8, friction=0.3`` adds ``--n`` and
            ``--friction``. `add_argument` with `number` as the type adds others.

    Example:
        ::

            parser = ScriptParser("A block on a plane", output="output/block", n=8, friction=0.3)
            parser.add_argument("--tilt", type=number(least=0), default=0.0, help="of the plane")
            args = parser.parse()
    """

    def __init__(self, description: str, *, output: str, **defaults: Any):
        super().__init__(description=description)
        for name, default in defaults.items():
            self.add_argument(f"--{name.replace('_', '-')}", default=default, **_RECURRING[name])
        self.add_argument("--output", default=output, help="folder of the results")

    def add_argument(self, *names: Any, **option: Any) -> argparse.Action:
        """Add an option as in `argparse`; the help shows the default."""
        if option.get("default") not in (None, argparse.SUPPRESS):
            option["help"] = f"{option.get('help', '')} (default: %(default)s)".strip()
        return super().add_argument(*names, **option)

    def parse(self, argv: Sequence[str] | None = None) -> argparse.Namespace:
        """Return the validated options; options with one dash are passed to PETSc.

        Args:
            argv: words; by default the command line.

        Raises:
            SystemExit: if an option is invalid, with a message on rank 0.
        """
        args = parse_arguments(self, argv)
        if getattr(args, "lame", None) is not None:
            lmbda, mu = args.lame
            if mu <= 0 or lmbda + mu <= 0:
                self.error("--lame needs mu > 0 and lambda + mu > 0, a stable material")
        if hasattr(args, "dim") and hasattr(args, "cell"):
            args.cell = args.cell or ("quad" if args.dim == 2 else "hex")
            if (args.dim == 2) != (args.cell in ("tri", "quad")):
                self.error(f"--cell {args.cell} does not fit --dim {args.dim}")
        return args

    def _print_message(self, message: str, file: Any = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


def motion_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `MOTION` for `NSCD`."""
    return {name: getattr(args, name) for name in MOTION}
