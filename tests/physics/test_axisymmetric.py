"""Bodies of revolution: areas, patch tests, closed forms and refused input."""

from mpi4py import MPI

import cases.press_fit
import numpy as np
import pytest
from cases._hertz import Hertz
from cases._round import draw, quarter
from support.blocks import box, facets, same_tables
from support.checks import solved_start
from support.pairs import FLOOR, disc, energy_of_revolution, section, tagged
from support.pairs import held_of_revolution as held

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    Sphere,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import (
    Axisymmetric,
    LinearElastic,
)
from dolfinx_contact.meshing import join, mesh_from_gmsh
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
FIT = [(cases.press_fit.YOUNG[k], cases.press_fit.NU[k]) for k in ("hub", "ring")]

STEEL = Axisymmetric(LinearElastic.from_young(1000.0, 0.3))
KINDS = [
    *(("tri", 1, "nodal"), ("quad", 1, "nodal"), ("tri", 1, "mixed"), ("quad", 1, "mixed")),
    *(("tri", 2, "mixed"), ("quad", 2, "mixed")),
    *(("tri", 1, "integral"), ("quad", 2, "integral"), ("tri", 2, "integral")),
]


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("cell", "degree", "method"), KINDS)
@pytest.mark.verifies(
    "bodies of revolution",
    "nodal contact",
    "mixed contact",
    "integral contact",
    reference="closed form: uniform pressure, hoop strain and energy of a disc",
    aspects=("2D",),
)
def test_uniform_pressure_on_a_disc_is_exact(cell, degree, method):
    """Exact to round-off: pressure, areas, forces of the circumference, hoop strain, energy."""
    problem = disc(section(5, cell), degree, method)
    result = problem.solve()
    table = result.tables["contact"]
    assert table.area.sum() == pytest.approx(np.pi, rel=1e-12)
    assert (table.area > 0).all()
    np.testing.assert_allclose(table.pressure, 10.0, rtol=1e-9)
    np.testing.assert_allclose(result.resultants["contact"], [0.0, 10.0 * np.pi], rtol=1e-9)
    np.testing.assert_allclose(result.support, [0.0, -10.0 * np.pi], rtol=1e-9)
    assert len(result.supports) == len(problem.bcs)  # the last condition is on the axis
    np.testing.assert_allclose(result.supports.sum(axis=0), result.support, rtol=1e-9)
    assert not result.supports[-1].any()
    np.testing.assert_allclose(result.external, 0.0, atol=1e-9)
    assert result.imbalance < 1e-10
    assert result.energies["bulk"] == pytest.approx(0.05 * np.pi, rel=1e-9)
    x = problem.V.tabulate_dof_coordinates()
    u = problem.u.x.array.reshape(-1, 2)
    np.testing.assert_allclose(u[:, 0], 0.003 * x[:, 0], atol=1e-11)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "bodies of revolution", "units", reference="itself: other units", aspects=("2D",)
)
def test_a_disc_in_other_units_has_the_same_iterates():
    """Millimetres and pascals: the same iterates, forces in the units of the input."""
    plain, other = (
        disc(section(4, size=size), law=Coulomb(0.1), size=size, modulus=modulus).solve()
        for size, modulus in ((1.0, 1.0), (1e3, 1e6))
    )
    assert plain.iterations == other.iterations
    a = plain.tables["contact"]
    b = other.tables["contact"]
    assert a.status == b.status
    np.testing.assert_allclose(b.force, 1e12 * a.force, atol=1e2)
    np.testing.assert_allclose(b.pressure, 1e6 * a.pressure, rtol=1e-9)


