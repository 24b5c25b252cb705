# SPDX-License-Identifier: LGPL-3.0-or-later
"""No room of this package: the other package of this name imports a module that is called so.

Where files of both are in one folder and its head is the other's, this is what that finds.
"""

from dolfinx_contact._install import refuse_mixture

__all__: list[str] = []

refuse_mixture()
