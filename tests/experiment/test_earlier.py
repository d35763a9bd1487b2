"""What earlier records show of the error of a fit: planted noise, and planted deviations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import barnax
from barnax import Evaluation, characterize, read_record
from barnax.bundled import BUNDLED
from barnax.experiment.information import LEFT_OUT_NODES, columns_of
from barnax.experiment.prior import counting, prior_of_chemistry
from barnax.model.prepared import Window, prepare_record


@pytest.fixture(scope="module")
def prepared():
    cell = characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="interpolated")
    return prepare_record(read_record(BUNDLED.record), cell, "so-rc", Window())


@pytest.fixture(scope="module")
def prior(prepared):
    known = prior_of_chemistry("nmc", prepared.capacity_ah)
    return replace(known, settings=barnax.TableSettings())


def left(prepared, prior, error_v):
    """What a fit of tables leaves of an error."""
    columns = columns_of(prior, prepared)
    tables = columns[:, : len(prior.names)]
    error_v = error_v.copy()
    error_v -= tables @ np.linalg.lstsq(tables, error_v, rcond=1e-6)[0]
    simulated_v = prepared.voltage_v - error_v
    return Evaluation(prepared, simulated_v)


def test_pairs_answer_to_the_current_between_samples_however_it_was_logged(prepared, prior):
    record = prepared.record
    logged_a = np.append(0.0, record.interval_current_a)
    backward = replace(record, current_a=logged_a, hold=replace(record.hold, value="backward"))
    twin = prepare_record(backward, prepared.cell, "so-rc", prepared.settled_window)
    np.testing.assert_array_equal(twin.held_a, prepared.held_a)
    forward, other = (
        columns_of(prior, each)[:, len(prior.names) :].reshape(
            len(each.soc), -1, len(LEFT_OUT_NODES)
        )
        for each in (prepared, twin)
    )
    # Of four other pairs, and of the resistances of both, but for what changes at once.
    answers = [0, 1, 2, 3, 5, 6]
    assert np.abs(forward[:, answers]).max(axis=(0, 2)).min() > 0
    # The charge at the start differs by what flows in a sample.
    largest = np.abs(forward[:, answers]).max()
    np.testing.assert_allclose(other[:, answers], forward[:, answers], atol=1e-3 * largest)


def correlated(rng, count, time_s, sd_v):
    kept = np.exp(-1 / time_s)
    return sd_v * np.sqrt(1 - kept**2) * lfilter([1.0], [1.0, -kept], rng.normal(size=count))


@pytest.mark.slow
def test_noise_is_distinguished_from_what_a_circuit_leaves_out(prepared, prior):
    rng = np.random.default_rng(3)
    count = len(prepared.soc)
    columns = columns_of(prior, prepared)
    left_out = columns[:, len(prior.names) :]
    collected = {}
    for size in (0.0, 0.4, 0.8):
        more_v = left_out @ rng.normal(size=left_out.shape[1]) * size
        noise_v = correlated(rng, count, 10, 2e-3) + correlated(rng, count, 200, 2e-3)
        left_v = left(prepared, prior, noise_v + more_v)
        collected[size] = counting(prior, [left_v]).error
    assert collected[0.0].left_out < 0.15
    assert collected[0.0].rest_v == pytest.approx(collected[0.0].rmse_v, rel=0.05)
    for size in (0.4, 0.8):
        assert collected[size].left_out == pytest.approx(size, rel=0.3)
        assert collected[size].rest_v < 0.95 * collected[size].rmse_v


def test_planted_noise_is_measured(prepared, prior):
    rng = np.random.default_rng(4)
    count = len(prepared.soc)
    noise_v = correlated(rng, count, 10, 2e-3) + correlated(rng, count, 200, 3e-3)
    error = counting(prior, [left(prepared, prior, noise_v)]).error
    fast, slow = (
        np.sqrt(sum(sd_v**2 for time_s, sd_v in error.noise if (time_s < 45) == is_fast))
        for is_fast in (True, False)
    )
    assert fast == pytest.approx(2e-3, rel=0.25)
    assert slow == pytest.approx(3e-3, rel=0.35)
