"""Changes of coming versions, tested on the installed ones: see docs/upstream.md."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

TREE = Path(__file__).resolve().parents[2]

SCRIPT = """
import sys
from mpi4py import MPI
import basix, ffcx.element_interface as interface, ffcx.ir.representation as representation
import numpy as np, ufl
rules = []
def create_quadrature(cellname, degree, rule, elements, create=interface.create_quadrature):
    if cellname == "tetrahedron" and 4 <= degree <= 8 and rule == "default":
        rules.append(degree)
        rule = sys.argv[1]
    return create(cellname, degree, rule, elements)
interface.create_quadrature = create_quadrature
for module in list(sys.modules.values()):
    if getattr(module, "__name__", "").startswith("ffcx") and hasattr(module, "create_quadrature"):
        module.create_quadrature = create_quadrature

from support.blocks import block
from dolfinx import fem
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import StVenantKirchhoff

found = []
for material in (None, StVenantKirchhoff(600.0, 400.0)):
    problem = block(n=2, cell="tet", degree=2, material=material, top=(0.02, 0.01, -0.06))
    found.append(problem.solve().resultants["contact"])
falling = block(n=1, cell="tet", degree=2, top=(0.0, 0.0, 0.0))
velocity = fem.Function(falling.V)
velocity.x.array[2::3] = -1.0
held = [bc.dof_indices()[0] for bc in falling.bcs]
velocity.x.array[np.concatenate(held)] = 0.0
steps = NSCD(falling, 7.0, dt=0.01, velocity=velocity, mass="consistent").run([0.0, 0.02]).steps
found.append(steps[-1].result.resultants["contact"])
print(*sorted(set(rules)))
print(*np.ravel(found).tolist())
"""


@pytest.mark.long
def test_quadrature_of_tetrahedra_is_pinned(tmp_path):
    """Basix after 0.11 has another default rule from degree 4 to 8."""
    forces = []
    for rule in ("Xiao-Gimbutas", "default"):
        env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / rule)}
        env["PYTHONPATH"] = os.pathsep.join([str(TREE), str(TREE / "tests")])
        command = [sys.executable, "-c", SCRIPT, rule]
        done = subprocess.run(command, capture_output=True, text=True, env=env)
        assert done.returncode == 0, done.stderr
        degrees, values = done.stdout.splitlines()
        assert "4" in degrees.split()  # else nothing was tried
        forces.append(np.array(values.split(), dtype=float).reshape(-1, 3))
    # Of polynomials: statics of a linear and of a quartic energy, and the mass of P2.
    assert np.abs(forces[0] - forces[1]).max() < 1e-9
