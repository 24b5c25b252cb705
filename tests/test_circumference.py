"""Bodies of revolution: integrals without the weight 2 pi r or with another, plane surfaces."""

from functools import lru_cache

from mpi4py import MPI

import numpy as np
import pytest
from blocks import box, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import Axisymmetric, LinearElastic, circumference, lame

COMM = MPI.COMM_WORLD
ELASTIC = LinearElastic.from_young(1000.0, 0.3)
TURNED = Axisymmetric(ELASTIC)
FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))
LAMBDA, MU = lame(1000.0, 0.3)
dx = ufl.dx
ds = ufl.ds


class Disc:
    """A disc on a floor, pressed by a hundredth of its height: the pressure is 10."""

    def __init__(self, inner=0.0):
        self.mesh = box(COMM, 3, "tri")
        self.mesh.geometry.x[:, 0] += inner
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(self.V)
        self.r = ufl.SpatialCoordinate(self.mesh)[0]
        self.around = circumference(self.mesh)
        self.energy = TURNED.energy(self.u)

    @property
    @lru_cache  # noqa: B019
    def parts(self):
        n = self.mesh.topology.index_map(2)
        cells = np.arange(n.size_local + n.num_ghosts, dtype=np.int32)
        upper = mesh.compute_midpoints(self.mesh, 2, cells)[:, 1] > 0.5
        return dx(subdomain_data=mesh.meshtags(self.mesh, 2, cells, 1 + upper.astype(np.int32)))

    def function(self, f, degree=1):
        g = fem.Function(fem.functionspace(self.mesh, ("Lagrange", degree)))
        g.interpolate(f)
        return g

    def strains(self, v):
        """rr, zz, around, and the shear."""
        return v[0].dx(0), v[1].dx(1), v[0] / self.r, v[0].dx(1) + v[1].dx(0)

    def problem(self, bulk, *, axisymmetric=True):
        bottom = facets(self.mesh, 1, 0.0)
        floor = dict(obstacle=FLOOR, law=Frictionless(), axisymmetric=axisymmetric)
        face = ContactSurface(self.u, bottom, **floor)
        top = fem.locate_dofs_topological(self.V.sub(1), 1, facets(self.mesh, 1, 1.0))
        bcs = [fem.dirichletbc(-0.01, top, self.V.sub(1))]
        return ContactProblem(bulk, self.u, [face], bcs=bcs)


def own(b, v, factor=1.0):
    """An energy with numbers as coefficients (v is None), or its residual."""
    e = b.strains(b.u)
    if v is None:
        squares = e[0] ** 2 + e[1] ** 2 + e[2] ** 2 + e[3] ** 2 / 2
        return factor * LAMBDA / 2 * (e[0] + e[1] + e[2]) ** 2 + factor * MU * squares
    d = b.strains(v)
    both = e[0] * d[0] + e[1] * d[1] + e[2] * d[2] + e[3] * d[3] / 2
    return LAMBDA * (e[0] + e[1] + e[2]) * (d[0] + d[1] + d[2]) + 2 * MU * both


#: Weights that are 2 pi r, in other words.
RIGHT = {
    "written out": lambda b: 2 * np.pi * b.energy * b.r * dx,
    "in the numbers": lambda b: own(b, None, 2 * np.pi) * b.r * dx,
    "half of it": lambda b: np.pi * b.r * own(b, None, 2.0) * dx,
    "of a residual": lambda b: own(b, ufl.TestFunction(b.V)) * b.around * dx,
    "a derivative": lambda b: ufl.derivative(b.energy * b.around * dx, b.u),
    "a Constant": lambda b: fem.Constant(b.mesh, 2 * np.pi) * b.energy * abs(b.r) * dx,
    "a Function": lambda b: 2 * np.pi * b.function(lambda x: x[0]) * b.energy * dx,
    "of parts": lambda b: b.energy * b.around * b.parts(1) + b.energy * b.around * b.parts(2),
}


def some_long(cases, short):
    """Names of cases; each compiles forms of its own, so that some are enough every time."""
    return [n if n in short else pytest.param(n, marks=pytest.mark.long) for n in cases]


@pytest.mark.parametrize("name", some_long(RIGHT, ["in the numbers", "of parts"]))
def test_the_weight_in_other_words(name, caplog):
    b = Disc()
    table = b.problem(RIGHT[name](b)).solve().tables["contact"]
    np.testing.assert_allclose(table.pressure, 10.0, rtol=1e-8)
    assert "2 pi" not in caplog.text


def test_what_varies_of_itself(caplog):
    """Graded materials, centrifugal forces, pressures, heat: data that vary like r or 1/r."""
    b = Disc(0.5)
    n = ufl.FacetNormal(b.mesh)
    ring = b.function(lambda x: 500 * x[0])
    graded = Axisymmetric(LinearElastic(ring, (1 + b.r) * MU)).energy(b.u)
    loads = 3.0 * b.r * b.u[0] - 2.0 * b.u[1] - sum(b.strains(b.u)[:3])
    line = 5.0 / (b.around * 1.0)  # a force over the height of a ring
    traction = line * b.u[0] + 0.1 * ufl.dot(n, b.u)
    b.problem((graded - loads) * b.around * dx - traction * b.around * ds)
    assert "2 pi" not in caplog.text


