"""The package computes the numbers of its regression record, which `golden.py` writes."""

import json

import golden
import pytest

RECORD = json.loads(golden.RECORD.read_text())
#: Cases that take several times as long on ranks, for hundreds of small linear systems; other tests
#: cover their mechanisms on ranks.
LONG_ON_RANKS = ("path with a record", "path that snaps back", "history of a crack")


def case(number, name):
    """A case of the record: every second one runs on two ranks too, every third one on three.

    With ``--long`` all cases run on one, two and three ranks.
    """
    sizes = [size for size in (2, 3) if number % size == 0 and name not in LONG_ON_RANKS]
    return pytest.param(name, marks=pytest.mark.ranks(*sizes, long=(2, 3), every_case=True))


@pytest.mark.parametrize("name", [case(*pair) for pair in enumerate(golden.CASES)])
def test_results_agree_with_the_record(name):
    kept = golden.in_record(RECORD, name, golden.COMM.size)
    assert golden.differences(golden.computed(name), kept) == []


def test_the_record_has_the_cases_and_no_others():
    assert set(RECORD) == set(golden.CASES)
