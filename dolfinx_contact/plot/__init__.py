# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of curves, branch diagrams, bodies and contact surfaces, and films."""

from dolfinx_contact.plot.bodies import picture_of_body, picture_of_states
from dolfinx_contact.plot.curves import draw_chart, draw_curves, draw_polar
from dolfinx_contact.plot.diagrams import draw_diagram
from dolfinx_contact.plot.films import film, film_of_contact
from dolfinx_contact.plot.scene import Look
from dolfinx_contact.plot.tractions import picture_of_contact

__all__ = [
    "Look",
    "draw_chart",
    "draw_curves",
    "draw_diagram",
    "draw_polar",
    "film",
    "film_of_contact",
    "picture_of_body",
    "picture_of_contact",
    "picture_of_states",
]
