"""What the package computes is what it computed; `golden.py` says how that is kept."""

import json

import golden
import pytest

RECORD = json.loads(golden.RECORD.read_text())


@pytest.mark.parametrize("name", golden.CASES)
def test_the_record(name):
    kept = golden.in_record(RECORD, name, golden.COMM.size)
    assert golden.differences(golden.computed(name), kept) == []


def test_nothing_else_is_in_the_record():
    assert set(RECORD) == set(golden.CASES)
