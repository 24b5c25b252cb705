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

each at the worst node and step: 0 for a solution. An answer in which one of them is no number is
refused. Of two bodies penetration and cone are those of the nodes of either face, and equilibrium
has what the faces together do to the bodies: their forces are opposite, in small displacements
their moments too, and no node carries a force that has nothing near it. Of a motion they are, over
its largest displacement, ``held``, ``penetration``, ``path``, by which the mean displacement is off
its closed form, and ``rest``, what is left of displacements at the end, where all are 0. ``closed``
is a problem's ratio of forces over its closed form, less 1; ``half_width`` and ``peak`` are those
over Hertz', less 1: twice the root of the second moment of the normal forces, which is the half
width of a half ellipse, and the largest force by area. The gap between two bodies is that of the
nodes of the first over the faces of the second, at the place below before anything moves. A point
is closed with more than 1e-5 F, and slips if it moves by more than 1e-3 L.

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
    if not len(problem["master_faces"]):
        return u[nodes], (x[nodes] - problem["point"]) @ problem["normal"]
    jump, gap, _ = over_faces(x, u, nodes, problem["master_faces"], problem["normal"])
    return jump, gap


def over_faces(x, u, nodes, faces, normal):
    """Displacements of nodes over faces (m, 2), gaps (m,), and whether a face is opposite (m,)."""
    start, end = x[faces[:, 0]], x[faces[:, 1]]
    along = end - start
    at = ((x[nodes][:, None] - start) * along).sum(axis=2) / (along**2).sum(axis=1)
    beyond = np.abs(np.clip(at, 0, 1) - at)
    face = beyond.argmin(axis=1)
    at = at[np.arange(len(nodes)), face][:, None]
    opposite = (1 - at) * u[faces[face, 0]] + at * u[faces[face, 1]]
    below = (1 - at) * start[face] + at * end[face]
    gap = (x[nodes] - below) @ normal
    return u[nodes] - opposite, gap, beyond.min(axis=1) < 1e-9


def unbalanced(at, force, unheld, nodes, others):
    """What of the forces on two faces is left (scalar).

    Args:
        at: places of all nodes (n, 2).
        force: on the bodies (n, 2).
        unheld: components that no support holds (n, 2).
        nodes, others: of the faces; those of the second carry nothing if all of the first are
            farther than twice the longest way from a node to the next.
    """
    carried = np.where(unheld, force, 0.0)
    both = np.union1d(nodes, others)
    far = distances(at[others], at[nodes]).min(axis=1)
    next_one = [np.sort(distances(at[f], at[f]), axis=1)[:, 1].max() for f in (nodes, others)]
    alone = carried[others][far > 2 * max(next_one)]
    return max(np.abs(carried[both].sum(axis=0)).max(), np.abs(alone).max(initial=0))


def turning(x, force, unheld, nodes, others, normal):
    """The moment of the forces of pressure on two faces over their size (scalar)."""
    both = np.union1d(nodes, others)
    pressing = (np.where(unheld, force, 0.0) @ normal)[both]
    along = x[both] @ tangent(normal)
    return abs((along - along.mean()) @ pressing) / np.ptp(along)


def tangent(normal):
    """Across the normal, in the plane (2,)."""
    return np.array([normal[1], -normal[0]])


def distances(a, b):
    """Of points (a, dim) from points (b, dim): (a, b)."""
    return np.linalg.norm(a[:, None] - b, axis=2)


def on_other_face(p, u, force, length, scale):
    """Penetration and cone of the nodes of the second of two bodies, at the worst."""
    nodes, normal = np.unique(p["master_faces"]), -p["normal"]
    jump, gap, opposite = over_faces(p["x"], u, nodes, p["contact_faces"], normal)
    law = at_nodes(jump, jump, gap, force[nodes], normal, p["mu"], length, scale)
    penetration = law["penetration"][opposite].max(initial=0)
    return {"penetration": penetration, "cone": law["cone"].max()}


