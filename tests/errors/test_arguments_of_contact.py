"""What surfaces, pairs and rigid bodies refuse: the call and its message."""

from mpi4py import MPI

import numpy as np
import pytest
from support import pairs
from support.blocks import box
from support.curved_obstacles import OnBody, block
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
    Frictionless,
    HalfSpace,
    NonlocalCoulomb,
    RigidBody,
    SelfContact,
    Sphere,
    Tresca,
)
from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.meshing import crack, join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
def test_mortar_refuses_obstacles_and_elements():
    both = stacked(3, 2, (0.0, 1.0), (0.0, 1.0))
    u = displacement(both.mesh)
    with pytest.raises(ValueError, match="slave and master touch at 1 nodes of the mesh"):
        discretise(ContactPair(u, both, slave=3, master=6, law=Frictionless()))


@pytest.mark.ranks(2)
def test_pair_refuses_faces_that_do_not_fit():
    both = pairs.stacked(2, "quad", 2)
    u = displacement(both.mesh)
    refused("contact: slave and master have 2 facets in common", u, both, master=3)
    refused(r"contact, master: no facet has the tag 9", u, both, master=9)
    refused("overlap by 2; .* look away", u, both, slave=4, master=1)
    for gap in (np.nan, "x", ufl.SpatialCoordinate(both.mesh)):
        refused("the gap must be", u, both, gap=gap)
    refused(r"the given gap is -0\.1; interference=True", u, both, gap=-0.1)
    refused("interference must be True, False or", u, both, interference="no")
    indices = both.facet_tags.find(3)
    with pytest.raises(ValueError, match="by their indices need master_facets"):
        discretise(ContactPair(u, indices, law=Frictionless()))
    with pytest.raises(ValueError, match="a crack needs names or tags of groups"):
        crack(both, [])
    exchanged = [
        ContactPair(u, both, slave=a, master=b, law=Frictionless(), name=str(a))
        for a, b in ((2, 3), (3, 2))
    ]
    with pytest.raises(ValueError, match="2 and 3 are one pair with slave and master exchanged"):
        ContactProblem(MATERIAL.energy(u) * ufl.dx, u, exchanged)
    refused("point in the same direction", u, both, slave=3, master=1)
    with pytest.raises(ValueError, match="MeshTags of facets"):
        crack(both.mesh, [5])
    with pytest.raises(
        ValueError, match=r"no facet has the tag 5; tags of the mesh: \[1, 2, 3, 4\]"
    ):
        crack(both, [5])
    with pytest.raises(ValueError, match="2 facets of the crack lie on the boundary"):
        crack(both, [1])
    with pytest.raises(ValueError, match="meshes of different kinds"):
        join([box(COMM, 2, "quad"), box(COMM, 2, "tri")])
    with pytest.raises(ValueError, match="a list of meshes is needed"):
        join([])


def of_second_order(body):
    """The same with nodes between those at corners, and tags 2 and 3."""
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


def refused_common(match, u, both, **options):
    with pytest.raises(ValueError, match=match) as info:
        discretise(pair_of(u, both, (1, 1), **options))
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
def test_integral_pair_refuses_friction_and_elements():
    both = stacked(3, 2, (0.0, 1.0), (0.0, 1.0))
    domain = both.mesh
    u = displacement(both.mesh)
    smooth = fem.Function(fem.functionspace(domain, ("Lagrange", 2)))
    where = "the friction of faces that do not match may"
    law = Coulomb(smooth.dx(0))
    refused_common(f"{where} not depend on derivatives: interpolate them first", u, both, law=law)
    law = Coulomb(ufl.CellVolume(domain))
    refused_common(f"{where} depend on coordinates, Functions and Constants", u, both, law=law)
    element = basix.ufl.quadrature_element(domain.basix_cell(), degree=2, scheme="default")
    law = Coulomb(fem.Function(fem.functionspace(domain, element)))
    refused_common(f"{where} not depend on values at quadrature points", u, both, law=law)
    refused_common("P1 with P1 must be a whole number >= 2", u, both, quadrature_degree=1)
    refused_common("is not a stable pair", u, both, multiplier_degree=2)
    refused_common("slave and master touch at 1 nodes of the mesh", u, both, sides=(3, 6))
    curved = of_second_order(both)
    refused_common("cells are curved where faces do not match", displacement(curved.mesh), curved)


@pytest.mark.ranks(2)
@pytest.mark.refuses("rigid bodies", aspects=("2D", "large sliding"))
def test_half_a_turn_in_a_step_is_refused():
    """A rotation by a whole turn leaves every place as it was, and no slip could be seen."""
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


