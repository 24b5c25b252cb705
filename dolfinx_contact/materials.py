# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk materials in UFL: stored energy density and Cauchy stress.

Material parameters are numbers, Constants, Functions or UFL expressions; numbers become Constants
in a form, so that other values need no new compilation. The bulk of a contact problem may also be
any other UFL energy or residual.

UFL overestimates the quadrature degree of hyperelastic energies on quadrilaterals and hexahedra (17
for a neo-Hookean hexahedron: 3 ms per cell, compared with 0.1 ms for degree 4). Set a sufficient
degree: ``material.energy(u) * ufl.dx(metadata={"quadrature_degree": 4})``.

A user-defined energy does not need a class. Write it as a function of the 3 x 3 deformation
gradient; in 2D (plane strain) F_33 = 1, and the out-of-plane stress follows::

    def W(F):  # stored energy per reference volume
        J = ufl.det(F)
        return mu / 2 * (ufl.tr(F.T * F) / J ** (2 / 3) - 3) + kappa / 2 * (J - 1) ** 2

    F = ufl.Identity(2) + ufl.grad(u)
    F = ufl.as_tensor([[F[0, 0], F[0, 1], 0], [F[1, 0], F[1, 1], 0], [0, 0, 1]])  # not in 3D
    F = ufl.variable(F)
    problem = ContactProblem(W(F) * ufl.dx, u, surfaces, bcs=bcs)
    stress = ufl.diff(W(F), F) * F.T / ufl.det(F)  # Cauchy, 3 x 3: for `io.write_fields`

For an axisymmetric body, half of a cross-section is meshed, r = x >= 0 and z = y, and
`Axisymmetric` defines the energy. Energies are given per volume and loads per area: the contact
problem multiplies every integral by 2 pi r::

    steel = Axisymmetric(LinearElastic.from_young(210e3, 0.3))
    bulk = steel.energy(u) * ufl.dx - pull * u[1] * ds

Bilinear quadrilaterals and trilinear hexahedra lock if a body is nearly incompressible. The mean
dilatation energy avoids locking and depends on u only. Linear triangles and tetrahedra also lock;
use u of degree 2 on these cells::

    rubber = LinearElastic.from_young(1.0, 0.499)
    bulk = rubber.mean_dilatation_energy(u, ufl.dx)

A body with several materials has one integral and one stress for each cell tag::

    dx = ufl.Measure("dx", domain, subdomain_data=cell_tags)
    bulk = steel.energy(u) * dx(1) + rubber.energy(u) * dx(2)
    stress = {1: steel.full_stress(u), 2: rubber.full_stress(u)}
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem
from ufl.corealg.traversal import traverse_unique_terminals

from dolfinx_contact._forms import at_middle
from dolfinx_contact._validate import is_number

__all__ = [
    "Axisymmetric",
    "CiarletGeymonat",
    "LinearElastic",
    "Material",
    "NeoHookean",
    "StVenantKirchhoff",
    "lame",
    "materials_in",
    "present_value",
]


#: Materials by the id of a UFL energy or stress, as long as this object lives. UFL compares
#: expressions by content, but equal expressions are different objects here.
_materials: dict[int, tuple[weakref.ref[Any], Material]] = {}


def lame(young: Any, poisson: Any) -> tuple[Any, Any]:
    """Return the Lame coefficients (lambda, mu) for Young's modulus and Poisson's ratio.

    The coefficients are valid in 3D and plane strain. For Constants, Functions and other UFL
    scalars they are UFL expressions, so that later values take effect.

    Args:
        young: Young's modulus, a stress.
        poisson: Poisson's ratio.

    Raises:
        ValueError: if an argument is neither a number nor a UFL scalar, ``young`` is not positive,
            or ``poisson`` is not in (-1, 1/2). UFL expressions of Constants are checked with their
            present values; data that vary in space are not checked.
    """
    _check("Young's modulus must be positive", lambda E: E > 0, young)
    _check("Poisson's ratio must lie in (-1, 1/2)", lambda nu: -1 < nu < 0.5, poisson)
    lmbda = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    return lmbda, young / (2 * (1 + poisson))


