# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc options of a problem.

Options that the package reads itself are checked, as are options of SNES that would replace the
tests and matrices of this package. All others are PETSc's: it reports wrong values, and
``-options_left`` lists names on the command line that nothing has read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from petsc4py import PETSc

from dolfinx_contact._validate import one_of, positive

__all__ = ["ProblemOptions", "check_options", "in_database"]

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


def in_database(prefix: str) -> dict[str, str]:
    """The options of PETSc's database under a prefix, without it; none under an empty prefix."""
    if not prefix:
        return {}
    everything = PETSc.Options().getAll()
    return {k[len(prefix) :]: v for k, v in everything.items() if k.startswith(prefix)}


def check_options(prefix: str, options: Mapping[str, Any]) -> None:
    """Check options of a problem, and those of the database under its prefix. Not collective.

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
        """Check the options as they are now; see `check_options`."""
        check_options(self.prefix, self.given)

    def value(self, name: str) -> str | None:
        """An option from the database, otherwise as it was given."""
        database = PETSc.Options()
        if database.hasName(self.prefix + name):
            return str(database.getString(self.prefix + name))
        value = self.given.get(name)
        return None if value is None else str(value)

    def beside_newton(self) -> dict[str, str]:
        """The options without those of SNES, with which a linear solver is made.

        Its kind is that of the database, if it is there.
        """
        found = {k: str(v) for k, v in self.given.items() if not k.startswith("snes_")}
        kind = self.value("linear_solver")
        return found if kind is None else found | {"linear_solver": kind}
