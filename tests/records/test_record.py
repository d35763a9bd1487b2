"""A record stays what it was when it was made."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.records import read_record
from reference import make_record

from .synthetic_records import pulse_frame


@pytest.fixture
def record(tmp_path):
    pulse_frame().write_csv(tmp_path / "cell.csv")
    return read_record(tmp_path / "cell.csv")


@pytest.mark.parametrize("name", ["time_s", "current_a", "voltage_v", "row"])
def test_the_arrays_of_a_record_cannot_be_written_to(record, name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(record, name)[0] = 1
    with pytest.raises(ValueError, match="read-only"):
        getattr(replace(record, name="other.csv"), name)[0] = 1


def test_writing_to_what_a_record_was_made_from_does_not_change_it():
    time_s, current_a = np.arange(20.0), np.ones(20)
    record = make_record(time_s, current_a)
    current_a[3], time_s[3] = 7.0, -1.0
    assert (record.current_a == 1).all()
    assert (np.diff(record.time_s) > 0).all()