def materials_in(form: ufl.Form) -> list[Material]:
    """Return the materials of this module whose energy or stress occurs in a form.

    Inner materials, such as `Axisymmetric.material`, are not listed. Expressions reconstructed by
    UFL, for example by ``ufl.replace``, are not recognised.
    """
    found: dict[int, Material] = {}
    left = [integral.integrand() for integral in form.integrals()]
    seen = set()
    while left:
        node = left.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if id(node) in _materials:
            material = _materials[id(node)][1]
            found[id(material)] = material
        else:
            left += node.ufl_operands
    return list(found.values())


def present_value(scalar: Any) -> float | None:
    """Return the value of a number or of a UFL expression of Constants; otherwise None.

    The value is NaN if it is not a real number, such as the square root of -1 or 1/0.
    """
    if is_number(scalar):
        return float(scalar)
    constants = {}
    for part in traverse_unique_terminals(scalar):
        if isinstance(part, fem.Constant):
            # UFL treats an array without axes as a complex number in functions.
            constants[part] = part.value if part.ufl_shape else part.value.item()
        elif not isinstance(part, ufl.classes.ConstantValue | ufl.classes.MultiIndex):
            return None
    try:
        value = scalar((), constants)
    except (ArithmeticError, ValueError):
        return np.nan
    return np.nan if isinstance(value, complex) else float(value)


def _check(rule: str, holds: Callable[..., bool], *values: Any) -> None:
    """Raise `ValueError` if values are not scalars, or if their present values violate a rule.

    Args:
        rule: description of the rule, for the message.
        holds: function of the values that returns whether the rule is satisfied. It is called only
            if all present values are known.
        values: numbers or UFL scalars.
    """
    scalars = [is_number(v) or getattr(v, "ufl_shape", None) == () for v in values]
    known = [present_value(v) if s else np.nan for v, s in zip(values, scalars, strict=True)]
    finite = all(v is None or np.isfinite(v) for v in known)
    if not finite or (None not in known and not holds(*known)):
        shown = [str(k) if s else repr(v) for k, v, s in zip(known, values, scalars, strict=True)]
        raise ValueError(f"{rule}, got {' and '.join(shown)}")


def _require_displacement(u: Any) -> None:
    """Raise `ValueError` if ``u`` is not a vector Function."""
    if not isinstance(u, fem.Function):
        raise ValueError(
            "a material needs the displacement, a fem.Function, also for a linear body, since "
            f"residual and stiffness are derived from its energy; got {type(u).__name__}"
        )
    if len(u.ufl_shape) != 1:
        raise ValueError(f"the displacement must be a vector Function, got shape {u.ufl_shape}")


def _constants(u: fem.Function, *values: Any) -> list[Any]:
    """Return values with numbers replaced by Constants on the mesh of ``u``."""
    domain = u.function_space.mesh
    return [fem.Constant(domain, float(v)) if is_number(v) else v for v in values]


def _deformation(H: Any) -> Any:
    """Return the deformation gradient I + H for the displacement gradient H."""
    return ufl.Identity(H.ufl_shape[0]) + H


def _in_space(A: Any, across: Any) -> Any:
    """Return the 2 x 2 tensor ``A`` as a 3 x 3 tensor with ``across`` as its 33 component."""
    return ufl.as_tensor([[A[0, 0], A[0, 1], 0], [A[1, 0], A[1, 1], 0], [0, 0, across]])