def at_nodes(jump, before, gap, force, normal, mu, length, scale):
    """The four figures of the contact law at every node of one step, by name."""
    slip = jump - before
    slip = slip - (slip @ normal)[:, None] * normal
    normals = np.broadcast_to(normal, jump.shape)
    return by_gap_and_slip(gap + jump @ normal, slip, force, normals, mu, length, scale)


def by_gap_and_slip(un, slip, force, normal, mu, length, scale):
    """The same of gaps (m,), tangential slips (m, dim) and normals (m, dim)."""
    rn = (force * normal).sum(axis=1)
    rt = force - rn[:, None] * normal
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
    held = u.reshape(len(u), -1)[:, p["held"]] - p["values"]
    figures = {
        "held": np.abs(held).max(initial=0) / length,
        "penetration": np.maximum(-gap, 0).max() / length,
        "path": np.abs(mean - p["path"]).max() / length,
        "rest": np.abs(u[-1]).max() / length,
    }
    return numbers(figures)


def by_hertz(x, force, area, hertz):
    """Half width and peak of normal forces at places along a line, over Hertz', less 1."""
    force = np.maximum(force, 0)
    middle = x @ force / force.sum()
    width = 2 * np.sqrt((x - middle) ** 2 @ force / force.sum())
    peak = (force / area).max()
    return {"half_width": float(width / hertz[0] - 1), "peak": float(peak / hertz[1] - 1)}


def _iso(F, inverse, J, lmbda, mu):
    """mu/2 (J^(-2/3) I1 - 3), of a stress."""
    first = (F**2).sum(axis=(-2, -1)) + 1
    return mu * J ** (-2 / 3) * (F - (first / 3)[..., None, None] * inverse)


def _iso1(F, inverse, J, lmbda, mu):
    return _iso(F, inverse, J, lmbda, mu) + (lmbda + 2 * mu / 3) * (J - 1) * J * inverse


def _log(F, inverse, J, lmbda, mu):
    return mu * (F - inverse) + lmbda * np.log(J) * inverse


#: First Piola-Kirchhoff stresses in plane strain, of F, its inverse's transpose, det F and Lame's
#: coefficients; energies mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2 and
#: mu/2 (I1 - 3 - 2 ln J) + lambda/2 (ln J)^2.
LAWS = {"iso1": _iso1, "log": _log}


def internal_forces(p, u):
    """Nodal forces (n, 2) of hyperelastic bodies that are displaced by u (n, 2)."""
    x, cells = p["x"], p["cells"]
    young = p["E"] * (p["times"] if len(p["times"]) else np.ones(len(cells)))[:, None, None]
    lmbda, mu = young * p["nu"] / ((1 + p["nu"]) * (1 - 2 * p["nu"])), young / (2 * (1 + p["nu"]))
    force = np.zeros_like(x)
    _, slopes, weights = shapes(str(p["kind"]))
    for slope, weight in zip(slopes, weights, strict=True):
        jacobian = np.einsum("dk,cke->cde", slope, x[cells])
        g = np.linalg.solve(jacobian, np.broadcast_to(slope, (len(cells), *slope.shape)))
        F = np.eye(2) + np.einsum("cki,cjk->cij", u[cells], g)
        J = np.linalg.det(F)
        if J.min() <= 0:
            raise ValueError("a cell is turned inside out")
        inverse = np.linalg.inv(F).transpose(0, 2, 1)
        P = LAWS[str(p["law"])](F, inverse, J[:, None, None], lmbda, mu)
        size = weight * np.abs(np.linalg.det(jacobian))
        np.add.at(force, cells, np.einsum("c,cij,cjk->cki", size, P, g))
    return force


def nearest(x, faces, points):
    """Of points (m, 2) on faces (f, 2): the face, the share of its second node, the normal there.

    Normals point out of the body, and are those of faces, in the mean at nodes, linear between.
    """
    start, end = x[faces[:, 0]], x[faces[:, 1]]
    along = end - start
    normals = outward(x, faces)
    at = ((points[:, None] - start) * along).sum(axis=2) / (along**2).sum(axis=1)
    at = np.clip(at, 0, 1)
    away = np.linalg.norm(points[:, None] - start - at[..., None] * along, axis=2)
    face = away.argmin(axis=1)
    at = at[np.arange(len(points)), face]
    normal = mixed(normals, faces[face], at)
    return face, at, normal / np.linalg.norm(normal, axis=1)[:, None]


