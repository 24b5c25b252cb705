# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the installation: missing packages, a namesake package, and a foreign MPI launcher.

The package asimov-contact of the Wells group is also imported as ``dolfinx_contact``. If both are
installed into one ``site-packages``, pip mixes their files without a message. The two packages are
distinguished by files that only asimov-contact contains.

Wheels of DOLFINx contain an MPI library, whose ``mpiexec`` is next to the interpreter. The
``mpirun`` of another MPI starts N runs of one rank each instead of one run with N ranks.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

__all__ = [
    "loads",
    "optional",
    "refuse_mixture",
    "refuse_serial_copies",
    "slepc",
    "warn_of_namesake",
]

_NAME = "dolfinx_contact"
_HERE = os.path.dirname(__file__)
#: Modules of asimov-contact; its extension module is ``cpp.<ABI>.so``.
_THEIRS = ("newton_solver.py", "parallel_mesh_ghosting.py")
#: Environment variables with the number of processes: Open MPI; MPICH and Intel MPI.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
_OF_SOLVER = ("mpi4py", "petsc4py", "dolfinx", "basix", "ffcx", "ufl")


def refuse_mixture(here: str = _HERE) -> None:
    """Raise ``ImportError`` if the folder ``here`` contains files of both packages."""
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


def loads(package: str, modules: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package, which loads a module when one of its names is used.

    Args:
        package: name of the package.
        modules: public names by module, relative to the package. Modules are attributes, too.

    Returns:
        Function returning an attribute by name. It raises ``ModuleNotFoundError`` with advice if
        DOLFINx or one of its dependencies is missing, which pip omits without a message on systems
        without a wheel of the extra ``solver``.
    """
    places = {name: module for module, names in modules.items() for name in names}

    def attribute(name: str) -> Any:
        if name not in places and name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        try:
            module = import_module(f"{package}.{places.get(name, name)}")
        except ModuleNotFoundError as error:
            if error.name not in _OF_SOLVER:
                raise
            raise ModuleNotFoundError(
                f"DOLFINx with PETSc and MPI is needed, and there is no module {error.name}. "
                "python3 -m pip install 'signorini-coulomb[solver]' installs them on Linux "
                "(x86_64) with Python 3.12 or later (this one is "
                f"{'.'.join(map(str, sys.version_info[:2]))} on {sys.platform}); on other systems "
                "use Debian, conda or a container: docs/install.md",
                name=error.name,
            ) from None
        return getattr(module, name) if name in places else module

    return attribute


def warn_of_namesake(here: str = _HERE, path: Sequence[str] | None = None) -> None:
    """Warn on rank 0 if the other package is installed too, hidden by this one.

    Args:
        here: folder of this package.
        path: search path of modules; default: `sys.path`.
    """
    for entry in sys.path if path is None else path:
        # Python ignores entries that are not strings.
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
    """Return the names in a folder belonging to asimov-contact; none if it is not a folder."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return []
    return [n for n in names if n in _THEIRS or (n.startswith("cpp.") and n.endswith(".so"))]


def refuse_serial_copies(environ: Mapping[str, str] = os.environ) -> None:
    """Raise ``RuntimeError`` if the launcher of another MPI started N runs of one rank each.

    Without mpi4py, only journals can be read, and nothing is tested.

    Args:
        environ: environment of this process.
    """
    try:
        from mpi4py import MPI
    except ModuleNotFoundError:
        return

    def number(name: str) -> int:
        text = environ.get(name)
        return int(text) if text and text.isdecimal() else 0

    # PMIx alone, as in Slurm, defines the rank of every process but not their number.
    started = [f"{name}={environ[name]}" for name in _SIZES if number(name) > 1]
    if not started and number("PMIX_RANK") > 0:
        started = [f"PMIX_RANK={environ['PMIX_RANK']}"]
    if MPI.COMM_WORLD.size > 1 or not started:
        return
    library = MPI.Get_library_version().strip("\0 \n").splitlines()[0].replace("\t", " ")
    beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(beside) if beside.exists() else "the mpirun or mpiexec of that MPI"
    raise RuntimeError(
        f"this process is one of several ({started[0]}), but mpi4py sees one rank: the launcher is "
        f"not of the MPI that mpi4py has ({library}), and every rank would compute the whole by "
        f"itself. Start the ranks with {launcher}"
    )


def optional(package: str, extra: str, *, in_debian: bool = True) -> Any:
    """Import an optional package or one of its modules.

    Args:
        package: name of the package or of a module in it.
        extra: extra of this distribution containing the package.
        in_debian: whether Debian's package suffices.

    Raises:
        ModuleNotFoundError: naming the package and the extra, if it is not installed.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        name = package.partition(".")[0]
        if error.name != name:  # the package is installed, and one of its dependencies is not
            raise
        other = f", or python3-{name} of Debian" if in_debian else ""
        raise ModuleNotFoundError(
            f"{name} is not installed: python3 -m pip install 'signorini-coulomb[{extra}]'{other}",
            name=name,
        ) from None


def slepc() -> Any:
    """Return the module of slepc4py.

    Raises:
        ModuleNotFoundError: if it is not installed.
    """
    try:
        from slepc4py import SLEPc
    except ModuleNotFoundError as error:
        message = "slepc4py is not installed beside petsc4py: python3-slepc4py of Debian, or conda"
        raise ModuleNotFoundError(message, name=error.name) from None
    return SLEPc
