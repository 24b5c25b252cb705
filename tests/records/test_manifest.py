"""The manifest of a record: a resumption with another problem is refused, and the item is named.

A resumption on another number of ranks, where solved or projected values differ in their last
digits, is not refused.
"""

import json
import zlib

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import facets, interpolate

import basix.ufl
import dolfinx.fem.petsc
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import BranchRecord, EvolutionRecord, read_journal

COMM = MPI.COMM_WORLD
RULE = {"quadrature_degree": 2}


class Stop(Exception):
    """Exception ending a run before it is resumed."""


def stop(step):
    if step.number == 2:
        raise Stop


def solved(V, right):
    """The solution of w - div grad w = right, which differs in its last bits on other ranks."""
    w = ufl.TrialFunction(V)
    v = ufl.TestFunction(V)
    a = (ufl.inner(w, v) + ufl.inner(ufl.grad(w), ufl.grad(v))) * ufl.dx
    A = dolfinx.fem.petsc.assemble_matrix(fem.form(a))
    A.assemble()
    b = dolfinx.fem.petsc.assemble_vector(fem.form(ufl.inner(right, v) * ufl.dx))
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    solver = PETSc.KSP().create(V.mesh.comm)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    found = fem.Function(V)
    x = A.createVecRight()
    solver.solve(b, x)
    found.x.array[: x.getLocalSize()] = x.array_r
    found.x.scatter_forward()
    for thing in (A, b, x, solver):
        thing.destroy()
    return found


def body(
    comm=COMM,
    *,
    friction=lambda x: 0.2 + 0.2 * x[0],
    young=lambda x: 1000.0 + 500.0 * (x[0] > 0.5),
    pull=(1.0, 0.5),
    heat=lambda x: x[0],
    modulus=(2e11, 0.3),
    tags=(1, 2),
    held=((0.0, 0.0), (1.0, 1.0)),
    dips=(-0.01, 0.0),
    warp=0.0,
    stiff=1000.0,
):
    """A square on a floor with data of every kind, in which nothing is uniform.

    Its top goes down. Two inner points are held along x by conditions of one node each.
    """
    domain = mesh.create_unit_square(comm, 3, 3)
    if warp:
        moved = solved(fem.functionspace(domain, ("Lagrange", 1)), fem.Constant(domain, warp))
        x = domain.geometry.x
        at = fem.Function(moved.function_space)
        at.interpolate(lambda x: 16 * x[0] * (1 - x[0]) * x[1] * (1 - x[1]))
        nodes = np.empty(len(x), dtype=np.int32)
        cells = domain.geometry.dofmap
        nodes[cells] = moved.function_space.dofmap.list
        x[:, 0] += (at.x.array * moved.x.array)[nodes]
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    P1, DG0 = (fem.functionspace(domain, kind) for kind in (("Lagrange", 1), ("DG", 0)))
    P2 = fem.functionspace(domain, ("Lagrange", 2, (2,)))
    at_points = basix.ufl.quadrature_element("triangle", degree=2)
    Q = fem.functionspace(domain, at_points)
    u = fem.Function(V)
    rough = fem.Function(P1, name="rough")
    E = fem.Function(DG0, name="E")
    rough.interpolate(friction)
    E.interpolate(young)
    x = ufl.SpatialCoordinate(domain)
    load = solved(P2, ufl.as_vector([pull[0] * x[1], pull[1] * (1 + x[0])]))
    load.name = "load"
    warm = fem.Function(Q, name="warm")
    interpolate(warm, ufl.as_ufl(heat(x)))
    moduli = fem.Constant(domain, modulus)
    n = domain.topology.index_map(2).size_local
    right = mesh.compute_midpoints(domain, 2, np.arange(n, dtype=np.int32))[:, 0] > 0.5
    lists = [(tag, np.flatnonzero(right == i).astype(np.int32)) for i, tag in enumerate(tags)]
    dx = ufl.Measure("dx", domain, subdomain_data=sorted(lists, key=lambda pair: pair[0]))
    eps = ufl.sym(ufl.grad(u))
    energy = 0.5 * (E + moduli[0] / 2e11) * ufl.inner(eps, eps) * dx
    energy += 0.5 * moduli[1] * stiff * ufl.div(u) ** 2 * dx
    energy -= ufl.inner(load, u) * dx + warm * u[1] * dx(metadata=RULE)
    energy += 3.0 * u[1] * dx(1) + 4.0 * u[1] * dx(2)
    top = fem.Function(V)
    high = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    third = fem.locate_dofs_geometrical(
        (V.sub(0), V.sub(0).collapse()[0]),
        lambda x: (
            np.logical_or.reduce([np.isclose(x[0], a) & np.isclose(x[1], b) for a, b in held])
            & (x[1] < 0.9)
        ),
    )
    zero = fem.Function(V.sub(0).collapse()[0])
    bcs = [fem.dirichletbc(top, high), fem.dirichletbc(zero, third, V.sub(0))]
    law = Coulomb(rough)
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, 0), (0, 1)), law=law)

    def lower(time):
        top.x.array[0::2] = 0.001 * time
        shape = fem.Function(top.function_space)
        shape.interpolate(lambda x: np.vstack([0 * x[0], dips[0] + dips[1] * (1 - 2 * x[0])]))
        top.x.array[1::2] = time * shape.x.array[1::2]

    return ContactProblem(energy, u, [surface], bcs=bcs), lower


