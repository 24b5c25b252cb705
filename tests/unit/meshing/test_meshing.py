"""Meshes from gmsh: physical groups by name, and errors in files on every rank."""

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from support.checks import assert_warned

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import NamedTags, crack, mesh_from_gmsh, read_mesh
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD


def box(*, groups=("body", "contact", "top"), order=1, quads=False, dim=3):
    """The box (0, 2) x (0, 1) (x (0, 1)), its bottom called contact."""
    occ = gmsh.model.occ
    model = gmsh.model
    shape = occ.addBox(0, 0, 0, 2, 1, 1) if dim == 3 else occ.addRectangle(0, 0, 0, 2, 1)
    occ.synchronize()
    sides = model.getBoundary([(dim, shape)], oriented=False)
    height = {side: occ.getCenterOfMass(*side)[dim - 1] for side in sides}
    ends = {"contact": min(sides, key=height.get), "top": max(sides, key=height.get)}
    for name, (d, tag) in {"body": (dim, shape), **ends}.items():
        if name in groups:
            model.addPhysicalGroup(d, [tag], tag={"body": 1, "contact": 5, "top": 9}[name])
            model.setPhysicalName(d, {"body": 1, "contact": 5, "top": 9}[name], name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
    if quads:
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
    model.mesh.generate(dim)
    model.mesh.setOrder(order)


def saved(folder, *, version=4.1, parts=0, **options):
    """A file with the box, written on rank 0."""
    file = folder / "box.msh"
    if COMM.rank == 0:
        gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        box(**options)
        if parts:
            gmsh.model.mesh.partition(parts)
        gmsh.write(str(file))
        gmsh.finalize()
    COMM.barrier()
    return file


def measure(body, name=None):
    """Volume of a mesh, or area of a named part of its boundary."""
    if name is None:
        form = fem.Constant(body.mesh, 1.0) * ufl.dx
    else:
        ds = ufl.Measure("ds", body.mesh, subdomain_data=body.facet_tags)
        form = fem.Constant(body.mesh, 1.0) * ds(body.tag(name))
    return COMM.allreduce(fem.assemble_scalar(fem.form(form)))


@pytest.mark.ranks(2)
@pytest.mark.parametrize("options", [{}, {"order": 2}, {"dim": 2}, {"dim": 2, "quads": True}])
def test_groups_of_a_file_have_their_names_sizes_and_bounds(folder, options):
    dim = options.get("dim", 3)
    body = read_mesh(COMM, saved(folder, **options), dim=dim, groups=("contact", "top"))
    assert body.names == {"body": (dim, 1), "contact": (dim - 1, 5), "top": (dim - 1, 9)}
    assert body.mesh.topology.dim == body.mesh.geometry.dim == dim
    np.testing.assert_allclose([measure(body), measure(body, "contact")], 2.0)
    assert set(body.cell_tags.values) <= {1}
    ends = ([0.0, 1.0], [2.0, 1.0]) if dim == 2 else ([0.0, 0.0, 1.0], [2.0, 1.0, 1.0])
    np.testing.assert_allclose(body.bounds("top")[:, :dim], ends, atol=1e-12)
    with pytest.raises(ValueError, match=r"'side'; names: \['body', 'contact', 'top'\]"):
        body.tag("side")


# -- parts by their names ------------------------------------------------------------------------


def surface(body, facets, tag):
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (body.mesh.geometry.dim,)))
    u = fem.Function(V)
    up = np.eye(V.mesh.geometry.dim)[-1]
    floor = HalfSpace(np.zeros(len(up)), up)
    return ContactSurface(u, facets, tag=tag, obstacle=floor, law=Coulomb(0.3), name="below")


@pytest.mark.parametrize("version", [4.1, 2.2])
def test_partitioned_file_is_read_as_a_whole(folder, version):
    """The partition is dropped: cells, groups and their sizes are those before partitioning."""
    body = read_mesh(COMM, saved(folder, version=version, parts=3), groups=("top",))
    sizes = [measure(body, name) for name in (None, "contact", "top")]
    assert sizes == pytest.approx([2.0, 2.0, 2.0])
    assert sorted(body.names) == ["body", "contact", "top"]


