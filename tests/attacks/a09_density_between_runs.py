"""The density, a Function cell by cell, is set to another value between two runs of one motion.

A free body under a uniform force in 3D: its velocity is the integral of force over density.
"""

from flying import flying

from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def attack(case):
    body = flying(case.comm, (0.0, 1.0, 2.0), (2, 1, 1), "tetrahedron")
    density = fem.Function(fem.functionspace(body.u.function_space.mesh, ("DG", 0)))
    density.x.array[:] = 1.0
    motion = NSCD(body.problem, density, dt=0.25, velocity=body.velocity, mass="lumped")
    motion.run([0.0, 0.5])
    density.x.array[:] = 4.0
    motion.run([0.5, 1.0])
    speed = 0.5 + 0.5 / 4
    case.equal("velocity", body.mean(body.velocity), [0.0, speed, 2 * speed])
