"""Cases of the benchmarks with other steps, augmentation parameters, numberings and units.

Results must not depend on any of these.
"""

import sys
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np

import basix.ufl
import dolfinx.mesh
import ufl

from dolfinx_contact.continuation import StepControl

CASES = Path(__file__).resolve().parents[2] / "benchmarks" / "cases"
_FOLLOWERS = ("explore", "follow", "follower_for")
_MESHES = ("create_rectangle", "create_submesh")


@contextmanager
def varied(*, step_factor=None, r=None, seed=None, mm=None, MPa=None):
    """Context manager changing imported cases.

    Args:
        step_factor: factor of the step lengths.
        r: augmentation parameter.
        seed: seed of a random numbering of nodes and cells of the block and the triangle; serial.
        mm: millimetre in the units of the hyperelastic block.
        MPa: megapascal in the units of the hyperelastic block.
    """
    with ExitStack() as stack:
        found = []

        def put(module, name, change):
            if hasattr(module, name):
                found.append(name)
                changed = change(getattr(module, name))
                stack.enter_context(mock.patch.object(module, name, changed))

        # Also their common modules, which make the problems of some.
        files = {m: getattr(m, "__file__", None) for m in sys.modules.values()}
        modules = [m for m, file in files.items() if file and Path(file).resolve().parent == CASES]
        for module in modules:
            if r is not None:
                put(module, "ContactProblem", lambda f: partial(f, r=r))
            if step_factor is not None:
                for where in (module, getattr(module, "records", None)):
                    for name in _FOLLOWERS:
                        put(where, name, lambda f: partial(f, control=control(step_factor)))
            if seed is not None:
                put(module, "mesh", partial(Renumbering, seed))
        if mm is not None or MPa is not None:
            units = {"mm": mm or 1.0, "MPa": MPa or 1.0}
            put(sys.modules["cases.ciarlet_geymonat"], "block", lambda f: partial(f, **units))
        varies = any(v is not None for v in (step_factor, r, seed, mm, MPa))
        assert found or not varies, "nothing that a case uses was changed"
        yield


def control(factor):
    """The default step lengths times a factor, as far as that is allowed."""
    plain = StepControl()
    steps = (min(factor * h, 1.0) for h in (plain.initial, plain.maximum))
    return StepControl(**dict(zip(("initial", "maximum"), steps, strict=True)))


class Renumbering:
    """``dolfinx.mesh`` as a case sees it, with nodes and cells in a random order."""

    def __init__(self, seed, module):
        self._seed = seed
        self._module = module

    def __getattr__(self, name):
        made = getattr(self._module, name)
        return partial(self._make, made) if name in _MESHES else made

    def _make(self, create, *args, **kwargs):
        made = create(*args, **kwargs)
        return renumbered(made, self._seed) if hasattr(made, "geometry") else self._first(made)

    def _first(self, made):
        return renumbered(made[0], self._seed), *made[1:]


def renumbered(whole, seed):
    """The mesh with its nodes and cells in another order; DOLFINx's own undoes some of them."""
    assert whole.comm.size == 1
    x = whole.geometry.x[:, :2]
    cells = whole.geometry.dofmap.astype(np.int64)
    element = basix.ufl.element("Lagrange", whole.basix_cell().name, 1, shape=(2,))
    random = np.random.default_rng(seed)
    for _ in range(100):
        order = random.permutation(len(x))
        new = np.argsort(order)[cells][random.permutation(len(cells))]
        if new.shape[1] == 3:  # simplices may begin with any of their nodes
            new = random.permuted(new, axis=1)
        domain = dolfinx.mesh.create_mesh(whole.comm, cells=new, x=x[order], e=ufl.Mesh(element))
        if not np.allclose(domain.geometry.x[:, :2], x, atol=1e-9 * np.ptp(x)):
            return domain
    raise AssertionError("no other order was found")
