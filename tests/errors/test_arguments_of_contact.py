"""Arguments that surfaces, pairs and rigid bodies refuse: one table for each class."""

from mpi4py import MPI

import numpy as np
import pytest
from support import pairs
from support.blocks import block, box
from support.curved_obstacles import OnBody
from support.mortars import pair_of, stacked
from support.pairs import MATERIAL, displacement, refused
from support.sliding_bodies import hairpin

import basix
import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactPair,
    ContactProblem,
    Coulomb,
    Cylinder,
    Frictionless,
    HalfSpace,
    LevelSet,
    NonlocalCoulomb,
    RigidBody,
    Sphere,
    Tresca,
)
from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.meshing import crack, join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
def test_nodal_pair_refuses_faces_with_common_nodes():
    both = stacked(3, 2, (0.0, 1.0), (0.0, 1.0))
    u = displacement(both.mesh)
    with pytest.raises(ValueError, match="slave and master touch at 1 nodes of the mesh"):
        discretise(ContactPair(u, both, slave=3, master=6, law=Frictionless()))


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"master": 3}, "contact: slave and master have 2 facets in common"),
        ({"master": 9}, "contact, master: no facet has the tag 9"),
        ({"slave": 4, "master": 1}, "overlap by 2; .* look away"),
        ({"slave": 3, "master": 1}, "point in the same direction"),
        ({"gap": ufl.SpatialCoordinate}, "the gap must be"),
        ({"gap": -0.1}, r"the given gap is -0\.1; interference=True"),
        ({"interference": "no"}, "interference must be True, False or"),
    ],
)
def test_pair_refuses_faces_and_gaps(arguments, message):
    both = pairs.stacked(2, "quad", 2)
    arguments = {k: v(both.mesh) if callable(v) else v for k, v in arguments.items()}
    refused(message, displacement(both.mesh), both, **arguments)


@pytest.mark.ranks(2)
def test_pair_refuses_indices_without_a_master_and_exchanged_faces():
    both = pairs.stacked(2, "quad", 2)
    u = displacement(both.mesh)
    with pytest.raises(ValueError, match="by their indices need master_facets"):
        discretise(ContactPair(u, both.facet_tags.find(3), law=Frictionless()))
    exchanged = [
        ContactPair(u, both, slave=a, master=b, law=Frictionless(), name=str(a))
        for a, b in ((2, 3), (3, 2))
    ]
    with pytest.raises(ValueError, match="2 and 3 are one pair with slave and master exchanged"):
        ContactProblem(MATERIAL.energy(u) * ufl.dx, u, exchanged)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda both: crack(both, []), "a crack needs names or tags of groups"),
        (lambda both: crack(both.mesh, [5]), "MeshTags of facets"),
        (
            lambda both: crack(both, [5]),
            r"no facet has the tag 5; tags of the mesh: \[1, 2, 3, 4\]",
        ),
        (lambda both: crack(both, [1]), "2 facets of the crack lie on the boundary"),
        (
            lambda _: join([box(COMM, 2, "quad"), box(COMM, 2, "tri")]),
            "meshes of different kinds",
        ),
        (lambda _: join([]), "a list of meshes is needed"),
    ],
)
def test_crack_and_join_refuse_groups_and_meshes(make, message):
    both = pairs.stacked(2, "quad", 2)
    with pytest.raises(ValueError, match=message):
        make(both)


def of_second_order(body):
    """Return the mesh with cells of second order, with the tags 2 and 3."""
    W = fem.functionspace(body.mesh, ("Lagrange", 2))
    nodes = W.dofmap.index_map
    n = body.mesh.topology.index_map(2).size_local
    cells = nodes.local_to_global(W.dofmap.list[:n].reshape(-1)).reshape(n, -1)
    x = W.tabulate_dof_coordinates()[: nodes.size_local, :2]
    element = basix.ufl.element("Lagrange", "quadrilateral", 2, shape=(2,))
    domain = mesh.create_mesh(COMM, cells=cells, x=x, e=element)
    face = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    domain.topology.create_connectivity(1, 2)
    to_cells = domain.topology.connectivity(1, 2)
    above = [midpoints(domain, to_cells.links(f)[:1])[0, 1] > 0 for f in face]
    tags = mesh.meshtags(domain, 1, face, np.where(above, 3, 2).astype(np.int32))
    return body._replace(mesh=domain, facet_tags=tags)


def friction_at_quadrature_points(domain):
    element = basix.ufl.quadrature_element(domain.basix_cell(), degree=2, scheme="default")
    return fem.Function(fem.functionspace(domain, element))


def derivative_of_friction(domain):
    return fem.Function(fem.functionspace(domain, ("Lagrange", 2))).dx(0)


