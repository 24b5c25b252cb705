# SPDX-License-Identifier: LGPL-3.0-or-later
"""sfepy: its term of the IPC Toolkit's barriers, dw_contact_ipc, and its line search for it.

sfepy has no term of friction between bodies: it solves the problems without, and its record says
so. The rigid plane is a layer of cells, all of whose nodes are held. Barriers take no distance of
0: where there is contact at rest the other side (the plane, or the lower body) is put lower by
``start``. sfepy's schemes of motion do not know that line search: Newmark's is written here, with
its terms of mass.

Settings: ``barrier``, the distance at which barriers begin, and ``start``, over L, the largest side
of the body (of both); ``stiffness`` of the barriers over E L^(dim-4), 0: the IPC Toolkit adapts
it; ``project``, its projection of their Hessians; ``tolerance``, of residuals over E L^(dim-1) or
their first, and ``iterations`` of Newton's method; ``increments`` of every step at rest;
``newmark``, beta and gamma.
"""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
from answers import processor_time, run
from problems import cell_sizes, plane_cells
from sfepy.base.base import IndexedStruct, output
from sfepy.discrete import (
    Equation,
    Equations,
    FieldVariable,
    Function,
    Functions,
    Integrals,
    Material,
    Materials,
    Problem,
    Variables,
)
from sfepy.discrete.conditions import Conditions, EssentialBC
from sfepy.discrete.fem import FEDomain, Field, Mesh
from sfepy.mechanics.matcoefs import stiffness_from_youngpoisson
from sfepy.solvers.auto_fallback import AutoDirect
from sfepy.solvers.nls import Newton, apply_line_search_ipc

CELLS = {"tri3": "2_3", "quad4": "2_4", "hex8": "3_8"}


def size_of(p):
    return np.ptp(p.x, axis=0).max()


def geometry(p, settings):
    """Nodes, cells, which nodes the surfaces have, and which the plane."""
    x, cells = p.x.copy(), p.cells
    down = settings["start"] * size_of(p) * p.normal * (p.gaps.min() <= 0)
    if len(p.master_faces):
        lower = np.unique(p.master_faces)
        while True:  # all of the body below
            more = np.unique(cells[np.isin(cells, lower).any(axis=1)])
            if len(more) == len(lower):
                break
            lower = more
        x[lower] -= down
        surfaces = np.union1d(p.contact_faces, p.master_faces)
        return x, cells, surfaces, np.zeros(0, int)
    below, layer, faces = plane_cells(p)
    if p.kind == "tri3":
        layer = np.concatenate([layer[:, [0, 1, 2]], layer[:, [0, 2, 3]]])
    plane = np.arange(len(x), len(x) + len(below))
    surfaces = np.union1d(p.contact_faces, plane[faces])
    return np.vstack([x, below - down]), np.vstack([cells, plane[layer]]), surfaces, plane


