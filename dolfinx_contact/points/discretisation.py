# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discretisation of contact descriptions."""

from __future__ import annotations

from dolfinx_contact.points.descriptions import Contact, ContactPair, ContactSurface
from dolfinx_contact.points.pair import DiscretePair
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["discretise"]


def discretise(contact: Contact) -> DiscreteSurface:
    """Create the contact points, multiplier and operators of a description. Collective.

    Args:
        contact: description of a surface, a pair or self-contact.

    Raises:
        ValueError: on every rank, if the description does not fit the mesh.
    """
    if isinstance(contact, ContactSurface):
        return DiscreteSurface(contact)
    if isinstance(contact, ContactPair):
        return DiscretePair(contact)
    from dolfinx_contact.points.self_contact import DiscreteSelfContact

    return DiscreteSelfContact(contact)
