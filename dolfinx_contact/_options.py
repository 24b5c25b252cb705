# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc options that cannot be meant: wrong names, wrong numbers, and names that nothing reads."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._compat import option_is_used

__all__ = ["ProblemOptions", "check_options", "in_database"]

logger = logging.getLogger(__name__)

#: Names that users give, for what is nearly one of them.
_KNOWN = (
    "linear_solver",
    "amg_pc_type",
    "surface_condensed",
    "snes_rtol",
    "snes_max_it",
    "snes_monitor",
    "snes_view",
    "snes_type",
    "snes_converged_reason",
    "snes_atol",
    "snes_stol",
    "snes_max_funcs",
    "snes_linesearch_type",
    "snes_linesearch_monitor",
    "snes_monitor_cancel",
    "ksp_type",
    "ksp_rtol",
    "ksp_atol",
    "ksp_divtol",
    "ksp_max_it",
    "ksp_monitor",
    "ksp_view",
    "ksp_converged_reason",
    "ksp_monitor_true_residual",
    "ksp_gmres_restart",
    "ksp_pc_side",
    "ksp_norm_type",
    "ksp_error_if_not_converged",
    "pc_type",
    "pc_mg_type",
    "pc_gamg_type",
    "pc_factor_mat_solver_type",
    "pc_factor_mat_ordering_type",
    "pc_factor_levels",
    "pc_factor_shift_type",
    "pc_hypre_type",
    "pc_view",
)
_MUMPS = re.compile(r"mat_mumps_i?cntl_\d+")
_NEARLY = 0.88  # similarity from which on a name counts as a misspelt one
_POSITIVE = ("snes_rtol",)
_NONNEGATIVE = ("snes_atol", "snes_stol", "ksp_rtol", "ksp_atol", "ksp_divtol")
_WHOLE = ("snes_max_it", "ksp_max_it", "ksp_gmres_restart")
#: Of SNES, those that give right answers (tried); with multigrid the first alone.
_SNES_TYPES = ("newtonls", "newtontr", "newtontrdc", "vinewtonssls")
_READ_HERE = "linear_solver"  # by this package, not by PETSc
_AT_TIMES = ("snes_linesearch_",)  # read by some of the strategies
_OF_MULTIGRID = ("amg_", "surface_")
_MATRIX_FREE = re.compile(r"snes_(mf|mf_operator|fd|fd_color)")
_NO_EFFECT = ("snes_atol", "snes_stol")


def in_database(prefix: str) -> dict[str, str]:
    """The options of PETSc's database under a prefix, without it; none under an empty prefix."""
    if not prefix:
        return {}
    everything = PETSc.Options().getAll()
    return {k[len(prefix) :]: v for k, v in everything.items() if k.startswith(prefix)}


def check_options(prefix: str, options: Mapping[str, Any]) -> None:
    """Raise ``ValueError`` for options that cannot be meant, the database's under ``prefix`` too.

    Refused are names with the prefix or a dash, names that are nearly a known one, numbers out of
    their range, kinds of SNES that do not solve contact problems, other tests of convergence, and
    Jacobians by differences. Not collective.
    """
    if not isinstance(prefix, str) or prefix.startswith("-") or any(c.isspace() for c in prefix):
        raise ValueError(f"the prefix of PETSc options must be a word without dash, got {prefix!r}")
    if not isinstance(options, Mapping):
        raise ValueError(f"petsc_options must be a dictionary, got {type(options).__name__}")
    for key, value in options.items():
        if not isinstance(key, str) or not key:
            raise ValueError(f"the names in petsc_options must be words, got {key!r}")
        if prefix and key.lstrip("-").startswith(prefix):
            short = key.lstrip("-")[len(prefix) :]
            raise ValueError(
                f"petsc_options: {key!r} has the prefix {prefix!r}, which is added to every name: "
                f"leave it out, as in {short!r}"
            )
        if key.startswith("-"):
            raise ValueError(f"petsc_options: leave the dash of {key!r} out")
        _check(key, value, f"petsc_options: {key}")
    for key, value in in_database(prefix).items():
        if key.startswith(prefix):
            raise ValueError(f"the PETSc option -{prefix}{key} has the prefix {prefix!r} twice")
        _check(key, value, f"the PETSc option -{prefix}{key}")


