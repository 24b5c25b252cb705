# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modules loaded on first use, missing packages, and detection of the wrong MPI launcher.

Wheels of DOLFINx contain an MPI library, whose ``mpiexec`` is next to the interpreter. The
``mpirun`` of another MPI library starts N runs of one rank each instead of one run with N ranks.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

__all__ = ["loads", "optional", "refuse_serial_copies"]

#: Environment variables with the number of processes: Open MPI; MPICH and Intel MPI.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
_OF_SOLVER = ("mpi4py", "petsc4py", "dolfinx", "basix", "ffcx", "ufl")


def loads(package: str, modules: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package, which loads a module when one of its names is used.

    Args:
        package: name of the package.
        modules: public names by module, relative to the package. The modules themselves are also
            available as attributes.

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


def refuse_serial_copies(environ: Mapping[str, str] = os.environ) -> None:
    """Raise ``RuntimeError`` if the launcher of another MPI started N runs of one rank each.

    Nothing is checked if mpi4py is not installed, because then only journals can be read.

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
        extra: extra of this distribution with the package, as in ``pip install "name[extra]"``.
        in_debian: whether Debian's package suffices.

    Raises:
        ModuleNotFoundError: naming the package and the extra, if the package is not installed.
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
