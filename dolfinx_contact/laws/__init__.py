# SPDX-License-Identifier: LGPL-3.0-or-later
"""What holds at one contact point: unilateral contact with a friction law."""

from dolfinx_contact.laws.cone import Augmented, Status, augment, classify, projection
from dolfinx_contact.laws.friction import Coulomb, FrictionLaw, Frictionless, Tresca

__all__ = [
    "Augmented",
    "Coulomb",
    "FrictionLaw",
    "Frictionless",
    "Status",
    "Tresca",
    "augment",
    "classify",
    "projection",
]