def without_elements():
    """A body with a part that has not been meshed, in the same group."""
    box()
    point = gmsh.model.addDiscreteEntity(3)
    body = gmsh.model.getEntitiesForPhysicalGroup(3, 1)
    gmsh.model.removePhysicalGroups([(3, 1)])
    gmsh.model.addPhysicalGroup(3, [*body, point], name="body")


@pytest.mark.ranks(2)
def test_names_and_numbers_select_the_same_facets():
    """A name and its number are the same facets, of the mesh and of its MeshTags."""
    body = mesh_from_gmsh(COMM, lambda: box(dim=2))
    facets = discretise(surface(body, body.facet_tags, 5)).submesh.parent_facets
    assert COMM.allreduce(len(facets)) > 0
    for given, tag in [(body, "contact"), (body, 5), (body.facet_tags, "contact")]:
        found = discretise(surface(body, given, tag)).submesh.parent_facets
        np.testing.assert_array_equal(found, facets)


@pytest.mark.ranks(2)
def test_solve_with_names():
    """Support, load and contact surface by name: the forces are in equilibrium."""
    body = mesh_from_gmsh(COMM, lambda: box(dim=2))
    contact = surface(body, body, "contact")
    u = contact.u
    V = contact.u.function_space
    sideways = fem.dirichletbc(0.0, body.dofs(V.sub(0), "top"), V.sub(0))
    pressure = fem.Constant(body.mesh, 3.0)
    energy = LinearElastic(1.0, 1.0).energy(u) * ufl.dx + pressure * u[1] * body.ds("top")
    result = ContactProblem(energy, u, [contact], bcs=[sideways]).solve()
    np.testing.assert_allclose(result.tables["below"].rn.sum(), 6.0)


def side_by_side(names, at):
    """The square (0, 2) x (0, 1) of two groups that meet at x = ``at``."""
    occ = gmsh.model.occ
    parts = [occ.addRectangle(0, 0, 0, at, 1), occ.addRectangle(at, 0, 0, 2 - at, 1)]
    occ.fragment([(2, parts[0])], [(2, parts[1])])
    occ.synchronize()
    for name, part in zip(names, parts, strict=True):
        gmsh.model.addPhysicalGroup(2, [part], name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)


def halves():
    side_by_side(("wheel", "tyre"), 0.5)
    gmsh.model.addPhysicalGroup(1, [1], name="rim")
    gmsh.model.mesh.generate(2)


