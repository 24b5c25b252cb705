# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the law of a surface is one, with fields and memory as they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_contact._errors import require
from dolfinx_contact.laws.law import obeys
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["check_law", "check_time", "check_times"]


def check_law(s: ContactSurface, where: str = "") -> None:
    """Raise ``ValueError`` if a surface has no law with the fields as they are. Collective.

    They must be finite and of the sign that the law asks for, and no radius of a friction disc
    negative; and the law must have what it needs, under the present memory.
    """
    check_time(s)
    fields = s.points.data.fields
    for name, values in fields.items():
        what = f"{name} of {s.law.name}{where}"
        require(s.comm, bool(np.isfinite(values).all()), f"{s.name}: NaN in the {what}")
        sign = s.law.signs.get(name, "any")
        words = {"positive": "not positive:", "fraction": "not between 0 and 1:"}
        good = bool(obeys(sign, values).all())
        require(s.comm, good, f"{s.name}: {words.get(sign, 'negative')} {what}")
    for x in s.law.internal:
        if x.end is None:
            continue
        left = x.sense * (x.end - fields[x.name])
        good = bool(np.all(left >= -1e-14 * (1.0 + abs(x.end))))
        what = f"{x.name} of {s.law.name}{where}"
        require(s.comm, good, f"{s.name}: {what} is beyond its end {x.end:g}")
    at_rest = np.zeros_like(s.points.data.n)
    radius = s.law_at_points(at_rest, at_rest, s._point_data).unit_bound
    message = f"{s.name}: the law {s.law.name} has a negative radius{where}"
    require(s.comm, not bool((radius < -1e-14).any()), message)


def check_time(s: ContactSurface) -> None:
    """Raise ``ValueError`` if the law lacks something, with the present memory. Collective.

    See `Law.lacks`; and a law that looks at the time needs one (`CompiledLaw.needs_time`).
    """
    history = s.memory is not None and s.memory.step > 0
    lack = s.law.lacks(history=history)
    kind = "in a history" if history else "statically"
    require(s.comm, not lack, f"{s.name}: {kind} the law {s.law.name} lacks {lack}")
    step = -1.0 if s.memory is None else min(s.memory.step, 0.0)
    # Laws that name the fields by which they need a time say what holds in a step of no length.
    said = history or (step == 0 and bool(s.law.needs_time))
    require(
        s.comm,
        said or not s.law_at_points.compiled.needs_time(step),
        f"{s.name}: the law {s.law.name} looks at the time of a step (a.step), and no time passes "
        "without a history: use evolution.QuasiStatic or NSCD, or say in the law what holds at "
        "rest, as in the speed ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - a.slid_before) / "
        "a.step, 0.0)",
    )


def check_times(surfaces: Sequence[ContactSurface]) -> None:
    """`check_time` of all surfaces. Collective."""
    for s in surfaces:
        check_time(s)
