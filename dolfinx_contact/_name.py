# SPDX-License-Identifier: LGPL-3.0-or-later
"""Another package has the same import name: asimov-contact of the Wells group.

Its distribution is called `dolfinx_contact`, ours `signorini-coulomb`; both install a folder
`dolfinx_contact`. In one site-packages pip mixes their files without a word, and modules of the one
import those of the other. The two are distinguished by files that only it has.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from importlib.util import find_spec

__all__ = ["refuse_mixture", "require_dolfinx", "warn_of_namesake"]

_NAME = "dolfinx_contact"
_HERE = os.path.dirname(__file__)
#: Modules of theirs that we shall never have; their extension module is ``cpp.<ABI>.so``.
_THEIRS = ("newton_solver.py", "parallel_mesh_ghosting.py")


def refuse_mixture(here: str = _HERE) -> None:
    """Raise ``ImportError`` if files of both packages are in the folder of this one."""
    found = _theirs_in(here)
    if found:
        raise ImportError(
            f"two packages that are both imported as {_NAME} are mixed in {here}: this one "
            "(signorini-coulomb) and asimov-contact of the Wells group, whose "
            f"{' and '.join(found)} {'is' if len(found) == 1 else 'are'} there. Neither is whole. "
            "python3 -m pip uninstall signorini-coulomb dolfinx_contact, remove what is left of "
            "the folder, and install each into an environment of its own",
            name=_NAME,
            path=here,
        )


def require_dolfinx(*modules: str) -> None:
    """Raise ``ModuleNotFoundError`` if modules of DOLFINx or what it is used with are missing.

    Pip leaves them out without a word on systems for which the wheel of the extra ``solver`` is not
    made.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise ModuleNotFoundError(
            f"DOLFINx with PETSc and MPI is needed, and there is no module {', '.join(missing)}. "
            "python3 -m pip install 'signorini-coulomb[solver]' brings them on Linux (x86_64) with "
            f"Python 3.12 or later (this one is {'.'.join(map(str, sys.version_info[:2]))} on "
            f"{sys.platform}); elsewhere take them from Debian, conda or a container: "
            "docs/install.md",
            name=missing[0],
        )


def warn_of_namesake(here: str = _HERE, path: Sequence[str] | None = None) -> None:
    """Warn on rank 0 if the other package is installed too, hidden by this one.

    For the head of the package: the warning is of the line that imports it. Names of files are
    read, and nothing is imported unless some are found.

    Args:
        here: folder of this package.
        path: where packages are looked for, by default `sys.path`.
    """
    for entry in sys.path if path is None else path:
        # Python ignores entries that are no strings.
        there = os.path.join(entry, _NAME) if isinstance(entry, str) else ""
        if _theirs_in(there) and os.path.realpath(there) != os.path.realpath(here):
            break
    else:
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        warnings.warn(
            f"{_NAME} is imported from {here} (signorini-coulomb). asimov-contact of the Wells "
            f"group, imported by the same name, is in {os.path.abspath(there)} and hidden by it; "
            "code written for that one needs an environment without this one",
            stacklevel=3,
        )


def _theirs_in(folder: str) -> list[str]:
    """Names in a folder, if it is one, that belong to asimov-contact."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:  # nothing could be imported from it either
        return []
    return [n for n in names if n in _THEIRS or (n.startswith("cpp.") and n.endswith(".so"))]
