# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc: options of problems, events and stages of ``-log_view``, errors, matrices, factorisations.

Options in PETSc's database (from the command line or PETSC_OPTIONS) take precedence over options of
a problem. Options that this package reads itself are validated, as are options of SNES that would
replace the convergence tests and matrices of this package. PETSc reads all other options and
reports wrong values. A warning names the options of a problem that PETSc has not read;
``-options_left`` lists those of the command line.
"""

from __future__ import annotations

import argparse
import ctypes
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._validate import one_of, positive

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix as Columns

__all__ = [
    "BATCH",
    "DEFAULTS",
    "Entries",
    "Factor",
    "ProblemOptions",
    "as_raised",
    "destroy",
    "forget_product",
    "half_of",
    "has_package",
    "in_database",
    "is_symmetric",
    "logged",
    "marked_symmetric",
    "matrix_of",
    "options_in_database",
    "parse_arguments",
    "product",
    "reason_name",
    "reasons_of",
    "require_real",
    "stacked",
    "staged",
    "triplet_matrix",
    "triplets",
]

#: PETSc's error codes for unsupported, unknown or missing features, and for invalid or inconsistent
#: numbers.
_NO_SUCH_THING = (56, 62, 63, 83, 86, 92)
#: Options of this package; a similar name is an error.
_OWN = ("linear_solver", "snes_rtol", "surface_condensed")
_NEARLY = 0.88
#: Prefixes of solvers that a solve may not need.
_PARTS = ("amg_", "held_", "surface_")
#: Kinds of SNES that solve contact problems (tried); with multigrid only the first.
_SNES_TYPES = ("newtonls", "newtontr", "newtontrdc", "vinewtonssls")
#: Options that cannot be used here, by name, with the reason.
_NOT_HERE = {
    "snes_(mf|mf_operator|fd|fd_color)": "the linear solvers need the assembled Jacobian",
    "snes_convergence_test": "the convergence test of this package cannot be replaced; "
    "set snes_rtol",
    "snes_(atol|stol)": "only snes_rtol decides on convergence",
}


def parse_arguments(
    parser: argparse.ArgumentParser, argv: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse the command line of a script, and pass PETSc's options on to PETSc.

    Arguments that are unknown to the parser and begin with one dash and a letter, such as
    ``-contact_snes_monitor``, are added to PETSc's database with their values. Other unknown
    arguments are an error. With ``-log_view``, logging begins at this call, because PETSc was
    initialised without these arguments.

    Args:
        parser: parser with the options of the script.
        argv: arguments; default: arguments of the command line.
    """
    args, rest = parser.parse_known_args(argv)
    if rest and (not _is_option(rest[0]) or any(word.startswith("--") for word in rest)):
        parser.error(f"unknown options: {' '.join(rest)}")
    database = PETSc.Options()
    for word, value in pairwise([*rest, ""]):
        if _is_option(word):
            database.setValue(word[1:], "" if _is_option(value) else value)
    if database.hasName("log_view") and not PETSc.Log.isActive():
        PETSc.Log.begin()
    return args


def _is_option(word: str) -> bool:
    """Return whether a word of a command line is the name of an option, unlike ``-1``."""
    return bool(re.match(r"-[A-Za-z_]", word))


@contextmanager
def options_in_database(
    prefix: str, options: Mapping[str, Any], *, read: set[str] | None = None
) -> Iterator[None]:
    """Context manager that puts options into PETSc's database and removes them on exit.

    Options that are already in the database (command line, PETSC_OPTIONS) take precedence.

    Args:
        prefix: prefix of the options.
        options: values by name without the prefix.
        read: set to which the names of the options read by PETSc are added; default: none.
    """
    database = PETSc.Options()
    mine = {prefix + k: v for k, v in options.items() if not database.hasName(prefix + k)}
    for key, value in mine.items():
        database.setValue(key, "" if value is None else value)
    try:
        yield
    finally:
        for key in mine:
            if read is not None and _is_read(key):
                read.add(key.removeprefix(prefix))
            database.delValue(key)


