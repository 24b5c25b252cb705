# SPDX-License-Identifier: LGPL-3.0-or-later
"""Akantu: its coupled solid and contact models, linear penalty with friction, static.

The rigid plane is a layer of cells, all of whose nodes are held.

Settings: ``normal`` and ``tangential``, penalties over Young's modulus by the largest side of the
body; ``tolerance`` and ``iterations`` of Newton's method; ``increments`` of every step.
"""

from __future__ import annotations

import os
import tempfile
from importlib.metadata import version
from pathlib import Path

import akantu as aka
import numpy as np
from answers import processor_time, run
from problems import plane_cells

#: Numbers of gmsh's cells by their numbers of nodes, in the space and on its boundary.
CELLS = {2: {3: 2, 4: 3}, 3: {8: 5}}
FACES = {2: 1, 3: 3}


def written(p, folder):
    """Write the mesh, in gmsh's format 2.2; nodes of the plane are returned."""
    x, cells, master = p.x, [p.cells], p.master_faces
    plane = np.zeros(0, int)
    if not len(master):
        below, layer, faces = plane_cells(p)
        plane = np.arange(len(x), len(x) + len(below))
        x, cells, master = np.vstack([x, below]), [*cells, plane[layer]], plane[faces]
    x = np.hstack([x, np.zeros((len(x), 3 - p.dim))])
    rows = []
    groups = [(some, CELLS[p.dim][some.shape[1]], 1) for some in cells]
    groups += [(p.contact_faces, FACES[p.dim], 2), (master, FACES[p.dim], 3)]
    for some, kind, tag in groups:
        rows += [f"{kind} 2 {tag} {tag} " + " ".join(map(str, row + 1)) for row in some]
    names = [f'{p.dim} 1 "body"', f'{p.dim - 1} 2 "slave"', f'{p.dim - 1} 3 "master"']
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "3", *names]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(x))]
    lines += [f"{i} " + " ".join(repr(float(v)) for v in row) for i, row in enumerate(x, 1)]
    lines += ["$EndNodes", "$Elements", str(len(rows))]
    lines += [f"{i} {row}" for i, row in enumerate(rows, 1)]
    (folder / "job.msh").write_text("\n".join([*lines, "$EndElements"]) + "\n")
    return plane


def material(p, settings):
    """The text of the material file."""
    slope = float(p.E / np.ptp(p.x, axis=0).max())
    deformable = "true" if len(p.master_faces) else "false"
    return f"""
material elastic [
  name = body
  rho = 1.0
  E = {p.E!r}
  nu = {p.nu!r}
]
contact_detector [
  type = explicit
  master = master
  slave = slave
  projection_tolerance = 1e-10
  max_iterations = 100
  extension_tolerance = 1e-5
]
contact_resolution penalty_linear [
  name = master
  mu = {p.mu!r}
  epsilon_n = {slope * settings["normal"]!r}
  epsilon_t = {slope * settings["tangential"]!r}
  is_master_deformable = {deformable}
]
"""


def solve(p, settings):
    if p.density:
        raise NotImplementedError("the driver has states of rest alone")
    here = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            return _solved(p, settings, Path(folder))
        finally:
            os.chdir(here)


def _solved(p, settings, folder):
    plane = written(p, folder)
    (folder / "material.dat").write_text(material(p, settings))
    begun = processor_time()
    aka.parseInput("material.dat")
    mesh = aka.Mesh(p.dim)
    mesh.read("job.msh")
    coupler = aka.CouplerSolidContact(mesh)
    solid = coupler.getSolidMechanicsModel()
    contact = coupler.getContactMechanicsModel()
    coupler.initFull(_analysis_method=aka._static)
    contact.getContactDetector().setSurfaceSelector(aka.PhysicalSurfaceSelector(mesh))
    blocked = solid.getBlockedDOFs()
    blocked[p.held // p.dim, p.held % p.dim] = True
    blocked[plane] = True
    solver = coupler.getNonLinearSolver()
    solver.set("max_iterations", settings["iterations"])
    solver.set("threshold", settings["tolerance"])
    solver.set("convergence_type", aka.SolveConvergenceCriteria.residual)
    found = []
    iterations = 0
    says = "converged"
    old, load = np.zeros(len(p.held)), np.zeros_like(p.x)
    for step in range(p.steps):
        for part in np.arange(1, settings["increments"] + 1) / settings["increments"]:
            u, force = solid.getDisplacement(), solid.getExternalForce()
            u[p.held // p.dim, p.held % p.dim] = old + part * (p.values[step] - old)
            force[: len(p.x)] = load + part * (p.loads[step] - load)
            try:
                coupler.solveStep()
            except Exception as error:  # Akantu's has no name in Python; its words are the record
                says = str(error).split(" : ")[-1].split(" [")[0]
            iterations += int(solver.getInt("nb_iterations"))
        old, load = p.values[step], p.loads[step]
        found.append(np.array(solid.getDisplacement())[: len(p.x)])
    record = {
        "version": version("akantu"),
        "says": says,
        "converged": says == "converged",
        "iterations": iterations,
        "seconds": processor_time() - begun,
    }
    return np.array(found), None, record


if __name__ == "__main__":
    run(solve)