FRICTION = "the friction of faces that do not match may"


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"law": derivative_of_friction},
            f"{FRICTION} not depend on derivatives: interpolate them first",
        ),
        ({"law": ufl.CellVolume}, f"{FRICTION} depend on coordinates, Functions and Constants"),
        (
            {"law": friction_at_quadrature_points},
            f"{FRICTION} not depend on values at quadrature points",
        ),
        ({"sides": (3, 6)}, "slave and master touch at 1 nodes of the mesh"),
    ],
)
def test_integral_pair_refuses_friction_and_degrees(arguments, message):
    both = stacked(3, 2, (0.0, 1.0), (0.0, 1.0))
    options = {k: Coulomb(v(both.mesh)) if callable(v) else v for k, v in arguments.items()}
    refused_integral(message, both, **options)


@pytest.mark.ranks(2)
def test_integral_pair_refuses_curved_cells():
    refused_integral(
        "cells are curved where faces do not match",
        of_second_order(stacked(3, 2, (0.0, 1.0), (0.0, 1.0))),
    )


def refused_integral(message, both, **options):
    with pytest.raises(ValueError, match=message) as info:
        discretise(pair_of(displacement(both.mesh), both, (1, 1), **options))
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
@pytest.mark.refuses("rigid bodies", aspects=("2D", "large sliding"))
def test_half_a_turn_in_a_step_is_refused():
    """After a whole turn all positions are the same, making the slip zero."""
    turns = []

    def body(domain):
        turns.append(fem.Constant(domain, 0.0))
        motion = {"x": 0.0, "y": 0.0, "rz": turns[0]}
        return RigidBody(Sphere((0.4, -1.0), 1.0), about=(0.4, -1.0), motion=motion)

    on_body = OnBody(2, body, Coulomb(0.3), sliding="large")
    on_body.move(lambda X: np.tile([0.0, -0.05], (len(X), 1)))
    turn = turns[0]
    for angle in (3.3, -2 * np.pi):
        turn.value = angle
        with pytest.raises(ValueError, match="rad in one step: slips on it are known below half"):
            on_body.problem.solve()
    turn.value = 3.0
    assert on_body.problem.solve().converged
    turn.value = 0.0
    on_body.u.x.array[:] = 0.0
    on_body.problem.solve()

    def load(t):
        turn.value = t

    evolution = QuasiStatic(on_body.problem, load)
    with pytest.raises(ValueError, match="rad in one step: slips on it are known below half"):
        evolution.run([0.0, 2 * np.pi])
    history = evolution.run([0.0, 2.0, 4.0])
    assert history.energies.dissipated > 0


DISC = Sphere((0.4, -3.0), 3.0)


@pytest.mark.ranks(2)
@pytest.mark.refuses(
    "mixed contact", "RCCM adhesion", "nonlocal friction", aspects=("large sliding",)
)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"law": RCCM(0.3, 100.0, 100.0, 0.1)}, "no friction with the law RCCM, which has bonds"),
        (
            {"law": NonlocalCoulomb(0.3, radius=0.3)},
            "no friction with the law .*, which averages the pressure around points",
        ),
        ({"method": "mixed"}, "gaps of mixed contact are averages"),
        ({"sliding": "huge"}, "sliding must be one of small, large, None; got 'huge'"),
    ],
)
def test_large_sliding_on_curved_obstacles_refuses_laws_and_methods(arguments, message):
    with pytest.raises(ValueError, match=message):
        OnBody(2, DISC, **({"law": Coulomb(0.3), "sliding": "large"} | arguments))


@pytest.mark.ranks(2)
@pytest.mark.refuses("NSCD motion", aspects=("large sliding",))
def test_velocity_level_refuses_friction_on_curved_obstacles():
    on_disc = OnBody(2, DISC, Coulomb(0.3))
    with pytest.raises(ValueError, match="large sliding on a curved obstacle is about positions"):
        NSCD(on_disc.problem, 1.0, dt=0.1, level="velocity", mass="lumped")


@pytest.mark.ranks(2)
@pytest.mark.refuses("RCCM adhesion", aspects=("large sliding",))
def test_bonds_refuse_large_sliding_on_a_turning_body():
    turned = RigidBody(DISC, about=(0.0, 0.0), motion={"rz": 0.1}, held=["x"], load={"y": 1.0})
    assert OnBody(2, turned, Coulomb(0.3)).surface.displaced is None  # by default it turns little
    with pytest.raises(ValueError, match="no friction with the law RCCM, which has bonds"):
        OnBody(2, turned, RCCM(10.0, 10.0, 0.1), sliding="large")


