"""A hang of an adversarial test ends the run with a traceback."""

import pytest


@pytest.fixture(autouse=True)
def no_hang(nothing_hangs):
    """Limit the time of every test."""
