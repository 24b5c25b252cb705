# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled UFL, found again in a time that does not grow with what else was compiled before.

A look-up in FFCx's cache lists its folder, which on a machine in use holds thousands of files.
Here the cache has a folder for every first two letters of a signature.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, jit
from ufl.corealg.traversal import unique_pre_traversal
from ufl.domain import extract_unique_domain

from dolfinx_contact._errors import everywhere

__all__ = ["at_middle", "compiled_expression", "compiled_form", "is_of_cells"]

_PARTS = {"cell": "cells", "exterior_facet": "boundary", "interior_facet": "facets between cells"}


def compiled_form(form: ufl.Form, entity_maps: Any = None) -> fem.Form:
    """A form, compiled. Collective.

    Args:
        form: UFL.
        entity_maps: of submeshes that occur in it.

    Raises:
        ValueError: if something has complex values, integrals of one kind do not have the same
            tags, which DOLFINx needs, or an integrand is known at the middles of cells alone and
            taken at other points.
    """
    maps = {} if entity_maps is None else {"entity_maps": entity_maps}
    values = [c.value for c in form.constants() if isinstance(c, fem.Constant)]
    values += [f.x.array for f in form.coefficients() if isinstance(f, fem.Function)]
    if any(np.iscomplexobj(v) for v in values):
        raise ValueError("a Constant or Function has complex values: give real ones")
    ((domain, tags),) = form.subdomain_data().items()
    for kind, given in tags.items():
        if any(each is not given[0] for each in given):
            raise ValueError(
                f"integrals over the {_PARTS.get(kind, kind)} have tags, and others have none or "
                "other ones: take one measure, ufl.Measure('dx', domain, subdomain_data=tags), for "
                "all of them; without a number it is over all"
            )
    if any(is_of_cells(i.integrand()) and not _at_middle(i) for i in form.integrals()):
        raise ValueError(
            "the stress of a mean dilatation is known at the middles of cells alone, where an "
            'integral over it has to take it: dx(metadata={"quadrature_degree": 1})'
        )
    form = _without_one_point_beside_others(form)
    with _compiler_named(domain.ufl_cargo().comm):
        return fem.form(form, jit_options=_folder(form.signature()[:2]), **maps)


def compiled_expression(
    e: Any, points: npt.NDArray[np.float64], comm: MPI.Comm | None = None
) -> fem.Expression:
    """An expression at points of the reference cell, compiled once for all ranks. Collective.

    Args:
        e: UFL.
        points: of the reference cell.
        comm: of the ranks, by default those of the mesh.
    """
    with _compiler_named(comm or extract_unique_domain(e).ufl_cargo().comm):
        return fem.Expression(e, points, comm=comm, jit_options=_folder("expressions"))


def at_middle(dim: int) -> dict[str, Any]:
    """Metadata of an integral over quadrilaterals or hexahedra by the middle of each.

    A second point, close by, has no weight. FFCx (0.9, 0.11) takes what is the same at all points
    of one rule, as the Jacobian at a single one, for all rules of an integral: beside another rule,
    a rule of one point gives both a wrong value where cells are no parallelograms.

    Args:
        dim: of the cells.
    """
    return {
        "quadrature_rule": "custom",
        "quadrature_points": ((0.5,) * dim, (0.51,) * dim),
        "quadrature_weights": (1.0, 0.0),
    }


def is_of_cells(e: Any) -> bool:
    """Whether UFL has changes of the volumes of cells (`_cell_volumes`).

    These are known at the middles of cells alone.
    """
    kinds = {ufl.classes.CellVertices, ufl.classes.Grad}
    return any(
        isinstance(node, ufl.classes.Determinant)
        and kinds <= {type(part) for part in unique_pre_traversal(node)}
        for node in unique_pre_traversal(e)
    )


def _at_middle(integral: ufl.Integral) -> bool:
    """Whether an integral is one over cells, by their middles."""
    if integral.integral_type() != "cell":
        return False
    rule = integral.metadata()
    if rule.get("quadrature_rule") != "custom":
        return _has_one_point(integral)
    weighted = zip(rule["quadrature_points"], rule["quadrature_weights"], strict=True)
    return all(w == 0 or all(x == 0.5 for x in point) for point, w in weighted)


def _without_one_point_beside_others(form: ufl.Form) -> ufl.Form:
    """The form, with `at_middle` for rules of one point that FFCx would mix with others.

    Raises:
        ValueError: where it would mix them and that is no way out: on facets, on which FFCx (0.11)
            adds up such rules wrongly too, for rules of one's own, and for other cells.
    """
    mixed = [
        len(form.integrals_by_type(integral.integral_type())) > 1 and _has_one_point(integral)
        for integral in form.integrals()
    ]
    if not any(mixed):
        return form
    integrals = []
    for integral, is_mixed in zip(form.integrals(), mixed, strict=True):
        if is_mixed:
            topology = integral.ufl_domain().ufl_cargo().topology
            cell = topology.cell_type.name
            own = integral.metadata().get("quadrature_rule") == "custom"
            over_cells = integral.integral_type() == "cell"
            if own or not over_cells or cell not in ("quadrilateral", "hexahedron"):
                raise ValueError(
                    "an integral that is taken by one point stands beside integrals by other "
                    f"rules over {'' if over_cells else 'facets of '}cells that are not affine "
                    f"({cell}), which FFCx does not compile correctly: take quadrature_degree 2"
                )
            integral = integral.reconstruct(metadata=at_middle(topology.dim))
        integrals.append(integral)
    return ufl.Form(integrals)


def _has_one_point(integral: ufl.Integral) -> bool:
    """Whether the rule was given, and is one point of cells that are not affine."""
    domain = integral.ufl_domain()
    simplex = domain.ufl_cargo().topology.cell_type.name in ("interval", "triangle", "tetrahedron")
    if simplex and domain.ufl_coordinate_element().degree == 1:
        return False
    rule = integral.metadata()
    kind = rule.get("quadrature_rule", "default")
    if kind == "custom":
        return len(rule["quadrature_points"]) == 1
    degree = rule.get("quadrature_degree", -1)
    return kind in ("default", "Gauss-Jacobi", "GJ") and degree in (0, 1)


@contextmanager
def _compiler_named(comm: MPI.Comm) -> Iterator[None]:
    """Say on every rank what FFCx needs where its C is not compiled. Collective."""
    # Rank 0 compiles, and only there is known what has failed.
    with everywhere(comm, "compiling a form"):
        try:
            yield
        except Exception as error:
            kinds = ("CompileError", "LinkError", "PlatformError")  # in messages of cffi
            if not any(kind in str(error) for kind in kinds):
                raise
            raise RuntimeError(
                "FFCx could not compile a form. It needs a C compiler (gcc, or the one that CC "
                "names) and the headers of Python (Python.h): apt install gcc libc6-dev "
                f"python3-dev, or conda install c-compiler. The error was: {error}"
            ) from error


def _folder(name: str) -> dict[str, Any]:
    cache: Path = jit.get_options()["cache_dir"]
    return {"cache_dir": cache / "dolfinx_contact" / name}
