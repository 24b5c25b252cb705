# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problems in files that favour no code: arrays alone, read by numpy.

A linear elastic body (plane strain in 2D) of cells of one kind, in small displacements, with
Coulomb's friction at the nodes of a flat part of its boundary, against a rigid plane or another
body. It begins at rest without displacement, and goes through steps of prescribed displacements and
tractions; slips are those of a step. `Problem` tells what the arrays of a file are.

    python3 benchmarks/codes/problems.py output/codes
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path

import numpy as np

#: Coefficients of stiffness of Ligursky and Renard's triangle.
LAME = (100.0, 82.0)


@dataclass(frozen=True, eq=False)
class Problem:
    """What a file has; n nodes, c cells, f loaded faces, s steps, m contact nodes.

    Attributes:
        name: of the problem.
        kind: of the cells: tri3, quad4 (counter-clockwise) or hex8 (in VTK's order).
        x: nodes (n, dim).
        cells: nodes of cells (c, k).
        E, nu: Young's modulus, Poisson's ratio.
        body_force: by volume (dim,).
        faces: nodes of loaded faces (f, k).
        tags: of each, the row in ``tractions`` (f,).
        tractions: (s, tags, dim).
        held: degrees of freedom, dim * node + component, whose displacement is prescribed.
        values: of these (s, held).
        contact: nodes that may touch (m,), none of which is held.
        area: of the surface, that belongs to them (m,).
        normal: of the obstacle there, towards the body (dim,).
        point: of the obstacle (dim,).
        contact_faces: nodes of the faces that may touch, those with held nodes too.
        master_faces: nodes of the faces opposite; none: the obstacle is rigid.
        mu: coefficient of friction.
        loads: nodal forces of body force and tractions (s, n, dim), for codes that take these.
        closed: force along the first axis over that along the second, on the obstacle; 0 if there
            is no closed form.
        density: mass by volume; 0: the body goes through states of rest. A motion begins at rest.
        dt: length of the steps of a motion, whose ends are the times of ``values``.
        path: mean displacement along the second axis at these, exactly (s,); of a motion.
        times: Young's moduli of the cells over E (c,); none: all have E.
        hertz: half width and peak pressure of two plane bodies by Hertz; none: without these.
        law: of hyperelastic bodies that slide far in plane strain, by its name in `judge.LAWS`; "":
            linear elasticity and small displacements.
        window: steps of these whose forces are told: the end of the press, and first and last of
            the slide whose mean is taken.
    """

    name: str
    kind: str
    x: np.ndarray
    cells: np.ndarray
    E: float
    nu: float
    held: np.ndarray
    values: np.ndarray
    contact: np.ndarray
    area: np.ndarray
    normal: np.ndarray
    point: np.ndarray
    contact_faces: np.ndarray
    mu: float
    body_force: np.ndarray
    faces: np.ndarray
    tags: np.ndarray
    tractions: np.ndarray
    master_faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))
    loads: np.ndarray = field(default_factory=lambda: np.zeros(0))
    closed: float = 0.0
    density: float = 0.0
    dt: float = 0.0
    path: np.ndarray = field(default_factory=lambda: np.zeros(0))
    times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    hertz: np.ndarray = field(default_factory=lambda: np.zeros(0))
    law: str = ""
    window: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def __post_init__(self):
        if not self.loads.size:
            object.__setattr__(self, "loads", self._nodal_loads())

    @property
    def dim(self):
        return self.x.shape[1]

    @property
    def steps(self):
        return len(self.values)

    @property
    def materials(self):
        """Young's moduli, and the numbers of the cells that have them."""
        times = self.times if len(self.times) else np.ones(len(self.cells))
        return [(self.E * float(t), np.flatnonzero(times == t)) for t in np.unique(times)]

    @property
    def gaps(self):
        """Of the contact nodes over the plane, before anything moves (m,)."""
        return (self.x[self.contact] - self.point) @ self.normal

    def opposite(self):
        """What lies below the contact nodes at rest: nodes of faces (m, 2), and their shares.

        Of two plane bodies; there are none on a rigid plane (m, 0).
        """
        if not len(self.master_faces):
            nothing = np.zeros((len(self.contact), 0))
            return nothing.astype(int), nothing
        start, end = self.x[self.master_faces[:, 0]], self.x[self.master_faces[:, 1]]
        along = end - start
        over = self.x[self.contact][:, None] - start
        at = (over * along).sum(axis=2) / (along**2).sum(axis=1)
        face = np.abs(np.clip(at, 0, 1) - at).argmin(axis=1)
        at = at[np.arange(len(face)), face]
        return self.master_faces[face], np.stack([1 - at, at], axis=1)

    def _nodal_loads(self):
        """Equal shares of cells and faces: exact for simplices and parallelograms."""
        loads = np.zeros((self.steps, *self.x.shape))
        size = cell_sizes(self.x, self.cells, self.kind) / self.cells.shape[1]
        share = size[:, None] * self.body_force
        for column in self.cells.T:
            np.add.at(loads, (slice(None), column), share)
        if len(self.faces):
            area = face_areas(self.x, self.faces) / self.faces.shape[1]
            share = area[:, None] * self.tractions[:, self.tags]
            for column in self.faces.T:
                np.add.at(loads, (slice(None), column), share)
        return loads

    def save(self, folder):
        """Write the file; its path is returned."""
        path = Path(folder) / f"{self.name}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{f.name: getattr(self, f.name) for f in fields(self)})
        return path

    @staticmethod
    def load(path):
        """The problem of a file."""
        with np.load(path) as data:
            return Problem(**{k: data[k].item() if not data[k].ndim else data[k] for k in data})


