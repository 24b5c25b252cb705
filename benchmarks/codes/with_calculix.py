# SPDX-License-Identifier: LGPL-3.0-or-later
"""CalculiX: an input deck for ccx, and what it prints.

A plane problem is a layer of cells of the third dimension, held in it: its two faces move alike.
The rigid plane is one large cell, all of whose nodes are held. Displacements have the seven digits
that ccx prints.

Settings: ``type``, of the contact pair; ``stiffness``, the slope of pressure over penetration over
Young's modulus by the largest side of the body (None: none is given, and mortar contact is hard);
``stick``, the stick slope over that of the pressure, or without one over Young's modulus
by the largest side; ``increment``, the first one of a step of length 1; ``controls``, lines for the
deck.
"""

from __future__ import annotations

import re
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from answers import debian_version, processor_time, run

#: Faces of cells by the places of their nodes, numbered as CalculiX does.
FACES = {
    "C3D8": [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)],
    "C3D6": [(0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
}
PER_LINE = 8


class Layer:
    """The nodes, cells and faces that ccx is given; a layer of a plane body."""

    def __init__(self, p):
        self.plane = p.dim == 2
        self.kind = "C3D6" if p.kind == "tri3" else "C3D8"
        self.x, self.cells = p.x, p.cells
        self.thickness = 1.0
        self._nodes = len(p.x)
        if self.plane:
            edges = p.x[p.cells[:, 1]] - p.x[p.cells[:, 0]]
            self.thickness = float(np.linalg.norm(edges, axis=1).mean())
            flat = np.zeros((len(p.x), 1))
            behind, front = np.hstack([p.x, flat]), np.hstack([p.x, flat + self.thickness])
            self.x = np.vstack([behind, front])
            self.cells = np.hstack([p.cells, p.cells + len(p.x)])

    def copies(self, nodes):
        """Nodes of the layer that are copies of nodes (copies, n)."""
        nodes = np.asarray(nodes)
        return np.stack([nodes, nodes + self._nodes]) if self.plane else nodes[None]

    def surface(self, faces):
        """Lines (cell, face) of faces that are given by their nodes in the problem."""
        wanted = {frozenset(int(n) for n in self.copies(f).reshape(-1)) for f in faces}
        lines = []
        for number, cell in enumerate(self.cells, start=1):
            for side, places in enumerate(FACES[self.kind], start=1):
                if frozenset(int(cell[i]) for i in places) in wanted:
                    lines.append(f"{number}, S{side}")
        if len(lines) != len(faces):
            raise ValueError("not all faces are those of cells")
        return lines


def plane_cell(p, layer):
    """Corners (8, 3) of a cell whose first face is the obstacle, seen from the body."""
    normal, point = np.zeros(3), np.zeros(3)
    normal[: p.dim], point[: p.dim] = p.normal, p.point
    first = np.array([normal[1], -normal[0], 0.0])
    if not first.any():
        first = np.array([1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    middle = layer.x[layer.copies(p.contact).reshape(-1)].mean(axis=0)
    middle -= ((middle - point) @ normal) * normal
    half = 2 * np.ptp(layer.x, axis=0).max()
    around = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    face = np.array([middle + half * (a * first + b * second) for a, b in around])
    return np.vstack([face - half * normal, face])


def joined(items):
    """Lines of several items each."""
    items = [str(i) for i in items]
    return [", ".join(items[i : i + PER_LINE]) for i in range(0, len(items), PER_LINE)]


def interface(p, layer, settings):
    """Lines of the surface interaction."""
    slope = p.E / np.ptp(layer.x, axis=0).max()
    lines = ["*SURFACE INTERACTION, NAME=I"]
    if settings["stiffness"] is not None:
        slope *= settings["stiffness"]
        lines += ["*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{slope:.12g}"]
        if settings["type"] == "NODE TO SURFACE":
            lines[-1] += f", {p.E * settings['tension']:.12g}"
    if p.mu:
        lines += ["*FRICTION", f"{p.mu:.12g}, {slope * settings['stick']:.12g}"]
    return lines


def step(p, layer, settings, s):
    """Lines of a step."""
    far = ", NLGEOM" if p.law else ""
    lines = [f"*STEP, INC=10000{far}", "*STATIC", f"{settings['increment']:g}, 1., 1e-7, 1."]
    every = 100000
    if p.density:
        end = p.dt * p.steps
        lines[1:] = ["*DYNAMIC, DIRECT", f"{p.dt:.15g}, {end:.15g}"]
        every = 1
    lines += settings["controls"]
    lines.append("*BOUNDARY")
    for dof, value in zip(p.held, p.values[s], strict=True):
        component = dof % p.dim + 1
        for node in layer.copies([dof // p.dim]).reshape(-1):
            lines.append(f"{node + 1}, {component}, {component}, {value:.12g}")
    forces = []
    share = layer.thickness / (2 if layer.plane else 1)
    for node, k in np.argwhere(p.loads[s]):
        for copy in layer.copies([node]).reshape(-1):
            forces.append(f"{copy + 1}, {k + 1}, {p.loads[s][node, k] * share:.12g}")
    if forces:
        lines += ["*CLOAD, OP=NEW", *forces]
    return [*lines, f"*NODE PRINT, NSET=BODY, FREQUENCY={every}", "U", "*END STEP"]


def elastic(p, young):
    """Lines of the material; the energy of its neo-Hookean law is that of "iso1"."""
    if not p.law:
        return ["*ELASTIC", f"{young:.12g}, {p.nu:.12g}"]
    shear, bulk = young / (2 * (1 + p.nu)), young / (3 * (1 - 2 * p.nu))
    return ["*HYPERELASTIC, NEO HOOKE", f"{shear / 2:.12g}, {2 / bulk:.12g}"]


def deck(p, layer, settings):
    """All lines of the input."""

    def listed(numbers, rows):
        return [
            f"{n}, " + ", ".join(f"{v:.12g}" for v in row)
            for n, row in zip(numbers, rows, strict=True)
        ]

    nodes = layer.x
    cells = layer.cells + 1
    lines = ["*NODE, NSET=BODY", *listed(range(1, len(nodes) + 1), nodes)]
    lines += [f"*ELEMENT, TYPE={layer.kind}, ELSET=E"]
    lines += [f"{i}, " + ", ".join(map(str, c)) for i, c in enumerate(cells, start=1)]
    held = []
    if len(p.master_faces):
        master = layer.surface(p.master_faces)
    else:
        corners = np.arange(len(nodes) + 1, len(nodes) + 9)
        lines += ["*NODE, NSET=PLANE", *listed(corners, plane_cell(p, layer))]
        number = len(cells) + 1
        lines += ["*ELEMENT, TYPE=C3D8, ELSET=E", f"{number}, " + ", ".join(map(str, corners))]
        master = [f"{number}, S2"]
        held = ["PLANE, 1, 3"]
    for part, (young, some) in enumerate(p.materials):
        numbers = [*(some + 1), *([] if part or len(p.master_faces) else [len(cells) + 1])]
        lines += [f"*ELSET, ELSET=E{part}", *joined(numbers)]
        lines += [f"*MATERIAL, NAME=M{part}", *elastic(p, young)]
        lines += ["*DENSITY", f"{p.density:.12g}"] if p.density else []
        lines += [f"*SOLID SECTION, ELSET=E{part}, MATERIAL=M{part}"]
    lines += ["*SURFACE, NAME=SLAVE", *layer.surface(p.contact_faces)]
    lines += ["*SURFACE, NAME=MASTER", *master]
    small = ", SMALL SLIDING" if settings["type"] == "NODE TO SURFACE" else ""
    lines += interface(p, layer, settings)
    lines += [f"*CONTACT PAIR, INTERACTION=I, TYPE={settings['type']}{small}", "SLAVE, MASTER"]
    if layer.plane:
        held.append("BODY, 3, 3")
    if held:
        lines += ["*BOUNDARY", *held]
    for s in range(1 if p.density else p.steps):
        lines += step(p, layer, settings, s)
    return "\n".join(lines) + "\n"


def displacements(text, p, layer):
    """What is printed of all steps (s, n, dim), as many as there are."""
    rows = re.findall(r"^ +(\d+) +(\S+) +(\S+) +(\S+)$", text, re.M)
    values = np.array([[float(v) for v in row[1:]] for row in rows]).reshape(-1, len(layer.x), 3)
    return values[:, layer.copies(np.arange(len(p.x)))].mean(axis=1)[..., : p.dim]


def solve(p, settings):
    layer = Layer(p)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "job.inp").write_text(deck(p, layer, settings))
        begun = processor_time()
        ended = subprocess.run(
            ["ccx", "-i", "job"], cwd=folder, capture_output=True, text=True, check=False
        )
        seconds = processor_time() - begun
        status = (Path(folder) / "job.sta").read_text()
        u = displacements((Path(folder) / "job.dat").read_text(), p, layer)
    counts = [line.split() for line in status.splitlines() if re.match(r" +\d", line)]
    good = ended.returncode == 0 and "Job finished" in ended.stdout
    stopped = "stopped"
    if ended.returncode < 0:
        stopped += f" by {signal.Signals(-ended.returncode).name}"
    error = re.search(r"\*ERROR[^\n]*(?:\n[^\n]+)?", ended.stdout)
    if len(u) != p.steps:
        good = False
        u = np.concatenate([u, np.full((p.steps - len(u), *p.x.shape), np.nan)])
    record = {
        "version": debian_version("calculix-ccx"),
        "steps": int(np.isfinite(u).all(axis=(1, 2)).sum()),
        "says": "Job finished" if good else " ".join((error[0] if error else stopped).split()),
        "converged": good,
        "iterations": sum(int(c[3]) for c in counts),
        "seconds": seconds,
    }
    if p.law:
        record["law"] = "iso1"
    return u, None, record


if __name__ == "__main__":
    run(solve)
