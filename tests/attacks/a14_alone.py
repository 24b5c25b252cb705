"""The checker copied to a folder of its own, where nothing but Python and numpy may be imported.

It has to import nothing else from outside of the standard library, give the same words and exit
status as ``python3 -m dolfinx_contact check``, and name the hash of the data, which is that of
`ReducedProblem`.
"""

import os
import shutil
import subprocess
import sys

from a14_tampered import CHECKER, on_root, several

_MODULES = """
import runpy, sys
sys.argv = ["check_proof.py", {proof!r}]
status = None
try:
    runpy.run_path({checker!r}, run_name="__main__")
except SystemExit as end:
    status = end.code
known = {{*sys.stdlib_module_names, "sitecustomize"}}
tops = {{name.partition(".")[0] for name in sys.modules}}
print("OUTSIDE", sorted(t for t in tops if t not in known and not t.startswith("_")), status)
"""


def tried(folder):
    proof = several().certificate
    proof.save(folder / "proof.npz")
    copied = shutil.copy(CHECKER, folder / "alone.py")
    # No variable of MPI or Python: a child of mpirun is a process of its own.
    clean = ("PATH", "HOME", "LC_ALL", "XDG_CACHE_HOME")
    env = {k: os.environ[k] for k in clean if k in os.environ}
    code = _MODULES.format(proof=str(folder / "proof.npz"), checker=str(copied))
    options = dict(capture_output=True, text=True, timeout=100, cwd=folder)
    alone = subprocess.run([sys.executable, "-I", "-c", code], env=env, **options)
    env["PYTHONPATH"] = str(CHECKER.parents[2])
    env["OMPI_ALLOW_RUN_AS_ROOT"] = env["OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"] = "1"
    command = [sys.executable, "-m", "dolfinx_contact", "check", "proof.npz"]
    package = subprocess.run(command, env=env, **options)
    return alone.stdout, alone.stderr, package.stdout, package.returncode, proof.problem.digest


def attack(case):
    alone, error, package, status, digest = on_root(case, tried)
    said, _, outside = alone.partition("OUTSIDE")
    case.true(f"numpy alone is imported, {outside} {error}", outside.strip() == "['numpy'] 0")
    case.true("both ways say the same", said.strip() == package.strip() and status == 0)
    case.true("the hash of the data is printed", digest in said)
    case.true("it says that the mesh is not part of the proof", "mesh" in said)
