# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kratos: its ContactStructuralMechanicsApplication, mortar with an augmented Lagrangian.

The rigid plane is a layer of cells, all of whose nodes are held. Faces with a held node are none of
the slave's: Kratos' matrix is singular otherwise.

Settings: ``criterion``, ``tolerance``, ``absolute`` and ``iterations`` of Newton's method; ``type``
and ``solver``, its contact settings; ``contact``, parameters of the contact process;
``increments`` of every step (1).
"""

from __future__ import annotations

import json
import os
import tempfile
from importlib.metadata import version

import KratosMultiphysics as Kratos
import KratosMultiphysics.ConstitutiveLawsApplication
import KratosMultiphysics.ContactStructuralMechanicsApplication
import KratosMultiphysics.LinearSolversApplication
import KratosMultiphysics.StructuralMechanicsApplication as Structural
import numpy as np
from answers import processor_time, run
from KratosMultiphysics.StructuralMechanicsApplication import structural_mechanics_analysis
from problems import plane_cells

ELEMENTS = {
    "tri3": "SmallDisplacementElement2D3N",
    "quad4": "SmallDisplacementElement2D4N",
    "hex8": "SmallDisplacementElement3D8N",
}
#: Those of bodies that slide far; this law's energy is that of "log".
FAR = {"quad4": "TotalLagrangianElement2D4N"}
HYPERELASTIC = "HyperElasticPlaneStrain2DLaw"
LAWS = {2: "LinearElasticPlaneStrain2DLaw", 3: "LinearElastic3DLaw"}
FACES = {2: "LineCondition2D2N", 3: "SurfaceCondition3D4N"}
LOADS = {2: "PointLoadCondition2D1N", 3: "PointLoadCondition3D1N"}


def block(name, lines):
    return [f"Begin {name}", *lines, f"End {name.split()[0]}", ""]


def listed(x):
    return [str(n) for n in np.unique(x)]


def part(name, nodes, elements=(), conditions=()):
    inside = block("SubModelPartNodes", listed(nodes))
    inside += block("SubModelPartElements", [str(e) for e in elements])
    inside += block("SubModelPartConditions", [str(c) for c in conditions])
    return block(f"SubModelPart {name}", inside)


def numbered(rows, first):
    return [f"{i} 0 " + " ".join(str(n) for n in row) for i, row in enumerate(rows, start=first)]


def written(p, path):
    """Write the mesh; nodes that are held altogether are in the part "Plane"."""
    x, cells = p.x, [p.cells]
    slave = p.contact_faces[np.isin(p.contact_faces, p.contact).all(axis=1)]
    master = p.master_faces
    plane = np.zeros(0, int)
    if not len(master):
        below, layer, master = plane_cells(p)
        plane = np.arange(len(x), len(x) + len(below))
        x, cells, master = np.vstack([x, below]), [*cells, plane[layer]], plane[master]
    loaded = np.flatnonzero(np.abs(p.loads).sum(axis=(0, 2)))
    lines = block("Properties 0", []) + block("Properties 1", [])  # of conditions
    rows = [f"{i} " + " ".join(repr(float(v)) for v in (*r, 0)[:3]) for i, r in enumerate(x, 1)]
    lines += block("Nodes", rows)
    count = 0
    for some in cells:
        kind = {3: "tri3", 4: "quad4", 8: "hex8"}[some.shape[1]]
        elements = FAR if p.law else ELEMENTS
        lines += block(f"Elements {elements[kind]}", numbered(some + 1, count + 1))
        count += len(some)
    faces = np.concatenate([slave, master])
    lines += block(f"Conditions {FACES[p.dim]}", numbered(faces + 1, 1))
    lines += block(f"Conditions {LOADS[p.dim]}", numbered(loaded[:, None] + 1, len(faces) + 1))
    for number, (_, some) in enumerate(p.materials, start=1):
        inside = [*(some + 1), *([] if number > 1 else range(len(p.cells) + 1, count + 1))]
        nodes = np.concatenate([p.cells[some].reshape(-1), [] if number > 1 else plane]).astype(int)
        lines += part(f"Body{number}", nodes + 1, inside)
    lines += part("Plane", plane + 1)
    numbers = np.arange(1, len(faces) + 1)
    lines += part("Slave", slave + 1, conditions=numbers[: len(slave)])
    lines += part("Master", master + 1, conditions=numbers[len(slave) :])
    lines += part(
        "Loads", loaded + 1, conditions=range(len(faces) + 1, len(faces) + len(loaded) + 1)
    )
    with open(path, "w") as file:
        file.write("\n".join(lines) + "\n")


def parameters(p, settings):
    """The project's parameters and its materials, as JSON has them."""
    tolerances = {}
    for name in ("displacement", "residual"):
        tolerances[f"{name}_relative_tolerance"] = settings["tolerance"]
        tolerances[f"{name}_absolute_tolerance"] = settings["absolute"]
    project = {
        "problem_data": {
            "problem_name": "job", "parallel_type": "OpenMP", "echo_level": 0,
            "start_time": 0.0, "end_time": p.steps * settings.get("increments", 1) - 0.5,
        },
        "solver_settings": {
            "solver_type": "Static", "model_part_name": "Structure", "domain_size": p.dim,
            "echo_level": 0, "analysis_type": "non_linear",
            "model_import_settings": {"input_type": "mdpa", "input_filename": "job"},
            "material_import_settings": {"materials_filename": "materials.json"},
            "convergence_criterion": settings["criterion"], "max_iteration": settings["iterations"],
            "time_stepping": {"time_step": 1.0}, **tolerances,
            "contact_settings": {"mortar_type": settings["type"], **settings["solver"]},
        },
        "processes": {
            "contact_process_list": [{
                "python_module": "alm_contact_process",
                "kratos_module": "KratosMultiphysics.ContactStructuralMechanicsApplication",
                "process_name": "ALMContactProcess",
                "Parameters": {
                    "model_part_name": "Structure",
                    "contact_model_part": {"0": ["Slave", "Master"]},
                    "assume_master_slave": {"0": ["Slave"]},
                    "friction_coefficients": {"0": p.mu},
                    "contact_type": "Frictional", **settings["contact"],
                },
            }],
        },
    }  # fmt: skip
    if p.density:
        project["problem_data"]["end_time"] = p.dt * (p.steps - 0.5)
        solver = project["solver_settings"]
        solver["time_stepping"]["time_step"] = p.dt
        solver |= {
            "solver_type": "Dynamic",
            "time_integration_method": "implicit",
            "scheme_type": "bossak",
        }
    bodies = []
    for number, (young, _) in enumerate(p.materials, start=1):
        values = {"YOUNG_MODULUS": young, "POISSON_RATIO": p.nu, "DENSITY": p.density or 1.0}
        material = {
            "constitutive_law": {"name": HYPERELASTIC if p.law else LAWS[p.dim]},
            "Variables": values,
            "Tables": {},
        }  # fmt: skip
        bodies.append(
            {
                "model_part_name": f"Structure.Body{number}",
                "properties_id": number,
                "Material": material,
            }
        )
    return project, {"properties": bodies}