@pytest.mark.ranks(2)
@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs"))
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"normal": (0.0, 1.0)}, "does not support normal"),
        ({"method": "nodal"}, "does not support method"),
        ({"sliding": "huge"}, "sliding must be"),
        ({"law": Tresca(1.0)}, "bounds the shear of open points"),
        ({"master": 2}, "facets in common"),
    ],
)
def test_sliding_pair_refuses_arguments(arguments, message):
    both = stacked(4, 4, (0.0, 1.0), (0.0, 1.0))
    arguments = {"slave": 2, "master": 3, "law": Coulomb(0.3), "sliding": "large"} | arguments
    with pytest.raises(ValueError, match=message):
        discretise(ContactPair(displacement(both.mesh), both, **arguments))


@pytest.mark.ranks(2)
@pytest.mark.refuses("self contact", aspects=("2D",))
def test_pair_of_a_face_with_itself_names_self_contact():
    domain, tags = hairpin(0.5)
    u = displacement(domain)
    with pytest.raises(ValueError, match="SelfContact"):
        discretise(ContactPair(u, tags, slave=1, master=1, law=Coulomb(0.3), sliding="large"))


@pytest.mark.refuses("sliding pairs", "bodies of revolution", aspects=("2D", "pairs"))
def test_sliding_of_revolution_refuses_friction():
    both = stacked(4, 4, (0.0, 1.0), (0.0, 1.0))
    options = {"slave": 3, "master": 2, "sliding": "large", "axisymmetric": True}
    with pytest.raises(ValueError, match="take only Frictionless"):
        discretise(ContactPair(displacement(both.mesh), both, law=Coulomb(0.3), **options))


PLANE = HalfSpace((0, 1), (0, -1))


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"load": {"y": -1.0}, "held": ["x"]}, "needs one load or motion.* got y, x"),
        ({"load": {"y": -1.0}, "held": ["x", "y", "rz"]}, "got y, x, y, rz"),
        ({"load": {"y": np.nan}, "held": ["x", "rz"]}, "must be a finite number"),
        ({"load": {"z": -1.0}, "held": ["x", "y", "rz"]}, "got z, x, y, rz"),
        ({"load": {"y": "down"}, "held": ["x", "rz"]}, "number or a UFL scalar"),
        ({"load": {"y": True}, "held": ["x", "rz"]}, "number or a UFL scalar"),
        ({"load": -1.0, "held": ["x", "y", "rz"]}, "go by component"),
        ({"held": "xy"}, "free and held must be a list"),
        ({"held": ["x", "x", "y", "rz"]}, "got x, x, y, rz"),
        ({"about": (0.0, np.inf), "held": ["x", "y", "rz"]}, "must be 2 or 3 finite numbers"),
        ({"shape": None, "held": ["x", "y", "rz"]}, "its shape must be"),
        ({"name": "", "held": ["x", "y", "rz"]}, "must be a word"),
        ({"name": "support_1", "held": ["x", "y", "rz"]}, "must not be 'support_1'"),
    ],
)
def test_rigid_body_refuses_arguments(arguments, message):
    arguments = {"shape": PLANE, "about": (0, 1)} | arguments
    with pytest.raises(ValueError, match=message):
        RigidBody(arguments.pop("shape"), **arguments)


@pytest.mark.parametrize(
    ("obstacle", "message"),
    [
        (lambda: HalfSpace((0, 0), (0, 0)), "normal of the half-space must be 2 or 3 finite .* 0"),
        (lambda: HalfSpace((0, (1, 2)), (0, 1)), "the point of the half-space must be 2 or 3"),
        (lambda: Sphere((0.0,), 1.0), "the centre of the sphere must be 2 or 3 finite numbers"),
        (lambda: Sphere(np.array([0, 1j]), 1.0), "the centre of the sphere must be 2 or 3 finite"),
        (lambda: Sphere((0, 0), np.complex64(1 + 1j)), "the radius must be positive"),
        (lambda: Sphere((0.0, 0.0), -1.0), "the radius must be positive, got -1.0"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 1), np.nan), "the radius must be positive, got nan"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 0), 1.0), "the axis of the cylinder must be .* not"),
        (lambda: LevelSet(1.0), "the level set must be a function of position, got 1.0"),
    ],
)
def test_obstacles_refuse_inadmissible_arguments_at_construction(obstacle, message):
    with pytest.raises(ValueError, match=message):
        obstacle()


@pytest.mark.ranks(2)
def test_a_sphere_in_space_is_refused_on_a_plane_mesh():
    with pytest.raises(ValueError, match="centre of the sphere must have 2 components"):
        block(cell="tri", n=2, obstacle=Sphere((0.0, 0.0, -1.0), 1.0))
