"""Manufactured solutions: displacement and tractions are prescribed, loads and gaps follow.

On the face y = 0 of a block above it (in space z = 0) are chosen: the slip a, the height b, the
pressure p and the shear t, within the law: open left of `OPENS`, stuck up to `SLIPS`, slipping
beyond. With u = (a + y c, b + y d) Hooke's law on the face gives

    mu (c + grad b) = -t,        (lambda + 2 mu) d + lambda div a = -p,

and the body force is -div sigma(u). All is written here, and nothing of the package is used but the
solve. From the command line, the table of orders is written anew (minutes):

    docker/run env PYTHONPATH=.:tests:benchmarks python3 tests/support/manufactured.py
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem
from ufl.domain import extract_unique_domain

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    NormalCompliance,
    Regularised,
    Tresca,
)
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.laws import RCCM, BilinearCohesive
from dolfinx_contact.materials import Axisymmetric, LinearElastic, NeoHookean
from dolfinx_contact.obstacles import Cylinder, LevelSet, Obstacle, Sphere
from support.blocks import box, facets, interpolate

COMM = MPI.COMM_WORLD
TABLE = Path(__file__).parents[1] / "data" / "orders.csv"
OPENS = 0.25  # both at nodes, or orders depend on where between them they are
SLIPS = 0.5
SIZE = 0.01  # of displacements and tractions, for which sliding is small
LAMBDA = 1.2
MU = 0.8
STIFFNESS = 5.0  # of compliance
WIDTH = 0.02 * SIZE  # of regularised friction
STEEL = LinearElastic(LAMBDA, MU)


class GapField(Obstacle):
    """A flat obstacle below with a gap of its own at every point."""

    def __init__(self, gap):
        self.gap = gap

    @property
    def flat(self):
        return True

    def on(self, domain):
        down = np.zeros(domain.geometry.dim)
        down[-1] = -1.0
        return self.gap, fem.Constant(domain, down)


def beyond(x, start, power):
    """(x - start)_+^power."""
    return ufl.conditional(ufl.gt(x, start), x - start, 0.0) ** power


def hooke(H):
    """Stress of a displacement gradient (dim, dim)."""
    return LAMBDA * ufl.tr(H) * ufl.Identity(H.ufl_shape[0]) + MU * (H + H.T)


@dataclass(frozen=True)
class Exact:
    """A solution in UFL.

    Attributes:
        u: displacement.
        pressure: pressure p on the face.
        gap: gap of the obstacle.
        friction: coefficient F.
        bound: bound g of Tresca's law, 0 where the face is open.
    """

    u: object
    pressure: object
    gap: object
    friction: object
    bound: object


def exact(x, law, *, axisymmetric=False, below=False, way=1.0, slope=0.2):
    """Return the data of a law, or of the lower body of a pair with the same tractions.

    All points slip in one direction; ``way`` -1 reverses it. The friction coefficient grows by
    ``slope`` along the face.
    """
    dim = len(x)
    s = x[0]
    along = [way] if dim == 2 else [0.8 * way, 0.6 * way]
    y = x[dim - 1]
    depth = 1.0 if dim == 2 else 1.0 + 0.3 * x[1] ** 2
    friction = 0.3 + slope * s
    p = 3.0 * SIZE * beyond(s, OPENS, 2) * depth
    bound = 0.5 * SIZE * beyond(s, OPENS, 2) * (1.0 + s)
    reached = 1.0 - 10.0 * beyond(-s, -SLIPS, 3)
    most = {"frictionless": 0.0, "Tresca": bound}.get(law, friction * p)
    size = (0.0 if below else 0.5 * SIZE) * beyond(s, SLIPS, 3) * depth
    if law == "regularised":
        x = ufl.exp(2.0 * size / WIDTH)
        reached = (x - 1.0) / (x + 1.0)
    shear = -reached * most
    open_ = SIZE * beyond(-s, -OPENS, 3)
    b = 0.05 * SIZE * (1.0 - s**2) - (open_ if below else 0.0)
    a = [size * e for e in along]
    slope = ufl.grad(b)
    divergence = 0.0 if below else sum(ufl.grad(a[i])[i] for i in range(dim - 1))
    if axisymmetric:
        divergence += a[0] / ufl.conditional(ufl.gt(s, SLIPS), s, 1.0)
    c = [-shear * e / MU - slope[i] for i, e in enumerate(along)]
    d = (-p - LAMBDA * divergence) / (LAMBDA + 2 * MU)
    u = ufl.as_vector([*(a[i] + y * c[i] for i in range(dim - 1)), b + y * d])
    gap = -b + open_ - (p / STIFFNESS if law == "compliance" else 0.0)
    return Exact(u, p, gap, friction, bound)


def law_of(name, e):
    return {
        "frictionless": lambda: Frictionless(),
        "Coulomb": lambda: Coulomb(e.friction),
        "Tresca": lambda: Tresca(e.bound),
        "regularised": lambda: Regularised(Coulomb(e.friction), WIDTH),
        "compliance": lambda: NormalCompliance(STIFFNESS, friction=Coulomb(e.friction)),
    }[name]()


def prescribed(V, value, where):
    """Dirichlet data of a UFL displacement on facets."""
    f = fem.Function(V)
    interpolate(f, value)
    return fem.dirichletbc(f, fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, where))


def sides(domain):
    """1 on facets that are upright, else 0."""
    n = ufl.FacetNormal(domain)
    return ufl.conditional(ufl.lt(abs(n[len(n) - 1]), 0.5), 1.0, 0.0)


def loads(stress, v, side=1.0):
    """Return minus the virtual work of body force and tractions at the sides, by Green's formula.

    It is the work of the stress minus the work of the contact traction on the face, of the body
    above the face (``side`` 1) or below it (-1).
    """
    domain = extract_unique_domain(v)
    height = side * ufl.SpatialCoordinate(domain)[len(v) - 1]
    n = ufl.FacetNormal(domain)
    at_face = ufl.And(ufl.lt(abs(height), 1e-9), ufl.lt(side * n[len(v) - 1], -0.5))
    face = ufl.conditional(at_face, 1.0, 0.0) * ufl.dot(ufl.dot(stress, n), v)
    inside = ufl.conditional(ufl.gt(height, 0.0), 1.0, 0.0) * ufl.inner(stress, ufl.grad(v))
    metadata = {"quadrature_degree": 6}
    return face * ufl.ds(metadata=metadata) - inside * ufl.dx(metadata=metadata)


def grown(a, b, traction, y):
    """u = (a + y c, b + y d) of a body above y = 0, with a traction on its face; a may be 0."""
    stretch = ufl.grad(a)[0] if a else 0.0
    c = -traction[0] / MU - ufl.grad(b)[0]
    d = (-traction[1] - LAMBDA * stretch) / (LAMBDA + 2 * MU)
    return ufl.as_vector([a + y * c, b + y * d])


def norm(domain, value, weight=1.0):
    form = fem.form(ufl.inner(value, value) * weight * ufl.dx(metadata={"quadrature_degree": 8}))
    return np.sqrt(domain.comm.allreduce(fem.assemble_scalar(form)))


def errors(u, e, table, weight=1.0, known=None):
    """Relative errors: of displacement and gradient in L2, of the pressure at the points."""
    domain = u.function_space.mesh
    p = pressures(table) if known is None else known
    return {
        "displacement": norm(domain, u - e.u, weight) / norm(domain, e.u, weight),
        "gradient": norm(domain, ufl.grad(u - e.u), weight) / norm(domain, ufl.grad(e.u), weight),
        "pressure": np.sqrt(
            np.sum(table.area * (table.pressure - p) ** 2) / np.sum(table.area * p**2)
        ),
    }


def pressures(table):
    """The prescribed pressure at contact points, in numpy."""
    x = table.x
    depth = 1.0 if x.shape[1] == 2 else 1.0 + 0.3 * x[:, 1] ** 2
    return 3.0 * SIZE * np.maximum(x[:, 0] - OPENS, 0.0) ** 2 * depth


def statics(n, cell, law, degree=1, method=None, way=1.0, slope=0.2):
    """A block on an obstacle."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    e = exact(ufl.SpatialCoordinate(domain), law, way=way, slope=slope)
    stress = hooke(ufl.grad(e.u))
    dx = ufl.dx(metadata={"quadrature_degree": 6})
    ds = ufl.ds(metadata={"quadrature_degree": 6})
    traction = ufl.dot(stress, ufl.FacetNormal(domain))
    residual = ufl.inner(STEEL.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    residual += ufl.dot(ufl.div(stress), v) * dx - sides(domain) * ufl.dot(traction, v) * ds
    bottom = facets(domain, dim - 1, 0.0)
    law = law_of(law, e)
    surface = ContactSurface(u, bottom, obstacle=GapField(e.gap), law=law, method=method)
    bcs = [prescribed(V, e.u, facets(domain, dim - 1, 1.0))]
    result = ContactProblem(residual, u, [surface], bcs=bcs).solve(progress=False)
    return errors(u, e, result.tables["contact"])


def revolution(n, cell, law, degree=1):
    """A disc on an obstacle, open about its axis, that slips outwards."""
    domain = box(COMM, n, cell)
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    x = ufl.SpatialCoordinate(domain)
    r = x[0]
    e = exact(x, law, axisymmetric=True)
    H = ufl.grad(e.u)
    around = e.u[0] / ufl.conditional(ufl.gt(r, 1e-9), r, 1.0)
    trace = ufl.tr(H) + around
    s = LAMBDA * trace * ufl.Identity(2) + MU * (H + H.T)
    hoop = LAMBDA * trace + 2 * MU * around
    force = -ufl.div(s) - ufl.as_vector([s[0, 0] - hoop, s[0, 1]]) / r
    dx = ufl.dx(metadata={"quadrature_degree": 6})
    energy = Axisymmetric(STEEL).energy(u) * ufl.dx - ufl.dot(force, u) * dx
    outside = ufl.conditional(ufl.gt(r, 0.5), sides(domain), 0.0)
    traction = ufl.dot(s, ufl.FacetNormal(domain))
    energy -= outside * ufl.dot(traction, u) * ufl.ds(metadata={"quadrature_degree": 6})
    surface = ContactSurface(
        u,
        facets(domain, 1, 0.0),
        obstacle=GapField(e.gap),
        law=law_of(law, e),
        axisymmetric=True,
    )
    bcs = [prescribed(V, e.u, facets(domain, 1, 1.0))]
    result = ContactProblem(energy, u, [surface], bcs=bcs).solve(progress=False)
    return errors(u, e, result.tables["contact"], r)


def pair(n, cell, law, other=1.0, degree=1):
    """Two blocks, n cells along the face of the upper one, ``other`` times as many of the lower."""
    from support.mortars import stacked

    both = stacked(int(other * n), n, (0.0, 1.0), (0.0, 1.0), cell)
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    x = ufl.SpatialCoordinate(domain)
    upper = exact(x, law)
    lower = exact(x, law, below=True)
    above = ufl.gt(x[1], 0.0)
    whole = Exact(
        ufl.conditional(above, upper.u, lower.u), upper.pressure, None, upper.friction, upper.bound
    )
    dx = ufl.dx(metadata={"quadrature_degree": 6})
    ds = ufl.ds(metadata={"quadrature_degree": 6})
    residual = ufl.inner(STEEL.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    for e, part in ((upper, above), (lower, ufl.Not(above))):
        stress = hooke(ufl.grad(e.u))
        here = ufl.conditional(part, 1.0, 0.0)
        residual += here * ufl.dot(ufl.div(stress), v) * dx
        traction = ufl.dot(stress, ufl.FacetNormal(domain))
        residual -= here * sides(domain) * ufl.dot(traction, v) * ds
    contact = ContactPair(u, both, slave=3, master=2, law=law_of(law, upper))
    tags = both.facet_tags
    bcs = [prescribed(V, e.u, tags.find(t)) for e, t in ((upper, 4), (lower, 1))]
    result = ContactProblem(residual, u, [contact], bcs=bcs).solve(progress=False)
    (table,) = result.tables.values()
    return errors(u, whole, table)


def rubber(n, cell):
    """A block with strains of a third, that slips along a floor by a tenth of its length."""
    domain = box(COMM, n, cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    x = ufl.SpatialCoordinate(domain)
    a = 0.05 + 0.1 * x[0]
    c = 0.3 + 0.1 * x[0] ** 2
    d = -0.2 - 0.1 * x[0]
    prescribed_u = ufl.as_vector([a + x[1] * c, x[1] * d])
    F = ufl.Identity(2) + ufl.grad(prescribed_u)
    G = ufl.inv(F).T
    P = MU * (F - G) + LAMBDA * ufl.ln(ufl.det(F)) * G
    p = -P[1, 1]
    e = Exact(prescribed_u, p, 0.0, P[0, 1] / p, None)
    dx = ufl.dx(metadata={"quadrature_degree": 6})
    ds = ufl.ds(metadata={"quadrature_degree": 6})
    traction = ufl.dot(P, ufl.FacetNormal(domain))
    energy = NeoHookean(LAMBDA, MU).energy(u) * dx + ufl.dot(ufl.div(P), u) * dx
    energy -= sides(domain) * ufl.dot(traction, u) * ds
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    bottom = facets(domain, 1, 0.0)
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(e.friction))
    bcs = [prescribed(V, e.u, facets(domain, 1, 1.0))]
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    table = problem.solve(progress=False).tables["contact"]
    s = table.x[:, 0]
    # P on the face, in numpy.
    F = np.zeros((len(s), 2, 2))
    F[:, 0, 0], F[:, 0, 1], F[:, 1, 1] = 1.1, 0.3 + 0.1 * s**2, 0.8 - 0.1 * s
    G = np.linalg.inv(F).swapaxes(1, 2)
    J = np.linalg.det(F)[:, None, None]
    known = -(MU * (F - G) + LAMBDA * np.log(J) * G)[:, 1, 1]
    return errors(u, e, table, known=known)


ENDS = 0.75  # contact, of what slides far
SLIDE = 0.35
STRETCH = 1.0  # of the slip, over the cube of the distance from SLIPS


def slid(x, last, *, below):
    """Return a body of a pair in large sliding, and its displacement; at first all slips.

    The upper body has slid by SLIDE, and then by STRETCH (s - SLIPS)^3 more where s > SLIPS. The
    point of the lower body opposite to s is at s + slide, by Cardano's formula. The face of both is
    a wave, whose normal is the normal of the law. Tractions are per length of the upper face in the
    mesh.
    """
    s = x[0]
    place = x[0]
    if below:
        w = place - SLIDE - SLIPS
        root = 1.5 * np.sqrt(3.0 * STRETCH) * w
        root = ufl.ln(root + ufl.sqrt(root**2 + 1.0)) / 3.0
        ahead = 2.0 / np.sqrt(3.0 * STRETCH) * ufl.sinh(root)
        s = SLIPS + (ufl.conditional(ufl.gt(w, 0.0), ahead, w) if last else w)
    else:
        place = s + SLIDE + (STRETCH * beyond(s, SLIPS, 3) if last else 0.0)
    slope = -0.1 * ufl.sin(2.0 * place)
    size = ufl.sqrt(1.0 + slope**2)
    p = 25.6 * beyond(s, OPENS, 2) * beyond(-s, -ENDS, 2)
    reached = 1.0 - (10.0 * beyond(-s, -SLIPS, 3) if last else 0.0)
    friction = 0.3 + 0.2 * s
    shear = -reached * friction * p
    traction = ufl.as_vector([-p * slope + shear, p + shear * slope]) / size
    b = 0.05 * ufl.cos(2.0 * place)
    if below:
        u = grown(0.0, b, traction * ufl.grad(s)[0], x[1])
    else:
        gap = 0.5 * (beyond(-s, -OPENS, 3) + beyond(s, ENDS, 3))
        u = grown(place - s, b + gap, traction, x[1])
    return Exact(u, p, None, friction, None)


def sliding(n, cell, other=0.75):
    """Two blocks of different meshes after a long slide, slipping and sticking in a second step."""
    from support.mortars import stacked

    both = stacked(int(2 * other * n), n, (-0.25, 1.75), (0.0, 1.0), cell)
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    x = ufl.SpatialCoordinate(domain)
    above = ufl.gt(x[1], 0.0)
    second = fem.Constant(domain, 0.0)
    residual = ufl.inner(STEEL.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    stages = []
    for last, share in ((False, 1.0 - second), (True, second)):
        parts = [slid(x, last, below=below) for below in (False, True)]
        for e, side in zip(parts, (1.0, -1.0), strict=True):
            residual += share * loads(hooke(ufl.grad(e.u)), v, side)
        stages.append(parts)
    start, (upper, lower) = stages
    pair = ContactPair(u, both, slave=3, master=2, law=Coulomb(upper.friction), sliding="large")
    ends = [both.facet_tags.find(tag) for tag in (4, 1)]
    held = [[prescribed(V, e.u, end) for e, end in zip(s, ends, strict=True)] for s in stages]
    bcs = [fem.dirichletbc(fem.Function(V), b.dof_indices()[0] // 2) for b in held[0]]

    def load(time):
        second.value = time
        for bc, first, end in zip(bcs, *held, strict=True):
            bc.g.x.array[:] = (1.0 - time) * first.g.x.array + time * end.g.x.array

    problem = ContactProblem(residual, u, [pair], bcs=bcs)
    load(0.0)
    # Newton's method begins where the bodies lie over each other: other states are folded.
    first = ufl.conditional(above, *(e.u for e in start))
    interpolate(u, first)
    problem.solve(progress=False)
    QuasiStatic(problem, load).run([0.0, 1.0], progress=False)
    whole = Exact(ufl.conditional(above, upper.u, lower.u), *[None] * 4)
    table = problem.table(pair)
    s = table.x[:, 0]
    known = 25.6 * (np.maximum(s - OPENS, 0.0) * np.maximum(ENDS - s, 0.0)) ** 2
    return errors(u, whole, table, known=known)


SPRINGS = 0.6, 1.0  # of a bond, across and along the face
WEAK = 0.2  # what is broken of it before the load
OFTEN = 3.0  # size of the jump at which it breaks, over that at which it begins to


def adhesive(n, cell, law):
    """A block that bonds hold, which weaken where it is open and where it slips most."""
    domain = box(COMM, n, cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    s, y = ufl.SpatialCoordinate(domain)
    friction = 0.5 + 0.2 * s
    p = 30.0 * SIZE * beyond(s, OPENS, 2)
    gap = 20.0 * SIZE * beyond(-s, -OPENS, 3)
    a = 5.0 * SIZE * beyond(s, SLIPS, 3)
    lost = WEAK + 2.0 * (beyond(-s, -OPENS / 2, 2) + beyond(s, 0.75, 2))
    weakens = ufl.Or(ufl.lt(s, OPENS / 2), ufl.gt(s, 0.75))
    if law == "RCCM":
        across, along = SPRINGS
        share = (1.0 - lost) ** 2
        work = (across * gap**2 + along * a**2) * (1.0 - lost)
        work = ufl.conditional(weakens, work, 1.0)
        bond = RCCM(across, along, work, friction=friction, beta=1.0 - WEAK)
    else:
        across = along = SPRINGS[1]
        share = 1.0 - lost
        elastic = ufl.sqrt(gap**2 + a**2) * (1.0 - lost * (OFTEN - 1.0) / OFTEN)
        elastic = ufl.conditional(weakens, elastic, 1.0)
        soft = (OFTEN - 1.0) * elastic
        bond = BilinearCohesive(along * elastic, elastic, soft, friction=friction, damage=WEAK)
    reached = 1.0 - 10.0 * beyond(-s, -SLIPS, 3)
    shear = -share * along * a - reached * friction * lost * p
    traction = ufl.as_vector([shear, p - share * across * gap])
    b = 0.05 * SIZE * (1.0 - s**2)
    e = Exact(grown(a, b, traction, y), p, gap - b, friction, None)
    residual = ufl.inner(STEEL.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    residual += loads(hooke(ufl.grad(e.u)), v)
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=GapField(e.gap), law=bond)
    bcs = [prescribed(V, e.u, facets(domain, 1, 1.0))]
    # Newton's method begins near: bonds that weaken are no monotone law.
    interpolate(u, e.u)
    result = ContactProblem(residual, u, [surface], bcs=bcs).solve(progress=False)
    table = result.tables["contact"]
    x = table.x[:, 0]
    known = WEAK + 2.0 * (np.maximum(OPENS / 2 - x, 0.0) ** 2 + np.maximum(x - 0.75, 0.0) ** 2)
    (variable,) = table.internal
    found = table.internal[variable]
    found = 1.0 - found if variable == "beta" else found
    off = np.sqrt(np.sum(table.area * (found - known) ** 2))
    most = np.sqrt(np.sum(table.area * (known - WEAK) ** 2))
    return errors(u, e, table, known=10.0 * pressures(table)) | {"damage": off / most}


RADIUS = 1.6


def curved(n, cell, kind, comes=False):
    """A block whose face lies on a curved obstacle, far from where it was, and slips; open aside.

    With ``comes`` the obstacle is first away, and has come in a step of a history.
    """
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    x = ufl.SpatialCoordinate(domain)
    s = x[0]
    place = s + 0.1 + 0.1 * s**2
    height = ufl.sqrt(RADIUS**2 - (place - 0.5) ** 2) - RADIUS
    friction = 0.3 + 0.2 * s
    p = 10.0 * SIZE * beyond(s, OPENS, 2)
    slope = -(place - 0.5) / (height + RADIUS)
    t = -friction * p
    size = ufl.sqrt(1.0 + slope**2)
    traction = ufl.as_vector([-p * slope + t, p + t * slope]) / size
    moved = grown(place - s, height + 0.5 * beyond(-s, -OPENS, 3), traction, x[dim - 1])
    moved = moved if dim == 2 else ufl.as_vector([moved[0], 0.0, moved[1]])
    e = Exact(moved, p, None, friction, None)
    time = fem.Constant(domain, 1.0)
    below = -RADIUS - (0.3 * (1.0 - time) if comes else 0.0)
    obstacle = {
        "ball": lambda: Sphere((0.5, below), RADIUS),
        "cylinder": lambda: Cylinder((0.5, 0.0, below), (0.0, 1.0, 0.0), RADIUS),
        "level set": lambda: LevelSet(
            lambda y: y[1] + RADIUS - ufl.sqrt(RADIUS**2 - (y[0] - 0.5) ** 2)
        ),
    }[kind]()
    residual = ufl.inner(STEEL.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    residual += time * loads(hooke(ufl.grad(e.u)), v)
    bottom, upper = (facets(domain, dim - 1, height) for height in (0.0, 1.0))
    surface = ContactSurface(u, bottom, obstacle=obstacle, law=Coulomb(friction), sliding="large")
    end = prescribed(V, e.u, upper)
    top = fem.Function(V)
    bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, dim - 1, upper))]

    def load(now):
        time.value = now
        top.x.array[:] = now * end.g.x.array

    problem = ContactProblem(residual, u, [surface], bcs=bcs)
    load(0.0 if comes else 1.0)
    problem.solve(progress=False)
    if comes:
        QuasiStatic(problem, load).run([0.0, 1.0], progress=False)
    table = problem.table(surface)
    known = 10.0 * SIZE * np.maximum(table.x[:, 0] - OPENS, 0.0) ** 2
    return errors(u, e, table, known=known)


TURN = 1.5  # by which the slip turns in the unit of time
PRESSURE = 0.1
FRICTION = 0.4


class Turning:
    """A cube whose slip turns: u = (a(t) + z c(t), z d), affine, so that only steps are in error.

    a is an arc, c the shear against its direction of the size F p/mu, d of the uniform pressure.
    """

    def __init__(self):
        domain = box(COMM, 2, "hex")
        self.V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
        self.u = fem.Function(self.V)
        self.shear = fem.Constant(domain, np.zeros(2))
        n = ufl.FacetNormal(domain)
        d = -PRESSURE / (LAMBDA + 2 * MU)
        c = self.shear
        stress = hooke(ufl.as_matrix([[0, 0, c[0]], [0, 0, c[1]], [0, 0, d]]))
        energy = STEEL.energy(self.u) * ufl.dx
        energy -= sides(domain) * ufl.dot(ufl.dot(stress, n), self.u) * ufl.ds
        self.energy = energy
        floor = HalfSpace(np.zeros(3), (0.0, 0.0, 1.0))
        bottom = facets(domain, 2, 0.0)
        surface = ContactSurface(self.u, bottom, obstacle=floor, law=Coulomb(FRICTION))
        self.top = fem.Function(self.V)
        held = fem.locate_dofs_topological(self.V, 2, facets(domain, 2, 1.0))
        bcs = [fem.dirichletbc(self.top, held)]
        self.problem = ContactProblem(energy, self.u, [surface], bcs=bcs)

    def field(self, time):
        """The displacement at the nodes."""
        x = self.V.tabulate_dof_coordinates()
        a, c = self.motion(time)
        d = -PRESSURE / (LAMBDA + 2 * MU)
        return np.column_stack([a + np.outer(x[:, 2], c), d * x[:, 2]]).ravel()

    def motion(self, time):
        """a and c."""
        angle = TURN * time
        a = 0.1 / TURN * np.array([np.sin(angle), 1.0 - np.cos(angle)])
        return a, FRICTION * PRESSURE / MU * np.array([np.cos(angle), np.sin(angle)])

    def load(self, time):
        self.top.x.array[:] = self.field(time)
        self.shear.value = self.motion(time)[1]

    def error(self, time):
        """Return the error of the displacement over the slip, and of the shear over the bound."""
        found = self.u.x.array - self.field(time)
        largest = COMM.allreduce(float(np.abs(found).max(initial=0.0)), op=max)
        table = self.problem.table(self.problem.surfaces[0])
        shear = table.shear[:, :2] + MU * self.motion(time)[1]
        return {
            "displacement": largest / 0.1,
            "shear": np.abs(shear).max() / (FRICTION * PRESSURE),
        }


def history(n):
    """A slip that turns, in n steps."""
    body = Turning()
    body.load(0.0)
    body.problem.solve(progress=False)
    QuasiStatic(body.problem, body.load).run(np.linspace(0.0, 1.0, n + 1), progress=False)
    return body.error(1.0)


class TurningInTime(Turning):
    """The same with mass, of density 1: the velocity is a' + z c', the force its derivative."""

    def __init__(self):
        super().__init__()
        domain = self.V.mesh
        self.forces = [fem.Constant(domain, np.zeros(3)) for _ in range(2)]
        z = ufl.SpatialCoordinate(domain)[2]
        load = ufl.dot(self.forces[0] + z * self.forces[1], self.u) * ufl.dx
        static = self.problem
        energy = self.energy - load
        self.problem = ContactProblem(energy, self.u, static.contacts, bcs=static.bcs)

    def load(self, time):
        super().load(time)
        angle = TURN * time
        self.forces[0].value[:2] = 0.1 * TURN * np.array([-np.sin(angle), np.cos(angle)])
        self.forces[1].value[:2] = -(TURN**2) * self.motion(time)[1]

    def velocity(self):
        """At the start, a Function."""
        v = fem.Function(self.V)
        v.x.array[0::3] = 0.1
        z = self.V.tabulate_dof_coordinates()[:, 2]
        v.x.array[1::3] = TURN * FRICTION * PRESSURE / MU * z
        return v


def motion(n):
    """The slip that turns, of a body with mass, in n steps."""
    body = TurningInTime()
    body.load(0.0)
    body.u.x.array[:] = body.field(0.0)
    start = body.velocity()
    moving = NSCD(
        body.problem, 1.0, dt=1.0 / n, load=body.load, velocity=start, theta=1.0, mass="consistent"
    )
    moving.run([0.0, 1.0], progress=False)
    return body.error(1.0)


@dataclass(frozen=True)
class Manufactured:
    """A row of tables: problem, meshes or numbers of steps, and expected orders.

    Attributes:
        feature: name of the feature in the manual.
        words: description for readers.
        solve: function of each of ``n`` that returns relative errors by name.
        n: numbers of cells along an edge, or of steps.
        orders: theoretical orders by the names of errors.
        long: whether it takes more than a few seconds.
    """

    feature: str
    words: str
    solve: Callable
    n: tuple
    orders: dict
    long: bool = True

    def measured(self):
        """Orders between the last two, and the last errors, by names."""
        found = [self.solve(n) for n in self.n]
        ratio = np.log(self.n[-1] / self.n[-2])
        orders = {k: float(np.log(found[-2][k] / found[-1][k]) / ratio) for k in self.orders}
        return orders, {k: float(found[-1][k]) for k in self.orders}


LINEAR = {"displacement": 2, "gradient": 1, "pressure": 1}
QUADRATIC = {"displacement": 3, "gradient": 2, "pressure": 2}
BLOCK = "block on an obstacle, "
COULOMB = "open, stick, slip, friction 0.3 + 0.2 x"
FAR = "two blocks, 4 facets on 3, slid by 0.35 over a wave; open, stick, slip in a second step"
WEAKENING = LINEAR | {"damage": 1}
BONDS = "block on an obstacle with bonds, weaker where it is open and where it slips most; stick"
LYING = "block that lies, open and slipping, on a {}; slips by a tenth to a fifth"
#: By names.
CASES = {
    "frictionless": Manufactured(
        "Signorini",
        f"{BLOCK}open and closed",
        partial(statics, cell="tri", law="frictionless"),
        (16, 32),
        LINEAR,
    ),
    "Coulomb": Manufactured(
        "Coulomb",
        f"{BLOCK}{COULOMB}",
        partial(statics, cell="tri", law="Coulomb"),
        (8, 16),
        LINEAR,
        long=False,
    ),
    "Coulomb quad": Manufactured(
        "Coulomb",
        f"{BLOCK}{COULOMB}",
        partial(statics, cell="quad", law="Coulomb"),
        (16, 32),
        LINEAR,
    ),
    "Coulomb P2": Manufactured(
        "integral contact",
        f"{BLOCK}{COULOMB}, degree 2; slip to the left",
        partial(statics, cell="tri", law="Coulomb", degree=2, method="integral", way=-1.0),
        (8, 16),
        QUADRATIC,
        long=False,
    ),
    "Coulomb tet": Manufactured(
        "Coulomb", f"{BLOCK}{COULOMB}", partial(statics, cell="tet", law="Coulomb"), (6, 12), LINEAR
    ),
    "Coulomb hex": Manufactured(
        "Coulomb", f"{BLOCK}{COULOMB}", partial(statics, cell="hex", law="Coulomb"), (8, 16), LINEAR
    ),
    "Tresca": Manufactured(
        "Tresca",
        f"{BLOCK}open, stick, slip, a bound that grows",
        partial(statics, cell="tri", law="Tresca"),
        (16, 32),
        LINEAR,
    ),
    "compliance": Manufactured(
        "normal compliance",
        f"{BLOCK}{COULOMB}",
        partial(statics, cell="tri", law="compliance"),
        (16, 32),
        LINEAR,
    ),
    "matching pair": Manufactured(
        "matching meshes",
        f"two blocks, {COULOMB}",
        partial(pair, cell="tri", law="Coulomb"),
        (16, 32),
        LINEAR,
    ),
    "mortar": Manufactured(
        "mortar",
        f"two blocks, 2 facets on 3, {COULOMB}",
        partial(pair, cell="quad", law="Coulomb", other=1.5),
        (8, 16),
        LINEAR,
        long=False,
    ),
    "revolution": Manufactured(
        "bodies of revolution",
        f"disc on an obstacle, {COULOMB}",
        partial(revolution, cell="tri", law="Coulomb"),
        (16, 32),
        LINEAR,
    ),
    "rubber tri": Manufactured(
        "hyperelastic bodies",
        "neo-Hookean block that slips by a tenth",
        partial(rubber, cell="tri"),
        (8, 16),
        LINEAR,
        long=False,
    ),
    "rubber quad": Manufactured(
        "hyperelastic bodies",
        "neo-Hookean block that slips by a tenth",
        partial(rubber, cell="quad"),
        (16, 32),
        LINEAR,
    ),
    "regularised": Manufactured(
        "regularised friction",
        f"{BLOCK}open and closed, a shear that grows with the slip",
        partial(statics, cell="tri", law="regularised"),
        (16, 32),
        LINEAR,
    ),
    "mixed": Manufactured(
        "mixed contact",
        f"{BLOCK}{COULOMB}",
        partial(statics, cell="tri", law="Coulomb", method="mixed"),
        (8, 16),
        LINEAR,
        long=False,
    ),
    "Coulomb P2 quad": Manufactured(
        "integral contact",
        f"{BLOCK}{COULOMB}, degree 2",
        partial(statics, cell="quad", law="Coulomb", degree=2, method="integral"),
        (16, 32),
        QUADRATIC,
    ),
    "Coulomb P2 tet": Manufactured(
        "integral contact",
        f"{BLOCK}{COULOMB}, degree 2, in space",
        partial(statics, cell="tet", law="Coulomb", degree=2, method="integral"),
        (4, 8),
        QUADRATIC,
    ),
    "Coulomb P2 hex": Manufactured(
        "integral contact",
        f"{BLOCK}{COULOMB}, degree 2, in space",
        partial(statics, cell="hex", law="Coulomb", degree=2, method="integral"),
        (4, 8),
        QUADRATIC,
    ),
    "mixed P2": Manufactured(
        "mixed contact",
        f"{BLOCK}open, stick, slip, friction 0.3, degree 2",
        partial(statics, cell="tri", law="Coulomb", degree=2, slope=0.0),
        (8, 16),
        QUADRATIC,
        long=False,
    ),
    "mixed P2 hex": Manufactured(
        "mixed contact",
        f"{BLOCK}open, stick, slip, friction 0.3, degree 2, in space",
        partial(statics, cell="hex", law="Coulomb", degree=2, slope=0.0),
        (4, 8),
        QUADRATIC,
    ),
    "mixed P2 tet": Manufactured(
        "mixed contact",
        f"{BLOCK}open, stick, slip, friction 0.3, degree 2, in space",
        partial(statics, cell="tet", law="Coulomb", degree=2, slope=0.0),
        (4, 8),
        QUADRATIC,
    ),
    "mixed P2 pair": Manufactured(
        "mixed contact",
        "two blocks, 2 facets on 3, open and closed, degree 2",
        partial(pair, cell="tri", law="frictionless", other=1.5, degree=2),
        (8, 16),
        QUADRATIC,
    ),
    "mixed P2 revolution": Manufactured(
        "mixed contact",
        "disc on an obstacle, open and closed, degree 2",
        partial(revolution, cell="tri", law="frictionless", degree=2),
        (8, 16),
        QUADRATIC,
    ),
    "sliding quad": Manufactured(
        "sliding pairs",
        FAR,
        partial(sliding, cell="quad"),
        (8, 16),
        LINEAR,
        long=False,
    ),
    "sliding tri": Manufactured(
        "sliding pairs", FAR, partial(sliding, cell="tri"), (16, 32), LINEAR
    ),
    "adhesion": Manufactured(
        "RCCM adhesion", BONDS, partial(adhesive, cell="quad", law="RCCM"), (16, 32), WEAKENING
    ),
    "cohesion": Manufactured(
        "bilinear cohesion",
        BONDS,
        partial(adhesive, cell="tri", law="bilinear"),
        (16, 32),
        WEAKENING,
    ),
    "ball": Manufactured(
        "spheres", LYING.format("disc"), partial(curved, cell="tri", kind="ball"), (8, 16), LINEAR
    ),
    "ball that comes": Manufactured(
        "moving obstacles",
        LYING.format("disc that comes in a step of a history"),
        partial(curved, cell="quad", kind="ball", comes=True),
        (8, 16),
        LINEAR,
    ),
    "cylinder": Manufactured(
        "cylinders",
        LYING.format("cylinder, in space"),
        partial(curved, cell="hex", kind="cylinder"),
        (4, 8),
        LINEAR,
    ),
    "level set": Manufactured(
        "level sets",
        LYING.format("level set"),
        partial(curved, cell="tri", kind="level set"),
        (8, 16),
        LINEAR,
    ),
    "history": Manufactured(
        "quasi-static",
        "cube whose slip turns, affine in space: steps of time",
        history,
        (4, 8),
        {"displacement": 1, "shear": 1},
        long=False,
    ),
    "motion": Manufactured(
        "NSCD motion",
        "the same cube with mass, theta = 1: steps of time",
        motion,
        (20, 40),
        {"displacement": 1, "shear": 1},
    ),
}


def rows():
    """The table: measured orders and errors."""
    for name, case in CASES.items():
        orders, errors_ = case.measured()
        for k, order in case.orders.items():
            yield [
                name,
                case.feature,
                case.words,
                *case.n,
                k,
                order,
                f"{orders[k]:.2f}",
                f"{errors_[k]:.1e}",
            ]


HEAD = [
    "name",
    "feature",
    "problem",
    "coarse",
    "fine",
    "error of",
    "theory",
    "measured",
    "last error",
]


def main():
    with TABLE.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEAD)
        for row in rows():
            writer.writerow(row)
            print(*row, flush=True)


if __name__ == "__main__":
    main()
