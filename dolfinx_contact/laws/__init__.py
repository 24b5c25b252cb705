# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact laws: relations at one contact point, written once in UFL.

All laws work in 2D and 3D, against obstacles and between bodies, with every discretisation, with
direct solvers and multigrid, and along branches. Some laws support more:

| law                           | needs                     | pivoting | proofs | points |
|-------------------------------|---------------------------|----------|--------|--------|
| `Frictionless()`              |                           | 2D       | 2D     | yes    |
| `Coulomb(F)`                  | F >= 0                    | 2D       | 2D     | yes    |
| `Tresca(g)`                   | g >= 0                    | no       | 2D     | yes    |
| `NonlocalCoulomb(F, rho)`     | F >= 0, number rho > 0    | no       | no     | no     |
| `NormalCompliance(C, 1, law)` | C > 0                     | 2D       | no     | no     |
| `NormalCompliance(C, m, law)` | C > 0, number m > 1       | no       | no     | no     |
| `Regularised(law, eps)`       | eps > 0                   | no       | no     | no     |
| `RCCM(K, K, w, F)`            | K, F >= 0, w > 0          | no       | no     | no     |
| `BilinearCohesive(t, a, b)`   | t, a, b > 0               | no       | no     | no     |
| `MaxwellLayer(k, eta, K)`     | k, eta > 0, K >= 0        | no       | no     | no     |

- *needs*: admissible parameters, explained in the docstring of each law.
- *pivoting*: a linear body with nodal or mixed contact is condensed onto its contact points, and
  branches are followed from vertex to vertex. The inner law of a compliant surface must be
  frictionless or Coulomb's law.
- *proofs*: proofs of uniqueness and of completeness of a set of solutions (`proofs`), for the same
  bodies.
- *points*: `ContactProblem.reduced` and the classical algorithms.

Unless the table requires a number, parameters may be Constants, Functions or UFL expressions of
these. They may contain the parameter of a branch; the branch is then followed in steps. A
user-defined law supports pivoting in 2D if, for each status, the required traction is linear in
jump and traction and all borders pass through zero. A user-defined bond, with or without memory, is
an `Interface`: an energy and a dissipation potential. In histories `Regularised` requires a
``speed``.
"""

from typing import TYPE_CHECKING

from dolfinx_contact._install import loads

if TYPE_CHECKING:
    from dolfinx_contact.laws.adhesion import RCCM
    from dolfinx_contact.laws.answers import Answers, FrozenBonds, LawAtPoints, PointData
    from dolfinx_contact.laws.cohesive import BilinearCohesive, MaxwellLayer
    from dolfinx_contact.laws.compliant import NormalCompliance, Regularised
    from dolfinx_contact.laws.friction import Coulomb, FrictionLaw, Frictionless, Tresca
    from dolfinx_contact.laws.interface import Interface, InterfaceState, Rates
    from dolfinx_contact.laws.law import (
        Bond,
        Border,
        ContactPoint,
        Internal,
        Law,
        StatusPiece,
    )
    from dolfinx_contact.laws.spreading import NonlocalCoulomb
    from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK

__all__ = [
    "MINUS",
    "OPEN",
    "PLUS",
    "RCCM",
    "STICK",
    "Answers",
    "BilinearCohesive",
    "Bond",
    "Border",
    "ContactPoint",
    "Coulomb",
    "FrictionLaw",
    "Frictionless",
    "FrozenBonds",
    "Interface",
    "InterfaceState",
    "Internal",
    "Law",
    "LawAtPoints",
    "MaxwellLayer",
    "NonlocalCoulomb",
    "NormalCompliance",
    "PointData",
    "Rates",
    "Regularised",
    "StatusPiece",
    "Tresca",
]

#: Public names by module. `laws.status` needs neither UFL nor DOLFINx.
__getattr__ = loads(
    __name__,
    {
        "adhesion": ("RCCM",),
        "answers": ("Answers", "FrozenBonds", "LawAtPoints", "PointData"),
        "cohesive": ("BilinearCohesive", "MaxwellLayer"),
        "compliant": ("NormalCompliance", "Regularised"),
        "friction": ("Coulomb", "FrictionLaw", "Frictionless", "Tresca"),
        "interface": ("Interface", "InterfaceState", "Rates"),
        "law": ("Bond", "Border", "ContactPoint", "Internal", "Law", "StatusPiece"),
        "spreading": ("NonlocalCoulomb",),
        "status": ("MINUS", "OPEN", "PLUS", "STICK"),
    },
)


def __dir__() -> list[str]:
    return __all__
