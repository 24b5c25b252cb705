# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points: positions, data of obstacle and law, and the operators B and E.

B maps nodal displacements to jumps at the contact points, E multipliers to tractions.

All surfaces:

- `descriptions`: the user's arguments, validated; `rigid_body`: obstacles with unknown motions
- `surface`: discrete surface, the interface to the equations
- `trace`, `surface_geometry`: facets of the boundary, their nodes, areas and normals
- `evaluators`: UFL at the contact points
- `contact_points`: points and operators of the three methods; `gauss_points`: quadrature on facets
- `jump_operators`: B, applied, transposed and differentiated
- `kinematics`: gap and slip at a state; `memory`: data of the last accepted state
- `displaced`: curved obstacles in large displacement
- `neighbours`: nonlocal laws
- `revolution`: bodies of revolution

Two bodies in small sliding:

- `pair`: discrete surface of a pair; `opposite`: opposing points of the slave nodes
- `spatial_search`: points and facets of other ranks
- `clipping`: common parts of facets; `mortar`: weights between faces that do not match
- `shared_functions`: nodes without a multiplier of their own

Two bodies in large sliding, and self-contact:

- `sliding_pair`: discrete surface, contact points and B
- `sliding_kinematics`: gap and slip of the slave nodes and their derivatives, in arrays
- `sliding_faces`: both faces at a displacement; `sliding_master`: search for opposing facets
"""
