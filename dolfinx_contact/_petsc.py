# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc: options of problems, events and stages of ``-log_view``, errors, matrices.

Options in PETSc's database (the command line, PETSC_OPTIONS) take precedence over those of a
problem. Options that this package reads itself are validated, as are options of SNES that would
replace the tests and matrices of this package. All others are PETSc's: it reports wrong values, and
``-options_left`` lists names on the command line that nothing has read.
"""

from __future__ import annotations

import argparse
import ctypes
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from itertools import pairwise
from typing import Any

from petsc4py import PETSc

from dolfinx_contact._validate import one_of, positive

__all__ = [
    "ProblemOptions",
    "as_raised",
    "check_options",
    "forget_product",
    "half_of",
    "has_package",
    "in_database",
    "logged",
    "options_in_database",
    "parse_arguments",
    "require_real",
    "staged",
]

#: PETSc's codes for what it does not support, does not know, or was built without, and for numbers
#: out of their range or that do not go together.
_NO_SUCH_THING = (56, 62, 63, 83, 86, 92)
#: Names that are read by this package; a name that is nearly one of them is refused.
_OWN = ("linear_solver", "snes_rtol", "surface_condensed")
_NEARLY = 0.88
#: Kinds of SNES that solve contact problems (tried); with multigrid only the first.
_SNES_TYPES = ("newtonls", "newtontr", "newtontrdc", "vinewtonssls")
#: Options that cannot be used here, by name, with the reason.
_NOT_HERE = {
    "snes_(mf|mf_operator|fd|fd_color)": "the linear solvers need the assembled Jacobian",
    "snes_convergence_test": "no other test of PETSc's can take its place; snes_rtol is the "
    "tolerance",
    "snes_(atol|stol)": "only snes_rtol decides on convergence",
}


def parse_arguments(
    parser: argparse.ArgumentParser, argv: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse a script's command line, leaving PETSc's options to PETSc.

    Words that the parser does not know and that begin with one dash, such as
    ``-contact_snes_monitor``, go to PETSc's database with their values; others are an error. With
    ``-log_view`` logging begins here, since PETSc has been initialised without these words.

    Args:
        parser: knows the options of the script.
        argv: words, by default those of the command line.
    """
    args, rest = parser.parse_known_args(argv)
    if rest and (rest[0][0] != "-" or any(word.startswith("--") for word in rest)):
        parser.error(f"unknown options: {' '.join(rest)}")
    database = PETSc.Options()
    for word, value in pairwise([*rest, "-"]):
        if word.startswith("-"):
            database.setValue(word[1:], "" if value.startswith("-") else value)
    if database.hasName("log_view") and not PETSc.Log.isActive():
        PETSc.Log.begin()
    return args


@contextmanager
def options_in_database(prefix: str, options: Mapping[str, Any]) -> Iterator[None]:
    """Keep ``options`` in PETSc's database under ``prefix`` while the context lasts.

    What is in the database already (the command line, PETSC_OPTIONS) wins.
    """
    database = PETSc.Options()
    mine = {prefix + k: v for k, v in options.items() if not database.hasName(prefix + k)}
    for key, value in mine.items():
        database.setValue(key, "" if value is None else value)
    try:
        yield
    finally:
        for key in mine:
            database.delValue(key)


def in_database(prefix: str) -> dict[str, str]:
    """Return the options of the database under a prefix, without it; none for an empty prefix."""
    if not prefix:
        return {}
    everything = PETSc.Options().getAll()
    return {k[len(prefix) :]: v for k, v in everything.items() if k.startswith(prefix)}


