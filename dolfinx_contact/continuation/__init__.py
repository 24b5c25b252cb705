# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numerical continuation: solution branches of piecewise smooth systems in PETSc."""

from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact.continuation.branch import (
    Branch,
    BranchPoint,
    Change,
    Diagram,
    Edge,
    Node,
    Ray,
    SpecialPoint,
)
from dolfinx_contact.continuation.diagram import explore
from dolfinx_contact.continuation.follow import Follower, Route, follow, follower_for, points_at
from dolfinx_contact.continuation.observer import (
    BranchStep,
    Observer,
    ObserverLike,
    Observers,
    Stepping,
    Stop,
    Task,
)
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.continuation.several_solutions import (
    Continuum,
    Solution,
    Solutions,
    find_solutions,
)
from dolfinx_contact.continuation.step_control import Direction, Kinks, StepControl
from dolfinx_contact.continuation.steps import Locate
from dolfinx_contact.continuation.system import (
    Condensed,
    Events,
    Piece,
    Preconditioner,
    System,
)

__all__ = [
    "Branch",
    "BranchPoint",
    "BranchStep",
    "Change",
    "Condensed",
    "Continuum",
    "Diagram",
    "Direction",
    "Edge",
    "Ending",
    "Ends",
    "Events",
    "Follower",
    "Kinks",
    "Locate",
    "Node",
    "Observer",
    "ObserverLike",
    "Observers",
    "Piece",
    "Pivoting",
    "Preconditioner",
    "Ray",
    "Route",
    "Solution",
    "Solutions",
    "SpecialPoint",
    "StepControl",
    "Stepping",
    "Stop",
    "System",
    "Task",
    "explore",
    "find_solutions",
    "follow",
    "follower_for",
    "points_at",
]
