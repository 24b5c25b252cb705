"""What a record says of a problem that is not the one that was recorded."""

from mpi4py import MPI

from blocks import block, box

from dolfinx import fem

from dolfinx_contact import Coulomb, Sphere
from dolfinx_contact.equations.given_data import numbers_of
from dolfinx_contact.output.identity import difference, identity, other_data

COMM = MPI.COMM_WORLD


def test_what_has_changed_is_named():
    """A Function by mean and root mean square, a part of an obstacle, a Constant in a form."""
    square = box(COMM, 2, "tri")
    friction = fem.Function(fem.functionspace(square, ("Lagrange", 1)), name="rough")
    friction.x.array[:] = 0.3
    centre = fem.Constant(square, (0.5, -2.0))
    problem = block(domain=square, law=Coulomb(2.0 * friction), obstacle=Sphere(centre, 2.0))
    known, data = identity(problem), numbers_of(problem.equations)
    assert difference(known, identity(problem)) == ""
    assert other_data(problem, data, numbers_of(problem.equations)) is None
    friction.x.array[:] = 0.4
    assert other_data(problem, data, numbers_of(problem.equations)) == (
        ": the Function 'rough' in the friction of Coulomb of 'contact', mean and root mean "
        "square: (0.3, 0.3) was recorded, (0.4, 0.4) is given"
    )
    friction.x.array[:] = 0.3
    centre.value[1] = -2.0 - 1e-7
    wanted = (
        ": the centre of Sphere of 'contact': (0.5, -2) was recorded, (0.5, -2.0000001) is given"
    )
    assert other_data(problem, data, numbers_of(problem.equations)) == wanted
    assert difference(known, identity(problem)) == "other materials, loads or friction" + wanted