class Material:
    """Bulk material; the argument ``u`` is always the displacement, a vector Function (length).

    The parameters are read-only. Moduli that change must be Constants; every solve uses their
    present values.

    A subclass defines the stored energy as a function of the displacement gradient H (dim x dim, or
    3 x 3): either `_energy_of`, or its two parts `_shape_energy` and `_volume_energy`. Stresses are
    derivatives of the energy.
    """

    #: Whether the body is a body of revolution.
    _of_revolution: ClassVar[bool] = False

    # -- energies and stresses of a body ---------------------------------------------------------

    def energy(self, u: fem.Function) -> Any:
        """Return the stored energy per reference volume (per area in 2D), in units of stress."""
        return self._own(self._law._energy_of(u, self._gradient(u)))

    def mean_dilatation_energy(self, u: fem.Function, dx: ufl.Measure = ufl.dx) -> ufl.Form:
        """Return the B-bar energy integral for nearly incompressible quadrilaterals or hexahedra.

        The part of the energy growing with the first Lame coefficient lambda depends on the change
        of volume of the whole cell, which is computed exactly, also for distorted cells. The
        remaining part is integrated by ``dx``. This is the mean dilatation or B-bar method
        (Nagtegaal, Parks and Rice, Comput. Methods Appl. Mech. Engrg. 4, 1974, 153-177; Hughes,
        Int. J. Numer. Methods Engrg. 15, 1980, 1413-1418), and for large strains the method with
        the ratio of the cell volumes (Simo, Taylor and Pister, Comput. Methods Appl. Mech. Engrg.
        51, 1985, 177-208). In the first part, moduli are evaluated at the centre of the cell.
        `mean_dilatation_stress` returns the stress.

        Args:
            u: displacement (length), of degree 1.
            dx: measure over all cells or over a tag.

        Raises:
            ValueError: if the cells are simplices (use u of degree 2 there), if edges are curved,
                if u is not Lagrange of degree 1, if ``dx`` is not a cell measure, or if the part of
                the energy that grows with lambda does not depend on the change of volume only
                (plane stress, which does not lock, `StVenantKirchhoff`, and user-defined
                materials).
        """
        if not isinstance(dx, ufl.Measure) or dx.integral_type() != "cell":
            raise ValueError(
                f"dx must be a cell measure such as ufl.dx or dx(1), got {dx}; for several tags "
                "use dx((1, 2))"
            )
        cell = self._cell_volumes(u)
        volume = self._law._volume_energy(u, cell.dilatation, cell.ratio) * cell.share
        shape = self._law._shape_energy(u, self._gradient(u))
        return self._own(shape) * dx + self._own(volume) * dx(metadata=at_middle(len(u)))

    def mean_dilatation_stress(self, u: fem.Function) -> Any:
        """Return the Cauchy stress, 3 x 3, of `mean_dilatation_energy`.

        The stress is valid at the centre of each cell, where files, pictures and films evaluate it.
        Integrals of the stress therefore require the one-point rule,
        ``dx(metadata={"quadrature_degree": 1})``. The stress from `full_stress` contains the
        pointwise pressure, which oscillates without bound as the first Lame coefficient grows.

        Raises:
            ValueError: for the reasons listed in `mean_dilatation_energy`.
        """
        law = self._law
        cell = self._cell_volumes(u)
        H = ufl.variable(self._gradient_in_space(u))
        dilatation = ufl.variable(cell.dilatation)
        ratio = ufl.variable(cell.ratio)
        volume = law._volume_energy(u, dilatation, ratio)
        pressure = ufl.diff(volume, dilatation) + ufl.diff(volume, ratio)
        shape = law._pushed_forward(ufl.diff(law._shape_energy(u, H), H), H)
        return self._own(shape + pressure * ufl.Identity(3))

    def stress(self, u: fem.Function) -> Any:
        """Return the Cauchy stress, dim x dim."""
        return self._own(self._stress_of(u, self._gradient(u)))

    def full_stress(self, u: fem.Function) -> Any:
        """Return the 3 x 3 Cauchy stress, which in 2D includes the out-of-plane stress.

        The expression is valid for this material only: for several materials pass one expression
        per cell tag, ``stress={1: steel.full_stress(u), 2: wood.full_stress(u)}``. For a body with
        `mean_dilatation_energy`, only the deviatoric part is meaningful, not the pressure. The
        module docstring shows the stress of a user-defined energy.
        """
        return self._own(self._law._stress_of(u, self._gradient_in_space(u)))

    def check_moduli(self) -> None:
        """Raise `ValueError` if the moduli do not belong to a stable material. Not collective.

        Numbers, Constants and UFL expressions of Constants are checked with their present values at
        construction and at the start of every solve with the material.
        """
        lmbda, mu = getattr(self, "lmbda", 0.0), getattr(self, "mu", 1.0)
        rule = (
            "Lame coefficients, numbers or UFL scalars, need mu > 0 and 3 lambda + 2 mu > 0 "
            "(Young's modulus > 0, Poisson's ratio in (-1, 1/2))"
        )
        _check(rule, lambda a, b: b > 0 and 3 * a + 2 * b > 0, lmbda, mu)

    def __post_init__(self) -> None:
        self.check_moduli()

    def _own(self, expression: Any) -> Any:
        """Register an expression of this material, so that `materials_in` finds it; return it."""
        key = id(expression)
        _materials[key] = weakref.ref(expression, lambda _: _materials.pop(key, None)), self
        return expression

    def _cell_volumes(self, u: fem.Function) -> Any:
        # Imported here, as a static solve does not need it.
        from dolfinx_contact._cell_volumes import volumes_of

        _require_bilinear(u)
        return volumes_of(u, revolution=self._of_revolution)

    @property
    def _law(self) -> Material:
        """Material that defines the energy as a function of the displacement gradient."""
        return self

    def _gradient(self, u: fem.Function) -> Any:
        """Return the displacement gradient on which the energy depends."""
        _require_displacement(u)
        return ufl.grad(u)

    def _gradient_in_space(self, u: fem.Function) -> Any:
        """Return the 3 x 3 displacement gradient on which the stress depends."""
        H = self._gradient(u)
        return H if len(u) == 3 else _in_space(H, 0)

    # -- the law of the material -----------------------------------------------------------------

    def _energy_of(self, u: fem.Function, H: Any) -> Any:
        """Return the stored energy density for the displacement gradient H."""
        ratio = ufl.det(_deformation(H))
        return self._shape_energy(u, H) + self._volume_energy(u, ufl.tr(H), ratio)

    def _shape_energy(self, u: fem.Function, H: Any) -> Any:
        """Return the energy density at gradient H that stays bounded as Lame's lambda grows."""
        raise NotImplementedError

    def _volume_energy(self, u: fem.Function, dilatation: Any, ratio: Any) -> Any:
        """Return the part of the energy density that grows with the first Lame coefficient.

        ``dilatation`` is the trace of the displacement gradient or its cell mean, ``ratio`` the
        determinant of the deformation gradient or the ratio of displaced to reference cell volume.
        """
        raise ValueError(
            f"the volumetric part of the energy of a {type(self).__name__} is unknown: "
            "use LinearElastic, NeoHookean or CiarletGeymonat"
        )

    def _stress_of(self, u: fem.Function, H: Any) -> Any:
        """Return the Cauchy stress for the displacement gradient H."""
        H = ufl.variable(H)
        return self._pushed_forward(ufl.diff(self._energy_of(u, H), H), H)

    def _pushed_forward(self, P: Any, H: Any) -> Any:
        """Return the Cauchy stress for the first Piola-Kirchhoff stress P at the gradient H."""
        F = _deformation(H)
        return P * F.T / ufl.det(F)


