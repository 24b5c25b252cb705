"""Named groups on meshes of DOLFINx, and the names of joined meshes."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets

from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, join, name_groups

COMM = MPI.COMM_WORLD


def at(height):
    return lambda x: np.isclose(x[1], height)


def blocks(**names):
    """Two unit squares, one on the other, whose facets are selected by functions and by indices."""
    upper, lower = box(COMM, 4, "quad"), box(COMM, 3, "quad")
    lower.geometry.x[:, 1] -= 1.0
    sides = {"top": facets(upper, 1, 1.0), names.get("upper", "sole"): at(0.0)}
    other = {"base": at(-1.0), names.get("lower", "seat"): facets(lower, 1, 0.0)}
    return [name_groups(upper, sides, cells="upper"), name_groups(lower, other, cells="lower")]


def length(body, name):
    one = fem.form(fem.Constant(body.mesh, 1.0) * body.ds(name))
    return COMM.allreduce(fem.assemble_scalar(one))


@pytest.mark.ranks(2, 3)
def test_names_of_joined_meshes_select_their_parts():
    """A stack is pressed by a load: every cross-section transmits it, and the materials differ."""
    body = join(blocks())
    assert body.names == {
        "upper": (2, 1),
        "lower": (2, 2),
        "top": (1, 1),
        "sole": (1, 2),
        "base": (1, 3),
        "seat": (1, 4),
    }
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    materials = {"upper": LinearElastic.from_young(1000.0, 0.0)}
    materials["lower"] = LinearElastic.from_young(250.0, 0.0)
    energy = sum(material.energy(u) * body.dx(name) for name, material in materials.items())
    bcs = [fem.dirichletbc(np.zeros(2), body.dofs(V, "base"), V)]
    pair = ContactPair(u, body, slave="sole", master="seat", law=Coulomb(0.3))
    problem = ContactProblem(energy + 5.0 * u[1] * body.ds("top"), u, [pair], bcs=bcs)
    result = problem.solve()
    np.testing.assert_allclose(result.tables["contact"].pressure, 5.0, rtol=1e-8)
    sunk = fem.form(-u[1] * body.ds("top"))
    assert COMM.allreduce(fem.assemble_scalar(sunk)) == pytest.approx(5.0 / 1000 + 5.0 / 250)


@pytest.mark.ranks(2)
def test_groups_of_one_name_are_joined():
    parts = blocks(upper="face", lower="face")
    assert length(parts[0], "face") == pytest.approx(1.0)
    body = join(parts)
    assert length(body, "face") == pytest.approx(2.0)
    np.testing.assert_allclose(body.bounds("face")[:, 1], 0.0)


@pytest.mark.ranks(2)
def test_named_facets_inside_a_body_become_a_crack():
    square = box(COMM, 4, "quad")
    square.topology.create_entities(1)
    inside = mesh.locate_entities(square, 1, at(0.5))
    body = crack(name_groups(square, {"fault": inside, "top": at(1.0)}), ["fault"])
    assert [length(body, name) for name in ("fault", "fault_opposite")] == pytest.approx([1.0, 1.0])


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ({"top": at(2.0)}, "no facet belongs to the group 'top'"),
        (
            {"top": at(1.0), "all": lambda x: x[0] < 2.0},
            "the groups 'top' and 'all' have a common facet",
        ),
        ({"top": np.ones(40, dtype=bool)}, "numpy.flatnonzero converts a mask"),
        ({"top": [0, 10**6]}, "the group 'top' has indices of facets outside the mesh"),
        ({"": at(1.0)}, "the name of a group must be a word"),
        ([at(1.0)], "facets must be a dict, as"),
    ],
)
def test_groups_that_are_empty_or_overlap_are_refused(groups, message):
    square = box(COMM, 4, "quad", ghost_mode=mesh.GhostMode.none)
    with pytest.raises(ValueError, match=message) as info:
        name_groups(square, groups)
    assert len(set(COMM.allgather(str(info.value)))) == 1
