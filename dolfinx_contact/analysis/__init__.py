# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is known of the solutions of a contact problem: whether they are unique, and stable."""

from dolfinx_contact.analysis.critical_friction import CriticalFriction, critical_friction
from dolfinx_contact.analysis.renard import Renard, renard_criterion

__all__ = ["CriticalFriction", "Renard", "critical_friction", "renard_criterion"]