@dataclass(frozen=True)
class LinearElastic(Material):
    """Isotropic linear elasticity: 3D, plane strain or plane stress (per unit thickness).

    Attributes:
        lmbda: first Lame coefficient of the 3D material.
        mu: shear modulus, the second Lame coefficient.
        plane_stress: whether a 2D body is in plane stress; otherwise it is in plane strain.
    """

    lmbda: Any
    mu: Any
    plane_stress: bool = False

    @classmethod
    def from_young(cls, young: Any, poisson: Any, *, plane_stress: bool = False) -> LinearElastic:
        """Return the material with Young's modulus and Poisson's ratio.

        Args:
            young: Young's modulus, a stress: a number, a Constant, whose value may change between
                two solves, a Function, or another UFL scalar.
            poisson: Poisson's ratio in (-1, 1/2), of the same types.
            plane_stress: in 2D, plane stress instead of plane strain.

        Raises:
            ValueError: for the reasons listed in `lame`.

        Example:
            ::

                young = fem.Constant(domain, 210e3)
                steel = LinearElastic.from_young(young, 0.3)
        """
        return cls(*lame(young, poisson), plane_stress=plane_stress)

    def full_stress(self, u: fem.Function) -> Any:
        return (
            self._own(_in_space(self.stress(u), 0)) if self.plane_stress else super().full_stress(u)
        )

    def _energy_of(self, u: fem.Function, H: Any) -> Any:
        return ufl.inner(self._stress_of(u, H), ufl.sym(H)) / 2

    def _stress_of(self, u: fem.Function, H: Any) -> Any:
        lmbda, mu = _constants(u, self.lmbda, self.mu)
        if self.plane_stress:
            if len(u) != 2:
                raise ValueError("plane stress needs a 2D mesh")
            lmbda = 2 * lmbda * mu / (lmbda + 2 * mu)
        strain = ufl.sym(H)
        return 2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(H.ufl_shape[0])

    def _shape_energy(self, u: fem.Function, H: Any) -> Any:
        (mu,) = _constants(u, self.mu)
        return mu * ufl.inner(ufl.sym(H), ufl.sym(H))

    def _volume_energy(self, u: fem.Function, dilatation: Any, ratio: Any) -> Any:
        if self.plane_stress:
            raise ValueError("plane stress does not lock: use energy(u)")
        (lmbda,) = _constants(u, self.lmbda)
        return lmbda / 2 * dilatation**2

    def _pushed_forward(self, P: Any, H: Any) -> Any:
        return P


