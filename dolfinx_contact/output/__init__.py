# SPDX-License-Identifier: LGPL-3.0-or-later
"""Guard against an installation mixed with the files of another package of this name.

The other package, ``dolfinx_contact`` of Asimov, imports a module ``output``. If both packages are
installed into one folder and its ``__init__.py`` has been overwritten by the other package, the
import finds this module, which raises an error.
"""

from dolfinx_contact._install import refuse_mixture

__all__: list[str] = []

refuse_mixture()
