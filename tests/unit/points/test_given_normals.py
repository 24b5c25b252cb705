"""Pairs of curved faces that look at each other in a given direction."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS, KINDS, box
from support.pairs import MATERIAL, displacement, held, tagged

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
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
BULGE = 0.2


def bulging(dim, cell, n, sign, first=1):
    """A box of height 1 resting on its bulge, or hanging from it; tags of face and far end."""
    body = box(COMM, n, cell)
    tags = tagged(body, **{f"t{first}": (dim - 1, 0.0), f"t{first + 1}": (dim - 1, 1.0)})
    x = body.geometry.x
    around = np.sum((x[:, : dim - 1] - 0.4) ** 2, axis=1)
    x[:, dim - 1] = sign * (x[:, dim - 1] + BULGE * around * (1 - x[:, dim - 1]))
    return body, tags


def pressed(dim, cell, sizes, law, **normal):
    """Two of them, pressed together and moved aside; the pair and its table."""
    bodies = [bulging(dim, cell, sizes[0], -1), bulging(dim, cell, sizes[1], 1, 3)]
    both = join([b for b, _ in bodies], facet_tags=[t for _, t in bodies])
    u = displacement(both.mesh)
    end = np.zeros(dim)
    end[0] = 0.01
    end[-1] = -0.04
    mirrored = end * [*[1.0] * (dim - 1), -1.0]
    ends = [held(u, both.facet_tags, 2, mirrored), held(u, both.facet_tags, 4, end)]
    pair = ContactPair(u, both, slave=3, master=1, law=law, **normal)
    options = {"snes_rtol": 1e-12}
    bulk = MATERIAL.energy(u) * ufl.dx
    problem = ContactProblem(bulk, u, [pair], bcs=ends, petsc_options=options)
    return problem.surfaces[0], problem.solve().tables["contact"]


def on_the_mirror(dim, cell, n, law):
    """One of them on the plane of symmetry; its table."""
    body, tags = bulging(dim, cell, n, 1)
    u = displacement(body)
    end = np.zeros(dim)
    end[0] = 0.01
    end[-1] = -0.04
    plane = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, tags, tag=1, obstacle=plane, law=law)
    options = {"snes_rtol": 1e-12}
    top = held(u, tags, 2, end)
    bulk = MATERIAL.energy(u) * ufl.dx
    problem = ContactProblem(bulk, u, [surface], bcs=[top], petsc_options=options)
    return problem.solve().tables["contact"]


def down(dim):
    return -3.0 * np.eye(dim)[-1]  # of any length


@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "matching meshes",
    "Coulomb",
    reference="itself: one body on the plane between",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_mirrored_bulges_match_along_the_given_normal(dim, cell):
    """They match along the given normal, and carry the forces of one body on the plane between.

    By symmetry they do so with friction, too.
    """
    n = 6 if dim == 2 else 3
    pair, table = pressed(dim, cell, (n, n), Coulomb(0.3), normal=down(dim))
    assert pair.obstacle.opposite.matching
    np.testing.assert_allclose(table.n, np.tile(down(dim) / 3, (len(table.n), 1)))
    assert set(table.letters) == {"o", "k"}
    alone = on_the_mirror(dim, cell, n, Frictionless())
    np.testing.assert_array_equal(table.letters == "o", alone.letters == "o")
    np.testing.assert_allclose(table.force, alone.force, atol=1e-9 * np.abs(alone.force).max())
    np.testing.assert_allclose(table.un, 2 * alone.un, atol=1e-9)


def test_without_given_normals_the_slave_decides():
    """Round faces do not match along their own normals, and forces lean by the slope of one."""
    pair, table = pressed(2, "quad", (6, 6), Frictionless())
    assert not pair.obstacle.opposite.matching
    assert np.abs(table.force[:, 0]).max() > 1e-3 * np.abs(table.force).max()


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("normal", "reason"),
    [
        ((0.0, 1.0), "more than 60 degrees off 6 facet normals of the slave"),
        ((ufl.as_ufl(0.0), -1.0), "the normal must be numbers, got"),
        ((2.0, -1.0), "more than 60 degrees off"),
    ],
)
def test_given_normals_refuse_bad_input(normal, reason):
    with pytest.raises(ValueError, match=reason):
        pressed(2, "quad", (6, 6), Frictionless(), normal=normal)


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
    """Return the contact pressure over Lame's for two tubes of one material in plane strain."""
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

    still = RigidBody(small, about=(0, 0), held=["x", "y", "rz"])
    refused("the surface must be a HalfSpace, Sphere", surface=still)
    refused(r"the gap to the given surface is -0\.001; interference=True", surface=disc)
    wrong = HalfSpace((0.0, 0.0), (0.0, 1.0))
    refused("the normal of the given surface deviates from the slave normal", surface=wrong)
    ContactPair(u, both, slave=3, master=2, law=Frictionless(), surface=small)
