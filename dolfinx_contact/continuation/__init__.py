# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following solution branches of piecewise smooth systems in PETSc."""

from dolfinx_contact.continuation.branch import Branch, BranchPoint, Change, Ray, SpecialPoint
from dolfinx_contact.continuation.follow import Follower, follow
from dolfinx_contact.continuation.observer import Observer, Observers, Stepping, Task
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.system import Events, Piece, System

__all__ = [
    "Branch",
    "BranchPoint",
    "Change",
    "Events",
    "Follower",
    "Observer",
    "Observers",
    "Piece",
    "Ray",
    "SpecialPoint",
    "StepControl",
    "Stepping",
    "System",
    "Task",
    "follow",
]
