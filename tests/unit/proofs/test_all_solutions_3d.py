"""All solutions of bodies in space: the case against a table, and its proofs."""

from mpi4py import MPI

import cases.proofs_3d
import numpy as np
import pytest
from support.blocks import facets
from support.checks import solved_start

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
    Tresca,
)
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.proofs import check

COMM = MPI.COMM_WORLD

#: Cells, load, friction; normal forces of the solutions that another program finds, which condenses
#: the same tetrahedra on its own and starts Newton's method some thousand times.
TABLE = {
    "2x1": (("2", "1"), ("-1", ".1", "-.5"), "2", (0.00537980, 0.01812383, 0.02988078)),
    "2x2": (("2", "2"), ("-.82", ".23", "-.34"), "3.5", (0.00332950, 0.00664365, 0.01788392)),
    "3x2": (("3", "2"), ("-1", ".2", "-.3"), "3.5", (0.0, 0.01447955, 0.01480283)),
    "4x2": (
        ("4", "2"),
        ("-1", ".2", "-.3"),
        "3.5",
        (0.0, 0.00863386, 0.00921417, 0.01007226, 0.01090128, 0.01331178, 0.01432214),
    ),
    "4x2, less friction": (("4", "2"), ("-1", ".2", "-.3"), "2", (0.0,)),
}


@pytest.mark.parametrize(
    "case",
    [
        "2x1",
        pytest.param("2x2", marks=pytest.mark.long),
        *(pytest.param(c, marks=pytest.mark.long) for c in list(TABLE)[2:]),
    ],
)
@pytest.mark.verifies(
    "all solutions",
    "certificates",
    "Coulomb",
    reference="independent code: tetrahedra condensed by numpy, Newton's method from many starts",
    aspects=("3D", "proofs"),
)
def test_several_solutions_agree_with_the_table(case, folder):
    cells, load, friction, forces = TABLE[case]
    words = ["--cells", *cells, "--load", *load, "--friction", friction]
    summary = cases.proofs_3d.main([*words, "--output", str(folder)])
    assert summary["complete"]
    assert summary["open"] == 0
    found = [s["sum_rn"] for s in summary["solutions"]]
    np.testing.assert_allclose(found, forces, atol=1e-8)
    assert summary["check_seconds"] < summary["proof_seconds"]
    for k, solution in enumerate(summary["solutions"]):
        assert np.hypot(*solution["sum_rt"]) <= float(friction) * solution["sum_rn"] + 1e-12
        assert (folder / f"solution_{k}.png").stat().st_size > 1000
    assert (folder / "proof.npz").is_file()


@pytest.mark.parametrize("friction", ["0.3", pytest.param("1", marks=pytest.mark.long)])
def test_block_in_space_has_one_solution(friction, folder):
    """49 points under an oblique load: one solution, at once."""
    words = ["--shape", "block", "--cells", "6", "6", "2", "--load", ".5", ".2", "-1"]
    summary = cases.proofs_3d.main([*words, "--friction", friction, "--output", str(folder)])
    assert summary["complete"]
    (one,) = summary["solutions"]
    # The top is clamped: what the floor bears is less than the weight of 0.5.
    assert 0 < one["sum_rn"] < 0.5


# -- which problems --------------------------------------------------------------------------------


def cube(law, *, held=None, gap=0.0, n=2, energy=None):
    """A cube under an oblique body force over a floor, and its load as the parameter."""
    domain = mesh.create_unit_cube(COMM, n, n, n)
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 1.0)
    top = fem.locate_dofs_topological(V, 2, facets(domain, 2, 1.0))
    bcs = [fem.dirichletbc(np.zeros(3), top, V)]
    for component, axis, value in held or ():
        Vc = V.sub(component)
        low = fem.locate_dofs_topological(Vc, 2, facets(domain, axis, 0.0))
        bcs.insert(0, fem.dirichletbc(value, low, Vc))
    law = law(domain) if callable(law) and not hasattr(law, "bound_kind") else law
    floor = HalfSpace((0.0, 0.0, -gap), (0.0, 0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 2, 0.0), obstacle=floor, law=law)
    stored = LinearElastic(1.0, 1.0).energy(u) if energy is None else energy(u)
    load = ufl.as_vector((0.5, 0.2, -1.0))
    whole = stored * ufl.dx - gamma * ufl.dot(load, u) * ufl.dx
    return ParametricContact(ContactProblem(whole, u, [surface], bcs=bcs), gamma)


def field(domain):
    """Friction vanishing on one half and varying on the other."""
    x = ufl.SpatialCoordinate(domain)
    return Coulomb(ufl.conditional(ufl.lt(x[0], 0.4), 0.0, 0.4 + 0.3 * x[1]))


