"""A hang ends the run with a traceback."""

import faulthandler

import pytest
from conftest import STDERR

SECONDS = 180  # that one test may take


@pytest.fixture(autouse=True)
def no_hang():
    """Abort the run with the tracebacks of all threads if a test takes too long."""
    faulthandler.dump_traceback_later(SECONDS, exit=True, file=STDERR)
    yield
    faulthandler.cancel_dump_traceback_later()
