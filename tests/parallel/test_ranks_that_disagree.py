"""Arguments that differ between ranks: the same error on every rank, and nothing is written."""

from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, facets
from support.misused_block import (
    FLOOR,
    MATERIAL,
    Telling,
    UsersError,
    WorseLaw,
    clamp,
    differs,
    discretised,
    explored,
    followed,
    found,
    on_last,
    parametric,
    problem,
    refused,
    several,
    tags_of,
    vector,
    with_option,
)

import ufl
from dolfinx import fem

from dolfinx_contact import (
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    Sphere,
    Tresca,
)
from dolfinx_contact.continuation import (
    StepControl,
    follow,
)
from dolfinx_contact.io import write_fields
from dolfinx_contact.plot import picture_of_body, picture_of_contact, picture_of_states
from dolfinx_contact.records import BranchRecord, total, write_series

pytestmark = [
    pytest.mark.ranks(2, every_case=True),
    pytest.mark.usefixtures("nothing_hangs"),
]
pytest_plugins = ["support.misused_block"]

#: What is written with other arguments on the last rank, below a folder; and what is said.
WRITTEN_DIFFERENTLY = {
    "format": (
        lambda w, f: write_fields(f, w.problem, format=differs("vtx", "vtk")),
        "format differs between ranks: 'vtx' on rank 0, 'vtk'",
    ),
    "stress": (
        lambda w, f: write_fields(f, w.problem, stress=differs(None, MATERIAL.full_stress(w.u))),
        "stress differs between ranks: None on rank 0",
    ),
    "folder": (
        lambda w, f: write_fields(f / differs("a", "b"), w.problem),
        "folder differs between ranks",
    ),
    "picture with stress": (
        lambda w, f: picture_of_body(
            f / "p.png", w.problem, stress=differs(None, MATERIAL.full_stress(w.u))
        ),
        "stress differs between ranks",
    ),
    "scale": (
        lambda w, f: picture_of_body(f / "p.png", w.problem, scale=differs(1.0, 2.0)),
        "scale differs between ranks: 1.0 on rank 0, 2.0",
    ),
    "picture": (
        lambda w, f: picture_of_body(f / differs("a.png", "b.png"), w.problem),
        "file differs between ranks",
    ),
    "picture of another surface": (
        lambda w, f: picture_of_contact(f / "p.png", w.problem, surface=differs(None, "floor")),
        "the surface 'floor' is not one of the problem",
    ),
    "number of states": (
        lambda w, f: picture_of_states(f / "p.png", w.system, [None] * differs(1, 2)),
        "points differs between ranks",
    ),
    "record in folders": (
        lambda w, f: BranchRecord(f / differs("a", "b"), w.system),
        "folder differs between ranks",
    ),
    "resume": (
        lambda w, f: BranchRecord(f, w.system, resume=differs(False, True)),
        "resume differs between ranks",
    ),
    "every": (
        lambda w, f: BranchRecord(f, w.system, every=differs(5, 6)),
        "every differs between ranks",
    ),
    "names of functionals": (
        lambda w, f: BranchRecord(f, w.system, {differs("a", "b"): total("rn")}),
        r"functionals differs between ranks: \['a'\] on rank 0, \['b'\]",
    ),
    "order of functionals": (
        lambda w, f: BranchRecord(
            f, w.system, {k: total("rn") for k in differs(("a", "b"), ("b", "a"))}
        ),
        "functionals differs between ranks",
    ),
}


@several
@pytest.mark.parametrize("name", WRITTEN_DIFFERENTLY)
def test_nothing_is_written_if_ranks_write_different_things(w, folder, name):
    do, *said = WRITTEN_DIFFERENTLY[name]
    refused(w, lambda w: do(w, folder), *said)
    assert not list(folder.iterdir())