def data_of(p, step, part):
    """Prescribed displacements and nodal loads when a part of a step is done."""
    if part == 1:
        return p.values[step], p.loads[step]
    before = (p.values[step - 1], p.loads[step - 1]) if step else (0.0, 0.0)
    now = p.values[step], p.loads[step]
    return [(1 - part) * old + part * new for old, new in zip(before, now, strict=True)]


class Analysis(structural_mechanics_analysis.StructuralMechanicsAnalysis):
    """An analysis that puts in the data of every step and takes out what there is after it."""

    def __init__(self, model, project, p, increments):
        super().__init__(model, project)
        self.increments = increments
        self.p, self.found, self.iterations, self.good = p, [], 0, []

    def ApplyBoundaryConditions(self):
        super().ApplyBoundaryConditions()
        p, structure = self.p, self.model["Structure"]
        s, part = divmod(len(self.good), self.increments)
        values, loads = data_of(p, s, (part + 1) / self.increments)
        components = [Kratos.DISPLACEMENT_X, Kratos.DISPLACEMENT_Y, Kratos.DISPLACEMENT_Z]
        for dof, value in zip(p.held, values, strict=True):
            node = structure.GetNode(int(dof // p.dim) + 1)
            node.Fix(components[dof % p.dim])
            node.SetSolutionStepValue(components[dof % p.dim], float(value))
        for node in self.model["Structure.Plane"].Nodes:
            for component in components:
                node.Fix(component)
        for n in np.flatnonzero(np.abs(loads).sum(axis=1)):
            load = [*map(float, loads[n]), 0.0][:3]
            structure.GetNode(int(n) + 1).SetSolutionStepValue(Structural.POINT_LOAD, load)

    def RunSolutionLoop(self):
        while self.KeepAdvancingSolutionLoop() and len(self.found) < self.p.steps:
            self.time = self._AdvanceTime()
            self.InitializeSolutionStep()
            self._GetSolver().Predict()
            self.good.append(bool(self._GetSolver().SolveSolutionStep()))
            self.FinalizeSolutionStep()
            structure = self.model["Structure"]
            self.iterations += structure.ProcessInfo[Kratos.NL_ITERATION_NUMBER]
            u = [
                list(structure.GetNode(i + 1).GetSolutionStepValue(Kratos.DISPLACEMENT))[
                    : self.p.dim
                ]
                for i in range(len(self.p.x))
            ]
            if len(self.good) % self.increments == 0:
                self.found.append(u)


def solve(p, settings):
    Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
    project, materials = parameters(p, settings)
    here = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            written(p, "job.mdpa")
            with open("materials.json", "w") as file:
                json.dump(materials, file)
            begun = processor_time()
            analysis = Analysis(
                Kratos.Model(), Kratos.Parameters(json.dumps(project)), p,
                settings.get("increments", 1),
            )  # fmt: skip
            analysis.Run()
            seconds = processor_time() - begun
        finally:
            os.chdir(here)
    good = all(analysis.good)
    record = {
        "version": version("KratosContactStructuralMechanicsApplication"),
        "says": "converged" if good else "did not converge",
        "converged": good,
        "steps": int(np.all(np.reshape(analysis.good, (p.steps, -1)), axis=1).sum()),
        "iterations": int(analysis.iterations),
        "seconds": seconds,
    }
    if p.law:
        record["law"] = "log"
    return np.array(analysis.found), None, record


if __name__ == "__main__":
    run(solve)
