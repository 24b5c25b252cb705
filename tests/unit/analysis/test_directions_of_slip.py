"""Critical friction over the direction of sliding: another condensation, symmetry, a demo."""

import importlib

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from demo_critical_friction import arguments, main, prism
from support.blocks import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, plot
from dolfinx_contact.analysis import critical_friction, critical_friction_by_direction
from dolfinx_contact.materials import LinearElastic


def leaning(offset=0.8):
    return prism(arguments(["--n", "2", "--height", "2", "--offset", str(offset)]))


def guided():
    """A leaning block of which one side moves in its plane alone."""
    domain = mesh.create_box(
        MPI.COMM_WORLD, [[0, 0, 0], [1, 0.6, 1.5]], [3, 2, 3], mesh.CellType.hexahedron
    )
    domain.geometry.x[:, 0] += 0.6 * domain.geometry.x[:, 2]
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    bottom, top, side = (
        mesh.locate_entities_boundary(domain, 2, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in ((2, 0.0), (2, 1.5), (1, 0.0))
    )
    bcs = [
        fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, top), V),
        fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(1), 2, side), V.sub(1)),
    ]
    floor = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=Coulomb(0.3))
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [floor], bcs=bcs)


def by_reduction(S, frames, d):
    """The smallest F with a real slip of one sign along d, from the points alone."""
    m = len(frames)
    tangents = np.einsum("iap,a->ip", frames[:, :, :-1], d)
    D = np.zeros((3 * m, m))
    for i in range(m):
        D[3 * i : 3 * i + 2, i] = tangents[i]
    values, vectors = scipy.linalg.eig(D.T @ S @ D, S[2::3] @ D)
    best = np.inf
    for F, v in zip(values, vectors.T, strict=True):
        if not np.isfinite(F) or abs(F.imag) > 1e-9 * abs(F) or F.real > 0:
            continue  # slip along d has rt = F rn < 0
        v = v / v[np.abs(v).argmax()]
        if v.real.min() >= -1e-8:
            best = min(best, -F.real)
    return best


@pytest.mark.verifies(
    "critical friction",
    reference="independent code: eigenvalues of the stiffness of the contact points, by scipy",
    aspects=("3D",),
)
def test_a_leaning_prism():
    problem = leaning()
    found = critical_friction_by_direction(problem, number=12)
    points = problem.reduced()
    expected = [by_reduction(points.S, points.frames, d) for d in found.directions]
    np.testing.assert_allclose(found.friction, expected, rtol=1e-7)
    assert np.isfinite(found.friction).sum() >= 3
    assert not np.isfinite(found.friction).all()
    assert (found.known_up_to == np.inf).all()
    np.testing.assert_allclose(found.basis, np.eye(3)[:2], atol=1e-12)
    # The prism is its own mirror image across the plane in which it leans.
    mirrored = found.friction[-np.arange(12) % 12]
    np.testing.assert_allclose(mirrored, found.friction, rtol=1e-7)
    assert "smallest of 12 directions; all were computed" in str(found)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("solver", ["direct", "amg"])
@pytest.mark.verifies(
    "critical friction",
    reference="itself: a body held for each direction",
    aspects=("3D", "multigrid"),
)
def test_one_body_serves_all_directions(solver, monkeypatch):
    """Also where some points cannot slip in some directions; a body is set up once."""
    problem = guided()
    module = importlib.import_module("dolfinx_contact.analysis.directions_of_slip")
    bodies = []
    held_body = module.held_body
    monkeypatch.setattr(module, "held_body", lambda *a: bodies.append(a) or held_body(*a))
    found = critical_friction_by_direction(problem, number=8, solver=solver)
    assert len(bodies) == 1
    for d, friction, opposite in zip(
        found.directions[:4], found.friction[:4], found.friction[4:], strict=True
    ):
        values = np.array(critical_friction(problem, d, solver="direct").one_signed)
        expected = [np.abs(values[s * values > 0]).min(initial=np.inf) for s in (-1.0, 1.0)]
        np.testing.assert_allclose([friction, opposite], expected, rtol=1e-8)
    assert np.isfinite(found.friction).any()


@pytest.mark.ranks(2)
def test_few_eigenvalues():
    """What SLEPc finds is what was computed whole, as far as it is known."""
    problem = leaning()
    whole = critical_friction_by_direction(problem, number=4)
    few = critical_friction_by_direction(problem, number=4, dense=False, count=2)
    known = np.isfinite(whole.friction) & (whole.friction < few.known_up_to)
    assert known.any()
    np.testing.assert_allclose(few.friction[known], whole.friction[known], rtol=1e-7)


@pytest.mark.ranks(2)
def test_bad_input():
    with pytest.raises(ValueError, match="3D"):
        critical_friction_by_direction(block(n=1))
    for number in (1, 3, 2.5, "a"):
        with pytest.raises(ValueError, match="even"):
            critical_friction_by_direction(leaning(), number=number)


def test_the_demo_and_the_picture(folder):
    summary = main(["--shape", "prism", "--n", "2", "--height", "2", "--output", str(folder)])
    assert summary["critical_friction"] == min(summary["friction"])
    assert (folder / "directions.png").stat().st_size > 10_000
    with pytest.raises(ValueError, match="nothing"):
        plot.draw_polar(folder / "none.png", {})
    with pytest.raises(ValueError, match="radii"):
        plot.draw_polar(folder / "none.png", {"a": ([0.0, 1.0], [1.0])})
