# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid obstacles bounded by a surface of facets, such as a tool read from a CAD file."""

from dolfinx_contact.rigid_surfaces.rigid_surface import RigidSurface

__all__ = ["RigidSurface"]
