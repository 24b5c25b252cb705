# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact mechanics on DOLFINx: the Signorini-Coulomb problem without regularisation."""

from typing import TYPE_CHECKING

from dolfinx_contact._install import loads, refuse_serial_copies

if TYPE_CHECKING:
    from dolfinx_contact import materials, obstacles
    from dolfinx_contact._petsc import parse_arguments
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
    from dolfinx_contact.obstacles import Cylinder, HalfSpace, LevelSet, Sphere
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.points.descriptions import ContactPair, ContactSurface, SelfContact
    from dolfinx_contact.points.rigid_body import RigidBody
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.result import Result
    from dolfinx_contact.results.tables import ContactTable
    from dolfinx_contact.rigid_surfaces import RigidSurface
    from dolfinx_contact.solvers import ConvergenceError

# MPI comes first: compiled modules of wheels use the library that mpi4py has loaded.
refuse_serial_copies()

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
]

#: Public names by module. A module is loaded when a name is used, so that
#: `dolfinx_contact.continuation` loads neither UFL nor DOLFINx and `records.read_journal` neither
#: MPI nor PETSc.
__getattr__ = loads(
    __name__,
    {
        "_petsc": ("parse_arguments",),
        "equations.state": ("State",),
        "laws": (
            *("RCCM", "BilinearCohesive", "Coulomb", "Frictionless", "MaxwellLayer"),
            *("NonlocalCoulomb", "NormalCompliance", "Regularised", "Tresca"),
        ),
        "materials": (),
        "obstacles": ("Cylinder", "HalfSpace", "LevelSet", "Sphere"),
        "parametric": ("ParametricContact",),
        "points.descriptions": ("ContactPair", "ContactSurface", "SelfContact"),
        "points.rigid_body": ("RigidBody",),
        "problem": ("ContactProblem",),
        "results.result": ("Result",),
        "results.tables": ("ContactTable",),
        "rigid_surfaces": ("RigidSurface",),
        "solvers": ("ConvergenceError",),
    },
)


def __dir__() -> list[str]:
    return __all__
