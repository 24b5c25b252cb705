"""Pairs of curved faces whose true shape is given: no gap is off by the sagitta of chords."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS
from support.pairs import displacement, tagged

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Frictionless,
    HalfSpace,
    RigidBody,
    Sphere,
)
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
INNER = 0.5  # radii of two tubes
MIDDLE = 1.0
OUTER = 1.6
OVERLAP = 1e-3


def tubes(inside, outside):
    """A quarter of two tubes, one pressed into the other; tags 2, 3 face to face, 5, 6 cut."""
    bodies = []
    tags = []
    ends = [(INNER, MIDDLE + OVERLAP), (MIDDLE, OUTER)]
    for i, (n, (a, b)) in enumerate(zip((inside, outside), ends, strict=True)):
        body = create_grid(COMM, [np.linspace(0, 1, n + 1), np.linspace(a, b, 9)], CELLS["quad"])
        planes = {f"t{2 * i + 1}": (1, a), f"t{2 * i + 2}": (1, b), "t5": (0, 0.0), "t6": (0, 1.0)}
        tags.append(tagged(body, **planes))
        angle = np.pi / 2 * (1 - body.geometry.x[:, 0])
        r = body.geometry.x[:, 1].copy()
        body.geometry.x[:, 0] = r * np.cos(angle)
        body.geometry.x[:, 1] = r * np.sin(angle)
        bodies.append(body)
    return join(bodies, facet_tags=tags)


def pressure(both, degree, **options):
    """Of the contact points, over that of Lame for two tubes of one material in plane strain."""
    u = displacement(both.mesh, degree)
    V = u.function_space
    ends = [
        fem.dirichletbc(
            0.0, fem.locate_dofs_topological(V.sub(i), 1, both.facet_tags.find(tag)), V.sub(i)
        )
        for i, tag in ((0, 5), (1, 6))
    ]
    pair = ContactPair(u, both, slave=3, master=2, law=Frictionless(), interference=True, **options)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    found = ContactProblem(energy, u, [pair], bcs=ends).solve().tables["contact"].pressure
    give = sum((b**2 + a**2) / (b**2 - a**2) for a, b in ((INNER, MIDDLE), (MIDDLE, OUTER)))
    return found / (OVERLAP / MIDDLE * 1000.0 / (1 - 0.3**2) / give)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.verifies(
    "press fits",
    reference="closed form: Lame's pressure",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_press_fit_with_its_true_shape_has_lames_pressure(degree):
    """The pressure of Lame, where the chords are off by several times the overlap."""
    both = tubes(12, 17)
    found = pressure(both, degree, surface=Sphere((0.0, 0.0), MIDDLE + OVERLAP))
    np.testing.assert_allclose(found, 1.0, rtol={1: 0.01, 2: 0.002}[degree])
    chords = pressure(both, degree)
    assert chords.max() > 2
    assert chords.min() < 0.1


@pytest.mark.ranks(2)
def test_pairs_refuse_true_surfaces():
    both = tubes(3, 4)
    u = displacement(both.mesh)
    disc, small = (Sphere((0.0, 0.0), radius) for radius in (MIDDLE + OVERLAP, MIDDLE))

    def refused(match, **options):
        with pytest.raises(ValueError, match=match) as info:
            discretise(ContactPair(u, both, slave=3, master=2, law=Frictionless(), **options))
        assert len(set(COMM.allgather(str(info.value)))) == 1

    refused("the surface must be a HalfSpace, Sphere", surface=1.0)
    still = RigidBody(small, about=(0, 0), held=["x", "y", "rz"])
    refused("the surface must be a HalfSpace, Sphere", surface=still)
    refused("a given surface has a gap and a normal of its own", surface=small, gap=0.0)
    refused(r"the gap to the given surface is -0\.001; interference=True", surface=disc)
    wrong = HalfSpace((0.0, 0.0), (0.0, 1.0))
    refused("nodes of the slave the normal of the given surface is another", surface=wrong)
    ContactPair(u, both, slave=3, master=2, law=Frictionless(), surface=small)
