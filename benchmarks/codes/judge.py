# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is wrong with an answer: computed from displacements and forces alone, by numpy and scipy.

It shares no code with this package nor with any of the codes. The forces on the body at the contact
nodes are r = K u - f, with a stiffness that is assembled here (P1, or Q1 with two Gauss points an
edge) and loads that are integrated here; or those that a code gives, and then r is what they are
compared with. With L the largest displacement, and F the largest force at a node, of a load, a
support or contact,

    held          |u - prescribed| / L
    equilibrium   |K u - f - contact forces| / F where the displacement is not prescribed
    penetration   max(-un, 0) / L
    cone          max(-rn, |rt| - mu max(rn, 0), 0) / F
    complementarity   min(max(un, 0) / L, max(rn, 0) / F)
    slip          min(|w| / L, |rt + mu rn w/|w|| / F), w the slip of the step

each at the worst node and step: 0 for a solution. Of a motion they are, over its largest
displacement, ``penetration``, ``path``, by which the mean displacement is off its closed form, and
``rest``, what is left of displacements at the end, where all are 0. ``closed`` is a problem's ratio
of forces over its closed form, less 1; ``half_width`` and ``peak`` are those over Hertz', less 1:
twice the root of the second moment of the normal forces, which is the half width of a half
ellipse, and the largest force by area. The gap between two bodies is that of the nodes of the first
over the faces of the second, at the place below before anything moves. A point is closed with more
than 1e-5 F, and slips if it moves by more than 1e-3 L.

    python3 benchmarks/codes/judge.py problem.npz answer.npz