@dataclass(frozen=True)
class StVenantKirchhoff(Material):
    """St. Venant-Kirchhoff material, in plane strain in 2D.

    The energy is W = lambda/2 (tr E)^2 + mu E:E with the Green-Lagrange strain E and the Lame
    coefficients lambda and mu.
    """

    lmbda: Any
    mu: Any

    def _energy_of(self, u: fem.Function, H: Any) -> Any:
        lmbda, mu = _constants(u, self.lmbda, self.mu)
        F = _deformation(H)
        E = (F.T * F - ufl.Identity(F.ufl_shape[0])) / 2
        return lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)


@dataclass(frozen=True)
class NeoHookean(Material):
    """Compressible neo-Hookean material.

    The energy is W = mu/2 (|F|^2 - 3 - 2 ln J) + lambda/2 (ln J)^2 with the deformation gradient F,
    J = det F, and small-strain Lame coefficients lambda and mu. In 2D (plane strain) F_33 = 1.
    """

    lmbda: Any
    mu: Any

    def _shape_energy(self, u: fem.Function, H: Any) -> Any:
        (mu,) = _constants(u, self.mu)
        F = _deformation(H)
        return mu / 2 * (ufl.inner(F, F) - F.ufl_shape[0] - 2 * ufl.ln(ufl.det(F)))

    def _volume_energy(self, u: fem.Function, dilatation: Any, ratio: Any) -> Any:
        (lmbda,) = _constants(u, self.lmbda)
        return lmbda / 2 * ufl.ln(ratio) ** 2


