"""A hang ends the run with a traceback."""

import faulthandler

import pytest
from conftest import STDERR

SECONDS = 400  # limit for one test; on a busy machine the longest takes a quarter of it


@pytest.fixture(autouse=True)
def no_hang():
    """Abort the run with the tracebacks of all threads if a test takes too long."""
    faulthandler.dump_traceback_later(SECONDS, exit=True, file=STDERR)
    yield
    faulthandler.cancel_dump_traceback_later()
