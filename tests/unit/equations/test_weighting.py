"""In bodies of revolution the problem multiplies the integrals of its user by 2 pi r."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import Axisymmetric, LinearElastic

COMM = MPI.COMM_WORLD
VOLUME = np.pi * (2.0**2 - 1.0**2)  # of a ring of height 1, which is also the area of its ends
YOUNG = 1000.0
STEEL = LinearElastic.from_young(YOUNG, 0.0)


class Ring:
    """A ring, 1 < r < 2, of Poisson's ratio 0 on a floor or above one."""

    def __init__(self, floor=0.0):
        self.mesh = box(COMM, 3, "quad")
        self.mesh.geometry.x[:, 0] += 1.0
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(self.V)
        self.floor = HalfSpace((0.0, floor), (0.0, 1.0))

    def energy(self):
        return Axisymmetric(STEEL).energy(self.u) * ufl.dx

    def tagged(self, place):
        """The measure of the facets at a height."""
        found = np.sort(facets(self.mesh, 1, place))
        tags = mesh.meshtags(self.mesh, 1, found, np.ones_like(found))
        return ufl.Measure("ds", self.mesh, subdomain_data=tags)(1)

    def problem(self, bulk, *, axisymmetric=True, bcs=()):
        bottom = facets(self.mesh, 1, 0.0)
        kind = dict(obstacle=self.floor, law=Frictionless(), axisymmetric=axisymmetric)
        return ContactProblem(bulk, self.u, [ContactSurface(self.u, bottom, **kind)], bcs=bcs)

    def velocity(self):
        """Axial and uniform."""
        v = fem.Function(self.V)
        v.interpolate(lambda x: np.stack([0 * x[0], 1.0 + 0 * x[0]]))
        return v


def as_energy(b):
    return b.energy() + 3.0 * b.u[1] * ufl.dx + 2.0 * b.u[1] * b.tagged(1.0)


def as_residual(b):
    return ufl.derivative(as_energy(b), b.u)


def written_out(b):
    v = ufl.TestFunction(b.V)
    x = ufl.SpatialCoordinate(b.mesh)
    strains = ufl.inner(ufl.sym(ufl.grad(b.u)), ufl.sym(ufl.grad(v)))
    inside = YOUNG * (strains + b.u[0] * v[0] / x[0] ** 2) * ufl.dx
    return inside + 3.0 * v[1] * ufl.dx + 2.0 * v[1] * b.tagged(1.0)


@pytest.mark.parametrize("bulk", [as_energy, as_residual, written_out])
def test_loads_of_revolution_are_weighted(bulk):
    """A weight of 3 per volume and a pressure of 2 on the upper end press a ring on a floor."""
    b = Ring()
    result = b.problem(bulk(b)).solve()
    np.testing.assert_allclose(result.resultants["contact"][1], 5.0 * VOLUME, rtol=1e-9)


def test_mass_and_damping_of_revolution_are_weighted():
    """Drag c v per volume slows a ring by the share c dt / (rho + c dt / 2) in a step."""
    b = Ring(floor=-1.0)
    velocity = b.velocity()
    drag = 3.0 * ufl.dot(velocity, ufl.TestFunction(b.V)) * ufl.dx
    motion = NSCD(
        b.problem(b.energy()), 2.0, dt=0.1, velocity=velocity, damping=drag, mass="consistent"
    )
    kinetic = motion.run([0.0, 0.2]).energies.kinetic
    np.testing.assert_allclose(kinetic, VOLUME * (1 - 0.3 / (2 + 0.15)) ** 4, rtol=1e-9)
