# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures: curves, diagrams, bodies, contact faces, films."""

from dolfinx_contact.plot.animation import animate
from dolfinx_contact.plot.curves import (
    draw_chart,
    draw_convergence,
    draw_curves,
    draw_regions,
    draw_solutions,
)
from dolfinx_contact.plot.diagrams import draw_diagram
from dolfinx_contact.plot.hertz import Hertz
from dolfinx_contact.plot.panels import draw_panels
from dolfinx_contact.plot.pictures import picture_of_body, picture_of_contact
from dolfinx_contact.plot.states import picture_of_states
from dolfinx_contact.plot.vibration import picture_of_vibration, write_vibration

__all__ = [
    "Hertz",
    "animate",
    "draw_chart",
    "draw_convergence",
    "draw_curves",
    "draw_diagram",
    "draw_panels",
    "draw_regions",
    "draw_solutions",
    "picture_of_body",
    "picture_of_contact",
    "picture_of_states",
    "picture_of_vibration",
    "write_vibration",
]
