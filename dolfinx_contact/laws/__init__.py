# SPDX-License-Identifier: LGPL-3.0-or-later
"""What holds at one contact point: a law, written once in UFL."""

from dolfinx_contact.laws.answers import Answers, PointData
from dolfinx_contact.laws.compiled import LawAtPoints
from dolfinx_contact.laws.compliant import NormalCompliance, Regularised
from dolfinx_contact.laws.friction import Coulomb, FrictionLaw, Frictionless, Tresca
from dolfinx_contact.laws.law import Border, ContactPoint, Kernel, Law, StatusPiece
from dolfinx_contact.laws.spreading import NonlocalCoulomb
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK

__all__ = [
    "MINUS",
    "OPEN",
    "PLUS",
    "STICK",
    "Answers",
    "Border",
    "ContactPoint",
    "Coulomb",
    "FrictionLaw",
    "Frictionless",
    "Kernel",
    "Law",
    "LawAtPoints",
    "NonlocalCoulomb",
    "NormalCompliance",
    "PointData",
    "Regularised",
    "StatusPiece",
    "Tresca",
]