"""

from __future__ import annotations

import json
import sys

import numpy as np
from scipy.sparse import coo_matrix

FIGURES = ("held", "equilibrium", "penetration", "cone", "complementarity", "slip")
#: Of the largest displacement, by which a point moves that is said to slip.
_MOVES = 1e-3
#: Of the largest force, from which on a point carries one that is said to be closed.
_CARRIES = 1e-5
_CORNERS = {
    2: np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]),
    3: np.array([(x, y, z) for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]),
}


def elasticity(E, nu, dim):
    """Stress by strain (xx, yy, [zz,] then gamma_xy, [gamma_yz, gamma_xz])."""
    lame, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    size = dim * (dim + 1) // 2
    D = np.zeros((size, size))
    D[:dim, :dim] = lame
    D += np.diag([2 * mu] * dim + [mu] * (size - dim))
    return D


def shapes(kind):
    """Values (g, k), derivatives (g, dim, k) of the shape functions and weights at Gauss points."""
    if kind == "tri3":
        return np.full((1, 3), 1 / 3), np.array([[[-1.0, 1, 0], [-1, 0, 1]]]), np.array([0.5])
    corners = _CORNERS[{"quad4": 2, "hex8": 3}[kind]]
    points = corners / np.sqrt(3)
    factors = (1 + points[:, None] * corners) / 2  # (g, k, dim)
    values = factors.prod(axis=2)
    slopes = [
        corners[:, d] / 2 * np.delete(factors, d, axis=2).prod(axis=2)
        for d in range(corners.shape[1])
    ]
    return values, np.stack(slopes, axis=1), np.ones(len(points))


def assembled(x, cells, kind, E, nu, body_force, times=()):
    """Stiffness (n dim, n dim), and the nodal forces of the body force (n, dim).

    ``times``: Young's moduli of the cells over E, if they differ (c,).
    """
    dim = x.shape[1]
    values, slopes, weights = shapes(kind)
    D = elasticity(E, nu, dim)
    c, k = cells.shape
    stiffness = np.zeros((c, dim * k, dim * k))
    force = np.zeros_like(x)
    factor = np.asarray(times) if len(times) else np.ones(c)
    for value, slope, weight in zip(values, slopes, weights, strict=True):
        J = np.einsum("dk,cke->cde", slope, x[cells])
        size = weight * np.abs(np.linalg.det(J))
        g = np.linalg.solve(J, np.broadcast_to(slope, (c, dim, k)))
        B = np.zeros((c, len(D), dim * k))
        for d in range(dim):
            B[:, d, d::dim] = g[:, d]
        for row, (i, j) in enumerate([(0, 1), (1, 2), (0, 2)][: len(D) - dim], start=dim):
            B[:, row, i::dim] = g[:, j]
            B[:, row, j::dim] = g[:, i]
        stiffness += np.einsum("cri,rs,csj,c->cij", B, D, B, size * factor, optimize=True)
        np.add.at(force, cells, np.einsum("c,k,d->ckd", size, value, body_force))
    dofs = (dim * cells[:, :, None] + np.arange(dim)).reshape(c, -1)
    rows, columns = (np.broadcast_to(d, stiffness.shape) for d in (dofs[:, :, None], dofs[:, None]))
    entries = (stiffness.reshape(-1), (rows.reshape(-1), columns.reshape(-1)))
    return coo_matrix(entries, shape=(x.size, x.size)).tocsr(), force


def surface_loads(x, faces, tractions):
    """Nodal forces (n, dim) of tractions (f, dim) that are constant on segments or flat quads."""
    force = np.zeros_like(x)
    if faces.shape[1] == 2:
        size = np.linalg.norm(x[faces[:, 1]] - x[faces[:, 0]], axis=1)
        np.add.at(force, faces, 0.5 * (size[:, None] * tractions)[:, None])
        return force
    for value, slope, weight in zip(*shapes("quad4"), strict=True):
        edges = np.einsum("dk,fke->fde", slope, x[faces])
        size = weight * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        np.add.at(force, faces, np.einsum("f,k,fd->fkd", size, value, tractions))
    return force


def jumps(problem, u):
    """Displacement of the contact nodes over what is opposite (m, dim), and gaps at rest (m,)."""
    x, nodes = problem["x"], problem["contact"]
    gap = (x[nodes] - problem["point"]) @ problem["normal"]
    faces = problem["master_faces"]
    if not len(faces):
        return u[nodes], gap
    start, end = x[faces[:, 0]], x[faces[:, 1]]
    along = end - start
    at = ((x[nodes][:, None] - start) * along).sum(axis=2) / (along**2).sum(axis=1)
    face = np.abs(np.clip(at, 0, 1) - at).argmin(axis=1)
    at = at[np.arange(len(nodes)), face][:, None]
    opposite = (1 - at) * u[faces[face, 0]] + at * u[faces[face, 1]]
    below = (1 - at) * start[face] + at * end[face]
    return u[nodes] - opposite, (x[nodes] - below) @ problem["normal"]


def at_nodes(jump, before, gap, force, normal, mu, length, scale):
    """The four figures of the contact law at every node of one step, by name."""
    un = gap + jump @ normal
    rn = force @ normal
    rt = force - rn[:, None] * normal
    slip = jump - before
    slip = slip - (slip @ normal)[:, None] * normal
    size = np.linalg.norm(slip, axis=1)
    opposed = rt + (mu * rn)[:, None] * slip / np.maximum(size, 1e-300)[:, None]
    over = np.linalg.norm(rt, axis=1) - mu * np.maximum(rn, 0)
    return {
        "penetration": np.maximum(-un, 0) / length,
        "cone": np.maximum(np.maximum(-rn, over), 0) / scale,
        "complementarity": np.minimum(np.maximum(un, 0) / length, np.maximum(rn, 0) / scale),
        "slip": np.minimum(size / length, np.linalg.norm(opposed, axis=1) / scale),
    }


def judged_motion(p, u):
    """The figures of a motion on a rigid plane; its mean is by volume."""
    x, nodes = p["x"], p["contact"]
    length = np.abs(u).max()
    gap = (x[nodes] - p["point"]) @ p["normal"] + u[:, nodes] @ p["normal"]
    _, share = assembled(x, p["cells"], str(p["kind"]), p["E"], p["nu"], np.array([0.0, 1.0]))
    mean = u[:, :, 1] @ share[:, 1] / share[:, 1].sum()
    figures = {
        "penetration": np.maximum(-gap, 0).max() / length,
        "path": np.abs(mean - p["path"]).max() / length,
        "rest": np.abs(u[-1]).max() / length,
    }
    return {name: float(value) for name, value in figures.items()}


def by_hertz(x, force, area, hertz):
    """Half width and peak of normal forces at places along a line, over Hertz', less 1."""
    force = np.maximum(force, 0)
    middle = x @ force / force.sum()
    width = 2 * np.sqrt((x - middle) ** 2 @ force / force.sum())
    peak = (force / area).max()
    return {"half_width": float(width / hertz[0] - 1), "peak": float(peak / hertz[1] - 1)}