@cache
def _library() -> ctypes.CDLL:
    """Return PETSc's C library, for functions that petsc4py does not provide."""
    return ctypes.CDLL(PETSc.__file__)


def _require_success(error: int) -> None:
    """Raise ``PETSc.Error`` if the return value of a PETSc function is an error code."""
    if error:
        raise PETSc.Error(error)


def _is_read(key: str) -> bool:
    """Return whether PETSc has read an option in its database."""
    database = PETSc.Options()
    if hasattr(database, "used"):  # since petsc4py 3.23
        return bool(database.used(key))
    # PetscBool is an int, or a bool of one byte: then the other bytes remain zero (little-endian)
    found = ctypes.c_int(0)
    _require_success(_library().PetscOptionsUsed(None, key.encode(), ctypes.byref(found)))
    return bool(found.value)


def in_database(prefix: str) -> dict[str, str]:
    """Return the options in the database with a prefix, by name without the prefix.

    The result is empty for an empty prefix.
    """
    if not prefix:
        return {}
    everything = PETSc.Options().getAll()
    return {k[len(prefix) :]: v for k, v in everything.items() if k.startswith(prefix)}


class ProblemOptions:
    """PETSc options of a problem.

    Args:
        prefix: prefix of the options.
        given: the user's options, named without the prefix; the dictionary may be changed later.
            Options in the database take precedence.

    Attributes:
        prefix: prefix of the options.
        given: the user's options, named without the prefix.
        read: names of the options that PETSc has read in solves.
    """

    def __init__(self, prefix: str, given: Mapping[str, Any]):
        self.prefix = prefix
        self.given = given
        self.read: set[str] = set()

    def check(self) -> None:
        """Validate the user's options and those in the database under the prefix. Not collective.

        Raises:
            ValueError: for a prefix with a dash, names with a dash or the prefix, misspelled names
                of this package, a tolerance that is not positive, and options that cannot be used
                here.
        """
        prefix = self.prefix
        if prefix.startswith("-") or prefix != "".join(prefix.split()):
            raise ValueError(
                f"the prefix of PETSc options must be a word without dash, got {prefix!r}"
            )
        for key in self.given:
            if key.startswith("-") or (prefix and key.startswith(prefix)):
                short = key.lstrip("-").removeprefix(prefix)
                raise ValueError(
                    f"petsc_options: {key!r} must be given without dash and prefix, as {short!r}"
                )
        named = {f"petsc_options: {key}": (key, value) for key, value in self.given.items()}
        named |= {f"-{prefix}{key}": (key, value) for key, value in in_database(prefix).items()}
        for name, (key, value) in named.items():
            # before the search for misspelled names: snes_atol resembles snes_rtol
            for pattern, reason in _NOT_HERE.items():
                if re.fullmatch(pattern, key):
                    raise ValueError(f"{name} cannot be used: {reason}")
            near = get_close_matches(key, _OWN, n=1, cutoff=_NEARLY)
            if near and key not in _OWN:
                raise ValueError(f"{name}: there is no such option; did you mean {near[0]}?")
            if key == "snes_rtol":
                positive(value, name, text=True)
            if key == "snes_type":
                one_of(value, name, _SNES_TYPES)

    def value(self, name: str) -> str | None:
        """Return an option from the database or otherwise the user; None if it is not set."""
        database = PETSc.Options()
        if database.hasName(self.prefix + name):
            return str(database.getString(self.prefix + name))
        value = self.given.get(name)
        return None if value is None else str(value)

    def unread(self) -> str:
        """Return a warning about the user's options that PETSc has not read; "" if there are none.

        Options of components that a solve may not use, such as multigrid, are not reported.
        """
        known = {*_OWN, *self.read, *in_database(self.prefix)}
        names = [k for k in self.given if k not in known and not k.startswith(_PARTS)]
        reasons = "misspelled, or not an option of the solvers that were used; -help lists all"
        return f"PETSc has not read {', '.join(names)}: {reasons}" if names else ""

    def beside_newton(self) -> dict[str, str]:
        """Return the user's options except those of SNES.

        For the option ``linear_solver``, the value in the database takes precedence.
        """
        found = {k: str(v) for k, v in self.given.items() if not k.startswith("snes_")}
        kind = self.value("linear_solver")
        return found if kind is None else found | {"linear_solver": kind}