def indented(shape, contact_radius, n=16):
    """A rigid sphere of radius 50 indenting a cylinder of 40 contact radii."""
    a = contact_radius
    across = graded(40 * a, a / n, 2 * n, n)
    domain = create_grid(COMM, [across, across], mesh.CellType.quadrilateral)
    domain.geometry.x[:, 1] *= -1.0
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    size = 40 * a
    near = mesh.locate_entities_boundary(
        domain, 1, lambda x: (x[1] > -1e-9) & (x[0] < across[2 * n] * (1 + 1e-9))
    )
    shape = RigidBody(shape, about=(0.0, 0.0), held=["x", "rz"], load={"y": -LOAD})
    surface = ContactSurface(u, near, obstacle=shape, law=Frictionless(), axisymmetric=True)
    energy = STEEL.energy(u) * ufl.dx
    bcs = [held(V, 1, domain, 1, -size, 0.0), held(V, 0, domain, 0, size, 0.0)]
    return ContactProblem(energy, u, [surface], bcs=bcs)


HERTZ = Hertz(3, 50.0, 1000.0 / (1 - 0.3**2))
LOAD = HERTZ.load(1.0)


@pytest.mark.verifies(
    "bodies of revolution",
    "spheres",
    "rigid bodies",
    reference="closed form: Hertz",
    aspects=("2D",),
)
def test_axisymmetric_rigid_sphere_agrees_with_hertz():
    """A rigid sphere on a half-space: peak and radius at the given force, to 1 %."""
    problem = indented(Sphere((0.0, 50.0), 50.0), 1.0)
    result = problem.solve()
    table = result.tables["contact"]
    ball = result.rigid_bodies["rigid body"]
    np.testing.assert_allclose(ball.contact, [0.0, LOAD, 0.0], rtol=1e-9)
    np.testing.assert_allclose(result.resultants["contact"], [0.0, -LOAD], rtol=1e-9)
    found = HERTZ.compare(table)
    assert found["load"] == pytest.approx(LOAD, rel=1e-4)  # normals lean
    assert found["peak_pressure"] == pytest.approx(HERTZ.peak(LOAD), rel=0.01)
    assert found["radius"] == pytest.approx(1.0, rel=0.01)
    assert found["profile_error"] < 0.01
    assert -ball.displacement[1] == pytest.approx(HERTZ.approach(LOAD, 40.0, 0.3), rel=0.05)


@pytest.mark.verifies(
    "bodies of revolution",
    "Signorini",
    reference="independent code: Code_Aster, SSNV104",
    aspects=("2D",),
)
def test_axisymmetric_sphere_on_a_plane_agrees_with_hertz():
    """SSNV104 by symmetry: one sphere pressed by half, as two: 660.7 kN, 2912 MPa, 10.2 mm."""
    size = 0.5
    body = mesh_from_gmsh(COMM, lambda: draw({"upper": quarter(size, 1, 50.0)}))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = ContactSurface(
        u, body, tag="upper face", obstacle=FLOOR, law=Frictionless(), axisymmetric=True
    )
    energy = Axisymmetric(LinearElastic.from_young(20e3, 0.3)).energy(u) * ufl.dx
    down = fem.dirichletbc(-2.0, body.dofs(V.sub(1), "upper end"), V.sub(1))
    result = ContactProblem(energy, u, [floor], bcs=[down]).solve()
    table = result.tables["contact"]
    found = Hertz(3, 50.0, 20e3 / (1 - 0.3**2)).compare(table)
    assert found["load"] == pytest.approx(660.7e3, rel=3e-3)
    assert found["peak_pressure"] == pytest.approx(2912, rel=2e-3)
    assert found["peak_pressure_error"] < 1e-3
    assert found["touching_radius"] == pytest.approx(10.3, abs=0.4)