@pytest.mark.ranks(2)
def test_names_select_cells():
    """Areas of groups of cells, and their energies; a name of facets is none of cells."""
    body = mesh_from_gmsh(COMM, halves)
    one = fem.Constant(body.mesh, 1.0)
    x = ufl.SpatialCoordinate(body.mesh)

    def integral(form):
        return COMM.allreduce(fem.assemble_scalar(fem.form(form)))

    np.testing.assert_allclose(integral(one * body.dx("wheel")), 0.5)
    np.testing.assert_allclose(integral(one * body.dx("tyre")), 1.5)
    np.testing.assert_allclose(integral(x[0] ** 2 * body.dx("wheel", quadrature_degree=2)), 1 / 24)
    rule = body.dx("wheel", quadrature_degree=2).metadata()
    assert rule == {"quadrature_degree": 2}
    u = fem.Function(fem.functionspace(body.mesh, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: np.array([0.1 * x[0], np.zeros_like(x[0])]))
    # Stretch 0.1 of one modulus over each part: W = E e^2/2, as nu = 0.
    soft = LinearElastic.from_young(1.0, 0.0).energy(u)
    stiff = LinearElastic.from_young(10.0, 0.0).energy(u)
    energy = integral(stiff * body.dx("wheel") + soft * body.dx("tyre"))
    np.testing.assert_allclose(energy, (10.0 * 0.5 + 1.5) * 0.1**2 / 2)
    for name in ("rim", "hub"):
        match = rf"no group of cells is named '{name}'; names: \['tyre', 'wheel'\]"
        refused(match, lambda name=name: body.dx(name))


def halves_with_seam(*, seam):
    """Two halves, and a group of facets: the seam alone, with a side, or the side alone."""
    side_by_side(("left", "right"), 1)
    occ = gmsh.model.occ
    wanted = {"inside": (1,), "both": (0, 1), "outside": (0, 2)}[seam]
    curves = [t for d, t in gmsh.model.getEntities(1) if occ.getCenterOfMass(d, t)[0] in wanted]
    gmsh.model.addPhysicalGroup(1, curves, tag=7, name="seam")
    gmsh.model.mesh.generate(2)


@pytest.mark.parametrize(("seam", "inside", "count"), [("inside", 5, 5), ("both", 5, 10)])
def test_ds_is_refused_inside_a_body(seam, inside, count):
    """`ds` would silently be 0 there; `dS` has the length, and dofs are available."""
    body = mesh_from_gmsh(COMM, lambda: halves_with_seam(seam=seam))
    match = rf"the group 'seam' has {inside} of {count} facets inside the body, .*dS\(7\)"
    refused(match, lambda: body.ds("seam"))
    if COMM.size == 1:  # the mesh has no ghost cells
        dS = ufl.Measure("dS", body.mesh, subdomain_data=body.facet_tags)
        length = fem.assemble_scalar(fem.form(one_of(body)("+") * dS(7)))
        np.testing.assert_allclose(length, 1.0)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    assert COMM.allreduce(len(body.dofs(V, "seam"))) > 0
    body = mesh_from_gmsh(COMM, lambda: halves_with_seam(seam="outside"))
    length = COMM.allreduce(fem.assemble_scalar(fem.form(one_of(body) * body.ds("seam"))))
    np.testing.assert_allclose(length, 2.0)


def one_of(body):
    return fem.Constant(body.mesh, 1.0)


@pytest.mark.ranks(2)
def test_both_sides_of_a_crack_have_ds():
    body = crack(mesh_from_gmsh(COMM, lambda: halves_with_seam(seam="inside")), ["seam"])
    for name in ("seam", "seam_opposite"):
        length = COMM.allreduce(fem.assemble_scalar(fem.form(one_of(body) * body.ds(name))))
        np.testing.assert_allclose(length, 1.0)


def same_names():
    halves_with_seam(seam="inside")
    sides = gmsh.model.getEntitiesForPhysicalGroup(1, 7)
    floor = [
        t
        for d, t in gmsh.model.getEntities(1)
        if gmsh.model.occ.getCenterOfMass(d, t)[1] == 0 and t not in sides
    ]
    gmsh.model.addPhysicalGroup(1, floor, name="left")


def test_cells_and_facets_may_have_one_name():
    """Each measure knows its own, also after a crack."""
    whole = mesh_from_gmsh(COMM, same_names)
    for body in (whole, crack(whole, ["seam"])):
        area = COMM.allreduce(fem.assemble_scalar(fem.form(one_of(body) * body.dx("left"))))
        length = COMM.allreduce(fem.assemble_scalar(fem.form(one_of(body) * body.ds("left"))))
        np.testing.assert_allclose((area, length), (1.0, 2.0))
        assert body.names["left"][0] == 1
        assert body.facet_tags.tag("left") == body.tag("left")
        assert set(body.cell_tags.names) == {"left", "right"}
        refused("no group of cells is named 'seam'", lambda body=body: body.cell_tags.tag("seam"))


def test_names_select_dofs():
    body = mesh_from_gmsh(COMM, lambda: box(dim=2))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    W, _ = V.sub(1).collapse()
    everywhere = fem.locate_dofs_topological(V, 1, body.facet_tags.find(9))
    np.testing.assert_array_equal(body.facets("top"), body.facet_tags.find(9))
    np.testing.assert_array_equal(body.dofs(V, "top"), everywhere)
    np.testing.assert_array_equal(body.dofs(V.sub(1), "top"), 2 * everywhere + 1)
    of_both = body.dofs((V.sub(1), W), "top")
    np.testing.assert_array_equal(of_both[0], 2 * everywhere + 1)
    other = fem.functionspace(mesh_from_gmsh(COMM, lambda: box(dim=2)).mesh, ("Lagrange", 1))
    refused("not on this mesh", lambda: body.dofs(other, "top"))


def refused(match, do):
    with pytest.raises(ValueError, match=match) as info:
        do()
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
def test_unknown_names_are_refused_with_the_known_ones():
    """The error lists the names on every rank; the body is not a facet group."""
    body = mesh_from_gmsh(COMM, lambda: box(dim=2))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    for name in ("side", "body"):
        match = rf"no group of facets is named '{name}'; names: \['contact', 'top'\]"
        for do in (body.facets, body.ds, lambda name: body.dofs(V, name), body.facet_tags.tag):
            refused(match, lambda do=do, name=name: do(name))
        for facets in (body, body.facet_tags):
            refused(f"below: {match}", lambda f=facets, name=name: surface(body, f, name))
    refused(
        r"below: .* need a tag; names: \['contact', 'top'\]",
        lambda: discretise(surface(body, body, None)),
    )
    plain = mesh.MeshTags(body.facet_tags._cpp_object)
    assert not isinstance(plain, NamedTags)
    refused(
        "only a GmshMesh and its facet_tags have",
        lambda: discretise(surface(body, plain, "contact")),
    )


@pytest.mark.ranks(2)
@pytest.mark.skipif(COMM.size == 1, reason="needs another rank")
def test_names_that_differ_between_ranks_are_refused():
    body = mesh_from_gmsh(COMM, lambda: box(dim=2))
    tag = "contact" if COMM.rank == 0 else "top"
    refused(
        "tag differs between ranks: 'contact' on rank 0",
        lambda: discretise(surface(body, body, tag)),
    )
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    unknown = "top" if COMM.rank == 0 else "side"
    for do in (body.facets, body.ds, lambda name: body.dofs(V, name)):
        for name in (tag, unknown):
            refused("name differs between ranks: ", lambda do=do, name=name: do(name))
    other = mesh_from_gmsh(COMM, lambda: box(dim=2)).mesh
    W = fem.functionspace(other, ("Lagrange", 1, (2,)))
    refused("not on this mesh", lambda: body.dofs(V if COMM.rank == 0 else W, "top"))


@pytest.mark.ranks(2)
@pytest.mark.skipif(COMM.size == 1, reason="needs another rank")
@pytest.mark.parametrize(
    ("match", "options"),
    [
        ("filename differs between ranks", {"file": ("box.msh", "other.msh")}),
        ("dim differs between ranks: 3 on rank 0, 2 on rank 1", {"dim": (3, 2)}),
        ("groups differs between ranks", {"groups": (["top"], ["side"])}),
        ("groups differs between ranks", {"groups": (["top"], [])}),
    ],
)
def test_files_that_differ_between_ranks_are_refused(folder, match, options):
    mine = {k: v[min(COMM.rank, 1)] for k, v in options.items()}
    file = saved(folder).with_name(mine.pop("file", "box.msh"))
    fails(ValueError, match, file, **mine)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt])
