"""The slips of a solution in which some points are open, some stuck, some slip.

Asked with ``direction="solution"``; numpy condenses open points away and holds stuck ones, by the
statuses of the table, and takes the sense of every slip.
"""

from mpi4py import MPI

import numpy as np
from a10_all_listed import compare, energy_of, leaning, made, sorted_by_slips, tangent
from bodies import condensed, dense, nodes_of

from dolfinx_contact.analysis import critical_friction


def attack(case):
    kinds = set()
    for shear, turn in ((0.08, 0.1), (0.02, 0.0), (-0.05, 0.12)):
        body = leaning(case.comm, 0.5, (6, 3))
        body.moved.interpolate(
            lambda x, s=shear, t=turn: np.stack([s + 0 * x[0], -0.02 - t * (0.8 - x[0])])
        )
        problem = made(body, energy_of(body))
        table = problem.solve().tables["contact"]
        kinds |= set(table.status)
        letters = np.array(list(table.status))
        if not np.isin(letters, ["+", "-"]).any():
            continue
        found = critical_friction(problem, "solution")
        own = leaning(MPI.COMM_SELF, 0.5, (6, 3))
        K = dense(tangent(energy_of(own), own))
        bottom = nodes_of(own.V, lambda y: np.isclose(y[:, 1], 0))
        top = nodes_of(own.V, lambda y: np.isclose(y[:, 1], 1))
        slips = bottom[np.isin(letters, ["+", "-"])]
        sign = np.where(letters[np.isin(letters, ["+", "-"])] == "+", 1.0, -1.0)
        stuck = bottom[letters == "k"]
        gone = np.concatenate([2 * top, 2 * top + 1, 2 * stuck, 2 * stuck + 1])
        S = condensed(K, np.concatenate([2 * slips, 2 * slips + 1]), gone)
        m = len(slips)
        S_tt = sign[:, None] * S[:m, :m] * sign
        compare(case, found, sorted_by_slips(S_tt, S[m:, :m] * sign))
        case.equal("positions", found.positions[:, 0], own.V.tabulate_dof_coordinates()[slips, 0])
    case.true(f"several kinds of statuses: {kinds}", len(kinds) >= 3)
