# SPDX-License-Identifier: LGPL-3.0-or-later
"""``python3 -m dolfinx_contact``: explore records, check stored proofs, list installed packages.

``check`` runs the code of ``python3 dolfinx_contact/proofs/check_proof.py PROOF``. The latter
command needs only numpy, while this one imports the package and DOLFINx. After an installation by
pip, ``dolfinx_contact`` is the same command.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx

import dolfinx_contact
from dolfinx_contact._mpi import on_root
from dolfinx_contact.explorer import SolutionCount, explorer
from dolfinx_contact.proofs.check_proof import Certificate
from dolfinx_contact.proofs.check_proof import check as follow_proof
from dolfinx_contact.proofs.check_proof import main as check

__all__ = ["main"]

#: Optional modules with their purpose.
_OPTIONAL = {
    "matplotlib": "pictures",
    "pyvista": "pictures of bodies",
    "imageio": "films",
    "imageio_ffmpeg": "films in .mp4",
    "plotly": "pages of records",
    "pandas": "tables of journals",
    "h5py": "point problems in HDF5",
    "gmsh": "meshes",
    "slepc4py": "large eigenproblems",
}
_SOLVERS = ("mumps", "hypre", "superlu_dist", "ml")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        argv: arguments; default: arguments of the command line.

    Returns:
        Exit status of the command.
    """
    if argv is None:
        # a closed pipe, as of `| head`, ends the command, not the handler that PETSc has installed
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    words = list(sys.argv[1:] if argv is None else argv)
    if words[:1] == ["check"]:
        return check(words[1:])
    parser = _parser()
    args = parser.parse_args(words)
    if args.command == "info":
        return _info(MPI.COMM_WORLD)
    return _explore(args, MPI.COMM_WORLD)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python3 -m dolfinx_contact", description="Frictional contact mechanics on DOLFINx."
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("check", help="check a stored proof", add_help=False)
    commands.add_parser("info", help="list versions and installed packages")
    about = "Write a page that explores a record: one HTML file that needs no network."
    explore = commands.add_parser("explore", help="write a page for a record", description=about)
    add = explore.add_argument
    add("record", metavar="RECORD", help="folder of a record")
    add("-o", "--output", default="diagram.html", metavar="FILE", help="default: %(default)s")
    add("--title", default="", help="title of the page (default: name of the record)")
    pair: dict[str, Any] = dict(action="append", default=[])
    add("--label", **pair, metavar="COLUMN=TEXT", help="label of a column; may be repeated")
    units = "unit of length, force or stress; may be repeated"
    add("--unit", **pair, metavar="QUANTITY=UNIT", help=units)
    proof = "stored proof of the solutions at a gamma, which is checked; may be repeated"
    add("--proof", **pair, metavar="GAMMA=FILE", help=proof)
    error = "error of displacements over the largest one (default: %(default)s)"
    add("--error", type=float, default=0.005, help=error)
    return parser


def _pairs(words: Sequence[str], option: str) -> dict[str, str]:
    """Parse arguments ``NAME=VALUE`` of a command-line option; return the values by name.

    Raises:
        ValueError: if an argument does not contain ``=``.
    """
    for word in words:
        if "=" not in word:
            raise ValueError(f"{option} is NAME=VALUE, got {word!r}")
    return {name: value for name, _, value in (word.partition("=") for word in words)}


def _proofs(words: Sequence[str]) -> list[SolutionCount]:
    """Check proofs given as ``GAMMA=FILE``; return the proved solution counts. On one rank."""
    found = []
    for gamma, file in _pairs(words, "--proof").items():
        number = float(gamma)
        proved = follow_proof(Certificate.load(file))
        count = len(proved.inside) + proved.at_rest
        method = f"{Path(file).name}, which was checked"
        found.append(SolutionCount(number, count, proved.verdict == "complete", method))
    return found


def _explore(args: argparse.Namespace, comm: MPI.Comm) -> int:
    try:
        look: dict[str, Any] = {
            "title": args.title,
            "labels": _pairs(args.label, "--label"),
            "units": _pairs(args.unit, "--unit"),
            "counts": on_root(comm, lambda: _proofs(args.proof)),
            "error": args.error,
        }
        explorer(args.output, args.record, **look)
    except (OSError, ValueError, ModuleNotFoundError) as error:
        if comm.rank == 0:
            print(f"refused: {error}", file=sys.stderr)
        return 1
    if comm.rank == 0:
        print(args.output)
    return 0


def _info(comm: MPI.Comm) -> int:
    """Print versions of the package, its dependencies and optional packages, on rank 0."""
    if comm.rank != 0:
        return 0
    scalar = PETSc.ScalarType.__name__  # type: ignore[attr-defined]
    library = MPI.Get_library_version().replace("\0", "").splitlines()[0].split(",")[0]
    solvers = {name: PETSc.Sys.hasExternalPackage(name) for name in _SOLVERS}
    lines = {
        "dolfinx_contact": dolfinx_contact.__version__,
        "DOLFINx": dolfinx.__version__,
        "PETSc": f"{'.'.join(map(str, PETSc.Sys.getVersion()))}, {scalar}",
        **{f"  {name}": "installed" if has else "not installed" for name, has in solvers.items()},
        "MPI": f"{library}, {comm.size} rank{'s' * (comm.size > 1)}",
        "Python": sys.version.split()[0],
        "numpy": _version("numpy"),
        "scipy": _version("scipy"),
        **{f"  {name}": f"{_version(name):16} {use}" for name, use in _OPTIONAL.items()},
    }
    for name, text in lines.items():
        print(f"{name:16} {text}")
    return 0


def _version(name: str) -> str:
    if not find_spec(name):
        return "not installed"
    try:
        return version(name)
    except PackageNotFoundError:  # Debian's modules may have no metadata of that name
        return "installed"


if __name__ == "__main__":
    sys.exit(main())
