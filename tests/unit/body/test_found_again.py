"""Forms that are found again by what they say: none is taken for another, with whatever it is made.

The oracle is DOLFINx's own look-up, by the signature of the derivatives that are written out.
"""

import copy
from itertools import combinations

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, _forms
from dolfinx_contact.body import bulk
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.materials import LinearElastic, NeoHookean

COMM = MPI.COMM_WORLD
i, j = ufl.indices(2)


class World:
    """A mesh, a displacement, and what forms are made of, in one order of making or the other."""

    def __init__(self, seed, cell=mesh.CellType.quadrilateral, degree=1, other_order=False):
        random = np.random.default_rng(seed)
        self.domain = domain = mesh.create_unit_square(COMM, 3, 3, cell)
        domain.geometry.x[:, :2] *= random.uniform(0.5, 1.5, size=2)
        V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
        W = fem.functionspace(domain, ("Lagrange", 1))
        makers = {
            "u": lambda: fem.Function(V),
            "f": lambda: fem.Function(W),
            "g": lambda: fem.Function(W),
            "d": lambda: fem.Function(fem.functionspace(domain, ("DG", 0))),
            "a": lambda: fem.Constant(domain, random.uniform(1.0, 2.0)),
            "b": lambda: fem.Constant(domain, random.uniform(3.0, 4.0)),
        }
        for name in reversed(makers) if other_order else makers:
            setattr(self, name, makers[name]())
        for k, name in enumerate("ufgd"):
            a, b = random.uniform(0.1, 0.3, size=2)
            width = 2 if name == "u" else 1
            getattr(self, name).interpolate(
                lambda x, a=a, b=b, k=k, width=width: np.vstack(
                    [1.0 + k + a * x[0] + (b + m) * x[1] for m in range(width)]
                )
            )
        self.x = ufl.SpatialCoordinate(domain)
        self.n = ufl.FacetNormal(domain)
        marked = [facets(domain, 1, 0.0), facets(domain, 0, 0.0)]
        every = np.concatenate(marked).astype(np.int32)
        values = np.repeat([1, 2], [len(m) for m in marked]).astype(np.int32)
        order = np.unique(every, return_index=True)[1]
        tags = mesh.meshtags(domain, 1, every[order], values[order])
        self.ds = ufl.Measure("ds", domain, subdomain_data=tags)
        self.at = ufl.inner(self.u, self.u)
        self.v = ufl.TestFunction(V)


def strain(w):
    return ufl.sym(ufl.grad(w.u))