PROVED = {
    "Coulomb": dict(law=Coulomb(0.5)),
    "a gap": dict(law=Coulomb(0.5), gap=0.05),
    "a field": dict(law=field),
    "Tresca": dict(law=Tresca(0.1)),
    "no friction": dict(law=Frictionless()),
    "both tangents held": dict(law=Coulomb(0.5), held=[(0, 0, 0.0), (1, 0, 0.0)]),
    "one held, no friction": dict(law=Frictionless(), held=[(1, 1, 0.0)]),
}


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("case", PROVED)
@pytest.mark.verifies(
    "all solutions",
    "Tresca",
    "Signorini",
    reference="itself: Newton's method on the whole body",
    aspects=("3D", "proofs"),
)
def test_the_solution_of_a_body_in_space_is_proved_the_only_one(case):
    """One solution, which a solve finds as well."""
    system = cube(**PROVED[case])
    found = find_solutions(system, [system.create_vector()], 1.0)
    assert found.complete, found
    assert check(found.proof.certificate).verdict == "complete"
    (one,) = found.found
    x = solved_start(system, 1.0)
    assert (one.x - x).norm() <= 1e-8 * x.norm()
    words = system.letters(one.piece), system.letters(system.piece_at(x, 1.0))
    assert words[0] == words[1]


def hyperelastic(u):
    strain = ufl.grad(u)
    return ufl.inner(strain, strain) / 2 + ufl.inner(strain, strain) ** 2


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (dict(law=Coulomb(0.5), held=[(1, 1, 0.0)]), "one tangential displacement"),
        (dict(law=Coulomb(0.5), energy=hyperelastic), "not linear"),
    ],
)
def test_problems_without_proofs_in_space_give_the_reason(options, reason):
    system = cube(n=1, **options)
    found = find_solutions(system, [system.create_vector()], 1.0, lengths=(0.5,), max_iterations=3)
    assert not found.complete
    assert found.proof is None
    assert "nothing is proved" in found.method
    assert reason in found.method


def test_friction_as_the_parameter_is_proved():
    given = []

    def law(domain):
        given.append(fem.Constant(domain, 0.3))
        return Coulomb(given[0])

    problem = cube(law, n=1).problem
    system = ParametricContact(problem, given[0])
    assert find_solutions(system, [system.create_vector()], 0.3).complete


@pytest.mark.verifies(
    "all solutions",
    reference="itself: all seven solutions, proved when there is time",
    aspects=("3D",),
)
def test_a_proof_without_time_leaves_regions_open():
    """The verdict is open, and solutions from starts in the open region are reported once."""
    words = ["--cells", "4", "2", "--load", "-1", ".2", "-.3", "--friction", "3.5"]
    system = cases.proofs_3d.body(cases.proofs_3d.arguments(words), COMM)
    few = dict(lengths=(0.5,), max_iterations=3)
    found = find_solutions(system, [system.create_vector()], 1.0, proof_seconds=1e-6, **few)
    assert not found.complete
    assert found.proof.verdict == "open"
    assert "time is over" in found.method
    assert len({system.letters(s.piece) for s in found.found}) == len(found.found) == 7
    b = system.create_vector()
    assert max(system.residual(s.x, 1.0, b, s.piece) for s in found.found) < 1e-10


# -- one solution ----------------------------------------------------------------------------------


@pytest.mark.verifies(
    "uniqueness",
    reference="itself: all solutions, proved",
    aspects=("3D", "proofs"),
)
def test_another_solution_comes_with_a_solution_in_space(caplog):
    system = cases.proofs_3d.body(cases.proofs_3d.arguments([]), COMM)
    problem = system.problem
    problem.solve()
    answer = problem.uniqueness()
    assert answer.verdict == "others exist"
    found = find_solutions(system, [system.create_vector()], 1.0)
    assert found.complete
    x = system.create_vector()
    problem.write(x)
    problem.restore(answer.other)
    other = system.create_vector()
    problem.write(other)
    for state in (x, other):
        near = [(s.x - state).norm() <= 1e-7 * state.norm() for s in found.found]
        assert sum(near) == 1
    assert (x - other).norm() > 1e-3 * x.norm()
    assert COMM.rank > 0 or "there is another" in caplog.text


def test_uniqueness_is_proved_by_search():
    """Where the certificate does not hold and no other solution is found, time helps."""
    words = ["--cells", "4", "2", "--load", "-1", ".2", "-.3", "--friction", "2"]
    problem = cases.proofs_3d.body(cases.proofs_3d.arguments(words), COMM).problem
    problem.solve()
    assert problem.uniqueness().verdict == "not proved"
    found = problem.uniqueness(proof_seconds=60.0)
    assert found.verdict == "proved"
    assert "a proof of" in found.reason
