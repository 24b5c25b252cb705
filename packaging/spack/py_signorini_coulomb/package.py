# SPDX-License-Identifier: (Apache-2.0 OR MIT)
"""A recipe for Spack: `spack repo` wants the folder `packages/` of a repository around it."""

from spack_repo.builtin.build_systems.python import PythonPackage

from spack.package import *


class PySignoriniCoulomb(PythonPackage):
    """Frictional contact mechanics on DOLFINx without regularisation: the Signorini-Coulomb
    problem itself and all of its solutions, in 2D and 3D, in parallel."""

    license("LGPL-3.0-or-later")

    import_modules = ["dolfinx_contact"]

    # A release has its url and sha256 here; until then: spack dev-build py-signorini-coulomb@0.1.0
    version("0.1.0")

    variant("slepc", default=False, description="Large eigenproblems of dolfinx_contact.analysis")
    variant("gmsh", default=False, description="Meshes of gmsh")
    variant("pictures", default=False, description="Pictures and animations")

    depends_on("py-hatchling", type="build")
    depends_on("python@3.11:", type=("build", "run"))
    depends_on("py-numpy", type=("build", "run"))
    depends_on("py-scipy", type=("build", "run"))
    depends_on("py-mpi4py", type=("build", "run"))
    depends_on("py-petsc4py", type=("build", "run"))
    depends_on("py-fenics-dolfinx@0.9:0.11 +petsc4py", type=("build", "run"))
    # Complex scalars are refused, and direct solves are those of MUMPS.
    depends_on("petsc ~complex +mumps", type=("build", "run"))

    with when("+slepc"):
        depends_on("py-slepc4py", type=("build", "run"))
    with when("+gmsh"):
        depends_on("gmsh", type=("build", "run"))
    with when("+pictures"):
        depends_on("py-matplotlib", type=("build", "run"))
        depends_on("py-pyvista", type=("build", "run"))