#: No two of them say the same.
FORMS = {
    "a": lambda w: w.a * w.at * ufl.dx,
    "a, b": lambda w: (w.a * w.at + w.b * w.u[0]) * ufl.dx,
    "b, a": lambda w: (w.b * w.at + w.a * w.u[0]) * ufl.dx,
    "a, a": lambda w: (w.a * w.at + w.a * w.u[0]) * ufl.dx,
    "f / g": lambda w: w.f / w.g * w.at * ufl.dx,
    "g / f": lambda w: w.g / w.f * w.at * ufl.dx,
    "f f": lambda w: w.f / w.f * w.at * ufl.dx,
    "piecewise": lambda w: w.d / w.f * w.at * ufl.dx,
    "a number": lambda w: 2.0 * w.at * ufl.dx,
    "another number": lambda w: 2.0000000000000004 * w.at * ufl.dx,
    "a whole number": lambda w: 2 * w.at * ufl.dx,
    "a power": lambda w: w.at**2 * ufl.dx,
    "a power that is a Constant": lambda w: w.at**w.a * ufl.dx,
    "a rule": lambda w: w.a * w.at**2 * ufl.dx(metadata={"quadrature_degree": 1}),
    "another rule": lambda w: w.a * w.at**2 * ufl.dx(metadata={"quadrature_degree": 3}),
    "x": lambda w: w.x[0] * w.at * ufl.dx,
    "y": lambda w: w.x[1] * w.at * ufl.dx,
    "tag 1": lambda w: w.at * ufl.dx + w.u[0] * w.ds(1),
    "tag 2": lambda w: w.at * ufl.dx + w.u[0] * w.ds(2),
    "both tags": lambda w: w.at * ufl.dx + w.u[0] * w.ds((1, 2)),
    "everywhere": lambda w: w.at * ufl.dx + w.u[0] * w.ds,
    "the normal": lambda w: w.at * ufl.dx + ufl.dot(w.u, w.n) * w.ds(1),
    "in turn": lambda w: ufl.as_tensor(ufl.grad(w.u)[i, j], (i, j))[0, 1] ** 2 * ufl.dx,
    "transposed": lambda w: ufl.as_tensor(ufl.grad(w.u)[i, j], (j, i))[0, 1] ** 2 * ufl.dx,
    "sum": lambda w: ufl.grad(w.u)[i, j] * ufl.grad(w.u)[i, j] * ufl.dx,
    "sum crossed": lambda w: ufl.grad(w.u)[i, j] * ufl.grad(w.u)[j, i] * ufl.dx,
    "a side": lambda w: w.at * ufl.dx + (w.d("+") * w.u[0]("+")) ** 2 * ufl.dS,
    "a mean of sides": lambda w: w.at * ufl.dx + (ufl.avg(w.d) * w.u[0]("+")) ** 2 * ufl.dS,
    "elastic": lambda w: LinearElastic(w.a, w.b).energy(w.u) * ufl.dx,
    "elastic, f": lambda w: LinearElastic(w.f, w.b).energy(w.u) * ufl.dx,
    "plane stress": lambda w: LinearElastic(w.a, w.b, plane_stress=True).energy(w.u) * ufl.dx,
    "hyperelastic": lambda w: NeoHookean(w.a, w.b).energy(w.u) * ufl.dx,
    "a residual": lambda w: w.a * ufl.inner(strain(w), ufl.grad(w.v)) * ufl.dx,
    "another residual": lambda w: w.b * w.a * ufl.inner(strain(w), ufl.grad(w.v)) * ufl.dx,
    "a condition": lambda w: ufl.conditional(ufl.lt(w.f, w.g), w.a, w.b) * w.at * ufl.dx,
    "its reverse": lambda w: ufl.conditional(ufl.lt(w.g, w.f), w.a, w.b) * w.at * ufl.dx,
    "a kink": lambda w: ufl.max_value(w.u[0], w.a) ** 2 * ufl.dx,
}


def by_dolfinx(form, u):
    """Residual, product of the Jacobian with a displacement, and whether that depends on it."""
    compiled = _forms._compiled_anew
    residual = form if form.arguments() else ufl.derivative(form, u)
    b = fem.assemble_vector(compiled(residual, None))
    J = dolfinx.fem.petsc.assemble_matrix(compiled(ufl.derivative(residual, u), None))
    J.assemble()
    affine = u not in ufl.algorithms.expand_derivatives(ufl.derivative(residual, u)).coefficients()
    return b.array.copy(), product(J, u), affine


def product(J, u):
    x, y = J.createVecs()
    x.array[:] = u.x.array[: x.getLocalSize()]
    J.mult(x, y)
    return y.array_r.copy()


def check(world, form):
    """That a body has what DOLFINx makes of its form."""
    rows, changes, affine = by_dolfinx(form, world.u)
    body = Bulk(form, world.u)
    u = world.u.x.array.copy()
    scale = np.abs(rows).max(initial=1.0)
    np.testing.assert_allclose(
        body._local(body.residual_form, u).array, rows, rtol=0, atol=1e-13 * scale
    )
    stiffness = product(body.stiffness(u), world.u)
    np.testing.assert_allclose(
        stiffness, changes, rtol=0, atol=1e-13 * np.abs(changes).max(initial=1.0)
    )
    assert body.linear == affine
    if not form.arguments():
        energy = COMM.allreduce(fem.assemble_scalar(_forms._compiled_anew(form, None)))
        body.stiffness(u)
        assert body.energy_at(u) == pytest.approx(energy, rel=1e-12)
    body.destroy()


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "name", ["b, a", "g / f", "tag 2", "elastic, f", "hyperelastic", "a residual", "a side"]
)
def test_each_form_is_that_of_dolfinx(name, monkeypatch):
    """On one mesh, on another with all else anew, where it is found, and made in another order."""
    make = FORMS[name]
    first = World(1)
    check(first, make(first))
    anew: list[object] = []
    real = _forms._compiled_anew
    monkeypatch.setattr(_forms, "_compiled_anew", lambda *a: anew.append(a) or real(*a))
    second = World(2)
    body = Bulk(make(second), second.u)
    body.stiffness(second.u.x.array)
    body.energy_at(second.u.x.array)
    # UFL sorts Constants by their numbers as words: 10 comes before 9.
    same = _forms.content_of(make(second)).key == _forms.content_of(make(first)).key
    assert (not anew) == same
    monkeypatch.undo()
    check(second, make(second))
    third = World(3, other_order=True)
    check(third, make(third))


