"""Planted faults: each can be planted, and is not there."""

from pathlib import Path

import pytest
from benchmarks.planted import FAULTS

REPOSITORY = Path(__file__).parents[2]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_replaces_a_text_that_is_there_once(fault):
    assert fault.count() == 1
    assert fault.planted != fault.text
    assert all((REPOSITORY / path).is_file() for path in fault.tests)


def test_there_are_thirty_five_by_different_names():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) == 35
