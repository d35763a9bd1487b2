"""What slow OCV sweeps lose under load, on cells whose circuit, OCV and hysteresis are known."""

import numpy as np
import pytest

from barnax import Window, characterize, find_global_optimum, make_problem, read_record
from barnax.global_optimum.assumptions import without_sweep_drop
from helpers.ocv_tests import CAPACITY_AH, KNOTS, average_v
from helpers.reference import drop_v, filtered_response, make_record

R0_OHM, R_OHM, TAU_S = 0.03, (0.015, 0.02), (15.0, 200.0)
INNER = np.linspace(0.1, 0.9, 33)
# Linear between the knots of the fitted segments.
SHAPE = (0.5, 1.0, 1.0, 1.0, 0.5, 0.2)


def made(interval_s, current_a, start_soc, half_gap_v, direction, name):
    """The record of a cell whose hysteresis of so many V switches with the current."""
    current_a = np.asarray(current_a, float)
    time_s = interval_s * np.arange(len(current_a))
    soc = start_soc - np.append(0.0, np.cumsum(current_a[:-1])) * interval_s / 3600 / CAPACITY_AH
    moving = np.maximum.accumulate(np.where(current_a != 0, np.arange(len(current_a)), 0))
    last = np.where(current_a[moving] == 0, direction, -np.sign(current_a[moving]))
    ocv_v = average_v(soc) + last * half_gap_v * np.interp(soc, KNOTS, SHAPE)
    drop = drop_v(filtered_response, interval_s, current_a, (R0_OHM, R_OHM, TAU_S))
    return make_record(time_s, current_a, ocv_v - drop, name=name)


def sweep(hours, direction, half_gap_v):
    rest, load = np.zeros(360), np.full(360 * hours, -direction * CAPACITY_AH / hours)
    start_soc = float(direction < 0)
    currents_a = [rest, load, rest]
    return made(10.0, np.concatenate(currents_a), start_soc, half_gap_v, -direction, f"{direction}")


def problem_of(hours, half_gap_v, circuit="iso-rc", directions=(-1, 1)):
    """A cell's problem as slow sweeps show it, from full down to 20 % by a drive cycle."""
    tests = [sweep(hours, each, half_gap_v) for each in directions]
    cell = characterize(tests, ocv_fit="interpolated")
    rng = np.random.default_rng(0)
    levels = rng.choice([0.0, 1.0, 2.0, 4.0, -1.0], 300)
    levels *= 0.8 * CAPACITY_AH * 3600 / (20 * levels.sum())
    record = made(1.0, np.append(0.0, np.repeat(levels, 20)), 1.0, half_gap_v, 1, "drive")
    window = Window(initial_soc=1.0, initial_direction=1)
    return make_problem(record, cell, circuit, window=window, objective="compressed")


@pytest.mark.parametrize(("hours", "half_gap_v"), [(20, 0.0), (10, 0.0), (20, 0.01), (10, 0.01)])
def test_the_drop_of_a_sweep_is_no_hysteresis(hours, half_gap_v):
    at_rest = without_sweep_drop(problem_of(hours, half_gap_v))
    actual = find_global_optimum(at_rest, prove=False).parameters
    assert (actual.r0, *actual.r) == pytest.approx((R0_OHM, *R_OHM), rel=0.03)
    gap_v = half_gap_v * np.interp(INNER, KNOTS, SHAPE)
    np.testing.assert_allclose(at_rest.cell.hysteresis_v(INNER) / 2, gap_v, atol=1e-3)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_sweep_in_one_direction_gives_the_ocv_at_rest(direction):
    at_rest = without_sweep_drop(problem_of(15, 0.0, "so-rc", [direction])).cell
    np.testing.assert_allclose(at_rest.average_ocv_v(INNER), average_v(INNER), atol=0.5e-3)


def test_the_drop_is_taken_out_once_and_rests_have_none(bundled_record, bundled_cell):
    at_rest = without_sweep_drop(problem_of(20, 0.0))
    assert without_sweep_drop(at_rest) is at_rest
    by_rests = make_problem(bundled_record, bundled_cell, window=Window(score_to_s=600.0))
    assert without_sweep_drop(by_rests) is by_rests


def test_the_hysteresis_of_an_lfp_cell_stays(real_data):
    folder = real_data / "plett-a123-26650"
    tests = [read_record(folder / f"ocv-{name}_25degC.parquet") for name in ("s1", "s3")]
    cell = characterize(tests, ocv_fit="interpolated")
    record = read_record(folder / "dyn-s1_25degC.parquet")
    window = Window(score_to_s=record.time_s[0] + 6000.0)
    problem = make_problem(record, cell, "esc", window=window, objective="compressed")
    left_v = without_sweep_drop(problem).cell.hysteresis_v(INNER)
    # C/30 through 25 to 70 mOhm on both ways, out of a gap of 39 mV.
    assert np.mean(cell.hysteresis_v(INNER) - left_v) == pytest.approx(7e-3, abs=3.5e-3)