def stacked(sizes, degree, method, *, cell="tri", law=None, gap=None, cone=0.0):
    """Two discs on each other, of different materials without Poisson's effect.

    The lower face of the upper one may be a cone, with its tip on the axis, by its slope.
    """
    bodies = []
    tags = []
    for i, n in enumerate(sizes):
        domain = box(COMM, n, cell)
        x = domain.geometry.x
        x[:, 1] += i
        bodies.append(domain)
        tags.append(tagged(domain, **{f"t{2 * i + 1}": (1, i), f"t{2 * i + 2}": (1, i + 1)}))
        x[:, 1] += i * cone * x[:, 0] * (2 - x[:, 1])
    both = join(bodies, facet_tags=tags)
    V = fem.functionspace(both.mesh, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    energy = energy_of_revolution(u, both, (1000.0, 0.0), (3000.0, 0.0))
    bcs = [held(V, 1, both.mesh, 1, z, value) for z, value in ((0.0, 0.0), (2.0, -0.01))]
    given = dict(slave=3, master=2, method=method, axisymmetric=True)
    pair = ContactPair(u, both, law=law or Frictionless(), **given)
    options = {"snes_rtol": 1e-12}
    return ContactProblem(energy, u, [pair], bcs=bcs, petsc_options=options)


@pytest.mark.parametrize(
    ("sizes", "degree", "method"),
    [
        ((4, 4), 1, "nodal"),
        ((4, 4), 1, "mixed"),
        ((3, 4), 2, "mixed"),
        ((3, 3), 2, "integral"),
        ((5, 7), 1, "nodal"),
        ((7, 5), 1, "integral"),
        ((3, 4), 2, "integral"),
    ],
)
@pytest.mark.verifies(
    "bodies of revolution",
    "mortar",
    "points in common",
    reference="closed form: uniform pressure between discs",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_uniform_pressure_between_discs_is_exact(sizes, degree, method):
    """Exact to round-off on any meshes, up to the axis."""
    problem = stacked(sizes, degree, method)
    result = problem.solve()
    table = result.tables["contact"]
    pressure = 0.01 / (1 / 1000 + 1 / 3000)
    assert problem.surfaces[0].obstacle.opposite.matching == (sizes[0] == sizes[1])
    assert table.area.sum() == pytest.approx(np.pi, rel=1e-12)
    np.testing.assert_allclose(table.pressure, pressure, rtol=1e-9)
    pair = result.pairs["contact"]
    np.testing.assert_allclose(pair.slave, [0.0, np.pi * pressure], rtol=1e-9)
    assert pair.imbalance < 1e-10
    assert pair.moment is None
    x = problem.V.tabulate_dof_coordinates()[:, 1]
    u = problem.u.x.array.reshape(-1, 2)
    np.testing.assert_allclose(u[:, 0], 0.0, atol=1e-11)
    above = -0.01 - pressure * (x - 2) / 3000
    exact = np.where(x > 1 + 1e-9, above, -pressure * x / 1000)
    inside = np.abs(x - 1) > 1e-9
    np.testing.assert_allclose(u[inside, 1], exact[inside], atol=1e-11)


@pytest.mark.verifies(
    "bodies of revolution", reference="closed form: the normals of a cone", aspects=("2D", "pairs")
)
@pytest.mark.parametrize("sizes", [(4, 4), (5, 7)])
def test_normal_at_the_tip_of_a_cone_is_along_the_axis(sizes):
    """The normal on the axis is the mean of the normals of opposite meridians, along the axis."""
    table = stacked(sizes, 1, "nodal", cone=0.1).solve().tables["contact"]
    tip = table.x[:, 0] < 1e-9
    assert tip.sum() == 1
    assert table.letters[tip] != "o"
    np.testing.assert_allclose(table.n[tip], [[0.0, -1.0]], atol=1e-12)
    aside = np.array([0.1, -1.0]) / np.sqrt(1.01)
    np.testing.assert_allclose(table.n[~tip], np.tile(aside, (sizes[1], 1)), atol=1e-12)
    np.testing.assert_allclose(table.force[tip, 0], 0.0, atol=1e-12)


def fitted(n, ratio, method, degree=1):
    """The hub and the ring of `cases.press_fit` in a section of length 10, in plane strain."""
    bodies = []
    tags = []
    for i, (name, k) in enumerate((("hub", n), ("ring", round(ratio * n)))):
        a, b = cases.press_fit.RADII[name]
        domain = mesh.create_rectangle(
            COMM, [(a, 0.0), (b, 10.0)], [k, k], mesh.CellType.quadrilateral
        )
        bodies.append(domain)
        tags.append(tagged(domain, **{f"t{2 * i + 1}": (0, a), f"t{2 * i + 2}": (0, b)}))
    both = join(bodies, facet_tags=tags)
    V = fem.functionspace(both.mesh, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    energy = energy_of_revolution(u, both, *FIT)
    bcs = [held(V, 1, both.mesh, 1, z, 0.0) for z in (0.0, 10.0)]
    given = dict(slave=2, master=3, method=method, axisymmetric=True)
    pair = ContactPair(u, both, law=Frictionless(), gap=-0.02, interference=True, **given)
    return ContactProblem(energy, u, [pair], bcs=bcs)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("ratio", "method", "degree"),
    [
        (1.0, "nodal", 1),
        (1.5, "nodal", 1),
        (1.0, "mixed", 1),
        (1.5, "mixed", 2),
        (1.5, "integral", 2),
    ],
)
@pytest.mark.verifies(
    "press fits",
    "bodies of revolution",
    reference="closed form: Lame's pressure and radial displacement",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_press_fit_of_revolution_has_lames_pressure(ratio, method, degree):
    """A press fit: Lame's pressure and radial displacement, to the square of the mesh size."""
    exact = cases.press_fit.lame(0.02)
    errors = []
    for n in (4, 8) if degree == 1 else (4,):
        problem = fitted(n, ratio, method, degree)
        result = problem.solve()
        table = result.tables["contact"]
        np.testing.assert_allclose(table.pressure, table.pressure.mean(), rtol=1e-3)
        errors.append(abs(table.pressure.mean() / exact - 1))
        np.testing.assert_allclose(result.resultants["contact"], 0.0, atol=1e-6 * table.rn.sum())
        assert table.rn.sum() == pytest.approx(table.pressure.mean() * 500 * np.pi, rel=1e-6)
    assert errors[-1] < (1e-3 if degree == 1 else 1e-4)
    assert degree == 2 or errors[1] < 0.3 * errors[0]
    x = problem.V.tabulate_dof_coordinates()
    u = problem.u.x.array.reshape(-1, 2)
    a = 15.0
    c = 25.0
    b = 40.0
    size = problem.V.dofmap.index_map.size_local
    for r, inner, outer, name, sign in ((a, a, c, "hub", -1), (b, c, b, "ring", 1)):
        E = cases.press_fit.YOUNG[name]
        nu = cases.press_fit.NU[name]
        # Plane strain: u = (1 + nu)/E (A (1 - 2 nu) r + B/r), of the pressure on one face.
        loaded = c**2 / (outer**2 - inner**2)
        A = sign * exact * loaded
        B = A * (inner**2 if sign < 0 else outer**2)
        free = (1 + nu) / E * (A * (1 - 2 * nu) * r + B / r)
        at = np.flatnonzero(np.abs(x[:size, 0] - r) < 1e-9)
        np.testing.assert_allclose(u[at, 0], free, rtol=2e-3)


@pytest.mark.verifies(
    "bodies of revolution",
    "energies of histories",
    reference="itself: half the step",
    aspects=("2D",),
)
def test_axisymmetric_history_balances_its_energies():
    """A disc slipping outwards and back stores or dissipates the external work."""
    residues = []
    for steps in (4, 8):
        domain = section(4, "quad")
        lid = fem.Constant(domain, 0.0)
        problem = disc(domain, law=Coulomb(0.2), lid=lid)
        times = np.concatenate([np.linspace(0, 1, steps + 1), np.linspace(1, 1.5, steps + 1)[1:]])

        def load(t, lid=lid):
            lid.value = -0.01 * min(t, 2 - t)

        energies = QuasiStatic(problem, load).run(times).energies
        assert energies.dissipated > 1e-3 * energies.stored > 0
        residues.append(abs(energies.residue) / energies.dissipated)
    assert residues[0] < 0.2
    assert residues[1] < 0.6 * residues[0]


# -- what is refused -----------------------------------------------------------------------------


def refused(reason, make):
    with pytest.raises(ValueError, match=reason):
        make()


@pytest.mark.refuses("bodies of revolution", aspects=("3D",))
def test_axisymmetry_refuses_surfaces_across_the_axis():
    def surface(domain, where, **given):
        u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (domain.geometry.dim,))))
        given = dict(obstacle=FLOOR, law=Frictionless(), axisymmetric=True) | given
        return discretise(ContactSurface(u, where, **given))

    domain = section(3)
    bottom = facets(domain, 1, 0.0)
    refused("True or False, got 'r'", lambda: surface(domain, bottom, axisymmetric="r"))
    refused("3 facets lie on the axis", lambda: surface(domain, facets(domain, 0, 0.0)))
    shifted = section(3)
    shifted.geometry.x[:, 0] -= 0.5
    refused("the mesh reaches to x = -0.5", lambda: surface(shifted, facets(shifted, 1, 0.0)))
    cube = box(COMM, 2, "tet")
    ground = HalfSpace((0, 0, 0), (0, 0, 1))
    refused("meshed in 2D", lambda: surface(cube, facets(cube, 2, 0.0), obstacle=ground))


