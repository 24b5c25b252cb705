# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact mechanics on DOLFINx: the Signorini-Coulomb problem without regularisation."""

from dolfinx_contact import materials, obstacles
from dolfinx_contact._petsc import parse_arguments
from dolfinx_contact.laws import Coulomb, Frictionless, Tresca
from dolfinx_contact.obstacles import Cylinder, HalfSpace, LevelSet, Sphere
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.result import ContactTable, Result
from dolfinx_contact.solvers import ConvergenceError
from dolfinx_contact.surface import ContactSurface

__version__ = "0.1.0"

__all__ = [
    "ContactProblem",
    "ContactSurface",
    "ContactTable",
    "ConvergenceError",
    "Coulomb",
    "Cylinder",
    "Frictionless",
    "HalfSpace",
    "LevelSet",
    "Result",
    "Sphere",
    "Tresca",
    "materials",
    "obstacles",
    "parse_arguments",
]
