"""Starts that files of the field begin with: noise, loads, a given SOC, and what a result is of."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

import barnax
from barnax import Job, assess, find_global_optimum, make_problem, read_record
from barnax.bundled import BUNDLED
from barnax.cell import characterize, read_ocv_test
from barnax.cell.ocv_points import find_rest_sweeps
from barnax.identification.setup import with_joint_starts
from barnax.model.prepared import prepare_record
from barnax.model.window import Window, mean_at_rest
from barnax.plan.running import prepare_pulse_tests
from helpers.problems import drive_a, simulated_record
from helpers.reference import make_record
from helpers.shared import CASES, needs_cases


def codes(prepared):
    return {notice.code for notice in prepared.warnings}


def loaded(cell, soc, rest_s=0, samples=1500, interval_s=2.0):
    """A drive that begins with so long a rest, and its true state of charge."""
    current_a = np.append(np.zeros(round(rest_s / interval_s)), drive_a(samples, seed=4) + 0.1)
    record = simulated_record(cell, interval_s * np.arange(len(current_a)), current_a, soc, 1.0)
    return record, soc - record.discharged_ah / cell.capacity_ah


# The rest at the start


def cell_of(folder):
    return characterize([read_ocv_test(folder / "ocv.csv")], capacity_ah=2.5)


@needs_cases
def test_a_noisy_rest_tells_the_start_by_its_mean_and_denies_no_given_one():
    folder = CASES / "cells" / "03_noisy_start"
    record = read_record(folder / "noisy.csv")
    cell = cell_of(folder)
    start = prepare_record(record, cell, "so-rc").start
    assert start.soc == pytest.approx(0.9, abs=0.005)
    assert 0.004 < start.soc_sd < 0.015
    given_soc = prepare_record(record, cell, "so-rc", Window(initial_soc=0.9))
    assert codes(given_soc) == set()
    # 30 mV of noise move no mean of ten samples by 0.1.
    doubted = prepare_record(record, cell, "so-rc", Window(initial_soc=0.8))
    assert codes(doubted) == {"start.other-soc"}


TRUTH = {"R0 [Ohm]": 0.025, "R1 [Ohm]": 0.015, "tau1 [s]": 20.0}


@needs_cases
def test_start_and_circuit_are_fitted_together():
    folder = CASES / "cells" / "03_noisy_start"
    options = {"model": "1rc", "capacity": 2.5, "seeds": 0}
    actual = barnax.identify(folder / "noisy.csv", ocv=folder / "ocv.csv", **options)
    for name, truth in TRUTH.items():
        estimate = actual.constant.assessment.uncertainty[name]
        assert estimate.low < truth < estimate.high
        # A start that only its rest tells leaves more than a thousand.
        assert estimate.high / estimate.low < 4
    assert not any(told.code.startswith("start.") for told in actual.warnings)
    part = actual.of_role("identification")[0]
    registration = part.window.registration
    assert registration.by == "circuit"
    assert registration.soc_low < 0.9 < registration.soc_high
    told = prepare_record(read_record(folder / "noisy.csv"), cell_of(folder), "so-rc").start
    assert (registration.given_soc, registration.given_sd) == (told.soc, told.soc_sd)


def test_intervals_hold_the_truth_with_a_start_that_noise_hides(bundled_cell):
    current_a = np.append(np.zeros(10), 0.75 * drive_a(4200, seed=1, interval=60))
    time_s = np.arange(float(len(current_a)))
    pair_a = lfilter([0, 1 - np.exp(-1 / 20)], [1, -np.exp(-1 / 20)], current_a)
    charge_ah = np.append(0, np.cumsum(current_a[:-1])) / 3600
    source_v = bundled_cell.average_ocv_v(0.6 - charge_ah / bundled_cell.capacity_ah)
    voltage_v = source_v - 0.025 * current_a - 0.015 * pair_a
    missed, widest = 0, 0.0
    for seed in range(5):
        noise_v = 0.03 * np.random.default_rng(seed).standard_normal(len(time_s))
        record = make_record(time_s, current_a, voltage_v + noise_v)
        problem = with_joint_starts(make_problem([record], bundled_cell, "1rc"))
        assert problem.prepared_records[0].start.soc == pytest.approx(0.6, abs=0.01)
        optimum = find_global_optimum(problem, prove=False).parameters
        estimates = assess(problem, optimum).uncertainty
        for name, truth in TRUTH.items():
            estimate = estimates[name]
            missed += not estimate.low < truth < estimate.high
        widest = max(widest, estimates["R1 [Ohm]"].high / estimates["R1 [Ohm]"].low)
    # Of fifteen intervals of 95 %, three are missed once in 28.
    assert missed <= 2
    assert widest < 4


@given(st.integers(0, 10**6), st.integers(2, 400), st.floats(1e-4, 0.05), st.floats(0.2, 0.9))
def test_the_mean_of_a_rest_is_within_its_error(bundled_cell, seed, samples, noise_v, soc):
    noise = np.random.default_rng(seed).standard_normal(samples)
    voltage_v = float(bundled_cell.average_ocv_v(np.array([soc]))[0]) + noise_v * noise
    current_a = np.append(np.zeros(samples), 1.0)
    record = make_record(np.arange(samples + 1.0), current_a, np.append(voltage_v, 3.0))
    mean_v, sd_v = mean_at_rest(record.segments(0.02), 0)
    # By the noise that is there, for that of two samples is hardly known.
    assert abs(mean_v - voltage_v.mean() + noise_v * noise.mean()) < 10 * noise_v
    if samples >= 30:
        assert sd_v < 4 * noise_v / np.sqrt(samples) or sd_v <= 1e-4
        true_v = float(bundled_cell.average_ocv_v(np.array([soc]))[0])
        assert abs(mean_v - true_v) < 7 * sd_v


def test_a_rest_that_drifts_is_read_near_the_start():
    time_s = np.arange(2001.0)
    voltage_v = 3.8 - 0.1 * np.exp(-time_s / 400)
    record = make_record(time_s, np.where(time_s < 2000, 0.0, 1.0), voltage_v)
    for at in (0, 500, 1999):
        assert mean_at_rest(record.segments(0.02), at)[0] == pytest.approx(voltage_v[at], abs=1e-3)


def test_one_sample_without_current_is_no_rest(real_data):
    """A cycler's first row, measured at once after something else; all reach full later."""
    folder = real_data / "calce-inr18650-20r"
    test = folder / "ocv-incremental_25degC_SP20-3.parquet"
    cell = characterize([read_record(test)], capacity_ah=2.0, ocv_fit="interpolated")
    for name in ("dst_25degC_50soc", "us06_25degC_80soc", "dst_25degC_80soc"):
        record = read_record(folder / f"{name}_SP20-2.parquet")
        prepared = prepare_record(record, cell, "so-rc")
        assert prepared.start.soc_source == "full end"
        # The charges end full.
        assert prepared.soc.max() == pytest.approx(1.0, abs=0.01)


