# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do the terms of Abaqus, GetFEM and code_aster translate?
#
# | Abaqus | code_aster | GetFEM | here |
# |---|---|---|---|
# | secondary surface | GROUP_MA_ESCL | slave | `slave=`, `ContactSurface` |
# | main surface, rigid | GROUP_MA_MAIT | obstacle | `master=`, `HalfSpace`, `RigidBody` |
# | CPRESS, CSHEAR | LAGS_C, RN, RT | multiplier | `pressure`, `shear`; forces `rn`, `rt` |
# | COPEN, CSLIP | JEU, GLI | gap | `un`, `ut` |
# | hard contact | ALGO_CONT STANDARD | unilateral contact | the default |
# | penalty, exponential | PENALISATION | penalised brick | `NormalCompliance` |
# | elastic slip | ALGO_FROT PENALISATION | - | `Regularised(law, width)` |
# | interference fit, shrink | DIST_MAIT | obstacle with offset | `interference=True`, `gap=` |
# | cohesive behaviour | JOINT_MECA_FROT, CZM | - | `BilinearCohesive`, `RCCM` |
# | Riks | PILOTAGE | continuation | `follow`, `ArcLength` |
#
# Penalty and elastic slip, compared with the exact law:

from common import Block

from dolfinx_contact import Coulomb, NormalCompliance, Regularised

exact = Coulomb(0.3)
for name, law in {
    "exact": exact,
    "penalty": NormalCompliance(1e6, friction=exact),
    "elastic slip": Regularised(exact, width=1e-4),
}.items():
    result = Block().problem(law).solve()
    gap = result.tables["contact"].un.min()
    print(f"{name:12} force {result.resultants['contact'].round(4)}, smallest gap {gap:.2e}")
    assert result.converged
