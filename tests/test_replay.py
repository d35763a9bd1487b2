"""A record replayed through a filter: what is scored, and what is an answer where nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import FilterSettings, InputError, Window, identify
from barnax.bundled import BUNDLED
from barnax.cell import Dependence, InterpolatedCurve
from barnax.plots import plot_soc_replay
from barnax.replay import Scenario, SocReplay, replay_soc
from barnax.reporting.replay import soc_screen
from barnax.reporting.terminal import to_text
from barnax.reporting.wording import sentences
from barnax.scenarios import converged
from helpers.results import make_record, make_result, make_table_result

SCENARIOS = (
    Scenario("right start"),
    Scenario("lost", offset_c=1e300),
    Scenario("start 20 % too low", soc_error=-0.2),
)


@pytest.fixture(scope="module")
def result():
    return identify(window=Window(score_to_s=1500.5), model="so-rc", seeds=0)


@pytest.fixture(scope="module")
def replay(result):
    return replay_soc(result, BUNDLED.validation, scenarios=SCENARIOS)


def test_the_right_start_comes_first_whatever_is_tried(result):
    wrong = replay_soc(result, BUNDLED.validation, scenarios=SCENARIOS[2:])
    assert [each.name for each in wrong.scenarios] == ["right start", "start 20 % too low"]


def test_errors_are_against_the_counter_from_convergence_on(replay):
    traces, right = replay.traces, replay.scenarios[0]
    time_s, errors = traces.time_s, np.asarray(traces.estimate.soc) - traces.truth
    # What a filter said before it diverged is no answer.
    pairs = zip(replay.scenarios, errors, strict=True)
    kept = [pair for pair in pairs if pair[0].diverged_s is None]
    assert len(kept) == len(SCENARIOS) - 1
    for scenario, error in kept:
        until_s = scenario.start_s + scenario.converged_s
        whole, after = error[time_s >= scenario.start_s], error[time_s >= until_s]
        before = error[(time_s >= scenario.start_s) & (time_s < until_s)]
        largest = np.nanmax(np.abs(before), initial=0.0)
        assert (scenario.max_before or 0.0) == pytest.approx(largest)
        for rms, most, of in (("rms", "max", after), ("whole_rms", "whole_max", whole)):
            assert getattr(scenario, rms) == pytest.approx(np.sqrt(np.mean(of**2)))
            assert getattr(scenario, most) == pytest.approx(np.abs(of).max())
    at = right.converged_s
    assert at < 300
    assert np.abs(errors[0][(time_s >= at) & (time_s < at + 600)]).max() < 0.03
    reach = 1.959964 * np.asarray(traces.estimate.soc_sd[0])
    assert right.band == pytest.approx(np.mean(reach))
    assert right.in_band == pytest.approx(np.mean(np.abs(errors[0]) <= reach))
    assert right.counter_max == pytest.approx(0.0, abs=1e-12)


def test_a_record_that_starts_where_no_ocv_was_measured_is_refused(result):
    cell = result.cell
    points = {
        name: tuple(point for point in getattr(cell, name) if point.soc < 0.8)
        for name in ("charge_points", "discharge_points")
    }
    partial = result.model_copy(update={"cell": replace(cell, **points)})
    with pytest.raises(InputError, match=r"to 100 %, and the OCV is known from 0 to 80 %"):
        replay_soc(partial, BUNDLED.validation, Window(initial_soc=1.0))


def test_a_filter_without_numbers_is_a_row_that_says_so(replay):
    part, traces = replay.scenarios[1], replay.traces
    is_lost = ~np.isfinite(traces.estimate.soc[1]) | ~np.isfinite(traces.estimate.soc_sd[1])
    # From the first sample or from the second on: what overflows first is the processor's.
    assert part.diverged_s == traces.time_s[np.argmax(is_lost)] <= 1.0
    assert (part.rms, part.in_band, part.converged_s) == (None, None, None)
    lines = dict(line.split(": ", 1) for line in sentences("replay.verdict", replay))
    assert lines["Diverged"].startswith(f"lost: after {part.diverged_s:.0f} s")
    assert to_text(soc_screen(replay))


def test_a_replay_is_stored_and_read_back(replay, tmp_path):
    (tmp_path / "soc.json").write_text(replay.to_json())
    again = SocReplay.from_json(tmp_path / "soc.json")
    assert again.to_json() == replay.to_json()
    with pytest.raises(InputError, match="replay the record again"):
        plot_soc_replay(again)
    assert len(plot_soc_replay(replay).axes) == 1 + len(replay.scenarios)


@pytest.mark.slow
def test_without_tables_the_cell_is_that_of_the_records_temperature():
    made = make_result("so-rc")
    soc = np.linspace(0, 1, 41)
    cold = InterpolatedCurve.fit(soc, made.cell.average_ocv_v(soc) - 0.03)
    there = replace(made.cell, charge=cold, discharge=cold, capacity_ah=1.8, temperature_degc=10.0)
    cells = replace(made.cell, temperature_degc=25.0, elsewhere=(there,)), there
    window, settings = Window(initial_soc=0.9, temperature_degc=10.0), FilterSettings(tables=False)
    both, alone = (
        replay_soc(made.model_copy(update={"cell": cell}), make_record(300), window, settings)
        for cell in cells
    )
    np.testing.assert_array_equal(both.traces.estimate.soc, alone.traces.estimate.soc)
    assert both.scenarios == alone.scenarios


@pytest.mark.slow
def test_resistances_that_follow_a_temperature_that_is_not_there_are_warned_of():
    made = make_table_result()
    fit, warm = made.fit, Dependence(beta_per_k=0.03, reference_degc=20.0)
    fits = (replace(fit, tables=replace(fit.tables, dependence=warm)),)
    made = made.model_copy(update={"tables": made.tables.model_copy(update={"fits": fits})})
    told = replay_soc(made, make_record(300), Window(initial_soc=0.9)).warnings
    assert "tables.no-temperature" in [each.code for each in told]


def test_convergence_must_hold_ten_minutes_or_to_the_end():
    time_s, near = np.arange(0.0, 2000.0, 100.0), np.ones(20, bool)
    for far, at in (([0, 3], 4), (8, 9), (-2, 9), (14, 19), (slice(None), None)):
        near[far] = False
        assert converged(time_s, near) == at


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"kind": "pf"}, "`filter` 'pf' is not known; there are sum, ekf, ukf"),
        ({"soc_sd": 0.0}, "soc_sd 0 must be above 0"),
    ],
)
def test_unknown_settings_are_refused(given, says):
    with pytest.raises(InputError, match=says):
        FilterSettings(**given)
