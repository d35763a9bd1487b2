"""A voltage that is older or newer than the current of its row."""

import numpy as np
import polars as pl
import pytest
from scipy.signal import lfilter

from barnax import bundled_file, check_file
from barnax.records import read_record, record_from_frame, source_from_frame
from barnax.records.lag import find_lag, lagged
from helpers.records import CURRENT, VOLTAGE, logged, simulated_cell

R0 = 0.05
BUNDLED = read_record(bundled_file("identification"))


def bundled_late(rows):
    """The bundled drive, whose voltage stands so many rows lower."""
    table = logged(BUNDLED.time_s, -BUNDLED.current_a, BUNDLED.voltage_v)
    return table.with_columns(pl.col(VOLTAGE).shift(rows)).drop_nulls()


def log(interval_s, lag, seed=0, samples=2000, least_a=-2.0):
    """A load that switches with the log, whose voltage is so many samples older."""
    rng = np.random.default_rng(seed)
    levels = np.where(rng.random(samples) < 0.2, 0.0, rng.uniform(least_a, 3.0, samples))
    current_a = np.repeat(levels, rng.integers(2, 12, samples))[:samples]
    current_a[:5] = 0.0
    row = np.arange(samples)
    volts = simulated_cell(current_a, interval_s, r0=R0)
    volts = np.interp(row - lag, row, volts) + 5e-4 * rng.standard_normal(samples)
    return logged(interval_s * row, -current_a, volts)


