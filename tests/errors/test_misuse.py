"""Wrong input of all public functions in one table, with the same error on every rank."""

import numpy as np
import pytest
from support.blocks import block, facets
from support.misused_block import (
    FLOOR,
    MATERIAL,
    Telling,
    UsersError,
    clamp,
    discretised,
    explored,
    followed,
    found,
    parametric,
    problem,
    raising,
    refused,
    solved,
    surface,
    tags_of,
    two_spaces,
    vector,
    with_option,
)

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactSurface,
    Coulomb,
    Cylinder,
    HalfSpace,
    LevelSet,
    ParametricContact,
    RigidBody,
    Sphere,
)
from dolfinx_contact.algorithms import Uzawa
from dolfinx_contact.analysis.two_parameters import contact_family
from dolfinx_contact.continuation import (
    StepControl,
    follower_for,
)
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import (
    CiarletGeymonat,
    LinearElastic,
    NeoHookean,
    StVenantKirchhoff,
)
from dolfinx_contact.obstacles import Obstacle

# Every case runs on two ranks, because the errors must be the same on both.
pytestmark = [
    pytest.mark.ranks(2, every_case=True),
    pytest.mark.usefixtures("nothing_hangs"),
]
pytest_plugins = ["support.misused_block"]


def started(value):
    p = block()
    p.u.x.array[:] = value
    return p.solve()


class LongNormals(Obstacle):
    """User-defined obstacle whose normals have the length 2."""

    def at(self, domain, x):
        return 2.0 * x[1], ufl.as_vector((0.0, -2.0))


def tilted(f):
    return LevelSet(lambda x: x[1] + 0.3 * f)


class BadLaw(FrictionLaw):
    def bind(self, domain):
        return self

    def bound(self, a, p):
        raise UsersError("in the law")