def test_exceptions_of_a_drawing_reach_the_caller(error):

    def draw():
        raise error(4)

    with pytest.raises(error) as info:
        mesh_from_gmsh(COMM, draw)
    assert info.value.args == (4,)
    assert not gmsh.isInitialized()


def test_body_without_named_facets_is_read(folder):
    body = read_mesh(COMM, saved(folder, groups=("body",)))
    assert COMM.allreduce(len(body.facet_tags.values)) == 0
    np.testing.assert_allclose(measure(body), 2.0)


def fails(error, match, file, **options):
    with pytest.raises(error, match=match) as info:
        read_mesh(COMM, file, **options)
    assert len(set(COMM.allgather(str(info.value)))) == 1
    assert not gmsh.isInitialized()


@pytest.mark.ranks(2)
def test_missing_file_is_named(folder):
    fails(FileNotFoundError, "there is no mesh file", folder / "nothing.msh")


def test_file_without_physical_groups_is_refused(folder):
    fails(ValueError, "no physical groups: name the body", saved(folder, groups=()))


def test_body_in_no_group_is_refused(folder):
    """Gmsh then saves the named faces alone."""
    file = saved(folder, groups=("contact", "top"))
    fails(ValueError, "not in a plane of constant z; if it has a volume", file)


def test_missing_group_is_named(folder):
    file = saved(folder, groups=("body", "top"))
    fails(
        ValueError,
        "no physical group of dimension 2 is named contact; there are: top",
        file,
        groups=("contact",),
    )
    fails(ValueError, "dimension 3, but 2 is required", file, dim=2)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "text", ["", "hello\nworld\n", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 8"]
)
def test_a_file_without_gmsh_content_is_refused(folder, text):
    file = folder / "bad.msh"
    if COMM.rank == 0:
        file.write_text(text)
    COMM.barrier()
    fails(ValueError, "gmsh made no mesh", file)


