# SPDX-License-Identifier: LGPL-3.0-or-later
"""``python3 -m dolfinx_contact check PROOF``: what a stored proof proves.

It is the same code as ``python3 dolfinx_contact/analysis/check_proof.py PROOF``, which needs numpy
alone; this way imports the package, and so needs DOLFINx. Where the package is installed by pip,
``dolfinx_contact check PROOF`` is the same command.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from dolfinx_contact.analysis.check_proof import main as check

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, by default that of the command line; its exit status."""
    argv = sys.argv[1:] if argv is None else argv
    if list(argv[:1]) == ["check"]:
        return check(argv[1:])
    print("usage: python3 -m dolfinx_contact check PROOF", file=sys.stderr)
    return 0 if list(argv) in (["-h"], ["--help"]) else 2


if __name__ == "__main__":
    sys.exit(main())