#: Call, pattern of the message, and class of the error (default: ValueError).
MISUSE = {
    # surfaces
    "tags of another mesh": (
        lambda w: discretised(w, tags_of(w.other), tag=7),
        "belong to another mesh",
    ),
    "tags of cells": (
        lambda w: discretised(w, tags_of(w.domain, 2), tag=7),
        "of dimension 1, not 2",
    ),
    "no tag": (lambda w: discretised(w, tags_of(w.domain)), "need a tag"),
    "half a tag": (lambda w: discretised(w, tags_of(w.domain), tag=7.5), "must be a whole number"),
    "facet -1": (lambda w: discretised(w, np.array([-1])), "facet indices outside the mesh"),
    "indices with a tag": (lambda w: discretised(w, tag=3), "MeshTags with a tag, not .* tag 3"),
    "facets as words": (lambda w: discretised(w, ["bottom"]), "array of integer indices"),
    "field of another mesh": (
        lambda w: discretised(w, law=Coulomb(w.f_other)),
        "friction of Coulomb is a Function of another mesh",
    ),
    "friction True": (lambda w: discretised(w, law=Coulomb(True)), "must be a nonnegative number"),
    "law class": (lambda w: discretised(w, law=Coulomb), "the law must be"),
    "law that raises": (lambda w: discretised(w, law=BadLaw()), "in the law", UsersError),
    "obstacle class": (lambda w: discretised(w, obstacle=HalfSpace), "the obstacle must be"),
    "point of another mesh": (
        lambda w: discretised(w, obstacle=HalfSpace(fem.Constant(w.other, (0.0, 0.0)), (0, 1))),
        "the point of the half-space is a Constant of another mesh",
    ),
    "radius vector": (
        lambda w: discretised(w, obstacle=Sphere((0.5, -1.0), fem.Constant(w.domain, (1.0, 1.0)))),
        "the radius must be a number",
    ),
    "cylinder in 2D": (
        lambda w: discretised(w, obstacle=Cylinder((0, 0), (0, 1), 1.0)),
        "needs a 3D mesh",
    ),
    "level set number": (
        lambda w: discretised(w, obstacle=LevelSet(lambda x: 1.0)),
        "scalar UFL expression",
    ),
    "level set that raises": (
        lambda w: discretised(w, obstacle=LevelSet(raising(UsersError("in the level set")))),
        "in the level set",
        UsersError,
    ),
    "no name": (lambda w: discretised(w, name=""), "the name of a contact surface"),
    "quadrature degree word": (
        lambda w: discretised(w, method="integral", quadrature_degree="4"),
        "the quadrature degree of P. with P. must be",
    ),
    "displacement expression": (
        lambda w: ContactSurface(2 * w.u, facets(w.domain, 1, 0.0), obstacle=FLOOR, law=BadLaw()),
        "the displacement must be a Function",
    ),
    # problems
    "bulk with a Constant of another mesh": (
        lambda w: problem(w, w.energy - w.c_other * w.u[1] * ufl.dx(domain=w.domain)),
        "the bulk contains a Constant of another mesh",
    ),
    "bulk over another mesh": (
        lambda w: problem(w, w.energy + w.u[1] * ufl.dx(domain=w.other)),
        "the bulk belongs to another mesh",
    ),
    "bulk of an energy and a residual": (
        lambda w: problem(w, w.energy - ufl.TestFunction(w.V)[1] * ufl.dx),
        "the bulk mixes an energy and a residual",
    ),
    "bulk of an energy and a residual in one integral": (
        lambda w: problem(w, (w.u[0] ** 2 - ufl.TestFunction(w.V)[1]) * ufl.dx),
        "the bulk mixes an energy and a residual",
    ),
    "bulk number": (lambda w: problem(w, 1.0), "the bulk must be a UFL form"),
    "Dirichlet condition of another mesh": (
        lambda w: problem(w, bcs=[clamp(w.v_other)]),
        "a Dirichlet condition, or its value, is on a space of another mesh",
    ),
    "Dirichlet Function of another mesh": (
        lambda w: problem(w, bcs=[fem.dirichletbc(w.v_other, two_spaces(w), w.V)]),
        "a Dirichlet condition, or its value, is on a space of another mesh",
    ),
    "Dirichlet condition of a complex number": (
        lambda w: problem(
            w, bcs=[fem.dirichletbc(np.array([0.0, 1j]), np.array([0], np.int32), w.V)]
        ),
        "Dirichlet condition 1 is complex",
    ),
    "conditions of words": (lambda w: problem(w, bcs=["top"]), "a list of Dirichlet conditions"),
    "r nan": (lambda w: problem(w, r=np.nan), "r must be positive"),
    # PETSc options
    "options list": (lambda w: problem(w, petsc_options=["snes_rtol"]), "items", AttributeError),
    "option with prefix": (
        lambda w: problem(w, petsc_options={"contact_snes_rtol": 1e-8}),
        "without dash and prefix, as 'snes_rtol'",
    ),
    "option misspelled": (
        lambda w: problem(w, petsc_options={"snes_rtoll": 1e-8}),
        "petsc_options: snes_rtoll: there is no such option; did you mean snes_rtol",
    ),
    "option in the database misspelled": (
        lambda w: with_option(w, "contact_linear_solvr", "amg"),
        "-contact_linear_solvr: there is no such option; did you mean linear_solver",
    ),
    "tolerance < 0": (
        lambda w: problem(w, petsc_options={"snes_rtol": -1e-8}),
        "snes_rtol must be a positive number",
    ),
    "tolerance nan": (
        lambda w: problem(w, petsc_options={"snes_rtol": np.nan}),
        "must be a positive number",
    ),
    "iterations 2.5": (
        lambda w: solved(options={"linear_solver": "amg", "ksp_max_it": 2.5}),
        "PETSc: Input string 2.5 has no integer value",
    ),
    "prefix with dash": (
        lambda w: problem(w, petsc_options_prefix="-contact_"),
        "must be a word without dash",
    ),
    **{
        f"snes_type {kind}": (
            lambda w, kind=kind: problem(w, petsc_options={"snes_type": kind}),
            f"snes_type must be one of newtonls, .*; got '{kind}'",
        )
        for kind in ("ksponly", "nrichardson", "ngmres", "qn", "ncg", "vinewtonrsls", "magic")
    },
    **{
        f"{name} {value}": (
            lambda w, name=name, value=value: solved(options={name: value}),
            words,
        )
        for name, value, words in (
            (
                "snes_convergence_test",
                "skip",
                "the convergence test of this package cannot be replaced",
            ),
            ("snes_divergence_tolerance", 0.5, "PETSc: Divergence tolerance 0.5"),
            ("snes_lag_preconditioner", -1, "PETSc: Cannot set the lag to -1"),
        )
    },
    "multigrid without Newton": (
        lambda w: solved(options={"linear_solver": "amg", "snes_type": "newtontr"}),
        "with the linear solver amg only newtonls can be used",
    ),
    "unknown KSP": (
        lambda w: solved(options={"ksp_type": "magic"}),
        "PETSc: Unable to find requested KSP type magic",
    ),
    "unknown PC": (
        lambda w: solved(options={"pc_type": "magic"}),
        "PETSc: Unable to find requested PC type magic",
    ),
    "unknown factorisation": (
        lambda w: solved(options={"pc_factor_mat_solver_type": "magic"}),
        "PETSc: Could not locate solver type magic",
    ),
    # solves
    "start 1e200": (lambda w: started(1e200), "the residual overflows at the start"),
    "stiffness 1e300": (lambda w: solved(young=1e300), "the residual overflows at the start"),
    "monitor that raises": (
        lambda w: block().solve(monitor=raising(UsersError("in the monitor"))),
        "in the monitor",
        UsersError,
    ),
    "monitor interrupted": (
        lambda w: block().solve(monitor=raising(KeyboardInterrupt("enough"))),
        "enough",
        KeyboardInterrupt,
    ),
    "monitor number": (lambda w: block().solve(monitor=3), "not callable", TypeError),
    # level sets and obstacles
    **{
        f"level set {what}": (
            lambda w, phi=phi: discretised(w, obstacle=LevelSet(lambda x: phi(w, x))),
            "the level set must depend on the position",
        )
        for what, phi in {
            "constant": lambda w, x: fem.Constant(w.domain, 1.0),
            "number": lambda w, x: 1.0 + 0 * x[0],
            "Function": lambda w, x: w.u[0],
        }.items()
    },
    **{
        f"{what} by {which}": (
            lambda w, made=made, field=field: problem(w, surfaces=[made(w, field(w))]).solve(),
            "must be the same at every point of the body",
        )
        for what, made in {
            "level set": lambda w, f: surface(w, obstacle=tilted(f)),
            "level set of a rigid body": lambda w, f: surface(
                w, obstacle=RigidBody(tilted(f), about=(0.0, 0.0), held=["x", "y", "rz"])
            ),
            "centre": lambda w, f: surface(
                w, obstacle=Sphere(ufl.as_vector([0.5, 0.3 * f - 1.0]), 1.0)
            ),
            "radius": lambda w, f: surface(w, obstacle=Sphere((0.5, -2.0), 1.0 + 0.3 * f)),
        }.items()
        for which, field in (
            ("a Function", lambda w: w.field),
            ("the position", lambda w: ufl.SpatialCoordinate(w.domain)[0]),
        )
    },
    "normals of two": (
        lambda w: problem(w, surfaces=[surface(w, obstacle=LongNormals())]).solve(),
        "normals of the obstacle must have the length 1, and one has 2",
    ),
    "obstacle that moves with the body": (
        lambda w: discretised(w, obstacle=LevelSet(lambda x: x[1] + w.u[1])),
        "must be the same at every point of the body",
    ),
    # options
    **{
        name: (
            lambda w, name=name: problem(w, petsc_options={name: None}),
            f"petsc_options: {name} cannot be used: the linear solvers need the assembled",
        )
        for name in ("snes_mf", "snes_mf_operator", "snes_fd")
    },
    "absolute tolerance": (
        lambda w: problem(w, petsc_options={"snes_atol": 1e-8}),
        "petsc_options: snes_atol cannot be used: only snes_rtol decides on convergence",
    ),
    "snes_fd in the database": (
        lambda w: with_option(w, "contact_snes_fd", True),
        "-contact_snes_fd cannot be used: the linear solvers need",
    ),
    # problems with a parameter
    "parameter of another mesh": (lambda w: parametric(w, w.c_other), "gamma is a Constant of"),
    "parameter number": (lambda w: parametric(w, 0.5), "gamma must be a scalar Constant"),
    "parameter vector": (
        lambda w: parametric(w, fem.Constant(w.domain, (0.0, 1.0))),
        "gamma must be a scalar Constant",
    ),
    "parameter that is not used": (
        lambda w: parametric(w, fem.Constant(w.domain, 0.5)),
        "gamma does not occur in the problem or in driven",
    ),
    "driven without the parameter": (
        lambda w: parametric(
            w, problem=problem(w, bcs=w.problem.bcs), driven=[(w.held, vector(1.0))]
        ),
        "gamma does not occur in the problem or in driven",
    ),
    "no parameter to follow": (
        lambda w: followed(w, system=ParametricContact(problem(w))),
        "gamma does not appear in H",
    ),
    "no problem": (lambda w: parametric(w, problem=w.energy), "must be a ContactProblem"),
    "driven of another mesh": (
        lambda w: parametric(w, driven=[(w.v_other, vector(w.gamma))]),
        "is a Function of another mesh",
    ),
    "driven of another shape": (
        lambda w: parametric(w, driven=[(w.held, w.gamma)]),
        r"has shape \(2,\), its expression \(\)",
    ),
    "driven by a word": (
        lambda w: parametric(w, driven=[(w.held, "gamma")]),
        "can not be converted to any UFL type",
    ),
    "driven nowhere": (
        lambda w: parametric(w, driven=[(fem.Function(w.V), vector(w.gamma))]),
        "is not in a Dirichlet condition",
    ),
    "driven twice": (
        lambda w: parametric(w, driven=[(w.held, vector(w.gamma)), (w.held, vector(w.gamma))]),
        "is driven twice",
    ),
    "driven and a load": (
        lambda w: parametric(
            w,
            problem=problem(w, w.energy - ufl.dot(w.held, w.u) * ufl.dx, bcs=w.problem.bcs),
            driven=[(w.held, vector(w.gamma))],
        ),
        "in the form of the body is a driven Function",
    ),
    "driven and a coefficient of friction": (
        lambda w: parametric(
            w,
            problem=problem(
                w, surfaces=[surface(w, law=Coulomb(0.3 + abs(w.held[0])))], bcs=w.problem.bcs
            ),
            driven=[(w.held, vector(w.gamma))],
        ),
        "is a driven Function",
    ),
    "driven by a driven one": (
        lambda w: parametric(w, driven=[(w.held, vector(w.gamma) + 0.5 * w.held)]),
        "is a driven Function",
    ),
    "driven by the displacement": (
        lambda w: parametric(w, driven=[(w.held, vector(w.gamma) + w.u)]),
        "is an unknown",
    ),
    "parameter that is held": (
        lambda w: parametric(
            w,
            problem=problem(
                w,
                bcs=[
                    fem.dirichletbc(
                        w.gamma,
                        fem.locate_dofs_topological(w.V.sub(1), 1, facets(w.domain, 1, 1.0)),
                        w.V.sub(1),
                    )
                ],
            ),
        ),
        "gamma is the value of a Dirichlet condition",
    ),
    "driven no list": (
        lambda w: parametric(w, driven=(w.held, vector(w.gamma))),
        "a list of pairs",
    ),
    "parameter nan": (lambda w: w.system.set_parameter(np.nan), "gamma must be a finite number"),
    # branches
    "range inf": (lambda w: followed(w, gamma_range=(0, np.inf)), "must be 2 finite numbers"),
    "range 1e-300": (lambda w: followed(w, gamma_range=(0, 1e-300)), "too short or too long"),
    "range of round-off": (
        lambda w: followed(w, gamma=1.0, gamma_range=(1, 1 + 1e-14)),
        "too short or too long",
    ),
    "range reversed": (lambda w: followed(w, gamma_range=(1, 0)), "of gamma is empty"),
    "range of three": (
        lambda w: followed(w, gamma_range=(0, 1, 2)),
        "gamma_range must be 2 finite numbers",
    ),
    "start beyond": (lambda w: followed(w, gamma=2.0), "must lie in the range"),
    **{
        f"stop answers {answer}": (
            lambda w, answer=answer: followed(w, stop=lambda *_: answer),
            f"it returned {answer}",
        )
        for answer in (True, False, None, 3)
    },
    "stop word": (lambda w: followed(w, stop="now"), "stop must be a function"),
    "stop raises": (
        lambda w: followed(w, stop=raising(UsersError("in stop"))),
        "in stop",
        UsersError,
    ),
    "stop interrupted": (
        lambda w: followed(w, stop=raising(KeyboardInterrupt("enough"))),
        "enough",
        KeyboardInterrupt,
    ),
    "observer word": (lambda w: followed(w, observer="me"), "must be an Observer"),
    "record function": (lambda w: followed(w, record=print), "must be a records.BranchRecord"),
    "progress word": (lambda w: followed(w, progress="yes"), "progress must be one of True, False"),
    "observer raises": (
        lambda w: followed(w, observer=Telling(raising(UsersError("in the observer")))),
        "in the observer",
        UsersError,
    ),
    "control dictionary": (
        lambda w: followed(w, control={"initial": 0.1}),
        "control must be a StepControl",
    ),
    "no steps": (lambda w: followed(w, max_steps=0), "max_steps must be a whole number >= 1"),
    "unknown route": (
        lambda w: followed(w, route="fast"),
        "route must be one of auto, pivoting, steps",
    ),
    "scale 0": (
        lambda w: follower_for(w.system, w.x, 0.0, gamma_scale=0.0),
        "gamma_scale must be a positive number",
    ),
    "state too short": (lambda w: followed(w, x=w.short), "x does not fit the unknowns"),
    "state Function": (lambda w: followed(w, x=w.u), "x must be a Vec, a PETSc vector"),
    "state nan": (lambda w: followed(w, x=w.infinite), "x has an entry that is not finite"),
    "system problem": (lambda w: followed(w, system=w.problem), "such as a ParametricContact"),
    "system None": (lambda w: followed(w, system=None), "such as a ParametricContact"),
    "control nan": (
        lambda w: StepControl(initial=np.nan),
        "initial of a StepControl must be a fin",
    ),
    "no starts": (lambda w: explored(w, []), "at least one start"),
    "starts that are no pairs": (lambda w: explored(w, [1.0]), "pairs of a state and its gamma"),
    "a start too short": (lambda w: explored(w, [(w.short, 0.0)]), "a start does not fit"),
    "no branches": (lambda w: explored(w, [(w.x, 0.0)], max_branches=0), "must be a whole number"),
    # solutions at one gamma
    "solutions at nan": (lambda w: found(w, gamma=np.nan), "gamma must be a finite number"),
    "no guess": (lambda w: found(w, []), "at least one guess"),
    "guess no list": (lambda w: found(w, w.x), "must be lists of states"),
    "guess too short": (lambda w: found(w, [w.short]), "a guess does not fit the unknowns"),
    "guess array": (lambda w: found(w, [w.x.array]), "a guess must be a Vec, a PETSc vector"),
    "length 0": (lambda w: found(w, lengths=(0.0,)), "must be a positive number"),
    "half an iteration": (
        lambda w: found(w, max_iterations=2.5),
        "max_iterations must be a whole number >= 1, got 2.5",
    ),
    "half an iteration of Uzawa": (
        lambda w: Uzawa(max_iterations=2.5),
        "max_iterations must be a whole number >= 1, got 2.5",
    ),
    "expected numbers": (lambda w: w.problem.solve(expected=[1, 2]), "not iterable", TypeError),
    "range of mu": (
        lambda w: contact_family(w.system, fem.Constant(w.V.mesh, 1.0), mu_range=(2.0, 1.0)),
        r"the range .2\.0, 1\.0. of mu is empty",
    ),
    # materials
    "stress of a trial function": (
        lambda w: MATERIAL.stress(ufl.TrialFunction(w.V)),
        "needs the displacement, a fem.Function, .* got Argument",
    ),
    "energy of an expression": (lambda w: MATERIAL.energy(2 * w.u), "needs the displacement"),
    "Young's modulus complex": (
        lambda w: LinearElastic.from_young(1.0 + 1j, 0.3),
        r"Young's modulus must be positive, got \(1\+1j\)",
    ),
    "Young's modulus in words": (
        lambda w: LinearElastic.from_young("a", 0.3),
        "Young's modulus must be positive, got 'a'",
    ),
    **{
        f"{material.__name__} {coefficients}": (
            lambda w, m=material, c=coefficients: m(*c),
            "a must lie between 0 and mu/2" if name == "a" else "Lame coefficients, numbers or UFL",
        )
        for material, name, coefficients in (
            (LinearElastic, "lambda", (np.inf, 1.0)),
            (StVenantKirchhoff, "mu", (1.0, np.inf)),
            (NeoHookean, "lambda", (np.inf, 1)),
            (NeoHookean, "lambda", ("a", 1.0)),
            (NeoHookean, "mu", (1.0, np.nan)),
            (CiarletGeymonat, "a", (1.0, 1.0, np.nan)),
        )
    },
    "vector for a coefficient": (
        lambda w: NeoHookean(1.0, ufl.as_vector([1.0, 2.0])),
        "Lame coefficients, numbers or UFL",
    ),
    "energy of a scalar": (lambda w: MATERIAL.energy(w.f_other), "must be a vector Function"),
}


@pytest.mark.parametrize("name", MISUSE)
def test_misuse_raises_the_same_error_on_every_rank(w, name):
    refused(w, *MISUSE[name])
