"""From files to an identified pulse test: what it starts from, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import Window, bundled_file, characterize, hppc, read_record
from barnax.identification import pipeline
from barnax.model.prepared import prepare_record

HPPC = bundled_file("hppc_25degC")


@pytest.fixture
def asked(monkeypatch):
    """What would be identified."""
    given = {}

    monkeypatch.setattr(pipeline, "_identified", lambda job: given.update(job.chosen))
    return given


def test_a_test_starts_at_its_first_long_rest_and_is_the_ocv_test_too(asked):
    hppc(HPPC, capacity=2.0)
    window = asked["window"]["hppc_25degC.parquet"]
    # The end of the rest of 3 h before the first pulse, from full.
    assert window.start_time_s == pytest.approx(10800, abs=1e-3)
    assert window.initial_soc == pytest.approx(1.0, abs=0.01)
    assert asked["ocv"] == asked["records"]
    assert (asked["ocv_fit"], asked["over"], asked["capacity"]) == ("interpolated", "soc", 2.0)


def test_tests_at_several_temperatures_have_an_ocv_each(asked):
    hppc([bundled_file("hppc_10degC"), HPPC])
    assert asked["over"] == "soc,temperature"
    assert [source.name for source in asked["ocv"]] == ["hppc_10degC.parquet", HPPC.name]
    # What is given of a test goes before what it measured.
    given = {"hppc_10degC.parquet": Window(temperature_degc=24.0)}
    hppc([bundled_file("hppc_10degC"), HPPC], window=given)
    assert asked["over"] == "soc"


def test_what_lies_beyond_the_test_s_ocv_is_not_scored_and_reported(asked):
    record = read_record(HPPC)
    # Cut in the discharge to the last level: the rest before that is the lowest OCV point.
    rows = record.discharged_ah < 1.88
    arrays = {name: each for name, each in vars(record).items() if isinstance(each, np.ndarray)}
    cut = replace(record, **{name: each[rows] for name, each in arrays.items()})
    hppc(cut)
    cell = characterize([cut], ocv_fit="interpolated")
    prepared = prepare_record(cut, cell, "so-rc", asked["window"][cut.name])
    lowest = prepared.soc[prepared.scored].min()
    assert lowest == pytest.approx(1 - 1.677 / 1.88 - 0.05, abs=0.01)
    assert prepared.soc.min() >= lowest
    assert "soc.without-ocv" in [notice.code for notice in prepared.warnings]


def test_without_any_record_it_is_the_bundled_test_validated_on_the_trips(asked):
    hppc()
    assert [source.name for source in asked["records"]] == ["hppc_25degC.parquet"]
    assert [source.name for source in asked["validate"]] == ["validation.parquet"]
