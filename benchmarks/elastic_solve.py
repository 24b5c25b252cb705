# SPDX-License-Identifier: LGPL-3.0-or-later
"""The yardstick: one linear elastic solve, by the fastest of many settings of multigrid.

Conjugate gradients with GAMG or BoomerAMG on the stiffness of DOLFINx, as one would set them up by
hand; the frictional solver takes no part. They stop by the norm of the residual itself, and a
solve counts if ||b - K x|| <= tolerance ||b|| by a product with K afterwards; else it is made again
with a tighter one. b is the load of the prescribed motion on the free rows: Dirichlet rows, which
would make ||b|| large and the test loose, are zero in it.

`SETTINGS` are all that are tried, `FEW` those that were the fastest somewhere, or nearly.

GAMG, named ``gamg<s>-<smoother>...`` with ``s`` steps of smoothing the aggregates
(`pc_gamg_agg_nsmooths`):

- smoothers: ``sor1``, ``sor2``: symmetric SOR, sweeps before and after; ``chebyshev1``,
  ``chebyshev2``: Chebyshev's iteration on Jacobi, that many steps; ``chebyshev2-sor``: on SOR;
  ``chebyshev2-blocks``: on the blocks of the nodes;
- ``half``: products and smoothing of the finest level by a symmetric matrix, stored by half;
- ``threshold<t>``: which couplings aggregates ignore (elsewhere 0.005);
- ``fine``: no aggressive coarsening of the first level (elsewhere one level);
- ``w``: W-cycles, and a factorisation from 1000 unknowns on, as the frictional solve has them;
- ``translations``: the near null space without rotations.

BoomerAMG, named ``hypre-...`` (HMIS, one aggressive level, ext+i with four entries a row, strong
threshold 0.25 but where said):

- ``unknown``: every displacement component on its own;
- ``nodal4``, ``nodal6``: nodes coarsened together (by row sums, by the sum of all entries);
- ``gm1``, ``gm2``, ``ln``: as ``nodal4``, with rigid motions interpolated in hypre's three ways;
- ``fine``, ``chebyshev``, ``entries6``: no aggressive level, another smoother, six entries a row;
- ``default``: as PETSc has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fnmatch import fnmatch

from petsc4py import PETSc

import numpy as np
from timing import Timer, peak_gigabytes

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._petsc import half_of, options_in_database
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.solvers.hierarchy import rigid_body_space

_PREFIX = "yardstick_"
_MOST = 500  # iterations
#: On one rank PETSc's own way of Galerkin products takes twice as long.
_PRODUCTS = {"matptap_via": "rap"}


@dataclass(frozen=True)
class Setting:
    """A way to precondition.

    Attributes:
        name: for the command line and the record.
        options: PETSc's.
        half: whether the finest level has its matrix by half.
        rigid: whether rigid motions are handed over.
    """

    name: str
    options: dict = field(default_factory=dict)
    half: bool = False
    rigid: bool = False


_SMOOTHERS = {
    "sor1": ("richardson", "sor", 1),
    "sor2": ("richardson", "sor", 2),
    "chebyshev1": ("chebyshev", "jacobi", 1),
    "chebyshev2": ("chebyshev", "jacobi", 2),
    "chebyshev2-sor": ("chebyshev", "sor", 2),
    "chebyshev2-blocks": ("chebyshev", "pbjacobi", 2),
}


_W = {"pc_mg_cycle_type": "w", "pc_gamg_coarse_eq_limit": 1000}


def _gamg(smooth, smoother, *words, half=True, threshold=0.005, aggressive=1, rigid=True):
    ksp, pc, sweeps = _SMOOTHERS[smoother]
    options = {
        **(_W if "w" in words else {}),
        "pc_type": "gamg",
        "pc_gamg_agg_nsmooths": smooth,
        "pc_gamg_threshold": threshold,
        "pc_gamg_aggressive_coarsening": aggressive,
        "mg_levels_ksp_type": ksp,
        "mg_levels_ksp_max_it": sweeps,
        "mg_levels_pc_type": pc,
    }
    name = "-".join([f"gamg{smooth}", smoother, *(["half"] if half else []), *words])
    return Setting(name, options, half, rigid)


def _all_of_gamg(s):
    return [
        _gamg(s, "sor1"),
        _gamg(s, "sor1", half=False),
        _gamg(s, "sor1", "threshold0", threshold=0.0),
        _gamg(s, "sor1", "threshold0.02", threshold=0.02),
        _gamg(s, "sor1", "translations", rigid=False),
        _gamg(s, "sor2"),
        _gamg(s, "chebyshev1"),
        _gamg(s, "chebyshev2"),
        _gamg(s, "chebyshev2", half=False),
        _gamg(s, "chebyshev2", "threshold0", threshold=0.0),
        _gamg(s, "chebyshev2", "threshold0.02", threshold=0.02),
        _gamg(s, "chebyshev2", "fine", aggressive=0),
        _gamg(s, "chebyshev2-sor", half=False),
        _gamg(s, "chebyshev2-blocks"),
        _gamg(s, "sor1", "w"),
        _gamg(s, "chebyshev1", "w"),
        _gamg(s, "chebyshev2", "w"),
    ]


def _hypre(name, rigid=False, **given):
    options = {
        "strong_threshold": 0.25,
        "coarsen_type": "HMIS",
        "interp_type": "ext+i",
        "P_max": 4,
        "agg_nl": 1,
        **given,
    }
    named = {f"pc_hypre_boomeramg_{k}": v for k, v in options.items()}
    return Setting(
        f"hypre-{name}", {"pc_type": "hypre", "pc_hypre_type": "boomeramg", **named}, rigid=rigid
    )


_NODAL = {"nodal_coarsen": 4}
SETTINGS = [
    *_all_of_gamg(0),
    *_all_of_gamg(1),
    _hypre("unknown"),
    _hypre("unknown-threshold0.5", strong_threshold=0.5),
    _hypre("unknown-fine", agg_nl=0),
    _hypre("unknown-chebyshev", relax_type_all="Chebyshev"),
    _hypre("unknown-entries6", P_max=6),
    _hypre("nodal4", **_NODAL),
    _hypre("nodal4-threshold0.5", **_NODAL, strong_threshold=0.5),
    _hypre("nodal6", nodal_coarsen=6),
    _hypre("gm1", rigid=True, **_NODAL, vec_interp_variant=1),
    _hypre("gm2", rigid=True, **_NODAL, vec_interp_variant=2),
    _hypre("gm2-threshold0.5", rigid=True, **_NODAL, vec_interp_variant=2, strong_threshold=0.5),
    _hypre("ln", rigid=True, **_NODAL, vec_interp_variant=3),
    Setting("hypre-default", {"pc_type": "hypre", "pc_hypre_type": "boomeramg"}),
]
FEW = (
    *("gamg0-sor1-half", "gamg0-sor1-half-threshold0.02", "gamg0-chebyshev1-half"),
    *("gamg0-sor1-half-w", "gamg0-chebyshev1-half-w", "gamg0-chebyshev2-half-w"),
    *("gamg1-sor1-half", "gamg1-chebyshev2-half"),
    *("hypre-unknown", "hypre-nodal4", "hypre-nodal4-threshold0.5", "hypre-nodal6"),
)


def chosen(words):
    """Settings by ``all``, ``few``, names or patterns of the shell.

    Raises:
        ValueError: if a word is none of these.
    """
    names = [s.name for s in SETTINGS]
    sets = {"all": names, "few": FEW}
    found = set()
    for word in words:
        more = sets.get(word) or [n for n in names if fnmatch(n, word)]
        if not more:
            raise ValueError(f"{word} is no setting; there are: all, few, {', '.join(names)}")
        found.update(more)
    return [s for s in SETTINGS if s.name in found]


def run_of(setting, V, conditions, poisson, tolerance, tie=None):
    """A function that makes one whole solve, and returns its record. Collective.

    Args:
        setting: how to precondition.
        V: space of the displacement.
        conditions: makes the Dirichlet conditions.
        poisson: ratio of the body; Young's modulus is 1.
        tolerance: of the true residual.
        tie: makes, of the displacement, the matrix P of what is tied, u = P x, and the local dofs
            that are tied to others, whose columns are zero; None where nothing is.
    """
    asked = tolerance

    def run():
        nonlocal asked
        record = _solve(setting, V, conditions, poisson, asked, tie)
        while record["converged"] and record["true_residual"] > tolerance:
            asked *= 0.5
            record = _solve(setting, V, conditions, poisson, asked, tie)
        return record

    return run


def _solve(setting, V, conditions, poisson, rtol, tie=None):
    comm = V.mesh.comm
    timer = Timer(V.mesh.comm)
    u, a, F, bcs = timer("problem", lambda: _problem(V, conditions, poisson))
    P = None
    if tie is not None:
        P, tied = timer("tie", lambda: tie(u))
    K, b = timer("assembly", lambda: _assembled(a, F, bcs))
    if P is not None:
        K, b = timer("products", lambda: _reduced(K, b, P, tied))
    made = [P] if P is not None else []  # what the set-up makes beside the KSP

    def set_up():
        if setting.rigid:
            null_space, vectors = rigid_body_space(V)
            K.setNearNullSpace(null_space)
            made.extend([null_space, *vectors])
        K.setOption(PETSc.Mat.Option.SPD, True)
        A = K
        if setting.half:
            A = half_of(K)
            made.append(A)
        ksp = PETSc.KSP().create(comm)
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=rtol, atol=0.0, max_it=_MOST)
        ksp.setOperators(A, K)
        ksp.setOptionsPrefix(_PREFIX)
        products = _PRODUCTS if comm.size == 1 else {}
        with options_in_database(_PREFIX, setting.options), options_in_database("", products):
            ksp.setFromOptions()
            ksp.setUp()
        pc = ksp.getPC()
        if setting.half and pc.getType() == "gamg" and pc.getMGLevels() > 1:
            pc.getMGSmoother(pc.getMGLevels() - 1).setOperators(A, K)
        return ksp

    ksp = timer("set-up", set_up)
    x = b.duplicate()

    def solve():
        x.set(0.0)
        ksp.solve(b, x)
        u.x.array[: x.getLocalSize()] = x.array_r if P is None else (P * x).array_r
        for bc in bcs:
            bc.set(u.x.array)
        u.x.scatter_forward()

    timer("solve", solve)
    r = b.duplicate()
    K.mult(x, r)
    r.aypx(-1.0, b)
    residual = r.norm() / b.norm()
    record = {
        "setting": setting.name,
        "preconditioner": setting.options["pc_type"],
        **timer.record,
        "iterations": ksp.getIterationNumber(),
        "rtol": rtol,
        "true_residual": residual if math.isfinite(residual) else None,
        "converged": ksp.getConvergedReason() > 0 and math.isfinite(residual),
        "reason": ksp.getConvergedReason(),
        "peak_memory": peak_gigabytes(comm),
        "options": setting.options,
        "half": setting.half,
        "rigid": setting.rigid,
    }
    for thing in (ksp, K, b, x, r, *made):
        thing.destroy()
    return record


def _problem(V, conditions, poisson):
    """Displacement, compiled forms of stiffness and residual, and Dirichlet conditions."""
    u = fem.Function(V)
    energy = LinearElastic.from_young(1.0, poisson).energy(u) * ufl.dx
    residual = ufl.derivative(energy, u, ufl.TestFunction(V))
    stiffness = ufl.derivative(residual, u, ufl.TrialFunction(V))
    return u, fem.form(stiffness), fem.form(residual), conditions()


def _assembled(a, F, bcs):
    """Stiffness with its Dirichlet rows and columns, and the load of the prescribed motion."""
    K = dolfinx.fem.petsc.assemble_matrix(a, bcs=bcs)
    K.assemble()
    b = dolfinx.fem.petsc.assemble_vector(F)
    b.scale(-1.0)
    dolfinx.fem.petsc.apply_lifting(b, [a], bcs=[bcs])
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    dolfinx.fem.petsc.set_bc(b, bcs, alpha=0.0)
    return K, b


def _reduced(K, b, P, tied):
    """Stiffness and load of what is not tied; of the rest the identity times a stiffness."""
    A = K.ptap(P)
    A.setBlockSize(K.getBlockSize())
    A.zeroRowsColumns((tied + A.getOwnershipRange()[0]).astype(np.int32), diag=K.norm() / K.size[0])
    f = b.duplicate()
    P.multTranspose(b, f)
    f.array[tied] = 0.0
    K.destroy(), b.destroy()
    return A, f


def glued(V, facets):
    """Dirichlet condition that holds ``facets``."""
    dofs = fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, facets)
    return fem.dirichletbc(np.zeros(V.mesh.geometry.dim), dofs, V)