def test_the_last_rest_of_a_test_may_lack_the_interval_that_no_sample_shows():
    # Every 10 s: 30 min of rest, 6 min of 1 A, five times, and the last row is of the last rest.
    current_a = np.append(np.zeros(180), np.tile(np.repeat([1.0, 0.0], [36, 180]), 5))
    time_s = 10.0 * np.arange(len(current_a))
    soc = 1 - np.append(0.0, np.cumsum(current_a[:-1])) / 360 / 0.6
    points = {}
    for short in (0, 2):
        rows = slice(0, len(time_s) - short)
        record = make_record(time_s[rows], current_a[rows], 3.2 + soc[rows])
        points[short] = len(find_rest_sweeps(record.segments(0.01))[0].points)
    # 1,790 s by the stamps, and 1,770 s.
    assert points == {0: 6, 2: 5}
    # What comes after an hour of load has not rested for an hour.
    time_s, current_a = 3600.0 * np.arange(11), np.append(np.tile([0.0, 0.1], 5), 0.0)
    soc = 1 - np.append(0.0, np.cumsum(current_a[:-1])) / 0.6
    record = make_record(time_s, current_a, 3.2 + soc)
    assert len(find_rest_sweeps(record.segments(0.01))[0].points) == 5


@pytest.mark.slow
def test_a_given_soc_is_that_of_the_first_row_where_a_pulse_test_starts_later():
    record = read_record(BUNDLED.hppc[1])
    job = prepare_pulse_tests(Job(records=BUNDLED.hppc[1], window=Window(initial_soc=0.9)))
    window = job.window[record.name]
    at = int(np.searchsorted(record.time_s, window.start_time_s))
    assert 0 < at < record.samples
    moved_ah = float(np.sum(record.current_a[:at] * np.diff(record.time_s)[:at])) / 3600
    capacity_ah = characterize([record], ocv_fit="interpolated").capacity_ah
    assert window.initial_soc == pytest.approx(0.9 - moved_ah / capacity_ah, abs=1e-4)