def tangents(normal):
    """Unit vectors across the normal (dim - 1, dim)."""
    if len(normal) == 2:
        return np.array([[normal[1], -normal[0]]])
    first = np.eye(3)[np.abs(normal).argmin()]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def cell_sizes(x, cells, kind):
    """Areas or volumes of simplices and parallelograms (c,)."""
    ends = {"tri3": (1, 2), "quad4": (1, 3), "hex8": (1, 3, 4)}[kind]
    edges = np.stack([x[cells[:, e]] - x[cells[:, 0]] for e in ends], axis=1)
    return np.abs(np.linalg.det(edges)) / (2 if kind == "tri3" else 1)


def face_areas(x, faces):
    """Lengths of segments, areas of parallelograms (f,)."""
    along = x[faces[:, 1]] - x[faces[:, 0]]
    if faces.shape[1] == 2:
        return np.linalg.norm(along, axis=1)
    return np.linalg.norm(np.cross(along, x[faces[:, 3]] - x[faces[:, 0]]), axis=1)


def grid(counts, size, origin=None):
    """Nodes and cells of a box: quad4 or hex8."""
    dim = len(counts)
    lines = [np.linspace(0, length, n + 1) for n, length in zip(counts, size, strict=True)]
    x = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, dim)
    number = np.arange(len(x)).reshape([n + 1 for n in counts])
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if dim == 3:
        corners = [(*c, z) for z in (0, 1) for c in corners]
    cuts = [tuple(slice(c, n + c) for c, n in zip(k, counts, strict=True)) for k in corners]
    cells = np.stack([number[cut].reshape(-1) for cut in cuts], axis=-1)
    return x + (0 if origin is None else np.asarray(origin, float)), cells


def plane_cells(p):
    """Nodes, cells and faces of a layer of cells below the obstacle, as large as those above.

    For codes that look for pairs of faces that are alike in size.
    """
    normal = p.normal
    across = [np.array([normal[1], -normal[0]])]
    if p.dim == 3:
        across = [np.array([1.0, 0.0, 0.0]), np.cross(normal, [1.0, 0.0, 0.0])]
    nodes = p.x[np.unique(p.contact_faces)] - p.point
    places = nodes @ np.transpose(across)
    low, size = places.min(axis=0), np.ptp(places, axis=0)
    h = size.max() / (len(nodes) ** (1 / (p.dim - 1)) - 1)
    counts = [round(1.5 * s / h) + 1 for s in size]
    at, cells = grid((*counts, 1), (*(1.5 * size), h))
    at[:, :-1] += low - 0.25 * size
    frame = np.array([*across, normal])
    faces = cells[:, [2, 3] if p.dim == 2 else [4, 5, 6, 7]]
    return p.point + at @ frame - h * normal, cells, faces


def boundary(cells, kind):
    """Faces that belong to one cell, seen counter-clockwise from outside (f, k)."""
    local = {
        "tri3": [(0, 1), (1, 2), (2, 0)],
        "quad4": [(0, 1), (1, 2), (2, 3), (3, 0)],
        "hex8": [
            (0, 3, 2, 1),
            (4, 5, 6, 7),
            (0, 1, 5, 4),
            (1, 2, 6, 5),
            (2, 3, 7, 6),
            (3, 0, 4, 7),
        ],
    }[kind]
    faces = np.concatenate([cells[:, list(f)] for f in local])
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return faces[first[count == 1]]


