"""A block, other objects, and calls with wrong arguments for the table of misuse."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import (
    Observer,
    explore,
    find_solutions,
    follow,
)
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import (
    LinearElastic,
)
from dolfinx_contact.problem import discretise
from support.blocks import block, box, facets
from support.checks import solved_start

COMM = MPI.COMM_WORLD


LAST = COMM.rank == COMM.size - 1


FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))


MATERIAL = LinearElastic.from_young(1000.0, 0.3)


several = pytest.mark.skipif(COMM.size == 1, reason="for ranks that differ")


class UsersError(Exception):
    """Exception class of a user."""


def square(n=4):
    domain = box(COMM, n, "tri")
    return fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))


def tags_of(domain, dim=1):
    where = facets(domain, 1, 0.0)
    if dim == 2:
        where = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
    return mesh.meshtags(domain, dim, np.sort(where), np.full(len(where), 7, dtype=np.int32))


def clamp(u, value=(0.0, -0.01), axis=1, at=1.0):
    V = u.function_space
    value = np.array(value) if isinstance(value, tuple) else value
    return fem.dirichletbc(value, fem.locate_dofs_topological(V, 1, facets(V.mesh, axis, at)), V)


@pytest.fixture(scope="module")
def w():
    """Return a block and the objects for its misuse, shared by all tests."""
    u = square()
    other = box(COMM, 3, "tri")
    domain = u.function_space.mesh
    V = u.function_space
    scalars = fem.functionspace(other, ("Lagrange", 1))
    vectors = fem.functionspace(other, ("Lagrange", 1, (2,)))
    gamma = fem.Constant(domain, 0.0)
    load = ufl.dot(ufl.as_vector([gamma, -1.0]), u) * ufl.ds
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=FLOOR, law=Coulomb(0.3))
    held = fem.Function(V)
    held.interpolate(lambda x: np.vstack([0 * x[0], 0 * x[0] - 0.01]))
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    energy = MATERIAL.energy(u) * ufl.dx
    problem = ContactProblem(energy - load, u, [surface], bcs=[fem.dirichletbc(held, top)])
    system = ParametricContact(problem, gamma)
    x = solved_start(system)
    short = PETSc.Vec().createMPI((2, None), comm=COMM)
    infinite = x.copy()
    infinite.array[:] = np.nan
    field = fem.Function(fem.functionspace(domain, ("Lagrange", 1)), name="slope")
    field.interpolate(lambda x: x[0])
    return SimpleNamespace(
        u=u,
        V=V,
        domain=domain,
        other=other,
        field=field,
        f_other=fem.Function(scalars),
        v_other=fem.Function(vectors),
        c_other=fem.Constant(other, 1.0),
        gamma=gamma,
        held=held,
        energy=energy,
        surface=surface,
        problem=problem,
        system=system,
        x=x,
        short=short,
        infinite=infinite,
    )


def surface(w, where=None, **options):
    where = facets(w.domain, 1, 0.0) if where is None else where
    return ContactSurface(w.u, where, **{"obstacle": FLOOR, "law": Coulomb(0.3), **options})


def discretised(w, where=None, **options):
    return discretise(surface(w, where, **options))


def problem(w, bulk=None, surfaces=None, **options):
    bulk = w.energy if bulk is None else bulk
    surfaces = surfaces or [w.surface]
    return ContactProblem(bulk, w.u, surfaces, **{"bcs": [clamp(w.u)], **options})


def followed(w, **options):
    x = options.pop("x", w.x)
    gamma = options.pop("gamma", 0.0)
    system = options.pop("system", w.system)
    return follow(system, x, gamma, **{"gamma_range": (0.0, 1.0), **options})


def explored(w, starts, **options):
    return explore(w.system, starts, **{"gamma_range": (0.0, 1.0), **options})


def found(w, guesses=None, gamma=0.0, **options):
    return find_solutions(w.system, [w.x] if guesses is None else guesses, gamma, **options)


def parametric(w, gamma=None, driven=(), problem=None):
    return ParametricContact(problem or w.problem, gamma or w.gamma, driven=driven)


def solved(**options):
    return block(**options).solve()


def raising(error):
    def function(*_):
        raise error

    return function


def on_last(error):
    def function(*_):
        if LAST:
            raise error
        return ""

    return function


class Telling(Observer):
    def __init__(self, do):
        self.do = do

    def step(self, *_):
        self.do()


class WorseLaw(FrictionLaw):
    """Law raising on some ranks only."""

    def __init__(self, raises):
        self.raises = raises

    def bound(self, a, p):
        if self.raises:
            raise UsersError("in the law")
        return 0.3 * p


def vector(g):
    return ufl.as_vector([g, g])


def differs(a, b):
    return b if LAST else a


def two_spaces(w):
    spaces = w.V, w.v_other.function_space
    parts = [fem.locate_dofs_topological(W, 1, facets(W.mesh, 1, 1.0)) for W in spaces]
    least = min(len(p) for p in parts)
    return [p[:least] for p in parts]


def with_option(w, name, value):
    """Return a problem that is made while an option is in PETSc's database."""
    options = PETSc.Options()
    options.setValue(name, value)
    try:
        return problem(w)
    finally:
        options.delValue(name)


def refused(w, do, message, error=ValueError):
    """Assert that the call raises the same error on every rank and leaves the displacement."""
    before = w.u.x.array.copy()
    with pytest.raises(error, match=message) as info:
        do(w)
    assert len(set(COMM.allgather(str(info.value)))) == 1
    np.testing.assert_array_equal(w.u.x.array, before)