@several
def test_nothing_is_written_if_ranks_write_different_series(w, folder):
    with BranchRecord(folder / "record", w.system) as record:
        follow(w.system, w.x, 0.0, gamma_range=(0.0, 1.0), max_steps=2, record=record)
        for said, options in {
            "branch": {"branch": differs(0, 1)},
            "format": {"format": differs("vtx", "vtk")},
            "folder": {"folder": folder / differs("a", "b")},
        }.items():
            do = {"folder": folder / "series", **options}
            match = f"{said} differs between ranks"
            refused(w, lambda _, do=do: write_series(record=record, **do), match)
        refused(w, lambda _: record.go_on(differs(0, 1)), "branch differs between ranks")
        refused(w, lambda _: record.go_on(max_steps=differs(3, 4)), "max steps differs between")


#: What is done with other arguments on the last rank, and what the message says.
DISAGREEMENT = {
    "friction": (
        lambda w: discretised(w, law=Coulomb(differs(0.3, 0.4))),
        r"law differs between ranks: 'Coulomb\(friction 0\.3 .* rank 0, 'Coulomb\(friction 0\.4 ",
    ),
    "friction Constant": (
        lambda w: discretised(w, law=Coulomb(fem.Constant(w.domain, differs(0.3, 0.4)))),
        "law differs between ranks",
    ),
    "kind of law": (
        lambda w: discretised(w, law=differs(Coulomb(0.3), Frictionless())),
        "law differs between ranks",
    ),
    "threshold": (
        lambda w: discretised(w, law=Tresca(differs(0.3, 0.4))),
        "law differs between ranks",
    ),
    "law that raises": (
        lambda w: discretised(w, law=differs(WorseLaw(False), WorseLaw(True))),
        "in the law",
        (UsersError, RuntimeError),
    ),
    "point": (
        lambda w: discretised(w, obstacle=HalfSpace((0.0, differs(0.0, -0.1)), (0, 1))),
        "obstacle differs between ranks",
    ),
    "radius": (
        lambda w: discretised(w, obstacle=Sphere((0.5, -2.0), differs(2.0, 1.9))),
        "obstacle differs between ranks",
    ),
    "kind of obstacle": (
        lambda w: discretised(w, obstacle=differs(FLOOR, Sphere((0.5, -2.0), 2.0))),
        "obstacle differs between ranks",
    ),
    "level set": (
        lambda w: discretised(w, obstacle=LevelSet(lambda x: differs(1.0, 1.1) + x[1])),
        "obstacle differs between ranks",
    ),
    "method": (
        lambda w: discretised(w, method=differs("nodal", "integral")),
        "method differs between ranks: 'nodal' on rank 0, 'integral'",
    ),
    "quadrature degree": (
        lambda w: discretised(w, method="integral", quadrature_degree=differs(2, 4)),
        "quadrature degree differs between ranks",
    ),
    "name": (lambda w: discretised(w, name=differs("a", "b")), "name differs between ranks"),
    "tag": (
        lambda w: discretised(w, tags_of(w.domain), tag=differs(7, 8)),
        "tag differs between ranks: 7 on rank 0, 8",
    ),
    "kind of facets": (
        lambda w: discretised(w, differs(tags_of(w.domain), facets(w.domain, 1, 0.0)), tag=7),
        "kind of facets differs between ranks",
    ),
    "facets outside": (
        lambda w: discretised(w, differs(facets(w.domain, 1, 0.0), np.array([10**6]))),
        "facet indices outside the mesh",
    ),
    "surfaces": (
        lambda w: problem(w, surfaces=differs([w.surface], [w.surface] * 2)),
        "need different names",
    ),
    "conditions": (
        lambda w: problem(w, bcs=differs([clamp(w.u)], [])),
        "Dirichlet data differs between ranks",
    ),
    "Dirichlet value": (
        lambda w: problem(w, bcs=[clamp(w.u, np.array([0.0, differs(-0.01, -0.02)]))]),
        r"Dirichlet data differs between ranks: .*-0\.01.* on rank 0, .*-0\.02",
    ),
    "r": (lambda w: problem(w, r=differs(10.0, 20.0)), "r differs between ranks: .*10.0"),
    "bulk": (
        lambda w: problem(w, fem.Constant(w.domain, differs(1.0, 2.0)) * w.energy),
        "bulk differs between ranks",
    ),
    "kind of bulk": (
        lambda w: problem(w, differs(w.energy, w.energy + w.u[1] * ufl.dx)),
        "bulk differs between ranks",
    ),
    "options": (
        lambda w: problem(w, petsc_options={"snes_rtol": differs(1e-8, 1e-9)}),
        "petsc options differs between ranks",
    ),
    "prefix": (
        lambda w: problem(w, petsc_options_prefix=differs("a_", "b_")),
        "petsc options prefix differs between ranks",
    ),
    "database": (
        lambda w: with_option(w, differs("contact_snes_rtol", "contact_snes_max_it"), 9),
        "PETSc database differs between ranks",
    ),
    "parameter": (
        lambda w: parametric(
            w, g := fem.Constant(w.domain, differs(0.0, 1.0)), driven=[(w.held, vector(g))]
        ),
        "gamma differs between ranks",
    ),
    "driven": (
        lambda w: parametric(w, driven=differs([], [(w.held, vector(w.gamma))])),
        "driven differs between ranks",
    ),
    "driven by": (
        lambda w: parametric(w, driven=[(w.held, differs(1.0, 2.0) * vector(w.gamma))]),
        "driven differs between ranks",
    ),
    "parameter that is set": (
        lambda w: w.system.set_parameter(differs(0.0, 1.0)),
        "gamma differs between ranks",
    ),
    "range": (
        lambda w: followed(w, gamma_range=(0.0, differs(1.0, 2.0))),
        "gamma range differs between ranks",
    ),
    "start": (lambda w: followed(w, gamma=differs(0.0, 0.5)), "gamma differs between ranks"),
    "direction": (
        lambda w: followed(w, gamma=0.5, direction=differs("increasing", "decreasing")),
        "direction differs between ranks",
    ),
    "control": (
        lambda w: followed(w, control=StepControl(initial=differs(0.01, 0.02))),
        "control differs between ranks",
    ),
    "steps": (lambda w: followed(w, max_steps=differs(5, 6)), "max steps differs between ranks"),
    "route": (lambda w: followed(w, route=differs("auto", "steps")), "route differs between ranks"),
    "stop of one rank": (
        lambda w: followed(w, stop=differs(None, lambda *_: "enough")),
        "stop differs between ranks: None on rank 0, given",
    ),
    "answers of stop": (
        lambda w: followed(w, stop=lambda *_: differs("", "enough")),
        "the answer of stop differs between ranks",
    ),
    "stop raises": (
        lambda w: followed(w, stop=on_last(ZeroDivisionError("in stop"))),
        "in stop",
        ZeroDivisionError,
    ),
    "stop answers True": (
        lambda w: followed(w, stop=lambda *_: differs("", True)),
        "returned True",
    ),
    "observer raises": (
        lambda w: followed(w, observer=Telling(on_last(ZeroDivisionError("in the observer")))),
        "in the observer",
        ZeroDivisionError,
    ),
    "state too short": (
        lambda w: followed(w, x=differs(w.x, PETSc.Vec().createSeq(3))),
        "x does not fit the unknowns",
    ),
    "monitor raises": (
        lambda w: block().solve(monitor=on_last(ZeroDivisionError("in the monitor"))),
        "in the monitor",
        ZeroDivisionError,
    ),
    "gamma of solutions": (lambda w: found(w, gamma=differs(0.0, 0.1)), "gamma differs between"),
    "lengths": (
        lambda w: found(w, lengths=differs((0.5,), (0.25,))),
        "lengths differs between ranks",
    ),
    "guesses": (
        lambda w: found(w, differs([w.x], [w.x, w.x])),
        "number of states differs between ranks: 1 on rank 0, 2",
    ),
    "branches": (
        lambda w: explored(w, [(w.x, 0.0)], max_branches=differs(3, 4)),
        "max branches differs between ranks",
    ),
}


@several
@pytest.mark.parametrize("name", DISAGREEMENT)
def test_ranks_that_disagree_raise_the_same_error(w, name):
    refused(w, *DISAGREEMENT[name])