@dataclass(frozen=True)
class CiarletGeymonat(Material):
    """Ciarlet-Geymonat material (Ciarlet, Mathematical Elasticity I, 1988, section 4.10).

    The energy, up to a constant, is

        W = a tr C + b ((tr C)^2 - |C|^2)/2 + c det C - d/2 ln det C,
        b = mu/2 - a,    c = lambda/4 - mu/2 + a,    d = lambda/2 + mu,

    with the right Cauchy-Green tensor C = F^T F of the deformation gradient F. The constant is such
    that W = 0 for F = I. In 2D (plane strain) C_33 = 1.

    Attributes:
        lmbda, mu: Lame coefficients lambda and mu at small strain.
        a: free parameter, 0 < a < mu/2.
    """

    lmbda: Any
    mu: Any
    a: Any

    def check_moduli(self) -> None:
        super().check_moduli()
        _check("a must lie between 0 and mu/2", lambda a, half: 0 < a < half, self.a, self.mu / 2)

    def _shape_energy(self, u: fem.Function, H: Any) -> Any:
        mu, a = _constants(u, self.mu, self.a)
        b = mu / 2 - a
        F = _deformation(H)
        out = 3 - F.ufl_shape[0]  # the out-of-plane stretch of plane strain, C_33 = 1
        C = F.T * F
        tr = ufl.tr(C) + out
        det = ufl.det(C)
        second = (tr**2 - ufl.inner(C, C) - out) / 2
        return a * (tr - 3) + b * (second - 3) - b * (det - 1) - mu / 2 * ufl.ln(det)

    def _volume_energy(self, u: fem.Function, dilatation: Any, ratio: Any) -> Any:
        (lmbda,) = _constants(u, self.lmbda)
        return lmbda / 4 * (ratio**2 - 1 - ufl.ln(ratio**2))


@dataclass(frozen=True)
class Axisymmetric(Material):
    """Material of an axisymmetric body; the mesh is half of a cross-section, r = x, z = y.

    The displacement is (u_r, u_z), and the circumferential stretch is 1 + u_r / r; the components
    of tensors are r, z and circumferential. Energies are given per volume: the contact problem
    multiplies all integrals by 2 pi r.

    Attributes:
        material: material in 3D.

    Raises:
        ValueError: if ``material`` is not a `Material`, is axisymmetric, or is in plane stress.
    """

    material: Material
    _of_revolution: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not isinstance(self.material, Material) or isinstance(self.material, Axisymmetric):
            raise ValueError(f"Axisymmetric requires a Material in 3D, got {self.material!r}")
        if getattr(self.material, "plane_stress", False):
            raise ValueError("an axisymmetric body cannot be in plane stress")

    def check_moduli(self) -> None:
        self.material.check_moduli()

    def stress(self, u: fem.Function) -> Any:
        full = self.full_stress(u)
        return self._own(ufl.as_tensor([[full[i, j] for j in range(2)] for i in range(2)]))

    @property
    def _law(self) -> Material:
        return self.material

    def _gradient(self, u: fem.Function) -> Any:
        return _in_space(ufl.grad(u), u[0] / _radius(u))

    def _gradient_in_space(self, u: fem.Function) -> Any:
        r = _radius(u)
        H = ufl.grad(u)
        on_axis = ufl.lt(r, _ON_AXIS * ufl.CellDiameter(u.function_space.mesh))
        return _in_space(H, ufl.conditional(on_axis, H[0, 0], u[0] / r))


_ON_AXIS = 1e-8  # distance from the axis, in cell sizes, below which u_r / r is du_r / dr


def _radius(u: Any) -> Any:
    """Return the radius x as UFL; raise `ValueError` unless ``u`` is a 2D displacement."""
    _require_displacement(u)
    if len(u) != 2:
        raise ValueError("an axisymmetric body requires a 2D mesh of its cross-section")
    return ufl.SpatialCoordinate(u.function_space.mesh)[0]


def _require_bilinear(u: Any) -> None:
    """Raise `ValueError` unless ``u`` has degree 1 on straight quadrilaterals or hexahedra."""
    _require_displacement(u)
    domain = u.function_space.mesh
    element = u.function_space.ufl_element()
    cell = domain.basix_cell().name
    needed = basix.ufl.element("P", cell, 1, shape=(domain.topology.dim,))
    solid = cell in ("quadrilateral", "hexahedron")
    straight = domain.ufl_domain().ufl_coordinate_element().degree == 1
    if not solid or not straight or element != needed:
        raise ValueError(
            "the mean dilatation requires a continuous Lagrange displacement of degree 1, with a "
            "component for every axis, on quadrilaterals or hexahedra with straight edges; got "
            f"{element} on {'' if straight else 'curved '}{cell}s. On other cells use u of degree "
            "2 and energy(u), which do not lock"
        )
