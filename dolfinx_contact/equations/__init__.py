# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem H(x) = 0. Data that vary are arguments of its methods.

In the order in which a static solve needs them:

- `unknowns`: layout of x, and motions of rigid bodies.
- `contact`: H, as a sum of terms; it combines all that follows.
- `constraints`: Dirichlet data, removed multipliers, gradual application of a load.
- `scaling`: typical stiffness, augmentation r, rigid motions that only contact can prevent.
- `evaluation`: values computed by one evaluation of H, and the terms of the surfaces.
- `validation`, with `data`: checks of the arguments of a problem, and of the data before a solve.
- `touching`: start of a solve without contact.
- `measures`: relative residuals, and detection of unphysical states.
- `jacobian`: derivative of H; `sliding`: its terms for faces sliding over each other.

Other uses: `parametric_equations` with `rates` is H(x, gamma) for the continuation, and `state` is
the immutable `State` that `ContactProblem.snapshot` returns.
"""