def outward(x, faces):
    """Unit normals (n, 2) at the nodes of faces (f, 2), their mean there; 0 elsewhere."""
    along = x[faces[:, 1]] - x[faces[:, 0]]
    normals = np.zeros_like(x)
    for column in faces.T:
        np.add.at(normals, column, np.stack([along[:, 1], -along[:, 0]], axis=1))
    return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]


def mixed(values, faces, at):
    """Of nodal values, those at shares of faces."""
    return (1 - at)[:, None] * values[faces[:, 0]] + at[:, None] * values[faces[:, 1]]


def judged_far(p, u):
    """The figures of bodies that slide far, of the steps that there are.

    Places and normals are those of the faces opposite where they are now (`nearest`), and the slip
    of a step is over the point there. ``pressed`` and ``slid`` are vertical and horizontal forces
    on the second body, by its supports: at the end of the press, and the mean of the slide. F is
    the largest force of all steps, since the bodies are apart to begin with. Of the second body's
    nodes tension alone is looked for, since its normals turn from face to face.
    """
    x, nodes, faces = p["x"], p["contact"], p["master_faces"]
    steps = int(np.isfinite(u).all(axis=(1, 2)).cumprod().sum())
    if not steps:
        raise ValueError("there are no displacements")
    unheld, free = free_of(p)
    others = np.unique(faces)
    loaded = np.unique(p["held"][np.abs(p["values"]).max(axis=0) > 0] // 2)
    worst = dict.fromkeys(FIGURES, 0.0)
    supports, before = [], np.zeros_like(x)
    all_forces = [internal_forces(p, now) for now in u[:steps]]
    scale = np.linalg.norm(all_forces, axis=2).max()
    for s, (now, r) in enumerate(zip(u, all_forces, strict=False)):
        force = r[nodes]
        length = np.abs(now).max()
        at = x + now
        face, share, normal = nearest(at, faces, at[nodes])
        gap = ((at[nodes] - mixed(at, faces[face], share)) * normal).sum(axis=1)
        slip = now[nodes] - before[nodes] - mixed(now - before, faces[face], share)
        slip -= (slip * normal).sum(axis=1)[:, None] * normal
        law = by_gap_and_slip(gap, slip, force, normal, p["mu"], length, scale)
        found = {name: values.max() for name, values in law.items()}
        held = now.reshape(-1)[p["held"]] - p["values"][s]
        found["held"] = np.abs(held).max() / length
        pulled = (np.where(unheld, r, 0.0) * outward(at, faces)).sum(axis=1)
        found["cone"] = max(found["cone"], pulled.max() / scale)
        left = unbalanced(at, r, unheld, nodes, others)
        found["equilibrium"] = max(np.abs(r[free]).max(), left) / scale
        worst = worse(worst, found)
        supports.append(r[loaded].sum(axis=0) * [1, -1])
        before = now
    closed = (force * normal).sum(axis=1) > _CARRIES * scale
    slips = closed & (np.linalg.norm(slip, axis=1) > _MOVES * length)
    counts = {"open": ~closed, "stick": closed & ~slips, "slip": slips}
    worst["statuses"] = {name: int(where.sum()) for name, where in counts.items()}
    worst["steps"] = steps
    press, *window = p["window"]
    if steps > press:
        worst["pressed"] = [float(f) for f in supports[press][::-1]]
    if len(window) and steps > window[1]:
        mean = np.mean(supports[window[0] : window[1] + 1], axis=0)
        worst["slid"] = [float(f) for f in mean[::-1]]
    return worst


def free_of(p):
    """Components that no support holds (n, dim), and those of them off the faces that may touch."""
    unheld = np.ones(p["x"].size, bool)
    unheld[p["held"]] = False
    unheld = unheld.reshape(p["x"].shape)
    free = unheld.copy()
    free[p["contact"]] = free[np.unique(p["master_faces"]).astype(int)] = False
    return unheld, free


def numbers(figures):
    """Figures by name as numbers, or ValueError if one is none: that compares with nothing."""
    found = {name: float(value) for name, value in figures.items()}
    wrong = [name for name, value in found.items() if not np.isfinite(value)]
    if wrong:
        raise ValueError(f"no number: {', '.join(wrong)}")
    return found


def worse(worst, found):
    """The larger of the figures of other steps and those of one."""
    found = numbers(found)
    return {name: max(worst[name], found[name]) for name in FIGURES}


def judged(problem, u, forces=None):
    """The figures of an answer.

    Args:
        problem: arrays by the names of `problems.Problem`.
        u: displacements (s, n, dim).
        forces: on the body at its contact nodes (s, m, dim), if a code gives them.

    Returns:
        Figures by name, and statuses: how many contact nodes are open, stick and slip at the end.

    Raises:
        ValueError: if displacements or forces do not fit, are no numbers, or are all zero.
    """
    p = dict(problem)
    u = np.asarray(u, float)
    fits = u.shape == (len(p["values"]), *p["x"].shape)
    if fits and str(p["law"]):
        return judged_far(p, u)
    if not fits or not np.isfinite(u).all():
        raise ValueError(f"displacements of shape {u.shape} do not fit, or are not numbers")
    if p["density"]:
        return judged_motion(p, u)
    if forces is not None:
        forces = np.asarray(forces, float)
        if forces.shape != u[:, p["contact"]].shape or not np.isfinite(forces).all():
            raise ValueError(f"forces of shape {forces.shape} do not fit, or are not numbers")
    return judged_near(p, u, forces)


def judged_near(p, u, forces):
    """The figures of linear bodies at rest, in small displacements."""
    x, nodes, normal = p["x"], p["contact"], p["normal"]
    kind = str(p["kind"])
    K, weight = assembled(x, p["cells"], kind, p["E"], p["nu"], p["body_force"], p["times"])
    unheld, free = free_of(p)
    worst = dict.fromkeys(FIGURES, 0.0)
    before = np.zeros((len(nodes), x.shape[1]))
    for s, now in enumerate(u):
        load = weight + surface_loads(x, p["faces"], p["tractions"][s][p["tags"]])
        r = (K @ now.reshape(-1)).reshape(x.shape) - load
        force = r[nodes] if forces is None else forces[s]
        length = np.abs(now).max()
        scale = max(np.linalg.norm(a, axis=1).max() for a in (r, load, force))
        if not (length and scale):
            raise ValueError("nothing moves, or no force is there")
        jump, gap = jumps(p, now)
        law = at_nodes(jump, before, gap, force, normal, p["mu"], length, scale)
        found = {name: values.max() for name, values in law.items()}
        held = now.reshape(-1)[p["held"]] - p["values"][s]
        found["held"] = np.abs(held).max(initial=0) / length
        left = [np.abs(r[free]).max(initial=0), np.abs(r[nodes] - force).max()]
        if len(p["master_faces"]):
            others = np.unique(p["master_faces"])
            left.append(unbalanced(x, r, unheld, nodes, others))
            left.append(turning(x, r, unheld, nodes, others, normal))
            below = on_other_face(p, now, r, length, scale)
            found |= {name: max(found[name], value) for name, value in below.items()}
        found["equilibrium"] = max(left) / scale
        worst = worse(worst, found)
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
    """The problem that a code says it has solved: without friction, or with another elastic law.

    Raises:
        ValueError: if it is another problem than these: an answer does not choose its judge.
    """
    law, mu = record.get("law"), record.get("mu")
    if law is not None:
        if not str(problem["law"]) or law not in LAWS:
            raise ValueError(f"the elastic law {law!r} is none of this problem")
        problem = dict(problem) | {"law": law}
    if mu is None:
        return problem
    if mu != 0:
        raise ValueError(f"it solved with the friction {mu!r}, neither the problem's nor none")
    return dict(problem) | {"mu": 0.0, "closed": 0.0}


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
