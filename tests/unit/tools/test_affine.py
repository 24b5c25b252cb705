"""Data that are affine by construction, and the treatment of others."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import NSCD, ArcLength
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


class Plate:
    """A plate that is pressed on a floor, with a parameter and whatever is added to its energy."""

    def __init__(self, term=None, *, degree=1, n=3, cell="triangle", floor=None, law=None):
        kind = getattr(mesh.CellType, cell)
        self.domain = domain = mesh.create_unit_square(COMM, n, n, kind)
        V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
        self.u = fem.Function(V, name="u")
        self.top = fem.Function(V)
        self.gamma, self.other = (fem.Constant(domain, 0.0) for _ in range(2))
        self.top.interpolate(lambda x: np.vstack([0 * x[0], -0.02 + 0 * x[0]]))
        held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        right = facets(domain, 0, 1.0)
        tags = mesh.meshtags(domain, 1, np.sort(right), np.full(len(right), 1, dtype=np.int32))
        self.side = ufl.Measure("ds", domain, subdomain_data=tags)(1)
        energy = LinearElastic.from_young(100.0, 0.3).energy(self.u) * ufl.dx
        if term is not None:
            energy += term(self)
        floor = HalfSpace((0.0, 0.0), (0.0, 1.0)) if floor is None else floor(self)
        law = Coulomb(0.3) if law is None else law(self)
        surface = ContactSurface(self.u, facets(domain, 1, 0.0), obstacle=floor, law=law)
        bcs = [fem.dirichletbc(self.top, held)]
        self.problem = ContactProblem(energy, self.u, [surface], bcs=bcs)

    def parametric(self, driven=None):
        pairs = [] if driven is None else [(self.top, driven(self))]
        return ParametricContact(self.problem, self.gamma, driven=pairs)

    @property
    def values(self):
        """Values of the displacement, in the order of the nodes."""
        x = self.u.function_space.tabulate_dof_coordinates()
        n = self.u.function_space.dofmap.index_map.size_local
        values = np.hstack([x[:n, :2], self.u.x.array.reshape(-1, 2)[:n]])
        whole = np.concatenate(COMM.allgather(values))
        return whole[np.lexsort(np.round(whole[:, 1::-1].T, 9))][:, 2:]


def pull(p):
    return -5 * p.u[0] * p.side


@pytest.mark.parametrize(
    ("sense", "degree", "cell"),
    [(1.0, 1, "triangle"), (1.0, 2, "quadrilateral"), (-1.0, 1, "triangle")],
)
@pytest.mark.verifies(
    "bulk with kinks", reference="itself: springs that act always, or never", aspects=("2D",)
)
@pytest.mark.refuses("bulk with kinks", aspects=("branches",))
def test_bulk_with_kinks_is_solved_and_not_followed(sense, degree, cell):
    """Springs on the side that only hold it back: as ever, or never, as the pull has it."""

    def springs(p, stretch):
        return 50 * stretch**2.0 * p.side + sense * pull(p)

    def solved(term):
        p = Plate(term, degree=degree, cell=cell)
        result = p.problem.solve()
        assert degree == 2 or result.kkt_violation < 1e-9
        return p, result, p.values

    p, _, found = solved(lambda p: springs(p, ufl.max_value(p.u[0], 0)))
    _, _, expected = solved(lambda p: springs(p, p.u[0] if sense > 0 else 0 * p.u[0]))
    # An edge of degree 2 is pressed in beside the held corner, by a little.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 if degree == 1 else 1e-5)
    assert np.abs(found).max() > 0.01
    assert p.problem.uniqueness().verdict == "not proved"
    system = p.parametric()
    for use in (
        lambda: follow(system, system.create_vector(), 0.0, gamma_range=(0.0, 1.0)),
        lambda: ArcLength(system),
    ):
        with pytest.raises(ValueError, match=r"the bulk has kinks in u: max_value"):
            use()


def _motion(damping, **options):
    """A floating body, with the velocity and the speed of a wind."""
    domain = mesh.create_unit_square(COMM, 2, 2)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="u")
    v = fem.Function(V, name="v")
    floor = HalfSpace((0.0, -5.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Frictionless())
    energy = LinearElastic.from_young(100.0, 0.3).energy(u) * ufl.dx
    wind = fem.Constant(domain, (0.4, 0.0))
    form = damping(v, wind, ufl.TestFunction(V), u)
    problem = ContactProblem(energy, u, [surface])
    density = options.pop("density", lambda u, v: 1.0)(u, v)
    motion = NSCD(problem, density, dt=0.05, velocity=v, damping=form, mass="consistent", **options)
    return motion, v, wind


@pytest.mark.verifies("NSCD motion", reference="closed form: v' = 3 (w - v)", aspects=("2D",))
def test_damping_in_a_wind_carries_the_body():
    """v' = 3 (w - v): the body takes the speed of the wind, which blows the other way later."""
    motion, v, wind = _motion(lambda v, w, t, u: 3.0 * ufl.inner(v - w, t) * ufl.dx)
    mean = fem.form(v[0] * ufl.dx)
    history = motion.run([0.0, 1.0])
    at_one = COMM.allreduce(fem.assemble_scalar(mean))
    assert at_one == pytest.approx(0.4 * (1 - np.exp(-3.0)), rel=2e-3)
    assert abs(history.energies.residue) < 1e-9 * history.energies.external
    wind.value = (-0.4, 0.0)
    motion.run([1.0, 2.0])
    expected = -0.4 + (at_one + 0.4) * np.exp(-3.0)
    assert COMM.allreduce(fem.assemble_scalar(mean)) == pytest.approx(expected, rel=5e-3)