def judged(problem, u, forces=None):
    """The figures of an answer.

    Args:
        problem: arrays by the names of `problems.Problem`.
        u: displacements (s, n, dim).
        forces: on the body at its contact nodes (s, m, dim), if a code gives them.

    Returns:
        Figures by name, and statuses: how many contact nodes are open, stick and slip at the end.
    """
    p = dict(problem)
    u = np.asarray(u, float)
    if u.shape != (len(p["values"]), *p["x"].shape) or not np.isfinite(u).all():
        raise ValueError(f"displacements of shape {u.shape} do not fit, or are not numbers")
    if p["density"]:
        return judged_motion(p, u)
    x, nodes, normal = p["x"], p["contact"], p["normal"]
    kind = str(p["kind"])
    K, weight = assembled(x, p["cells"], kind, p["E"], p["nu"], p["body_force"], p["times"])
    free = np.ones(x.size, bool)
    free[p["held"]] = False
    for of_contact in (nodes, np.unique(p["master_faces"]).astype(int)):
        free.reshape(x.shape)[of_contact] = False
    worst = dict.fromkeys(FIGURES, 0.0)
    before = np.zeros((len(nodes), x.shape[1]))
    for s, now in enumerate(u):
        load = weight + surface_loads(x, p["faces"], p["tractions"][s][p["tags"]])
        r = (K @ now.reshape(-1)).reshape(x.shape) - load
        force = r[nodes] if forces is None else np.asarray(forces[s], float)
        length = np.abs(now).max()
        scale = max(np.linalg.norm(a, axis=1).max() for a in (r, load, force))
        jump, gap = jumps(p, now)
        law = at_nodes(jump, before, gap, force, normal, p["mu"], length, scale)
        found = {name: values.max() for name, values in law.items()}
        held = now.reshape(-1)[p["held"]] - p["values"][s]
        found["held"] = np.abs(held).max(initial=0) / length
        left = np.abs(r.reshape(-1)[free]).max(initial=0)
        found["equilibrium"] = max(left, np.abs(r[nodes] - force).max()) / scale
        worst = {name: max(worst[name], float(found[name])) for name in FIGURES}
        slip, before = jump - before, jump
    tangential = np.linalg.norm(slip - (slip @ normal)[:, None] * normal, axis=1)
    closed = force @ normal > _CARRIES * scale
    slips = closed & (tangential > _MOVES * length)
    counts = {"open": ~closed, "stick": closed & ~slips, "slip": slips}
    total = force.sum(axis=0)
    worst["statuses"] = {name: int(where.sum()) for name, where in counts.items()}
    worst["force"] = [float(f) for f in total]
    if len(p["hertz"]):
        worst |= by_hertz(x[nodes, 0], force @ normal, p["area"], p["hertz"])
    if p["closed"]:
        worst["closed"] = float(-total[0] / total[1] / p["closed"] - 1)
    return worst


def solved(problem, record):
    """The problem that a code says it has solved: with another friction than asked for, or none."""
    if "mu" not in record:
        return problem
    return dict(problem) | {"mu": record["mu"], "closed": 0.0}


def main(problem, answer):
    with np.load(problem) as given, np.load(answer) as found:
        record = {"record": json.loads(str(found["record"]))}
        try:
            forces = found.get("forces")
            record["figures"] = judged(solved(given, record["record"]), found["u"], forces)
        except ValueError as error:
            record["error"] = str(error)
    print(json.dumps(record, indent=1))


if __name__ == "__main__":
    main(*sys.argv[1:])