def history(comm=COMM, **how):
    return QuasiStatic(*body(comm, **how))


def motion(comm=COMM, *, heavy=lambda x: 1.0 + (x[0] > 0.5), drag=lambda x: x[0], **how):
    """The square with a mass and a drag that are Functions."""
    problem, lower = body(comm, **how)
    domain = problem.V.mesh
    density = fem.Function(fem.functionspace(domain, ("DG", 0)), name="density")
    density.interpolate(heavy)
    slow = fem.Function(fem.functionspace(domain, ("Lagrange", 1)), name="slow")
    slow.interpolate(drag)
    v = fem.Function(problem.V)
    damping = slow * ufl.inner(v, ufl.TestFunction(problem.V)) * ufl.dx
    made = NSCD(problem, density, dt=0.25, load=lower, velocity=v, damping=damping)
    return made


def recorded(evolution, folder):
    """A run with a record ending after two steps of four."""
    times = [0.0, 0.25, 0.5, 0.75, 1.0]
    with EvolutionRecord(folder, evolution) as kept, pytest.raises(Stop):
        evolution.run(times, record=kept, observer=stop)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """Folders of a history and a motion that ended early."""
    made = {}
    for make in (history, motion):
        folder = COMM.bcast(tmp_path_factory.mktemp(make.__name__) if COMM.rank == 0 else None)
        recorded(make(), folder / "record")
        made[make] = folder / "record"
    return made


OTHERS = [
    ({"friction": lambda x: 0.4 - 0.2 * x[0]}, "the friction of Coulomb of 'contact'$"),
    ({"young": lambda x: 1500.0 - 500.0 * (x[0] > 0.5)}, "'E' in the form of the body$"),
    ({"pull": (0.5, 1.0)}, "the Function 'load' in the form of the body$"),
    ({"heat": lambda x: 1 - x[0]}, "the Function 'warm' in the form of the body$"),
    (
        {"modulus": (2e11, 0.31)},
        r"the Constant in the form of the body \(\S+, 0\.3 recorded, \S+, 0\.31 now\)$",
    ),
    ({"tags": (2, 1)}, "the domains of integration of the body$"),
    ({"held": ((0.0, 2 / 3), (1.0, 1 / 3))}, "the unknowns with Dirichlet conditions$"),
    ({"dips": (-0.01, 0.001)}, "the prescribed displacement$"),
    ({"warp": 1e-5}, "the coordinates of the mesh$"),
    ({"stiff": 1001.0}, "the form of the body$"),
]


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("other", "message"), OTHERS, ids=[next(iter(o)) for o, _ in OTHERS])
def test_other_data_are_refused(other, message, stopped):
    """Exchanged, mirrored, at other places: means and root mean squares may be the same."""
    before = {"held": ((0.0, 1 / 3), (1.0, 2 / 3))}
    folder = stopped[history]
    if "held" in other:
        folder = folder.parent / "held"
        if not COMM.bcast(folder.exists() if COMM.rank == 0 else None):
            recorded(history(**before), folder)
    with pytest.raises(
        ValueError, match=f"record of another problem; differs.*: .*{message}"
    ) as info:
        EvolutionRecord(folder, history(**other), resume=True)
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"heavy": lambda x: 2.0 - (x[0] > 0.5)}, "the density$"),
        (
            {"drag": lambda x: 1 - x[0]},
            "the Function 'slow' in the damping$",
        ),
    ],
    ids=["density", "damping"],
)
def test_other_masses_are_refused(other, message, stopped):
    with pytest.raises(ValueError, match=f"differs at the time 0.5: {message}"):
        EvolutionRecord(stopped[motion], motion(**other), resume=True)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("make", [motion, history])