def test_file_without_a_mesh_is_refused(folder):
    file = folder / "box.geo"
    if COMM.rank == 0:
        file.write_text('SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n')
    COMM.barrier()
    fails(ValueError, "has no mesh", file)


def overlapping():
    box()
    gmsh.model.addPhysicalGroup(2, gmsh.model.getEntitiesForPhysicalGroup(2, 5), name="again")


def two_bodies_one_named():
    box()
    gmsh.model.occ.addBox(5, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.clear()
    gmsh.model.mesh.generate(3)


def two_kinds_of_cells():
    box(dim=2)
    gmsh.model.mesh.setRecombine(2, 1)
    other = gmsh.model.occ.addRectangle(3, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [other])
    gmsh.model.mesh.generate(2)


def broken():
    box()
    raise RuntimeError("the caller's own mistake")


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("draw", "match"),
    [
        (overlapping, "groups of dimension 2 overlap"),
        (two_bodies_one_named, "some cells are in no physical group"),
        (without_elements, "dimension 3 has a part without elements"),
        (two_kinds_of_cells, "cells must be of one kind.*Triangle"),
        (broken, "gmsh made no mesh: the caller's own mistake"),
        (lambda: None, "has no mesh"),
    ],
)
def test_incomplete_gmsh_models_are_refused(draw, match):
    with pytest.raises(ValueError, match=match) as info:
        mesh_from_gmsh(COMM, draw)
    assert len(set(COMM.allgather(str(info.value)))) == 1
    assert not gmsh.isInitialized()


def sides_one_by_one():
    rectangle = gmsh.model.occ.addRectangle(0, 0, 0, 2, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [rectangle], name="body")
    for side in gmsh.model.getBoundary([(2, rectangle)], oriented=False):
        gmsh.model.addPhysicalGroup(1, [side[1]], name="side")
    gmsh.model.mesh.generate(2)


@pytest.mark.ranks(2)
def test_a_name_given_to_several_groups_is_reported(caplog):
    """gmsh keeps such a name for the first group only."""
    body = mesh_from_gmsh(COMM, sides_one_by_one)
    assert body.names["side"] == (1, 2)
    assert_warned(caplog, "dimension 1 without a name: tags 3, 4, 5")


def test_open_session_survives():
    """A caller who has gmsh open finds the model as it was."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("mine")
    gmsh.model.occ.addPoint(0, 0, 0)
    gmsh.model.occ.synchronize()
    body = mesh_from_gmsh(COMM, box)
    assert body.names["contact"] == (2, 5)
    assert gmsh.isInitialized()
    assert gmsh.model.getCurrent() == "mine"
    assert len(gmsh.model.getEntities(0)) == 1
    gmsh.finalize()
