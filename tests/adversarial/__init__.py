"""Adversarial tests: natural actions of a user for which an assumption of the package may not hold.

Each module states the assumption that its tests attack. Each test ends in the right answer, by a
closed form or an independent computation, in a clear error, or in a warning with a number.
"""