# -- errors, matrices, logging ---------------------------------------------------------------------


@contextmanager
def as_raised() -> Iterator[None]:
    """Context manager that reraises the original exception of a Python callback of PETSc.

    PETSc itself reports "error code -1". The PETSc objects of the failed call must not be used
    again, because their vectors may be locked.

    Raises:
        ValueError: if PETSc does not support a solver or the requested operation.
    """
    try:
        yield
    except PETSc.Error as error:
        cause: BaseException | None = error
        while isinstance(cause, PETSc.Error):
            cause = cause.__cause__
        if cause is not None:
            raise cause from cause.__cause__
        if error.ierr in _NO_SUCH_THING:
            raise ValueError(f"PETSc: {str(error).splitlines()[-1].partition('] ')[2]}") from error
        raise


def reasons_of(ksp: PETSc.KSP) -> str:
    """Return PETSc's names of the reasons for which KSP, PC and MUMPS stopped. Collective."""
    comm = ksp.comm.tompi4py()
    pc = ksp.getPC()
    words = [f"{ksp.getType()} with {pc.getType()}"]
    words.append(f"KSP {reason_name(PETSc.KSP.ConvergedReason, ksp.getConvergedReason())}")
    failed = max(comm.allgather(int(pc.getFailedReason())), key=abs)
    if failed != PETSc.PC.FailedReason.NOERROR:
        words.append(f"PC {reason_name(PETSc.PC.FailedReason, failed)}")
    if pc.getType() in ("lu", "cholesky"):
        words.append(str(pc.getFactorSolverType()))
        if pc.getFactorSolverType() == "mumps":
            info = [pc.getFactorMatrix().getMumpsInfog(i) for i in (1, 2)]
            if info[0] != 0:
                words[-1] += f" INFOG(1:2) = {info[0]}, {info[1]}"
    return ", ".join(words)


def reason_name(reasons: Any, value: int) -> str:
    """Return PETSc's name of a converged or diverged reason in a petsc4py class."""
    names = [k for k, v in vars(reasons).items() if v == value and not k.startswith("_")]
    return max(names, key=len, default=str(value))


def half_of(A: PETSc.Mat) -> PETSc.Mat:
    """Return the upper block triangle of a symmetric AIJ matrix, in SBAIJ format. Collective.

    Matrix-vector products take 0.4 to 0.65 times as long as with the AIJ matrix. The conversion
    takes as long as 20 to 35 products.
    """
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return A.convert("sbaij", PETSc.Mat())


def destroy(*objects: Any) -> None:
    """Destroy PETSc objects, or objects with a method ``destroy``; None is skipped. Collective."""
    for thing in objects:
        if thing is not None:
            thing.destroy()


def product(A: PETSc.Mat, values: Array, *, transposed: bool = False) -> Array:
    """Return the owned entries of A x or A^T x, where ``values`` begins with x. Collective."""
    x, y = reversed(A.createVecs()) if transposed else A.createVecs()
    x.array[:] = values[: x.getLocalSize()]
    (A.multTranspose if transposed else A.mult)(x, y)
    found: Array = y.array_r.copy()
    destroy(x, y)
    return found


def forget_product(A: PETSc.Mat) -> None:
    """Free the data that PETSc keeps to recompute the matrix product ``A``. Collective."""
    _require_success(_library().MatProductClear(ctypes.c_void_p(A.handle)))