def check_options(prefix: str, options: Mapping[str, Any]) -> None:
    """Validate options of a problem and those of the database under its prefix. Not collective.

    Raises:
        ValueError: for a prefix with a dash, names with a dash or the prefix, misspelt names of
            this package, a tolerance that is not positive, and options that cannot be used here.
    """
    if not isinstance(prefix, str) or prefix.startswith("-") or any(c.isspace() for c in prefix):
        raise ValueError(f"the prefix of PETSc options must be a word without dash, got {prefix!r}")
    if not isinstance(options, Mapping):
        raise ValueError(f"petsc_options must be a dictionary, got {type(options).__name__}")
    for key in options:
        if not isinstance(key, str) or not key:
            raise ValueError(f"the names in petsc_options must be words, got {key!r}")
        if key.startswith("-") or (prefix and key.startswith(prefix)):
            short = key.lstrip("-").removeprefix(prefix)
            raise ValueError(
                f"petsc_options: {key!r} must be given without dash and prefix, as {short!r}"
            )
    named = {f"petsc_options: {key}": (key, value) for key, value in options.items()}
    named |= {f"-{prefix}{key}": (key, value) for key, value in in_database(prefix).items()}
    for name, (key, value) in named.items():
        near = get_close_matches(key, _OWN, n=1, cutoff=_NEARLY)
        if near and key not in _OWN:
            raise ValueError(f"{name}: there is no such option; {near[0]} is meant?")
        reasons = [reason for pattern, reason in _NOT_HERE.items() if re.fullmatch(pattern, key)]
        if reasons:
            raise ValueError(f"{name} cannot be used: {reasons[0]}")
        if key == "snes_rtol":
            positive(value, name, text=True)
        if key == "snes_type":
            one_of(value, name, _SNES_TYPES)


class ProblemOptions:
    """PETSc options of a problem.

    Args:
        prefix: prefix of the options.
        given: options of the user, named without the prefix; the database wins.

    Attributes:
        prefix, given: as above.
    """

    def __init__(self, prefix: str, given: dict[str, Any]):
        self.prefix = prefix
        self.given = given

    def check(self) -> None:
        """Validate the present options; see `check_options`."""
        check_options(self.prefix, self.given)

    def value(self, name: str) -> str | None:
        """Return an option from the database, otherwise the given one, or None."""
        database = PETSc.Options()
        if database.hasName(self.prefix + name):
            return str(database.getString(self.prefix + name))
        value = self.given.get(name)
        return None if value is None else str(value)

    def beside_newton(self) -> dict[str, str]:
        """Return the options of the linear solver, with its kind from the database if set there."""
        found = {k: str(v) for k, v in self.given.items() if not k.startswith("snes_")}
        kind = self.value("linear_solver")
        return found if kind is None else found | {"linear_solver": kind}


# -- errors, matrices, logging ---------------------------------------------------------------------


@contextmanager
def as_raised() -> Iterator[None]:
    """Let exceptions that Python code raises inside PETSc come out as themselves.

    PETSc hands them on as an error of its own, "error code -1". The objects at work are not to be
    used again: their vectors may be locked.

    Raises:
        ValueError: for a kind of solver, or a use of one, that this PETSc does not know.
    """
    try:
        yield
    except PETSc.Error as error:
        cause: BaseException | None = error
        while isinstance(cause, PETSc.Error):
            cause = cause.__cause__
        if cause is not None:
            raise cause from cause.__cause__
        if error.ierr in _NO_SUCH_THING:
            raise ValueError(f"PETSc: {str(error).splitlines()[-1].partition('] ')[2]}") from error
        raise


def half_of(A: PETSc.Mat) -> PETSc.Mat:
    """The symmetric AIJ matrix ``A`` stored as blocks on and above its diagonal. Collective.

    Its products take 0.4 to 0.65 times as long; it is made in the time of 20 to 35 of them.
    """
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return A.convert("sbaij", PETSc.Mat())


def forget_product(A: PETSc.Mat) -> None:
    """Free what ``A``, a product of matrices, keeps to be made again: its factors. Collective."""
    library = ctypes.CDLL(PETSc.__file__)  # petsc4py has no name for it
    error = library.MatProductClear(ctypes.c_void_p(A.handle))
    if error:
        raise PETSc.Error(error)


def has_package(name: str) -> bool:
    """Whether PETSc was built with a package, as ``hypre``."""
    return bool(PETSc.Sys.hasExternalPackage(name))


def require_real() -> None:
    """Raise ``RuntimeError`` if PETSc was built with complex scalars."""
    if not issubclass(PETSc.ScalarType, float):
        raise RuntimeError(
            "dolfinx_contact needs PETSc with real scalars, and this one has complex scalars. "
            "On Debian install python3-dolfinx-real and set PETSC_DIR to the real build."
        )


#: Context whose time and flops are counted as an event of ``-log_view``; its argument is the name.
logged = PETSc.Log.Event


@contextmanager
def staged(name: str) -> Iterator[None]:
    """Make the context a stage of ``-log_view``, or a part of one."""
    stage = PETSc.Log.Stage(name)
    stage.push()
    try:
        yield
    finally:
        stage.pop()