@pytest.mark.verifies(
    "records of histories",
    "records of motions",
    reference="itself: the run on another number of ranks",
    aspects=(
        "2D",
        "records",
    ),
)
def test_record_resumes_on_other_ranks(make, folder):
    """Written on all ranks but one, resumed on one and on all; data differ in their last bits."""
    few = COMM.Split(int(COMM.rank >= max(COMM.size - 1, 1)), COMM.rank)
    warp = {"warp": 1e-3}
    for where in ("one", "all"):
        if COMM.rank < max(COMM.size - 1, 1):
            recorded(make(few, **warp), folder / where)
        COMM.barrier()
    if COMM.rank == 0:
        with EvolutionRecord(folder / "one", make(MPI.COMM_SELF, **warp), resume=True) as kept:
            assert kept.go_on().complete
    with EvolutionRecord(folder / "all", make(**warp), resume=True) as kept:
        assert kept.go_on().complete
    assert len(read_journal(folder / "all").states) == 5
    few.Free()


def rewritten(path, change):
    """Change lines of a journal and their checksums, the CRC-32 of the text before."""
    if COMM.rank == 0:
        lines = []
        for line in path.read_text().splitlines():
            entry = json.loads(line)
            del entry["crc"]
            change(entry)
            text = json.dumps(entry)[:-1]
            lines.append(f'{text}, "crc": "{zlib.crc32(text.encode()):08x}"}}\n')
        path.write_text("".join(lines))
    COMM.barrier()


def test_format_of_another_version_is_refused(folder):
    recorded(history(), folder / "record")

    def as_before(entry):
        if entry["type"] == "header":
            entry["format"] = 2
            entry["package"] = "0.0.7"

    path = folder / "record/journal.jsonl"
    rewritten(path, as_before)
    before = path.read_bytes()
    said = r"in format 2, .* format 6 only: use the version that wrote it \(0\.0\.7\)"
    with pytest.raises(ValueError, match=said):
        EvolutionRecord(folder / "record", history(), resume=True)
    with pytest.raises(ValueError, match=said):
        read_journal(folder / "record")
    assert path.read_bytes() == before


@pytest.mark.ranks(2)
def test_a_branch_of_a_step_is_resumed_from_the_same_start_only(folder):
    """Friction opposes the slip since the start of the step: another start, another problem."""

    def system(shift):
        """A step from a pressed block whose top has been moved sideways by ``shift``."""
        domain = mesh.create_unit_square(COMM, 4, 4)
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        u = fem.Function(V)
        top = fem.Function(V)
        gamma = fem.Constant(domain, 0.0)
        floor = HalfSpace((0, 0), (0, 1))
        surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
        held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        bcs = [fem.dirichletbc(top, held)]
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        problem = ContactProblem(energy, u, [surface], bcs=bcs)
        top.interpolate(lambda x: np.stack([shift + 0 * x[0], -0.01 + 0 * x[0]]))
        problem.solve()
        step = problem.step_from(problem.snapshot())
        path = ufl.as_vector((0.004 - 0.01 * gamma, -0.01))
        return ParametricContact(step, gamma, driven=[(top, path)])

    parametric = system(0.004)
    x = parametric.create_vector()
    parametric.problem.write(x)
    with BranchRecord(folder / "branch", parametric) as kept:
        follow(parametric, x, 0.0, gamma_range=(0.0, 1.0), max_steps=2, record=kept)
    with BranchRecord(folder / "branch", system(0.004), resume=True) as kept:
        assert kept.go_on(max_steps=100).complete
    said = "differs: the memory jump of 'contact' at the start of the step"
    with pytest.raises(ValueError, match=said):
        BranchRecord(folder / "branch", system(-0.02), resume=True)


@pytest.mark.ranks(2)
def test_a_branch_knows_its_functions(folder):
    """Friction that is mirrored while everything sticks, which no residual tells."""

    def system(mirrored=False):
        domain = mesh.create_unit_square(COMM, 2, 2)
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        u = fem.Function(V)
        gamma = fem.Constant(domain, 0.0)
        rough = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
        rough.interpolate(lambda x: 5.0 + (1 - x[0] if mirrored else x[0]))
        eps = ufl.sym(ufl.grad(u))
        energy = (50.0 * ufl.inner(eps, eps) - (gamma - 1.0) * u[1]) * ufl.dx
        floor = HalfSpace((0, 0), (0, 1))
        surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(rough))
        held = fem.locate_dofs_topological(V.sub(0), 1, facets(domain, 1, 1.0))
        bcs = [fem.dirichletbc(0.0, held, V.sub(0))]
        problem = ContactProblem(energy, u, [surface], bcs=bcs)
        return problem, ParametricContact(problem, gamma)

    problem, parametric = system()
    problem.solve()
    x = parametric.create_vector()
    problem.write(x)
    with BranchRecord(folder / "branch", parametric) as kept:
        follow(parametric, x, 0.0, gamma_range=(0.0, 0.5), max_steps=2, record=kept)
    with BranchRecord(folder / "branch", system()[1], resume=True) as kept:
        assert kept.last_state() is not None
    with pytest.raises(ValueError, match=r"differs: the friction of Coulomb of 'contact'$"):
        BranchRecord(folder / "branch", system(mirrored=True)[1], resume=True)