def has_package(name: str) -> bool:
    """Return whether PETSc was built with a package such as ``hypre``."""
    return bool(PETSc.Sys.hasExternalPackage(name))


def require_real() -> None:
    """Raise ``RuntimeError`` if PETSc was built with complex scalars."""
    if not issubclass(PETSc.ScalarType, float):
        raise RuntimeError(
            "dolfinx_contact needs PETSc with real scalars, and this one has complex scalars. "
            "On Debian install python3-dolfinx-real and set PETSC_DIR to the real build."
        )


#: Context manager that logs time and flops as an event of ``-log_view``, named by its argument.
logged = PETSc.Log.Event


@contextmanager
def staged(name: str) -> Iterator[None]:
    """Context manager or decorator that logs a block or function as a ``-log_view`` stage."""
    stage = PETSc.Log.Stage(name)
    stage.push()
    try:
        yield
    finally:
        stage.pop()


# -- entries of matrices --------------------------------------------------------------------------


class Entries:
    """Repeated assembly of sparse matrix entries; duplicates are summed, also across ranks.

    Args:
        rows: global row numbers, shape (n,); entries with a negative row or column are omitted.
        columns: global column numbers, shape (n,).

    Attributes:
        number: number n of entries.
    """

    def __init__(self, rows: Ints, columns: Ints):
        self.number = len(rows)
        self._kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        i = rows[self._kept]
        j = columns[self._kept]
        width = int(j.max(initial=0)) + 1
        places = i * width + j
        #: Index of the sum to which each entry contributes; None if no entries are summed.
        self._sums: Ints | None = None
        if not np.all(places[1:] > places[:-1]):
            places, self._sums = np.unique(places, return_inverse=True)
            i, j = np.divmod(places, width)
        self._size = len(places)
        starts = np.flatnonzero(np.diff(i, prepend=-1))
        self._rows = i[starts].astype(PETSc.IntType)
        self._starts = np.append(starts, self._size).astype(PETSc.IntType)
        self._columns = j.astype(PETSc.IntType)

    def numbers(self, rows: int) -> Ints:
        """Return the number of distinct columns in each of the first ``rows`` rows."""
        return np.bincount(self._rows, weights=np.diff(self._starts), minlength=rows).astype(
            np.int64
        )

    def add(self, values: Array, A: PETSc.Mat) -> None:
        """Add values, in the order of rows and columns, to ``A`` and assemble it. Collective."""
        self.insert(values, A)
        A.assemble()

    def insert(self, values: Array, A: PETSc.Mat) -> None:
        """Add values to a matrix like `add`, without assembling the matrix. Not collective."""
        summed = values[self._kept]
        if self._sums is not None:
            sums = np.bincount(self._sums, weights=summed, minlength=self._size)
            summed = np.asarray(sums, dtype=np.float64)
        csr = self._starts, self._columns, summed
        A.setValuesIJV(*csr, addv=PETSc.InsertMode.ADD_VALUES, rowmap=self._rows)


def matrix_of(comm: MPI.Comm, shape: tuple[int, int], *entries: Entries) -> PETSc.Mat:
    """Return a zero matrix whose sparsity pattern contains the given entries. Collective.

    Args:
        comm: communicator.
        shape: numbers of rows and columns of this rank.
        entries: entries of the sparsity pattern.
    """
    A = PETSc.Mat().createAIJ(((shape[0], None), (shape[1], None)), comm=comm)
    if comm.size == 1:  # on several ranks, entries of other ranks are unknown
        numbers = sum([e.numbers(shape[0]) for e in entries])
        A.setPreallocationNNZ(np.minimum(numbers, shape[1]).astype(PETSc.IntType))
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    A.setUp()
    for e in entries:
        e.insert(np.zeros(e.number), A)
    A.assemble()
    A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    return A


