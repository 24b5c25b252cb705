"""All coefficients of a rectangle that leans, sorted by the signs of their slips.

S_tt v = F S_nt v, with n along un, is solved in numpy from a stiffness assembled densely: real
coefficients with v of one sign, real ones of both signs, and complex ones. Where slips of one sign
do not exist, ``friction`` is None and ``known_up_to`` infinite. The twin stands upright.
"""

from mpi4py import MPI

import numpy as np
import scipy.linalg
from bodies import block, condensed, dense, nodes_of

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.analysis import critical_friction


def leaning(comm, offset, cells=(4, 4), unit=1.0, cell="quadrilateral", degree=1):
    """A block whose top is moved to the right in the mesh, and a material."""
    body = block(comm, cells, (unit, unit), cell, degree)
    x = body.domain.geometry.x
    x[:, 0] += offset * x[:, 1]
    return body


def energy_of(body, unit=1.0):
    return materials.LinearElastic(unit, unit).energy(body.u) * ufl.dx


def made(body, energy, **more):
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3), **more)
    return ContactProblem(energy, body.u, [contact], bcs=body.bcs)


def tangent(energy, body):
    """Second derivative of an energy, a bilinear form."""
    trial = ufl.TrialFunction(body.V)
    test = ufl.TestFunction(body.V)
    return ufl.derivative(ufl.derivative(energy, body.u, test), body.u, trial)


def expected(K, V, height):
    """Coefficients by own numpy: of one sign, mixed, complex, each by size."""
    bottom = nodes_of(V, lambda y: np.isclose(y[:, 1], 0, atol=1e-9 * height))
    top = nodes_of(V, lambda y: np.isclose(y[:, 1], height, rtol=1e-9))
    across = 2 * bottom
    along = 2 * bottom + 1
    S = condensed(K, np.concatenate([across, along]), np.concatenate([2 * top, 2 * top + 1]))
    m = len(bottom)
    return sorted_by_slips(S[:m, :m], S[m:, :m])


def sorted_by_slips(S_tt, S_nt):
    """Real F with v of one sign, real F with v of both, complex F, each by size.

    F > 0 belongs to slip against the directions, rt = F rn: S_tt v = rt = F rn = F S_nt v.
    """
    values, vectors = scipy.linalg.eig(S_tt, S_nt)
    lists = ([], [], [])
    scale = np.abs(S_tt).max() / np.abs(S_nt).max()
    for F, v in zip(values, vectors.T, strict=True):
        if not np.isfinite(F) or abs(F) > 1e8 * scale:
            continue
        if abs(F.imag) > 1e-7 * abs(F):
            lists[2].append(F)
            continue
        v = (v / v[np.argmax(np.abs(v))]).real
        lists[0 if v.min() > -1e-7 else 1].append(F.real)
    return [sorted(found, key=abs) for found in lists]


def compare(case, found, lists):
    """Compare all lists, and what is said of them."""
    one, mixed, unreal = lists
    case.equal("of one sign", sorted(found.one_signed), sorted(one))
    case.equal("of both signs", sorted(found.mixed), sorted(mixed))
    sizes = sorted(abs(F) for F in found.unreal)
    case.equal("complex ones, by size", sizes, sorted(abs(F) for F in unreal))
    if one:
        case.equal("size of the friction", abs(found.friction), abs(one[0]))
        case.true("with its sign", min(abs(F / found.friction - 1) for F in one) < 1e-6)
        case.true("slips of one sign", found.slips.min() >= 0 and np.isclose(found.slips.max(), 1))
    else:
        case.true("no friction", found.friction is None and not len(found.slips))
    case.true("all are known", found.complete and np.isinf(found.known_up_to))


def made_3d(comm):
    """The problem of a leaning box of tetrahedra, the box, and the form of its stiffness."""
    body = block(comm, (2, 2, 2), (1.0, 1.0, 1.0), "tetrahedron")
    x = body.domain.geometry.x
    x[:, 0] += 1.5 * x[:, 2]
    x[:, 1] += 1.0 * x[:, 2]
    energy = energy_of(body)
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem, body, tangent(energy, body)


def put(case, offset):
    body = leaning(case.comm, offset)
    found = critical_friction(made(body, energy_of(body)))
    own = leaning(MPI.COMM_SELF, offset)
    K = dense(tangent(energy_of(own), own))
    lists = expected(K, own.V, 1.0)
    compare(case, found, lists)


def attack(case):
    put(case, 1.5)
    put(case, -1.5)


def honest(case):
    put(case, 0.0)