@pytest.mark.ranks(2)
@pytest.mark.refuses(
    "mixed contact", "RCCM adhesion", "nonlocal friction", "NSCD motion", aspects=("large sliding",)
)
def test_friction_on_curved_obstacles_refuses_other_laws_and_motions():
    """Laws that need more than increments of slip, and what is about velocities."""
    disc = Sphere((0.4, -3.0), 3.0)
    for given, message in (
        ({"law": RCCM(0.3, 100.0, 100.0, 0.1)}, "no friction with the law RCCM, which has bonds"),
        (
            {"law": NonlocalCoulomb(0.3, radius=0.3)},
            "no friction with the law .*, which averages the pressure around points",
        ),
        ({"law": Coulomb(0.3), "method": "mixed"}, "gaps of mixed contact are averages"),
    ):
        with pytest.raises(ValueError, match=message):
            OnBody(2, disc, sliding="large", **given)
    on_disc = OnBody(2, disc, Coulomb(0.3))
    with pytest.raises(ValueError, match="large sliding on a curved obstacle is about positions"):
        NSCD(on_disc.problem, 1.0, dt=0.1, level="velocity", mass="lumped")
    turned = RigidBody(disc, about=(0.0, 0.0), motion={"rz": 0.1}, held=["x"], load={"y": 1.0})
    assert OnBody(2, turned, Coulomb(0.3)).surface.displaced is None  # by default it turns little
    adhesive = RCCM(10.0, 10.0, 0.1)
    with pytest.raises(ValueError, match="no friction with the law RCCM, which has bonds"):
        OnBody(2, turned, adhesive, sliding="large")


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"method": "mixed"}, "gaps of mixed contact are averages"),
        ({"sliding": "huge"}, "sliding must be one of small, large, None; got 'huge'"),
    ],
)
@pytest.mark.refuses("mixed contact", aspects=("large sliding",))
def test_large_sliding_refuses_methods(given, message):
    with pytest.raises(ValueError, match=message):
        block(Sphere((0.4, -3.0), 3.0), **given)


@pytest.mark.ranks(2)
@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs"))
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"gap": 0.1}, "does not support gap"),
        ({"normal": (0.0, 1.0)}, "does not support normal"),
        ({"method": "nodal"}, "does not support method"),
        ({"search_distance": -1.0}, "search distance must be positive"),
        ({"sliding": "huge"}, "sliding must be"),
        ({"law": Tresca(1.0)}, "bounds the shear of open points"),
        ({"master": 2}, "facets in common"),
    ],
)
def test_sliding_pair_refuses_methods_and_degrees(given, words):
    both = stacked(4, 4, (0.0, 1.0), (0.0, 1.0))
    known = {"slave": 2, "master": 3, "law": Coulomb(0.3), "sliding": "large"} | given
    with pytest.raises(ValueError, match=words):
        discretise(ContactPair(displacement(both.mesh), both, **known))


@pytest.mark.ranks(2)
@pytest.mark.refuses("self contact", aspects=("2D",))
def test_self_contact_refuses_methods():
    domain, tags = hairpin(0.5)
    u = displacement(domain)
    for given, words in (
        ({"direction": (0.0, 0.0)}, "direction must be"),
        ({"direction": (0.0, 0.0, 1.0)}, "direction must be"),
        ({"search_distance": 0.0}, "search distance must be positive"),
    ):
        with pytest.raises(ValueError, match=words):
            discretise(SelfContact(u, tags, tag=1, law=Coulomb(0.3), **given))
    with pytest.raises(ValueError, match="SelfContact"):
        discretise(ContactPair(u, tags, slave=1, master=1, law=Coulomb(0.3), sliding="large"))


LARGE = {"law": Frictionless(), "sliding": "large", "axisymmetric": True}


@pytest.mark.refuses("sliding pairs", "bodies of revolution", aspects=("2D", "pairs"))
def test_sliding_of_revolution_refuses_friction():
    both = stacked(4, 4, (0.0, 1.0), (0.0, 1.0))
    u = displacement(both.mesh)
    given = {"slave": 3, "master": 2} | LARGE | {"law": Coulomb(0.3)}
    with pytest.raises(ValueError, match="take Frictionless"):
        discretise(ContactPair(u, both, **given))


PLANE = HalfSpace((0, 1), (0, -1))


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("given", "words"),
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
        ({"about": (0.0, np.inf), "held": ["x", "y", "rz"]}, "must be 2 finite numbers"),
        ({"shape": None, "held": ["x", "y", "rz"]}, "its shape must be"),
        ({"name": "", "held": ["x", "y", "rz"]}, "must be a word"),
    ],
)
def test_rigid_body_refuses_components(given, words):
    given = {"shape": PLANE, "about": (0, 1), **given}
    with pytest.raises(ValueError, match=words):
        RigidBody(given.pop("shape"), **given)
