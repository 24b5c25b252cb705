# SPDX-License-Identifier: LGPL-3.0-or-later
"""GetFEM's continuation of the two problems of `branches_vs_getfem.py`, in a process of its own.

`GetFEM` starts this file as a program and talks to it by lines of JSON. So its solvers and those of
PETSc do not meet in one process, every wait can have a limit, and what GetFEM prints goes nowhere.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

#: Of the continuation, as far as the two problems have them in common. GetFEM needs a cosine this
#: close to 1 to notice kinks: with its default (0.9) it steps over them.
OPTIONS = {
    "lsolver": "mumps", "h_init": 5e-3, "h_max": 0.1, "h_min": 5e-7, "h_dec": 0.35,
    "max_iter": 5, "thr_iter": 4, "min_cos": 1 - 1e-5, "singularities": 2, "nb_dir": 40,
}  # fmt: skip


class GetFEM:
    """The other side: a problem in GetFEM, followed step by step.

    Args:
        problem: ``"triangle"`` or ``"block"``.
        parameters: of `triangle` or `block` below.
    """

    def __init__(self, problem, **parameters):
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self._rest = b""
        self.size = self.ask("make", problem=problem, **parameters)

    def ask(self, what, limit=None, **parameters):
        """The answer to a command.

        Raises:
            TimeoutError: if it takes longer than ``limit`` seconds; its first argument is the time
                of the processor that it took. The process has ended then.
        """
        before = self._cpu()
        line = json.dumps({"do": what, **parameters}) + "\n"
        self._process.stdin.write(line.encode())
        end = None if limit is None else time.monotonic() + limit
        while b"\n" not in self._rest:
            left = None if end is None else max(end - time.monotonic(), 0.0)
            if not select.select([self._process.stdout], [], [], left)[0]:
                spent = self._cpu() - before
                self._process.kill()
                raise TimeoutError(spent)
            more = os.read(self._process.stdout.fileno(), 1 << 16)
            if not more:
                raise RuntimeError(f"GetFEM has ended in {what}")
            self._rest += more
        line, self._rest = self._rest.split(b"\n", 1)
        answer = json.loads(line)
        if "error" in answer:
            raise RuntimeError(f"GetFEM: {answer['error']}")
        return answer

    def _cpu(self):
        """Seconds of the processor that the process has taken."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def close(self):
        """End the process."""
        self._process.stdin.close()
        self._process.kill()
        self._process.wait()


# -- the process -----------------------------------------------------------------------------------


class _Side:
    def make(self, problem, **parameters):
        # GetFEM's objects do not keep one another alive.
        self.md, self.contact, self.traction, self._kept = globals()[problem](**parameters)
        return {"dofs": self.md.nbdof(), "contact_nodes": len(self.contact[0])}

    def solve(self, gammas, tolerance):
        """Newton's method at one gamma after the other."""
        begun = time.perf_counter()
        iterations = 0
        for gamma in gammas:
            self._put(gamma)
            more, converged = self.md.solve("max_res", tolerance, "max_iter", 100)
            if not converged:
                raise RuntimeError(f"Newton's method fails at gamma = {gamma}")
            iterations += more
        self.gamma = gammas[-1]
        self.X = self.md.from_variables()
        return {"iterations": int(iterations), "seconds": time.perf_counter() - begun}

    def begin(self, sense, **options):
        import getfem as gf

        given = [v for pair in {**OPTIONS, **options}.items() for v in pair]
        names = ("gamma", "t0", "t1", "tc")
        self.S = gf.ContStruct(self.md, *names, 1.0 / self.md.nbdof(), "non-smooth", *given)
        start = self.S.init_Moore_Penrose_continuation(self.X, self.gamma, sense)
        self.tx, self.tg, self.h = start
        return {}

    def step(self):
        """One step, whatever it is that GetFEM does in it."""
        wall = time.perf_counter()
        cpu = time.process_time()
        found = self.S.Moore_Penrose_continuation(self.X, self.gamma, self.tx, self.tg, self.h)
        wall = time.perf_counter() - wall
        cpu = time.process_time() - cpu
        self.X, self.gamma, self.tx, self.tg, self.h, taken, label = found
        self.gamma = float(self.gamma)
        record = {"wall": wall, "cpu": cpu, "gamma": self.gamma, "h": float(taken)}
        record |= {"label": label, "failed": not self.h > 0}
        if "bifurcation" in label:
            _, gamma, _, rates = self.S.sing_data()
            record |= {"at": float(gamma), "tangents": int(np.size(rates))}
        return record

    def statuses(self):
        """Statuses of the contact nodes, left to right."""
        self.md.to_variables(self.X)
        ut = self.md.variable("u")[self.contact[0]]
        ln = self.md.variable("lambda_n")
        lt = self.md.variable("lambda_t")
        size = max(abs(ln).max(), abs(lt).max(), 1e-300)
        friction = float(self.md.variable("F")[0])
        closed = ln < -1e-8 * size
        stuck = abs(lt) < -friction * ln - 1e-8 * size
        letters = np.where(closed, np.where(stuck, "k", np.where(ut > 0, "+", "-")), "o")
        return {"status": "".join(letters), "sum_rn": float(-ln.sum()), "sum_rt": float(lt.sum())}

    def _put(self, gamma):
        t0, t1 = self.traction
        self.md.set_variable("gamma", [gamma])
        self.md.set_variable("tc", (1 - gamma) * t0 + gamma * t1)