def faces_where(x, faces, test):
    """Faces all of whose nodes pass a test of coordinates."""
    return faces[test(x)[faces].all(axis=1)]


def made(name, kind, x, cells, *, held, bottom, mu, E, nu, normal=None, point=None, **more):
    """A problem of its parts: ``held`` has arrays of (dof, value by step), ``bottom`` faces."""
    dim = x.shape[1]
    dofs = np.concatenate([h[0] for h in held])
    values = np.concatenate([np.broadcast_to(h[1], (len(h[0]), np.shape(h[1])[-1])) for h in held])
    dofs, first = np.unique(dofs, return_index=True)
    area = np.zeros(len(x))
    for column in bottom.T:
        np.add.at(area, column, face_areas(x, bottom) / bottom.shape[1])
    contact = np.setdiff1d(np.unique(bottom), dofs // dim)
    steps = values.shape[1]
    given = {
        "body_force": np.zeros(dim),
        "faces": np.zeros((0, bottom.shape[1]), int),
        "tags": np.zeros(0, int),
        "tractions": np.zeros((steps, 0, dim)),
    }
    return Problem(
        name=name, kind=kind, x=x, cells=cells, E=E, nu=nu, held=dofs, values=values[first].T,
        contact=contact, area=area[contact], contact_faces=bottom, mu=mu,
        normal=np.eye(dim)[-1] if normal is None else normal,
        point=np.zeros(dim) if point is None else point, **(given | more),
    )  # fmt: skip


def dofs_of(nodes, component, dim):
    return dim * np.flatnonzero(nodes) + component


def greco(n=32):
    """Raous, Chabrand and Lebon's block, as benchmarks/cases/greco_block.py has it (N, m)."""
    width = 0.04
    x, cells = grid((n, n), (width, width))
    sides = boundary(cells, "quad4")
    at = [lambda x, a=a, v=v: np.isclose(x[:, a], v) for a, v in ((0, 0), (0, width), (1, width))]
    left, top = (faces_where(x, sides, test) for test in (at[0], at[2]))
    bottom = faces_where(x, sides, lambda x: np.isclose(x[:, 1], 0))
    corner = at[1](x) & np.isclose(x[:, 1], 0)
    zero = np.zeros(1)
    held = [(dofs_of(at[1](x), 0, 2), zero), (dofs_of(corner, 1, 2), zero)]
    tags = np.repeat([0, 1], [len(top), len(left)])
    return made(
        "greco", "quad4", x, cells, held=held, bottom=bottom, mu=1.0, E=1.3e11, nu=0.2,
        faces=np.concatenate([top, left]), tags=tags,
        tractions=np.array([[[0, -5e7], [15e7, 0]]]),
    )  # fmt: skip


def dragged(nodes=16, layers=None):
    """A block of 16 (64, 256) contact nodes a side, pressed and dragged along a diagonal.

    It is a third as high as wide, or has as many layers of cubes as are asked for; its top moves by
    three hundredths of its height downwards.
    """
    n = nodes - 1
    height = (layers or max(n // 3, 1)) / n
    x, cells = grid((n, n, round(height * n)), (1.0, 1.0, height))
    top = np.isclose(x[:, 2], height)
    move = [3 * height * v for v in (0.008, 0.003, -0.01)]
    held = [(dofs_of(top, k, 3), np.array([v])) for k, v in enumerate(move)]
    bottom = faces_where(x, boundary(cells, "hex8"), lambda x: np.isclose(x[:, 2], 0))
    return made(
        f"dragged{nodes}", "hex8", x, cells, held=held, bottom=bottom, mu=0.3, E=1.0, nu=0.3
    )


def three(n=16):
    """Ligursky and Renard's triangle: three solutions, as `cases.linear_triangle` has it."""
    x, quads = grid((n, n), (1.0, 1.0))
    a, b, c, d = quads.T
    cells = np.concatenate([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)])
    cells = cells[x[cells].mean(axis=1).sum(axis=1) < 1]
    kept, cells = np.unique(cells, return_inverse=True)
    x = x[kept]
    cells = cells.reshape(-1, 3)
    sides = boundary(cells, "tri3")
    left = faces_where(x, sides, lambda x: np.isclose(x[:, 0], 0))
    bottom = faces_where(x, sides, lambda x: np.isclose(x[:, 1], 0))
    slope = np.isclose(x.sum(axis=1), 1)
    held = [(dofs_of(slope, k, 2), np.zeros(1)) for k in (0, 1)]
    lmbda, mu = LAME
    young = mu * (3 * lmbda + 2 * mu) / (lmbda + mu)
    return made(
        "three", "tri3", x, cells, held=held, bottom=bottom, mu=1.7, E=young,
        nu=lmbda / (2 * (lmbda + mu)), faces=left, tags=np.zeros(len(left), int),
        tractions=np.array([[[-26.0, -7.5]]]),
    )  # fmt: skip


def cyclic(n=12, steps=12):
    """A block that is pressed and then dragged to and fro: a history."""
    x, cells = grid((n, n // 2), (1.0, 0.5))
    top = np.isclose(x[:, 1], 0.5)
    phase = np.linspace(0, 3 * np.pi, steps)
    along = 0.012 * np.sin(phase)
    held = [(dofs_of(top, 0, 2), along), (dofs_of(top, 1, 2), np.full(steps, -0.01))]
    bottom = faces_where(x, boundary(cells, "quad4"), lambda x: np.isclose(x[:, 1], 0))
    return made("cyclic", "quad4", x, cells, held=held, bottom=bottom, mu=0.4, E=1.0, nu=0.3)


def wedge(n=12, angle=20.0, mu=0.3):
    """A heavy block pushed up an incline by a horizontal force: F/G = (tan a + mu)/(1 - mu tan a).

    The horizontal displacement of its lower end is prescribed (not that of the node below, which
    may touch), and only that: all of it slips.
    """
    x, cells = grid((n, n // 2), (1.0, 0.5))
    a = np.deg2rad(angle)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    end = np.isclose(x[:, 0], 0) & (x[:, 1] > 1e-9)
    bottom = faces_where(x, boundary(cells, "quad4"), lambda x: np.isclose(x[:, 1], 0))
    closed = (np.tan(a) + mu) / (1 - mu * np.tan(a))
    return made(
        "wedge", "quad4", x @ turn.T, cells, held=[(dofs_of(end, 0, 2), np.array([0.05]))],
        bottom=bottom, mu=mu, E=1.0, nu=0.3, normal=turn[:, 1],
        body_force=np.array([0.0, -0.02]), closed=closed,
    )  # fmt: skip


def pair():
    """A block dragged over a larger one, with nodes that do not match."""
    lower, below = grid((14, 6), (1.4, 0.6), (-0.2, -0.6))
    upper, above = grid((9, 5), (1.0, 0.5))
    x = np.concatenate([lower, upper])
    cells = np.concatenate([below, above + len(lower)])
    is_upper = np.arange(len(x)) >= len(lower)
    top = np.isclose(x[:, 1], 0.5)
    base = np.isclose(x[:, 1], -0.6)
    held = [(dofs_of(base, k, 2), np.zeros(1)) for k in (0, 1)]
    held += [(dofs_of(top, k, 2), np.array([v])) for k, v in enumerate((0.002, -0.01))]
    sides = faces_where(x, boundary(cells, "quad4"), lambda x: np.isclose(x[:, 1], 0))
    slave = is_upper[sides].all(axis=1)
    return made(
        "pair", "quad4", x, cells, held=held, bottom=sides[slave], master_faces=sides[~slave],
        mu=0.3, E=1.0, nu=0.3,
    )  # fmt: skip


def growing(first, even, last, ratio=1.2):
    """Places from 0 to ``last``, ``first`` apart up to ``even``, then further by ``ratio``."""
    steps = [first] * round(even / first)
    while sum(steps) < last:
        steps.append(steps[-1] * ratio)
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * last / places[-1]


def half_disc(radius, across, up):
    """Nodes and cells of the lower half of a disc whose lowest point is 0.

    Coons' patch of its lower arc, of 60 degrees to either side at ``across`` (-1 to 1), two arcs of
    30 degrees, and its flat top. Over its lowest point nodes are at ``up`` (0 to 1), at the sides,
    where two arcs meet at nearly 180 degrees, as far from each other everywhere.
    """

    def arc(degrees):
        a = np.deg2rad(degrees)
        return radius * np.stack([np.sin(a), 1 - np.cos(a)], axis=-1)

    even = np.linspace(0, 1, len(up))
    t = up + across[:, None] ** 2 * (even - up)
    s = (across[:, None, None] + 1) / 2
    low, high = arc(60 * across), radius * np.stack([across, np.ones_like(across)], axis=-1)
    x = (1 - t[..., None]) * low[:, None] + t[..., None] * high[:, None]
    for end, share in ((-1, 1 - s), (1, s)):
        chord = (1 - t[..., None]) * arc(60.0 * end) + t[..., None] * arc(90.0 * end)
        x = x + share * (arc(end * (60 + 30 * t)) - chord)
    return x.reshape(-1, 2), grid((len(across) - 1, len(up) - 1), (1.0, 1.0))[1]


def roller(fine=0.6):
    """A cylinder of steel that 35 kN/mm press on a block of aluminium: NAFEMS CB-1 (N, mm).

    Its radius is 50, and the block 400 wide and 200 high; no friction. Half the cylinder is there,
    pressed on its flat top; its axis is held across, and nothing else, so that contact alone bears
    it. Hertz' half spaces have the half width 6.21 and the peak 3585.
    """
    radius, width, load, nu = 50.0, 200.0, 35e3, 0.3
    steel, aluminium = 210e3, 70e3
    angle = np.deg2rad(60)
    across = growing(fine / (radius * angle), 10 / (radius * angle), 1.0)
    up = growing(fine / radius, 8 / radius, 1.0)
    upper, above = half_disc(radius, np.concatenate([-across[:0:-1], across]), up)
    side, down = growing(1.25 * fine, 12, width), growing(1.25 * fine, 8, width)
    lines = np.concatenate([-side[:0:-1], side]), -down[::-1]
    lower = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    below = grid((len(lines[0]) - 1, len(lines[1]) - 1), (1.0, 1.0))[1]
    x, quads = np.concatenate([lower, upper]), np.concatenate([below, above + len(lower)])
    # Cut from the lower outer corners, where two arcs of the disc meet at nearly 180 degrees.
    left = x[quads, 0].mean(axis=1) < 0
    turned = np.where(left[:, None], quads, np.roll(quads, -1, axis=1))
    cells = np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
    is_upper = np.arange(len(x)) >= len(lower)
    base = np.isclose(x[:, 1], -width)
    axis = is_upper & np.isclose(x[:, 0], 0) & (x[:, 1] > 1e-9)
    held = [(dofs_of(base, k, 2), np.zeros(1)) for k in (0, 1)]
    held += [(dofs_of(axis, 0, 2), np.zeros(1))]
    sides = boundary(cells, "tri3")
    on_upper = is_upper[sides].all(axis=1)
    middle = x[sides].mean(axis=1)
    top = on_upper & np.isclose(middle[:, 1], radius)
    slave = on_upper & (np.abs(middle[:, 0]) < 12) & (middle[:, 1] < 2)
    master = ~on_upper & (np.abs(middle[:, 0]) < 16) & np.isclose(middle[:, 1], 0)
    compliance = (1 - nu**2) * (1 / steel + 1 / aluminium)
    a = np.sqrt(4 * load * radius * compliance / np.pi)
    return made(
        "roller", "tri3", x, cells, held=held, bottom=sides[slave], master_faces=sides[master],
        mu=0.0, E=steel, nu=nu, faces=sides[top], tags=np.zeros(top.sum(), int),
        tractions=np.array([[[0, -load / (2 * radius)]]]),
        hertz=np.array([a, 2 * load / (np.pi * a)]),
        times=np.where(is_upper[cells].all(axis=1), 1.0, aluminium / steel),
    )  # fmt: skip


def ironing(h=0.2, until=1.52):
    """A stiff die with a round edge pressed into a slab and dragged along it (mm, N, MPa).

    The shallow ironing of the literature: 1 mm down, from a gap of 0.2, in 20 steps up to t = 1,
    and 10 mm along in a unit of time, by steps of 0.1 mm, of 0.025 mm from t = 1.48 to 1.52.
    """
    radius, nu = 0.75, 0.32
    lines = np.linspace(0, 12, round(12 / h) + 1), 4 - growing(h, h, 4.0, 1.12)[::-1]
    slab = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    in_slab = grid((len(lines[0]) - 1, len(lines[1]) - 1), (1.0, 1.0))[1]
    at, in_die = grid((round(1.39 / h), max(round(1.05 / h), 3)), (1.0, 1.0))
    angle = np.arcsin(0.8) * (2 * at[:, 0] - 1)
    arc = np.stack([0.8 + radius * np.sin(angle), 4.2 + radius * (1 - np.cos(angle))], axis=1)
    flat = np.stack([0.2 + 1.2 * at[:, 0], np.full(len(at), 5.4)], axis=1)
    die = (1 - at[:, 1:]) * arc + at[:, 1:] * flat
    x = np.vstack([slab, die])
    cells = np.vstack([in_slab, in_die + len(slab)])
    is_die = np.arange(len(x)) >= len(slab)
    press = np.linspace(0.05, 1, 20)
    slide = np.union1d(np.linspace(1.01, 1.48, 48), np.linspace(1.48, 1.52, 17))
    t = np.concatenate([press, np.unique(np.round(slide, 10))])
    t = t[t <= until + 1e-9]
    top = is_die & np.isclose(x[:, 1], 5.4)
    held = [(dofs_of(~is_die & np.isclose(x[:, 1], 0), k, 2), np.zeros(len(t))) for k in (0, 1)]
    held += [(dofs_of(top, 0, 2), 10 * np.maximum(t - 1, 0))]
    held += [(dofs_of(top, 1, 2), -np.minimum(t, 1))]
    sides = boundary(cells, "quad4")
    on_die = is_die[sides].all(axis=1)
    slave = ~on_die & np.isclose(x[sides, 1], 4).all(axis=1)
    master = on_die & ~top[sides].all(axis=1)
    window = [np.argmin(np.abs(t - at)) for at in (1.0, 1.48, 1.52) if t[-1] >= at - 1e-9]
    return made(
        "ironing", "quad4", x, cells, held=held, bottom=sides[slave], master_faces=sides[master],
        mu=0.3, E=689.6, nu=nu, normal=np.array([0.0, -1.0]), point=np.array([0.0, 4.2]),
        times=np.where(is_die[cells].all(axis=1), 10.0, 1.0), law="log", window=np.array(window),
    )  # fmt: skip


def bar(n=25, height=5.0):
    """An elastic bar that falls on a floor, bounces, and comes to rest where it was.

    The floor pushes with 300 + 300 (t - 1) for 1 < t < 5/3 and with 500 - 300 (t - 11/3) for
    11/3 < t < 13/3 (Doyen, Ern and Piperno, SIAM J. Sci. Comput. 2011). Steps are a cell's way of
    the wave, h/c.
    """
    length, weight, young, last = 10.0, 10.0, 900.0, 16 / 3
    dt = length / n / np.sqrt(young)
    t = dt * np.arange(1, round(last / dt) + 1)
    x, cells = grid((1, n), (1.0, length))
    a = np.clip(t, 1, 5 / 3) - 1
    b = np.clip(t, 11 / 3, 13 / 3) - 11 / 3
    # Twice the integral of the force, and the way at the speed that an impact has left.
    given = 150 * a**2 + 50 * a**3 + np.maximum(t - 5 / 3, 0) * (300 * 2 / 3 + 150 * (2 / 3) ** 2)
    given += 250 * b**2 - 50 * b**3
    given += np.maximum(t - 13 / 3, 0) * (500 * 2 / 3 - 150 * (2 / 3) ** 2)
    bottom = faces_where(x, boundary(cells, "quad4"), lambda x: np.isclose(x[:, 1], 0))
    return made(
        "bar", "quad4", x, cells, held=[(dofs_of(x[:, 1] > 0, 0, 2), np.zeros(len(t)))],
        bottom=bottom, mu=0.0, E=young, nu=0.0, point=np.array([0.0, -height]),
        body_force=np.array([0.0, -weight]), density=1.0, dt=dt,
        path=-weight * t**2 / 2 + given / length,
    )  # fmt: skip


#: Those of the table, by their names; sizes are arguments.
PROBLEMS = {
    "greco": greco,
    "dragged16": dragged,
    "dragged64": partial(dragged, 64),
    "dragged256": partial(dragged, 256, layers=2),
    "three": three,
    "cyclic": cyclic,
    "wedge": wedge,
    "pair": pair,
    "roller": roller,
    "bar": bar,
    "ironing": ironing,
}


def main(folder):
    for make in PROBLEMS.values():
        problem = make()
        path = problem.save(folder)
        print(f"{path}: {problem.x.size} unknowns, {len(problem.contact)} contact nodes")


if __name__ == "__main__":
    main(sys.argv[1])
