# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verified problems with command lines: scripts, and modules ``cases.NAME`` for tests."""

import sys
from pathlib import Path

# The scripts import their common parser as a neighbour, which also works for a script that is run.
sys.path.append(str(Path(__file__).parent))