def _check(key: str, value: Any, name: str) -> None:
    near = _meant(key)
    if near:
        raise ValueError(f"{name}: there is no such option; {near} is meant?")
    if key in (*_POSITIVE, *_NONNEGATIVE):
        number = _number(value, name)
        bound = "positive" if key in _POSITIVE else "nonnegative"
        if not np.isfinite(number) or number < 0 or (number == 0 and key in _POSITIVE):
            raise ValueError(f"{name} must be a {bound} number, got {value}")
    if key in _WHOLE:
        number = _number(value, name)
        if not np.isfinite(number) or number != int(number) or number < 0:
            raise ValueError(f"{name} must be a nonnegative whole number, got {value}")
    if _MATRIX_FREE.fullmatch(key):
        raise ValueError(
            f"{name}: the linear solvers need the assembled generalised Jacobian, whose place one "
            "that is matrix-free or made by differences cannot take"
        )
    if key == "snes_convergence_test":
        raise ValueError(
            f"{name}: whether contact holds is decided here, and no other test of PETSc's can take "
            "its place; snes_rtol is the tolerance"
        )
    if key == "snes_type" and value not in _SNES_TYPES:
        raise ValueError(
            f"{name}: the SNES {value!r} does not solve contact problems; those that do are "
            f"{', '.join(_SNES_TYPES)}"
        )


def _number(value: Any, name: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {value!r}") from None


def _meant(key: str) -> str:
    """The known name that ``key`` is nearly; "" if it is one, or like none."""
    if key in _KNOWN or _MUMPS.fullmatch(key) or any(key.endswith("_" + k) for k in _KNOWN):
        return ""
    return next(iter(get_close_matches(key, _KNOWN, n=1, cutoff=_NEARLY)), "")


class ProblemOptions:
    """PETSc options of a problem, and which of them something has read.

    Args:
        prefix: of the options.
        given: by the user, named without the prefix; the database wins.

    Attributes:
        prefix, given: as above.
    """

    _prefixes: set[str] = set()  # of all problems: one may begin with another

    def __init__(self, prefix: str, given: dict[str, Any]):
        self.prefix = prefix
        self.given = given
        self._used = set[str]()
        self._warned = False
        self._prefixes.add(prefix)

    def check(self) -> None:
        """Raise ``ValueError`` for options that cannot be meant."""
        check_options(self.prefix, self.given)

    def value(self, name: str) -> str | None:
        """An option: from the database, else as it was given."""
        database = PETSc.Options()
        if database.hasName(self.prefix + name):
            return str(database.getString(self.prefix + name))
        value = self.given.get(name)
        return None if value is None else str(value)

    def beside_newton(self) -> dict[str, str]:
        """Those given now, but for the options of SNES: a linear solver is made with them.

        Its kind is that of the database, if it is there.
        """
        found = {k: str(v) for k, v in self.given.items() if not k.startswith("snes_")}
        kind = self.value(_READ_HERE)
        return found if kind is None else found | {_READ_HERE: kind}

    def note(self) -> None:
        """Take note of what has been read, while the options are in the database."""
        if not self._warned:
            self._used |= {k for k in self.given if option_is_used(self.prefix + k)}

    def unused(self, *, multigrid: bool) -> list[str]:
        """Those that were given or are in the database under the prefix and that nothing has read.

        Args:
            multigrid: whether that is the linear solver, so that its options are to be read.
        """
        longer = tuple(p for p in self._prefixes if p != self.prefix)
        longer = tuple(p[len(self.prefix) :] for p in longer if p.startswith(self.prefix))
        found = in_database(self.prefix)
        left = [k for k in self.given if k not in self._used and k not in found]
        left += [
            k for k in found if not k.startswith(longer) and not option_is_used(self.prefix + k)
        ]
        spared = _AT_TIMES if multigrid else (*_AT_TIMES, *_OF_MULTIGRID)
        return sorted(k for k in left if k != _READ_HERE and not k.startswith(spared))

    def warn(self, *, multigrid: bool, root: bool) -> None:
        """Warn of what nothing has read, once.

        Args:
            multigrid: see `unused`.
            root: whether this rank speaks.
        """
        if self._warned:
            return
        self._warned = True
        given = {**self.given, **in_database(self.prefix)}
        words = [_with_hint(key) for key in self.unused(multigrid=multigrid)]
        words += [f"{k} (snes_rtol decides)" for k in _NO_EFFECT if k in given]
        if words and root:
            logger.warning("PETSc options that nothing uses: %s", ", ".join(words))


def _with_hint(key: str) -> str:
    near = [] if key in _KNOWN else get_close_matches(key, _KNOWN, n=1, cutoff=0.6)
    return f"{key} ({near[0]} is meant?)" if near else key