def test_axisymmetry_refuses_materials_without_hoop_stress():
    plane = LinearElastic.from_young(1.0, 0.3, plane_stress=True)
    refused("plane stress", lambda: Axisymmetric(plane))
    for wrong in (STEEL, 1.0):
        refused("Axisymmetric requires a Material in 3D", lambda wrong=wrong: Axisymmetric(wrong))
    cube = box(COMM, 2, "tet")
    u = fem.Function(fem.functionspace(cube, ("Lagrange", 1, (3,))))
    for make in (
        lambda: STEEL.energy(u),
        lambda: STEEL.full_stress(u),
    ):
        refused("requires a 2D mesh", make)


@pytest.mark.ranks(2)
def test_the_axis_is_held():
    """u_r = 0 there needs no condition of the user, and wins over one that says otherwise."""
    domain = section(3)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=FLOOR, law=Coulomb(0.2), axisymmetric=True
    )
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    moved = fem.dirichletbc(np.array([1e-4, -0.01]), top, V)
    energy = STEEL.energy(u) * ufl.dx
    result = ContactProblem(energy, u, [floor], bcs=[moved]).solve()
    axis = np.abs(V.tabulate_dof_coordinates()[:, 0]) < 1e-12
    np.testing.assert_array_equal(u.x.array.reshape(-1, 2)[axis, 0], 0.0)
    table = result.tables["contact"]
    assert table.rt[0, 0] == table.bound[0] == 0.0
    assert table.letters[0] == "k"


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "bodies of revolution",
    "friction as parameter",
    reference="itself: a solve at the end of the branch",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_a_branch_in_friction_ends_in_the_solution_of_a_disc():
    """The friction coefficient as a parameter leads to where a solve with it does."""
    domain = section(4, "quad")
    friction = fem.Constant(domain, 0.1)
    problem = disc(domain, law=Coulomb(friction))
    system = ParametricContact(problem, friction)
    x = solved_start(system)
    branch = follow(system, x, 0.1, gamma_range=(0.1, 0.4))
    assert branch.points[-1].gamma == pytest.approx(0.4)
    table = system.result_at(branch.points[-1]).tables["contact"]
    same_tables(table, disc(domain, law=Coulomb(0.4)).solve().tables["contact"], tolerance=1e-8)
