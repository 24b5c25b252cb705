# SPDX-License-Identifier: LGPL-3.0-or-later
"""Evolution of contact problems with memory, step by step in time or by arc length."""

from dolfinx_contact.evolution.arc_length import ArcLength
from dolfinx_contact.evolution.history import (
    EvolutionStep,
    History,
    NoContinuation,
    PathHistory,
    PathStep,
)
from dolfinx_contact.evolution.nscd import NSCD
from dolfinx_contact.evolution.quasi_static import QuasiStatic

__all__ = [
    "NSCD",
    "ArcLength",
    "EvolutionStep",
    "History",
    "NoContinuation",
    "PathHistory",
    "PathStep",
    "QuasiStatic",
]
