# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body without contact: residual, stiffness, mass, rigid motions and checks."""