def test_a_given_soc_is_counted_to_a_start_that_is_moved(bundled_cell):
    record, _ = loaded(bundled_cell, 0.6, rest_s=2000)
    relaxing_v = record.voltage_v - 0.03 * np.exp(-record.time_s / 300) * (record.time_s < 2000)
    current_a = np.where(record.time_s < 2000, 0.003, record.current_a)
    record = replace(record, current_a=current_a, voltage_v=relaxing_v)
    prepared = prepare_record(record, bundled_cell, "so-rc", Window(initial_soc=0.6))
    assert prepared.first == 999
    counted = 0.003 * 999 * 2.0 / 3600 / bundled_cell.capacity_ah
    assert prepared.start.soc == pytest.approx(0.6 - counted, abs=1e-9)
    at_start = Window(initial_soc=0.6, start_time_s=float(record.time_s[999]))
    assert prepare_record(record, bundled_cell, "so-rc", at_start).start.soc == 0.6


# A SOC that is given


@pytest.mark.parametrize(("given_soc", "is_denied"), [(0.7, False), (0.5, True)])
def test_a_later_rest_denies_a_given_soc(bundled_cell, given_soc, is_denied):
    first, _ = loaded(bundled_cell, 0.7)
    current_a = np.concatenate([first.current_a, np.zeros(1000), np.ones(50)])
    record = simulated_record(bundled_cell, 2.0 * np.arange(len(current_a)), current_a, 0.7, 1.0)
    prepared = prepare_record(record, bundled_cell, "so-rc", Window(initial_soc=given_soc))
    denials = [notice.values for notice in prepared.warnings if notice.code == "start.other-soc"]
    assert len(denials) == is_denied
    for denial in denials:
        assert denial["start_row"] == record.row[2499]
        counted = record.discharged_ah[2499] / bundled_cell.capacity_ah
        assert denial["rested_soc"] == pytest.approx(0.7 - counted, abs=0.01)


# A record under load


# A result's windows and starts


@pytest.mark.slow
def test_every_way_to_a_record_gives_the_same_start(tmp_path):
    window = {BUNDLED.record.name: Window(initial_soc=0.98, score_to_s=1500.5)}
    given = {"ocv": BUNDLED.ocv, "validate": BUNDLED.validation, "window": window}
    result = barnax.identify(BUNDLED.record, **given, model="so-rc", seeds=0)
    (identified,), (validated,) = map(result.of_role, ("identification", "validation"))
    assert (identified.start.soc, identified.samples) == (0.98, 1501)
    for part, path in ((identified, BUNDLED.record), (validated, BUNDLED.validation)):
        frame = pl.read_parquet(path)
        for given_record in (path, frame, read_record(path)):
            prepared = result.validate(given_record).prepared
            assert prepared.start.soc == part.start.soc
            assert prepared.scored.sum() == part.samples
        replayed = barnax.replay_soc(result, path)
        assert replayed.start.soc == part.start.soc
    assert validated.start.soc != 0.98
    # Another record of the same name has a start of its own.
    path = tmp_path / BUNDLED.record.name
    pl.read_parquet(BUNDLED.validation).head(9000).write_parquet(path)
    prepared = result.validate(path).prepared
    assert prepared.start.soc == validated.start.soc
    assert prepared.scored.sum() == 9000