NO_TWO_PI = "weight x.0. with no 2 pi beside it"
NO_WEIGHT = "has not the weight 2 pi r"
#: What was silently solved, with a part of the reason for which it is refused.
WRONG = {
    "no weight": (NO_WEIGHT, lambda b: b.energy * dx),
    "r": (NO_TWO_PI, lambda b: b.energy * b.r * dx),
    "r beside numbers": (NO_TWO_PI, lambda b: own(b, None) * b.r * dx),
    "2 pi": (NO_WEIGHT, lambda b: 2 * np.pi * b.energy * dx),
    "r, a Function": (NO_TWO_PI, lambda b: b.function(lambda x: x[0]) * b.energy * dx),
    "2 pi r^2, a Function": (
        NO_WEIGHT,
        lambda b: b.function(lambda x: 2 * np.pi * x[0] ** 2, 2) * b.energy * dx,
    ),
    "a load that sets in": (
        NO_WEIGHT,
        lambda b: (b.energy * b.around + fem.Constant(b.mesh, 0.0) * b.u[1]) * dx,
    ),
    "a field that sets in": (
        NO_WEIGHT,
        lambda b: (b.energy * b.around + b.function(lambda x: 0 * x[0]) * b.u[1]) * dx,
    ),
    "a residual": (NO_WEIGHT, lambda b: own(b, ufl.TestFunction(b.V)) * dx),
    "a load": (NO_WEIGHT, lambda b: (b.energy * b.around + 3.0 * b.u[1]) * dx),
    "a pressure": (
        "over exterior facets .* has not the weight",
        lambda b: b.energy * b.around * dx + 3.0 * ufl.dot(ufl.FacetNormal(b.mesh), b.u) * ds,
    ),
    "one part": (
        "over the cells 2 .* has not the weight",
        lambda b: b.energy * b.around * b.parts(1) + b.energy * b.parts(2),
    ),
    "a plane part": (
        "plane body over the cells 1",
        lambda b: ELASTIC.energy(b.u) * b.around * b.parts(1) + b.energy * b.around * b.parts(2),
    ),
    "a graded body": (
        NO_WEIGHT,
        lambda b: Axisymmetric(LinearElastic(b.function(lambda x: 1 + x[0]), MU)).energy(b.u) * dx,
    ),
}


@pytest.mark.parametrize(
    "name", some_long(WRONG, ["r", "one part", "a plane part", "a load that sets in"])
)
def test_no_weight(name):
    reason, make = WRONG[name]
    for inner in (0.0, 0.5) if name == "no weight" else (0.0,):
        b = Disc(inner)
        with pytest.raises(ValueError, match=reason):
            b.problem(make(b))


def test_not_decided(caplog):
    """No factor 2 pi r, yet over it nothing varies: a hoop stress written out; pi is rounded."""
    b = Disc()
    hoop = MU * b.u[0] ** 2 / b.r - MU * b.strains(b.u)[2] ** 2 * b.r
    right = 2 * np.pi * (own(b, None) * b.r + hoop) * dx
    b.problem(right)
    assert COMM.rank > 0 or "not decided whether it has the weight 2 pi r" in caplog.text
    caplog.clear()
    b.problem(b.energy * b.around * dx + 2 * 3.14 * b.r * b.u[1] * dx)
    assert COMM.rank > 0 or "2 pi is rounded" in caplog.text


def test_plane_surfaces():
    b = Disc()
    for bulk, reason in (
        (b.energy * dx, "has the hoop strain .* surfaces are plane"),
        (b.energy * b.around * dx, "has the hoop strain .* surfaces are plane"),
        (own(b, ufl.TestFunction(b.V)) * dx, "has the hoop strain .* surfaces are plane"),
        (ELASTIC.energy(b.u) * b.around * dx, "the weight 2 pi x.0. .* surfaces are plane"),
    ):
        with pytest.raises(ValueError, match=reason):
            b.problem(bulk, axisymmetric=False)
    # Loads and foundations may have the coordinates in them.
    spring = b.u[0] ** 2 / (b.r + 1) - b.u[0] / (b.r + 1) - 2 * np.pi * b.r * b.u[1]
    b.problem((ELASTIC.energy(b.u) + spring) * dx, axisymmetric=False)


def test_damping():
    b = Disc()
    problem = b.problem(b.energy * b.around * dx)
    v = ufl.TestFunction(b.V)
    velocity = fem.Function(b.V)
    drag = ufl.dot(velocity, v)
    NSCD(problem, density=1.0, dt=0.01, velocity=velocity, damping=drag * b.around * dx)
    with pytest.raises(ValueError, match=r"the damping: .* has not the weight"):
        NSCD(problem, density=1.0, dt=0.01, velocity=velocity, damping=drag * dx)
