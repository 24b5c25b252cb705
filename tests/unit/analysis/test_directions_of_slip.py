"""Critical friction over the direction of sliding: another condensation, symmetry, a demo."""

import numpy as np
import pytest
import scipy.linalg
from cases.critical_friction import arguments, main, prism
from support.blocks import block

from dolfinx_contact import plot
from dolfinx_contact.analysis import critical_friction_by_direction


def leaning(offset=0.8):
    return prism(arguments(["--n", "2", "--height", "2", "--offset", str(offset)]))


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
def test_leaning_prism_has_its_worst_direction():
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
def test_critical_friction_by_direction_refuses_numbers():
    with pytest.raises(ValueError, match="3D"):
        critical_friction_by_direction(block(n=1))
    for number in (1, 3, 2.5, "a"):
        with pytest.raises(ValueError, match="number must be"):
            critical_friction_by_direction(leaning(), number=number)


def test_critical_friction_demo_draws_its_picture(folder):
    summary = main(["--shape", "prism", "--n", "2", "--height", "2", "--output", str(folder)])
    assert summary["critical_friction"] == min(summary["friction"])
    assert (folder / "directions.png").stat().st_size > 10_000
    with pytest.raises(ValueError, match="same first dimension"):
        plot.draw_polar(folder / "none.png", {"a": ([0.0, 1.0], [1.0])})