def _contact(md, mfu, region, dirichlet, friction, r):
    """Nodal contact with the floor y = 0 at the nodes of a region that are not clamped."""
    import getfem as gf

    dofs = mfu.basic_dof_on_region(region).reshape(-1, 2)
    dofs = dofs[~np.isin(dofs[:, 0], mfu.basic_dof_on_region(dirichlet))]
    places = mfu.basic_dof_nodes(dofs[:, 0])
    order = np.argsort(places[0])
    dofs = dofs[order]
    heights = places[1][order]
    count = len(dofs)
    BN, BT = (gf.Spmat("empty", count, mfu.nbdof()) for _ in range(2))
    for i, (x, y) in enumerate(dofs):
        BN.add(i, int(y), -1.0)
        BT.add(i, int(x), 1.0)
    md.add_variable("lambda_n", count)
    md.add_variable("lambda_t", count)
    md.add_initialized_data("r", [r])
    md.add_initialized_data("F", [friction])
    md.add_initialized_data("gap", heights)
    md.add_initialized_data("alpha", np.ones(count))
    names = ("u", "lambda_n", "lambda_t", "r", BN, BT, "F", "gap", "alpha")
    md.add_basic_contact_brick(*names, 1)
    return dofs[:, 0], dofs[:, 1]


def triangle(n, friction, lame, start, end, r):
    """The linear triangle, under the traction (1 - gamma) start + gamma end."""
    import getfem as gf

    h = 1.0 / n
    cells = []
    for j in range(n):
        for i in range(n - j):
            cells.append([[i, i + 1, i], [j, j, j + 1]])
            if i + j < n - 1:
                cells.append([[i + 1, i + 1, i], [j, j + 1, j + 1]])
    m = gf.Mesh("empty", 2)
    points = np.asfortranarray(np.transpose(h * np.array(cells), (1, 2, 0)))
    m.add_convex(gf.GeoTrans("GT_PK(2,1)"), points)
    faces = m.outer_faces()
    normals = m.normal_of_faces(faces)
    m.set_region(1, faces[:, (normals[0] > 0.5) & (normals[1] > 0.5)])
    m.set_region(2, faces[:, normals[1] < -1 + 1e-7])
    m.set_region(3, faces[:, normals[0] < -1 + 1e-7])
    mfu = gf.MeshFem(m, 2)
    mim = gf.MeshIm(m, gf.Integ("IM_TRIANGLE(2)"))
    mfu.set_fem(gf.Fem("FEM_PK(2,1)"))
    md = gf.Model("real")
    md.add_fem_variable("u", mfu)
    md.add_initialized_data("lambda", [lame[0]])
    md.add_initialized_data("mu", [lame[1]])
    md.add_isotropic_linearized_elasticity_brick(mim, "u", "lambda", "mu")
    md.add_Dirichlet_condition_with_multipliers(mim, "u", mfu, 1)
    md.add_initialized_data("gamma", [0.0])
    for name, value in (("t0", start), ("t1", end), ("tc", start)):
        md.add_initialized_data(name, list(value))
    md.add_source_term_brick(mim, "u", "tc", 3)
    contact = _contact(md, mfu, 2, 1, friction, r)
    return md, contact, (np.array(start), np.array(end)), (m, mfu, mim)


def block(nx, ny, friction, r):
    """The block of Ciarlet and Geymonat's material, under -gamma (2, 0.12 (20 - x))."""
    import getfem as gf

    m = gf.Mesh("cartesian", np.linspace(0, 40, nx + 1), np.linspace(0, 80, ny + 1))
    faces = m.outer_faces()
    normals = m.normal_of_faces(faces)
    m.set_region(1, faces[:, normals[1] > 0.5])
    m.set_region(2, faces[:, normals[1] < -0.5])
    m.set_region(3, faces[:, np.abs(normals[0]) > 0.5])
    mfu = gf.MeshFem(m, 2)
    mim = gf.MeshIm(m, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,4)"))
    mfu.set_fem(gf.Fem("FEM_QK(2,1)"))
    md = gf.Model("real")
    md.add_fem_variable("u", mfu)
    md.add_initialized_data("law", [4000.0, 120.0, 30.0])
    md.add_finite_strain_elasticity_brick(mim, "Ciarlet Geymonat", "u", "law")
    md.add_Dirichlet_condition_with_multipliers(mim, "u", mfu, 1)
    x = mfu.basic_dof_nodes()[0]
    last = np.where(np.arange(len(x)) % 2 == 0, -2.0, -0.12 * (20.0 - x))
    md.add_initialized_data("gamma", [0.0])
    for name, value in (("t0", 0 * last), ("t1", last), ("tc", 0 * last)):
        md.add_initialized_fem_data(name, mfu, value)
    md.add_source_term_brick(mim, "u", "tc", 3)
    contact = _contact(md, mfu, 2, 1, friction, r)
    return md, contact, (0 * last, last), (m, mfu, mim)


def main():
    """Answer commands until there are no more."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    side = _Side()
    for line in sys.stdin:
        command = json.loads(line)
        try:
            answer = getattr(side, command.pop("do"))(**command)
        except Exception as error:  # whatever it is, it is the answer
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