class Body:
    """sfepy's problem, and the data of a step that it reads."""

    def __init__(self, p, settings):
        self.p = p
        x, cells, surfaces, plane = geometry(p, settings)
        mesh = Mesh.from_data("job", x, None, [cells], [np.zeros(len(cells), int)], [CELLS[p.kind]])
        self.domain = FEDomain("domain", mesh)
        self.omega = self.domain.create_region("Omega", "all")
        self.field = Field.from_args("displacement", np.float64, "vector", self.omega, 1)
        self.u = FieldVariable("u", "unknown", self.field)
        self.v = FieldVariable("v", "test", self.field, primary_var_name="u")
        self.values = np.zeros(len(p.held))
        self.load = np.zeros_like(p.x)
        self.status = IndexedStruct()
        self.problem = Problem(
            "job", equations=Equations([self._equation(surfaces, len(cells), settings)])
        )
        self.problem.set_bcs(ebcs=Conditions(self._held(plane)))
        tolerance = settings["tolerance"]
        newton = {
            "i_max": settings["iterations"], "eps_a": tolerance * p.E * size_of(p) ** (p.dim - 1),
            "eps_r": tolerance, "eps_mode": "or", "macheps": 1e-16, "lin_red": None,
            "line_search_fun": apply_line_search_ipc, "ls_red": 0.5, "ls_red_warp": 0.5,
            "ls_on": 1.0, "ls_min": 1e-5,
        }  # fmt: skip
        solver = Newton(newton, lin_solver=AutoDirect({}), status=self.status, context=self.problem)
        self.problem.set_solver(solver)

    def region(self, name, numbers, kind="vertex"):
        """A region of nodes, or of cells, by their numbers."""
        numbers = np.asarray(numbers, np.int32)
        select = Functions([Function(name, lambda coors, domain=None: numbers)])
        by = f"{'cells' if kind == 'cell' else 'vertices'} by {name}"
        return self.domain.create_region(name, by, kind, functions=select)

    def _equation(self, surfaces, count, settings):
        """Elasticity, barriers, nodal loads, and the mass of a motion."""
        p, size = self.p, size_of(self.p)
        # Barriers adapt to mass; at rest, in sfepy's example, E, the density and L are 1.
        mass = cell_sizes(p.x, p.cells, p.kind).sum() * (p.density or p.E / size**p.dim)
        barrier = {
            ".m": mass, ".k": settings["stiffness"] * p.E * size ** (p.dim - 4),
            ".d": settings["barrier"] * size, ".p": settings["project"],
        }  # fmt: skip
        materials = [
            Material("barrier", values=barrier), Material("load", function=self._loads),
        ]  # fmt: skip
        variables = [self.u, self.v]
        self.region("Contact", surfaces, "facet")
        self.region("Nodes", np.arange(len(p.x)))
        terms = """
            dw_contact_ipc.2.Contact(barrier.m, barrier.k, barrier.d, barrier.p, v, u)
            - dw_point_load.2.Nodes(load.val, v)"""
        for part, (young, some) in enumerate(p.materials):
            D = stiffness_from_youngpoisson(p.dim, young=young, poisson=p.nu, plane="strain")
            materials.append(Material(f"solid{part}", D=D))
            if not part:  # the plane's are of the first
                some = np.union1d(some, np.arange(len(p.cells), count))
            self.region(f"Part{part}", some, "cell")
            terms += f" + dw_lin_elastic.2.Part{part}(solid{part}.D, v, u)"
        if p.density:
            terms += """
            + dw_dot.2.Omega(inertia.rho, v, u) - dw_dot.2.Omega(inertia.rho, v, ahead)"""
            variables.append(FieldVariable("ahead", "parameter", self.field, primary_var_name="u"))
            rho = p.density / settings["newmark"][0] / p.dt**2
            materials.append(Material("inertia", rho=rho))
        return Equation.from_desc(
            "balance", terms + " = 0", Variables(variables), self.domain.regions,
            Materials(materials), Integrals(),
        )  # fmt: skip

    def _loads(self, ts, coors, mode=None, **kwargs):
        return {"val": self.load} if mode == "special" else None

    def _held(self, plane):
        conditions = []
        for k in range(self.p.dim):
            which = np.flatnonzero(self.p.held % self.p.dim == k)
            nodes = self.p.held[which] // self.p.dim
            order = which[np.argsort(nodes)]
            if len(which):
                prescribed = Function(
                    f"held{k}", lambda ts, coors, order=order, **kwargs: self.values[order]
                )
                region = self.region(f"Held{k}", nodes)
                conditions.append(EssentialBC(f"held{k}", region, {f"u.{k}": prescribed}))
        if len(plane):
            region = self.region("Plane", plane)
            conditions.append(EssentialBC("plane", region, {"u.all": 0.0}))
        return conditions

    def solved(self, u, **known):
        """Displacements of all nodes, begun with ``u`` of the same."""
        variables = self.problem.solve(
            state0=u.flatten(), save_results=False, var_data=known or None
        )
        return variables.get_state_parts()["u"].reshape(u.shape).copy()


def at_rest(p, body, u, increments):
    """Displacements at the end of every step, and statuses of all solves."""
    found, statuses = [], []
    old, load = np.zeros(len(p.held)), np.zeros_like(p.x)
    for step in range(p.steps):
        for part in np.arange(1, increments + 1) / increments:
            body.values = old + part * (p.values[step] - old)
            body.load = load + part * (p.loads[step] - load)
            u = body.solved(u)
            statuses.append((int(body.status["condition"]), int(body.status["n_iter"])))
        old, load = p.values[step], p.loads[step]
        found.append(u)
    return found, statuses


def moved(p, body, u, newmark):
    """The same of a motion, by Newmark's scheme."""
    beta, gamma = newmark
    found, statuses = [], []
    v, a = np.zeros_like(u), np.zeros_like(u)
    free = np.setdiff1d(np.arange(p.x.size), p.held)
    a[: len(p.x)] = p.body_force / p.density  # of a body that falls
    a.reshape(-1)[np.setdiff1d(np.arange(u.size), free)] = 0.0
    for step in range(p.steps):
        body.values, body.load = p.values[step], p.loads[step]
        ahead = u + p.dt * v + p.dt**2 * (0.5 - beta) * a
        u = body.solved(u, ahead=ahead.reshape(-1))
        old, a = a, (u - ahead) / (beta * p.dt**2)
        v = v + p.dt * ((1 - gamma) * old + gamma * a)
        statuses.append((int(body.status["condition"]), int(body.status["n_iter"])))
        found.append(u)
    return found, statuses


def solve(p, settings):
    output.set_output(quiet=True)
    begun = processor_time()
    body = Body(p, settings)
    u = np.zeros((body.field.n_nod, p.dim))
    if p.density:
        found, statuses = moved(p, body, u, settings["newmark"])
    else:
        found, statuses = at_rest(p, body, u, settings["increments"])
    good = not any(condition for condition, _ in statuses)
    record = {
        "version": f"{version('sfepy')}, ipctk {version('ipctk')}",
        "says": "converged" if good else "did not converge",
        "converged": good,
        "iterations": sum(count for _, count in statuses),
        "seconds": processor_time() - begun,
    }
    if p.mu:
        record["mu"] = 0.0
    return np.array(found)[:, : len(p.x)], None, record


if __name__ == "__main__":
    run(solve)
