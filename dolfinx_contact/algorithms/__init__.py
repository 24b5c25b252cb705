# SPDX-License-Identifier: LGPL-3.0-or-later
"""Classical contact algorithms for the reduced problem at the contact points, using NumPy.

`ContactProblem.solve(algorithm=...)` selects them by name.
"""

from dolfinx_contact.algorithms.exchange import load_points, save_points
from dolfinx_contact.algorithms.gauss_seidel import GaussSeidel
from dolfinx_contact.algorithms.interior_point import InteriorPoint
from dolfinx_contact.algorithms.iteration import Algorithm, Outcome
from dolfinx_contact.algorithms.lemke import Lemke, RayTermination, coulomb_by_lemke, lemke
from dolfinx_contact.algorithms.penalty import Penalty
from dolfinx_contact.algorithms.projected_cg import ProjectedGradient
from dolfinx_contact.algorithms.semismooth import SemismoothNewton
from dolfinx_contact.algorithms.tresca import TrescaFixedPoint
from dolfinx_contact.algorithms.uzawa import Uzawa
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = [
    "ALGORITHMS",
    "Algorithm",
    "GaussSeidel",
    "InteriorPoint",
    "Lemke",
    "Outcome",
    "Penalty",
    "PointProblem",
    "ProjectedGradient",
    "RayTermination",
    "SemismoothNewton",
    "TrescaFixedPoint",
    "Uzawa",
    "coulomb_by_lemke",
    "lemke",
    "load_points",
    "save_points",
]

#: The algorithm of each name in `ContactProblem.solve`.
ALGORITHMS: dict[str, Algorithm] = {
    "tresca": TrescaFixedPoint(),
    "uzawa": Uzawa(),
    "penalty": Penalty(),
    "sor": GaussSeidel(relaxation=1.5),
    "gauss-seidel": GaussSeidel(),
    "projected-gradient": ProjectedGradient(),
    "lemke": Lemke(),
    "interior-point": InteriorPoint(),
}
