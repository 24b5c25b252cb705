"""Indicators that sliding and rotation between bodies were not small."""

import logging

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    meshing,
)
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame

COMM = MPI.COMM_WORLD
SMALL_SLIDING = ("misfit", "slip of", "turn")


@pytest.fixture
def log():
    """Warnings, of rank 0 on every rank."""
    records = []

    class Keep(logging.Handler):
        def emit(self, record):
            records.append(record.getMessage())

    handler = Keep(logging.WARNING)
    logger = logging.getLogger("dolfinx_contact")
    logger.addHandler(handler)
    yield records
    logger.removeHandler(handler)


def said(log):
    """Number of the warnings about small sliding, on rank 0; the log is cleared."""
    count = sum(line.startswith(SMALL_SLIDING) for line in log)
    log.clear()
    return COMM.bcast(count)


def boxes(cell, n, width=3):
    """A unit block on one that is ``width`` wide, whose top is at 0; facets by tag 1 to 4."""
    flat = cell in ("triangle", "quadrilateral")
    kind = mesh.CellType[cell]
    side = (width - 1) / 2
    if flat:
        upper = mesh.create_rectangle(COMM, [[0, 0], [1, 1]], [n[0], n[0]], kind)
        size = [width * n[1], n[1]]
        lower = mesh.create_rectangle(COMM, [[-side, -1], [1 + side, 0]], size, kind)
    else:
        upper = mesh.create_box(COMM, [[0, 0, 0], [1, 1, 1]], [n[0]] * 3, kind)
        corners = [[-side, -side, -1], [1 + side, 1 + side, 0]]
        lower = mesh.create_box(COMM, corners, [width * n[1], width * n[1], n[1]], kind)
    parts = []
    for part, tags in ((upper, {1: 1.0, 2: 0.0}), (lower, {3: 0.0, 4: -1.0})):
        fdim = part.topology.dim - 1
        found = {
            tag: mesh.locate_entities_boundary(
                part, fdim, lambda x, axis=fdim, z=z: np.isclose(x[axis], z)
            )
            for tag, z in tags.items()
        }
        facets = np.concatenate(list(found.values()))
        values = np.concatenate([np.full(len(f), tag) for tag, f in found.items()])
        order = np.argsort(facets)
        marked = facets[order].astype(np.int32), values[order].astype(np.int32)
        parts.append(mesh.meshtags(part, fdim, *marked))
    return meshing.join([upper, lower], facet_tags=parts)


def stacked(
    cell="quadrilateral",
    n=(4, 4),
    *,
    degree=1,
    method=None,
    law=Coulomb(0.1),  # noqa: B008
    material=None,
    size=1.0,
):
    """Return two blocks on each other, clamped on their far sides by Functions.

    Returns:
        Problem, function ``move(slide, degrees)``, and the Function of the upper block.
    """
    body = boxes(cell, n)
    body.mesh.geometry.x[:] *= size
    domain = body.mesh
    dim = body.mesh.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    above = fem.Function(V)
    below = fem.Function(V)
    held = [
        fem.dirichletbc(f, fem.locate_dofs_topological(V, dim - 1, body.facet_tags.find(tag)))
        for f, tag in ((above, 1), (below, 4))
    ]
    pair = ContactPair(u, body.facet_tags, slave=2, master=3, law=law, method=method)
    material = material or LinearElastic.from_young(1000.0, 0.3)
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [pair], bcs=held)

    def move(slide=0.0, degrees=0.0, down=0.01):
        angle = np.radians(degrees)
        turn = np.eye(dim)
        turn[[0, 0, -1, -1], [0, -1, 0, -1]] = np.array(
            [np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)]
        )
        way = size * (turn @ (slide * np.eye(dim)[0] - down * np.eye(dim)[-1]))
        below.interpolate(lambda x: (turn - np.eye(dim)) @ x[:dim])
        above.interpolate(lambda x: (turn - np.eye(dim)) @ x[:dim] + way[:, None])

    return problem, move, above


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "options",
    [
        dict(),
        dict(cell="triangle", n=(4, 3)),
        dict(n=(3, 4), method="integral"),
        dict(cell="triangle", n=(4, 4), degree=2),
        dict(method="mixed"),
        dict(cell="hexahedron", n=(2, 2)),
        dict(cell="tetrahedron", n=(2, 1), method="integral"),
        dict(size=1e-4, n=(4, 3)),
    ],
    ids=str,
)
def test_small_sliding_warns_of_far_and_rotated_bodies(options, log):
    """Two per cent of a facet give no warning; most of one, beyond the edge, and degrees do."""
    problem, move, _ = stacked(**options)
    facet = 1 / options.get("n", (4, 4))[1]
    length = options.get("size", 1.0)
    move(0.02 * facet)
    result = problem.solve()
    (small,) = result.indicators.surfaces.values()
    assert small.slip < 0.03
    assert small.turn < 1
    assert result.misfit == small.misfit < 5e-4 * length
    assert result.warnings == {}
    assert said(log) == 0
    move(1.2 * facet)
    result = problem.solve()
    (far,) = result.indicators.surfaces.values()
    assert 0.9 < far.slip < 1.8  # of the root of the area of a triangle
    assert said(log) >= 1
    assert "slip of 'contact'" in result.warnings
    assert problem.uniqueness().verdict == "not proved"
    move(3.0)  # the block stands beyond the other one, on nothing
    result = problem.solve()
    assert "misfit of 'contact'" in result.warnings
    assert result.misfit == pytest.approx(2.0 * length, rel=0.2)
    assert said(log) >= 2
    for angle, few in ((1.5, True), (6.0, False), (90.0, False)):
        move(degrees=angle)
        result = problem.solve()
        assert ("turn of 'contact'" in result.warnings) != few
        # Linear strains are off by the square of the angle: blocks swell.
        turn = result.indicators.surfaces["contact"].turn
        assert turn == pytest.approx(angle, rel=0.35 if angle < 45 else 0.6)


def test_common_large_rotations_keep_the_forces(log):
    """Hyperelastic bodies turned together by 80 degrees have their forces in the old direction."""
    problem, move, _ = stacked(n=(2, 2), material=NeoHookean(*lame(1000.0, 0.3)))
    for angle in (0.0, 30.0, 60.0, 80.0):
        move(degrees=angle)
        result = problem.solve()
        assert ("turn of 'contact'" in result.warnings) == (angle > 0)
    assert result.indicators.surfaces["contact"].turn > 40
    assert sum(line.startswith("turn") for line in log) == 3 * (COMM.rank == 0)
