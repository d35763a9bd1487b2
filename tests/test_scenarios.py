"""What a filter is given where its start is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import Window, identify, replay_soc
from barnax.execution import in_float64
from barnax.model.prepared import prepare_record
from barnax.result_filter import model_of
from barnax.scenarios import Scenario, case_of, first_with_room
from helpers.results import make_record, make_result


@in_float64
def test_a_late_start_has_what_the_current_left_in_the_pairs():
    """After a constant current for t: R i (1 - exp(-t / tau)), in closed form."""
    result, flowing_a = make_result("so-rc"), 4.0
    record = make_record(1500)
    record = replace(record, current_a=np.full(record.samples, flowing_a))
    prepared = prepare_record(record, result.cell, "so-rc", Window(initial_soc=0.95))
    model, scenario = model_of(result), Scenario("too high", soc_error=0.2)
    first = first_with_room(prepared.soc, scenario.soc_error)
    _, (state, _), drive = case_of(model, prepared, scenario, first, 0.1).given
    assert first > 0
    assert state[0] == pytest.approx(prepared.soc[first] + 0.2)
    circuit = result.constant.parameters
    gone = 1 - np.exp(-float(first) / np.array(circuit.tau_s))
    assert state[1:3] == pytest.approx(flowing_a * np.array(circuit.r) * gone, rel=1e-9)
    assert drive.interval_s[0] == 0
    np.testing.assert_array_equal(drive.voltage_v[: record.samples - first][:-1],
                                  record.voltage_v[first:][:-1])  # fmt: skip


def test_before_a_scenario_starts_there_is_no_estimate_and_nothing_is_scored():
    result, record = make_result("so-rc"), make_record(2000)
    window = Window(initial_soc=0.9)
    both = (Scenario("right"), Scenario("too high", soc_error=0.15), Scenario("far", soc_error=1.5))
    replay = replay_soc(result, record, window, scenarios=both)
    assert [each.name for each in replay.scenarios] == ["right", "too high"]
    assert replay.untried == ("far",)
    late = replay.scenarios[1]
    soc = replay.traces.estimate.soc[1]
    before = replay.traces.time_s < late.start_s
    assert np.any(before)
    assert np.all(np.isnan(soc[before]))
    assert np.all(np.isfinite(soc[~before]))
    error = np.abs(soc - replay.traces.truth)[~before]
    held = error <= 1.959964 * replay.traces.estimate.soc_sd[1][~before]
    assert late.in_band == pytest.approx(np.mean(held))


@pytest.mark.slow
@pytest.mark.parametrize(("degc", "rms"), [(0, 0.015), (25, 0.008), (45, 0.008)])
def test_a_measured_cell_is_tracked_from_starts_too_low_and_too_high(real_data, degc, rms):
    """Identified on DST and replayed on US06; at 0 and 45 degC with the OCV test of 25 degC."""
    folder = real_data / "calce-inr18650-20r"
    window = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
    result = identify(
        folder / f"dst_{degc}degC_80soc_SP20-2.parquet",
        ocv=folder / "ocv-incremental_25degC_SP20-3.parquet",
        window=window,
        capacity=2.0, seeds=0, over="soc", model="so-rc", folds=0,
    )  # fmt: skip
    replay = replay_soc(result, folder / f"us06_{degc}degC_80soc_SP20-2.parquet", window)
    actual = {each.name: each for each in replay.scenarios}
    for name in ("start 20 % too low", "start 20 % too high"):
        part = actual[name]
        assert part.rms < rms
        assert part.in_band > 0.9
        # A wide enough one would hold anything.
        assert part.band < 0.025
