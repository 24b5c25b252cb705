# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact mechanics on DOLFINx: the Signorini-Coulomb problem without regularisation."""
# ruff: noqa: E402

from importlib import import_module
from typing import TYPE_CHECKING

from dolfinx_contact._install import (
    refuse_mixture,
    refuse_serial_copies,
    require_dolfinx,
    warn_of_namesake,
)

refuse_mixture()  # before other modules of the package are imported
require_dolfinx("mpi4py")
warn_of_namesake()
# MPI comes first: compiled modules of wheels use the library that mpi4py has loaded.
refuse_serial_copies()
require_dolfinx("petsc4py", "dolfinx")

from dolfinx_contact._petsc import parse_arguments

if TYPE_CHECKING:
    from dolfinx_contact import materials, obstacles
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.laws import (
        RCCM,
        BilinearCohesive,
        Coulomb,
        Frictionless,
        MaxwellLayer,
        NonlocalCoulomb,
        NormalCompliance,
        Regularised,
        Tresca,
    )
    from dolfinx_contact.nested import solve_nested
    from dolfinx_contact.obstacles import Cylinder, HalfSpace, LevelSet, Sphere
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.points.descriptions import ContactPair, ContactSurface, SelfContact
    from dolfinx_contact.points.rigid_body import RigidBody
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.result import Result
    from dolfinx_contact.results.tables import ContactTable
    from dolfinx_contact.rigid_surfaces import RigidSurface
    from dolfinx_contact.solvers import ConvergenceError

__version__ = "0.1.0"

__all__ = [
    "RCCM",
    "BilinearCohesive",
    "ContactPair",
    "ContactProblem",
    "ContactSurface",
    "ContactTable",
    "ConvergenceError",
    "Coulomb",
    "Cylinder",
    "Frictionless",
    "HalfSpace",
    "LevelSet",
    "MaxwellLayer",
    "NonlocalCoulomb",
    "NormalCompliance",
    "ParametricContact",
    "Regularised",
    "Result",
    "RigidBody",
    "RigidSurface",
    "SelfContact",
    "Sphere",
    "State",
    "Tresca",
    "materials",
    "obstacles",
    "parse_arguments",
    "solve_nested",
]

#: Module of each public name. It is loaded when the name is used, so that importing
#: `dolfinx_contact.continuation` loads neither UFL nor DOLFINx.
_MODULES = {
    **dict.fromkeys(("RCCM", "BilinearCohesive", "MaxwellLayer", "NonlocalCoulomb"), "laws"),
    **dict.fromkeys(("Coulomb", "Frictionless", "Tresca"), "laws"),
    **dict.fromkeys(("NormalCompliance", "Regularised"), "laws"),
    **dict.fromkeys(("Cylinder", "HalfSpace", "LevelSet", "Sphere"), "obstacles"),
    **dict.fromkeys(("ContactPair", "ContactSurface", "SelfContact"), "points.descriptions"),
    "ContactProblem": "problem",
    "ContactTable": "results.tables",
    "ConvergenceError": "solvers",
    "ParametricContact": "parametric",
    "Result": "results.result",
    "RigidBody": "points.rigid_body",
    "RigidSurface": "rigid_surfaces",
    "State": "equations.state",
    "solve_nested": "nested",
}


def __getattr__(name: str) -> object:
    if name in ("materials", "obstacles"):
        return import_module(f"{__name__}.{name}")
    if name in _MODULES:
        return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