def test_no_two_of_them_say_the_same():
    """And each says the same of other Functions, Constants and meshes."""
    w, other = World(1), World(2)
    keys = {name: _forms.content_of(make(w)).key for name, make in FORMS.items()}
    for a, b in combinations(keys, 2):
        assert keys[a] != keys[b], (a, b)
    for name, make in FORMS.items():
        found = _forms.content_of(make(other)).key
        assert found[:3] == keys[name][:3], name  # the last is the order in which all was made
    for world in (World(1, mesh.CellType.triangle), World(1, degree=2)):
        assert all(_forms.content_of(make(world)).key != keys[name] for name, make in FORMS.items())


def test_copies_say_what_one_says():
    """They are equal for UFL: of a Function and its copy one is compiled, of two others both."""
    w = World(1)
    for f, g in (("f", "g"), ("a", "b")):
        for other in (copy.copy(getattr(w, f)), getattr(w, g)):
            form = other * getattr(w, f) ** 2 * w.d * ufl.dx
            found = COMM.allreduce(fem.assemble_scalar(_forms.compiled_form(form)))
            expected = COMM.allreduce(fem.assemble_scalar(_forms._compiled_anew(form, None)))
            assert found == pytest.approx(expected, rel=1e-14)


def test_test_functions_of_one_space_are_one():
    """A residual may call for one in each of its terms."""
    for w in (World(1), World(2)):
        v, other = w.v, ufl.TestFunction(w.v.ufl_function_space())
        form = w.a * ufl.inner(ufl.grad(w.u), ufl.grad(v)) * ufl.dx + ufl.dot(w.u, other) * w.ds(1)
        check(w, form)
        rows = fem.assemble_vector(_forms.compiled_form(form)).array
        np.testing.assert_allclose(rows, by_dolfinx(form, w.u)[0], rtol=0, atol=1e-13)


def test_what_is_not_known_is_compiled_by_its_signature():
    """Operators that hold more than operands, and metadata that are no words and numbers."""
    w = World(1)

    class Own(type(w.x)):
        pass

    rule = {"quadrature_degree": 2, "of": object}
    for form in (w.at * ufl.dx(metadata=rule), Own(w.domain)[0] * w.at * ufl.dx):
        assert _forms.content_of(form) is None


@pytest.mark.ranks(2)
def test_a_form_that_one_rank_alone_knows():
    """All ranks find a form or none does: compiling is collective."""
    w = World(7)
    check(w, FORMS["a"](w))
    if COMM.rank == 0:
        _forms._compiled.clear()
    check(w, FORMS["a"](w))


def solved(w, law, gap):
    """The displacement of a block that is pressed on a plane."""
    u = w.u
    u.x.array[:] = 0.0
    top = facets(w.domain, 1, w.domain.comm.allreduce(w.domain.geometry.x[:, 1].max(), op=MPI.MAX))
    V = u.function_space
    bc = fem.dirichletbc(np.array([0.01, -0.05]), fem.locate_dofs_topological(V, 1, top), V)
    s = ContactSurface(u, facets(w.domain, 1, 0.0), obstacle=HalfSpace(gap(w), (0, 1)), law=law(w))
    energy = LinearElastic(w.a, w.b).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [s], bcs=[bc])
    problem.solve()
    first = u.x.array.copy()
    w.a.value *= 2.0
    problem.solve()
    return np.concatenate([first, u.x.array])


def test_problems_one_after_another():
    """With data of other kinds, changed between solves, as each of them alone in its process."""
    floor = {
        "numbers": lambda w: (0.0, 0.0),
        "a Constant": lambda w: fem.Constant(w.domain, (0.0, -0.01)),
    }
    laws = {
        "a number": lambda w: Coulomb(0.3),
        "a Constant": lambda w: Coulomb(fem.Constant(w.domain, 0.2)),
        "a Function": lambda w: Coulomb(w.g),
        "two Functions": lambda w: Coulomb(w.g / w.f),
    }
    cases = [(law, gap) for law in laws for gap in ("numbers", "a Constant")]
    alone = []
    for law, gap in cases:
        _forms._compiled.clear()
        bulk._facts.clear()
        alone.append(solved(World(5), laws[law], floor[gap]))
    for (law, gap), expected in zip(reversed(cases), reversed(alone), strict=True):
        found = solved(World(5), laws[law], floor[gap])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