def triplets(
    A: PETSc.Mat,
) -> tuple[Ints, Ints, Array]:
    """Return the global row, global column and value of each matrix entry of this rank."""
    indptr, columns, values = A.getValuesCSR()
    first, last = A.getOwnershipRange()
    rows = np.repeat(np.arange(first, last, dtype=np.int64), np.diff(indptr))
    return rows, columns.astype(np.int64), values


def stacked(blocks: Sequence[PETSc.Mat]) -> PETSc.Mat:
    """Stack matrices with the same columns on top of each other, in AIJ format. Collective."""
    nest = PETSc.Mat().createNest([[A] for A in blocks], comm=blocks[0].comm)
    whole = nest.convert("aij", PETSc.Mat())
    nest.destroy()
    return whole


def triplet_matrix(
    comm: MPI.Comm,
    shape: tuple[int, int],
    rows: Ints,
    columns: Ints,
    values: Array,
) -> PETSc.Mat:
    """Return the matrix with given entries; duplicates are summed, also across ranks. Collective.

    Args:
        comm: communicator.
        shape: numbers of rows and columns of this rank.
        rows: global row numbers; ``rows``, ``columns`` and ``values`` are broadcast to one shape.
        columns: global column numbers.
        values: values of the entries.
    """
    i, j, v = (a.reshape(-1) for a in np.broadcast_arrays(rows, columns, values))
    entries = Entries(i, j)
    A = matrix_of(comm, shape, entries)
    entries.add(v, A)
    return A


# -- factorisations -------------------------------------------------------------------------------
#: Options without entries in the database; ICNTL(14) is additional workspace in percent.
DEFAULTS: dict[str, Any] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 80,
}
BATCH = 128  # right-hand sides that are solved together
_TRIES = 4  # attempts at a factorisation, each with twice the workspace
#: INFOG(1) of MUMPS if workspace or buffers are too small (users' guide, section 8).
_NO_ROOM = (-8, -9, -14, -15, -17, -20)
_SYMMETRIC = 1e-12  # relative difference to the transpose that counts as round-off


