# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid obstacles with a surface of facets, as of a tool from a file."""

from dolfinx_contact.rigid_surfaces.surface import RigidSurface

__all__ = ["RigidSurface"]
