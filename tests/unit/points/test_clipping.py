"""What facets have in common, where they nearly coincide."""

import numpy as np
import pytest

from dolfinx_contact.points.clipping import Faces, cover

SHAPES = {
    "triangle": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    "quadrilateral": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
}


def faces(x, up):
    """Facets at height 0, the second number of corners in space."""
    corners = np.concatenate([x, np.zeros((*x.shape[:2], 1))], axis=2)
    normals = np.tile([0.0, 0.0, up], (len(x), 1))
    return Faces(corners, normals, np.zeros((len(x), 0), dtype=np.int64))


@pytest.mark.parametrize("size", [1.0, 1e-3])
@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-13, 1e-12, 3e-12, 1e-11, 1e-9])
@pytest.mark.parametrize("shape", SHAPES)
def test_facets_that_nearly_coincide(shape, off, size):
    """They cover each other, up to the distances of their corners."""
    rng = np.random.default_rng(3)
    n = 200
    mine = np.tile(SHAPES[shape], (n, 1, 1))
    theirs = mine + off * rng.uniform(-1.0, 1.0, mine.shape)
    pairs = np.tile(np.arange(n)[:, None], (1, 2))
    found = cover(faces(size * mine, 1.0), faces(size * theirs, -1.0), pairs, 1.0)
    areas = np.bincount(found.facet, found.rule(1).weights.sum(axis=1), n)
    whole = size**2 * (0.5 if shape == "triangle" else 1.0)
    assert np.abs(areas / whole - 1.0).max() <= 1e-9 + 10 * off


@pytest.mark.parametrize("overlap", [1e-7, 1e-5, 1e-4, 0.3])
def test_parts_of_a_master_that_overlap(overlap):
    """A little they both count; of layers the nearest."""
    square = SHAPES["quadrilateral"]
    left = np.array([0.5, 1.0]) * square
    right = np.array([0.5 + overlap, 1.0]) * square + np.array([0.5 - overlap, 0.0])
    master = faces(np.stack([left, right]), -1.0)
    master.x[1, :, 2] = -0.1
    found = cover(faces(square[None], 1.0), master, np.array([[0, 0], [0, 1]]), 1.0)
    covered = found.rule(1).weights.sum()
    if overlap < 0.1:
        assert covered == pytest.approx(1.0 + overlap, abs=1e-9)
    else:
        assert 0.5 <= covered <= 1.0 + 1e-9