@pytest.mark.parametrize("shape", [1000, (3, 1000)])
@pytest.mark.parametrize("tau", [0.8, 1000.0])
def test_a_first_order_lag_is_scipys_filter(tau, shape):
    values, kept = np.random.default_rng(0).normal(size=shape), np.exp(-1 / tau)
    expected = lfilter([0.0, 1 - kept], [1.0, -kept], values)
    np.testing.assert_allclose(lagged(values, tau), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("half", [3, 5])
@pytest.mark.parametrize("sign", [1, -1])
def test_half_a_period_of_a_simulated_load_is_no_lag(half, sign):
    current_a = 2.0 * np.resize([1.0] * half + [-1.0] * half, 3000)
    volts = simulated_cell(current_a, 1.0, r0=R0)
    record = record_from_frame(logged(np.arange(3000.0), sign * current_a, volts))
    assert (record.sign.value == "discharge-positive") is (sign > 0)
    assert not record.voltage_lag_s


@pytest.mark.parametrize("interval_s", [0.1, 1.0])
@pytest.mark.parametrize("lag", [-5, -1.4, -0.9, -0.6, -0.3, 0.3, 0.6, 0.9, 1, 1.25, 4.7])
def test_a_lag_is_shown_with_all_of_r0(interval_s, lag):
    late = find_lag(record_from_frame(log(interval_s, lag), voltage_lag=0.0))
    assert late is not None
    assert late.seconds == pytest.approx(interval_s * late.samples)
    # What the pairs answer within a sample is a part of it.
    assert R0 * 0.96 < late.ohm < (R0 + 0.01 * interval_s / 8) * 1.03
    if abs(lag) < 1:
        assert late.samples == pytest.approx(lag, abs=0.03)
    else:
        record = record_from_frame(log(interval_s, lag))
        assert record.sign.value == "charge-positive"
        assert record.voltage_lag_s == pytest.approx(interval_s * lag, abs=0.05 * interval_s)


@pytest.mark.parametrize("interval_s", [0.1, 1.0])
def test_without_a_lag_none_is_shown_and_the_current_is_as_logged(interval_s):
    table = log(interval_s, 0.0)
    record = record_from_frame(table)
    assert record.voltage_lag_s == 0.0
    assert np.array_equal(record.current_a, -table[CURRENT].to_numpy())


def test_a_pair_of_a_sample_is_no_lag():
    rng = np.random.default_rng(2)
    current_a = np.repeat(rng.uniform(-2, 3, 500), rng.integers(1, 9, 500))
    volts = simulated_cell(current_a, r0=R0, pairs=((0.2 * R0, 1.5),))
    table = logged(np.arange(len(volts)) * 1.0, -current_a, volts)
    assert record_from_frame(table).voltage_lag_s == 0.0


def test_a_given_lag_takes_the_current_that_much_earlier_and_keeps_its_charge():
    table = log(1.0, 0.4)
    raw, given = (record_from_frame(table, voltage_lag=lag) for lag in (0.0, 0.25))
    assert given.voltage_lag_s == 0.25
    mixed_a = 0.75 * raw.current_a[1:] + 0.25 * raw.current_a[:-1]
    assert given.current_a[1:] == pytest.approx(mixed_a, abs=1e-12)
    assert given.discharged_ah[-1] == pytest.approx(raw.discharged_ah[-1], abs=3.0 / 3600)


@pytest.mark.parametrize("rows", [1, 3, -2])
def test_a_check_of_a_late_voltage_finds_nothing_else(rows):
    source = source_from_frame(bundled_late(rows), "late")
    assert {each.check for each in check_file(source).findings if each.counts} == {"late voltage"}
    assert check_file(source, voltage_lag=float(rows)).is_clean


@pytest.mark.parametrize("lag", [0.6, -0.6])
def test_only_of_an_older_voltage_a_share_of_r0_is_missing(lag):
    outcome = check_file(source_from_frame(log(0.1, lag), "late"))
    (apart,) = [each for each in outcome.findings if each.code == "late-voltage.apart"]
    assert apart.values.get("missing_share") == (pytest.approx(lag, abs=0.03) if lag > 0 else None)


@pytest.mark.parametrize("every", [3, 10])
def test_a_slow_log_shows_a_row_too_late_and_takes_no_average_for_one(every):
    whole = BUNDLED.samples // every * every
    both = BUNDLED.current_a, BUNDLED.voltage_v
    amperes, volts = (values[:whole].reshape(-1, every) for values in both)

    def lag(current_a, voltage_v):
        table = logged(every * np.arange(float(len(current_a))), -current_a, voltage_v)
        known = {"current_sign": "charge-positive", "voltage_lag": 0.0}
        return find_lag(record_from_frame(table, name="slow", **known))

    actual = lag(amperes[1:, 0], volts[:-1, 0])
    assert actual is not None
    assert actual.seconds == pytest.approx(every, rel=0.05)
    for current_a in (amperes[:, 0], amperes.mean(axis=1)):
        for voltage_v in (volts[:, 0], volts.mean(axis=1)):
            assert lag(current_a, voltage_v) is None
    assert lag(amperes[:-1].mean(axis=1), volts[1:, 0]) is None


def regressed_lag(record, parts=24):
    """What a step answers a sample early, at once and late, by one regression on all samples near
    steps, and the lags by those without each part of them."""
    current_a, moved_a = record.current_a, np.diff(record.current_a)
    is_step = np.abs(moved_a) > 0.05 * np.abs(current_a).max()
    near = [k for k in range(5, len(moved_a) - 5) if is_step[max(k - 3, 0) : k + 4].any()]
    slow = [np.diff(lagged(current_a - current_a[0], tau)) for tau in (3, 10, 30, 100, 300)]
    rows = [
        [*moved_a[k - 1 : k + 2][::-1], *(each[k] for each in slow), current_a[k], 1.0]
        for k in near
    ]
    table, moved_v = np.array(rows), -np.diff(record.voltage_v)[near]
    every = np.arange(len(near))
    ohm = np.linalg.lstsq(table, moved_v)[0][:3]
    lags = []
    for part in np.array_split(every, np.linspace(0, len(near), parts + 1).astype(int)[1:-1]):
        first, at_once, last = np.linalg.lstsq(
            np.delete(table, part, axis=0), np.delete(moved_v, part)
        )[0][:3]
        lags.append((last - first) / (first + at_once + last))
    return ohm, np.array(lags)


def test_a_lag_is_shown_from_four_standard_errors_of_the_jackknife_on():
    shown, near = [], []
    for seed, noise_v in enumerate(np.geomspace(5e-3, 0.1, 24)):
        noise = noise_v * np.random.default_rng(100 + seed).standard_normal(1200)
        table = log(1.0, 0.3, seed, samples=1200).with_columns(pl.col(VOLTAGE) + noise)
        record = record_from_frame(table, voltage_lag=0.0)
        (first, at_once, last), without = regressed_lag(record)
        samples = (last - first) / (first + at_once + last)
        # Of a mean, the jackknife's squared error is (n - 1) / n times the sum of squares.
        error = np.sqrt(23 / 24 * np.sum((without - np.mean(without)) ** 2))
        is_sure, is_one_sided = 4 * error < samples, abs(first) < 0.25 * last
        lag = find_lag(record)
        assert (lag is not None) == (is_sure and is_one_sided)
        shown.append(lag is not None)
        near.append(is_one_sided and 2 * error < samples < 4 * error)
        if lag is not None:
            assert lag.samples == pytest.approx(samples, rel=1e-6)
    # Some are shown, and some are left for their error alone.
    assert sum(shown) > 4
    assert sum(near) > 2