class Factor:
    """Direct solver that factorises one matrix after another. All methods are collective.

    Args:
        comm: communicator.
        prefix: prefix of PETSc options.
        symmetric: whether the matrices are marked symmetric (`marked_symmetric`), which halves the
            work and provides the number of negative eigenvalues; default: False.
        determinant: whether the sign of the determinant is required; default: False.
        counted: whether MUMPS detects and counts zero pivots, as needed for singular matrices;
            default: False.
        columns: whether many right-hand sides are solved together; default: False.
        room: additional workspace of MUMPS in percent of its estimate.

    Attributes:
        ksp: linear solver, with the factorisation as preconditioner.
        defaults: options used unless the database contains other values.
    """

    def __init__(
        self,
        comm: Any,
        prefix: str,
        *,
        symmetric: bool = False,
        determinant: bool = False,
        counted: bool = False,
        columns: bool = False,
        room: int = DEFAULTS["mat_mumps_icntl_14"],
    ):
        self._prefix = prefix
        self.defaults = DEFAULTS | {"mat_mumps_icntl_14": room}
        if symmetric:
            self.defaults["pc_type"] = "cholesky"
        if counted:
            self.defaults["mat_mumps_icntl_24"] = 1
        if columns:
            self.defaults["mat_mumps_icntl_27"] = BATCH
        if determinant:
            self.defaults["mat_mumps_icntl_33"] = 1
        self.ksp = PETSc.KSP().create(comm)
        self.ksp.setOptionsPrefix(prefix)
        with self.options():
            self.ksp.setFromOptions()

    def options(self) -> AbstractContextManager[None]:
        """Context manager that puts the options of this solver into PETSc's database.

        It is used at every set-up, because MUMPS reads its options then.
        """
        return options_in_database(self._prefix, self.defaults)

    def factorise(self, A: PETSc.Mat) -> bool:
        """Factorise a matrix; return False if it is singular or has entries that are not finite.

        Entries are checked first, because MUMPS may crash on entries that are not finite.
        """
        if not np.isfinite(A.norm(PETSc.NormType.FROBENIUS)):
            return False
        self.ksp.setOperators(A)
        for _ in range(_TRIES):
            with self.options():
                self.ksp.setUp()
            if self.ksp.getPC().getFailedReason() == PETSc.PC.FailedReason.NOERROR:
                return True
            lacking = self._lacks_room()
            self.ksp.reset()  # MUMPS does not recover from a singular matrix
            if not lacking:
                return False
            self.defaults["mat_mumps_icntl_14"] *= 2
            self.ksp.setOperators(A)
        return False

    def _lacks_room(self) -> bool:
        """Return whether MUMPS ran out of workspace that can be increased. Collective."""
        if PETSc.Options().hasName(self._prefix + "mat_mumps_icntl_14"):
            return False
        pc = self.ksp.getPC()
        if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
            return False
        return pc.getFactorMatrix().getMumpsInfog(1) in _NO_ROOM

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b with the factorised matrix A; return whether this succeeded."""
        self.ksp.solve(b, x)
        return bool(self.ksp.getConvergedReason() > 0)

    def solve_columns(self, loads: Columns) -> PETSc.Mat:
        """Solve A X = B; return the dense matrix X, to be destroyed by the caller.

        Args:
            loads: owned rows of B as sparse columns, shape (n, k).
        """
        pc = self.ksp.getPC()
        factor = pc.getFactorMatrix()
        n, k = loads.shape
        comm = factor.comm
        X = PETSc.Mat().createDense(((n, None), (None, k)), comm=comm)
        X.setUp()
        X.assemble()
        # On one rank MUMPS exploits the zeros of a sparse right-hand side.
        if comm.size == 1 and pc.getFactorSolverType() == "mumps":
            index = PETSc.IntType
            csr = loads.indptr.astype(index), loads.indices.astype(index), loads.data
            rows = PETSc.Mat().createAIJ((k, n), csr=csr, comm=comm)
            B = PETSc.Mat().createTranspose(rows)
            rows.destroy()
        else:
            B = PETSc.Mat().createDense(((n, None), (None, k)), comm=comm)
            B.setUp()
            B.getDenseArray()[:] = np.asarray(loads.todense())
            B.assemble()
        factor.matSolve(B, X)
        B.destroy()
        return X

    @property
    def determinant_sign(self) -> float:
        """Sign of the determinant of the factorised matrix, from MUMPS."""
        return float(np.sign(self.ksp.getPC().getFactorMatrix().getMumpsRinfog(12)))

    @property
    def inertia(self) -> tuple[int, int, int]:
        """Numbers of negative, zero and positive eigenvalues of the factorised symmetric matrix."""
        negative, zero, positive = self.ksp.getPC().getFactorMatrix().getInertia()
        return int(negative), int(zero), int(positive)

    @property
    def is_symmetric(self) -> bool:
        """Whether the factorised matrix is treated as symmetric."""
        return bool(self.ksp.getPC().getType() == "cholesky")

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.ksp.destroy()


def is_symmetric(A: PETSc.Mat) -> bool:
    """Return whether a matrix is symmetric up to round-off. Collective.

    PETSc's own test considers only the rows of each rank and may be wrong for few rows.
    """
    size = A.norm(PETSc.NormType.NORM_INFINITY)
    off = A.transpose(PETSc.Mat())
    off.axpy(-1.0, A, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    largest = off.norm(PETSc.NormType.NORM_INFINITY)
    off.destroy()
    return bool(largest <= _SYMMETRIC * size)


def marked_symmetric(A: PETSc.Mat) -> bool:
    """Mark a matrix as symmetric if it is symmetric; return whether it is. Collective."""
    symmetric = is_symmetric(A)
    if symmetric:
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return symmetric
