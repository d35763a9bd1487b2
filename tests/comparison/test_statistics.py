"""Errors by SOC, and differences over time and over seeds."""

import numpy as np
import pytest
from scipy import stats

from barnax.comparison.statistics import compare_over_seeds, compare_over_time, errors_by_soc


def test_bands_hold_every_scored_sample_once():
    rng = np.random.default_rng(0)
    soc, error_v = rng.uniform(-0.02, 1.02, 1000), rng.normal(size=1000)
    scored = rng.random(1000) < 0.8
    bands = errors_by_soc(error_v, soc, scored)
    assert [(band.low_soc, band.high_soc) for band in bands] == [(0, 0.1), (0.1, 0.2), (0.2, 1)]
    assert sum(band.samples for band in bands) == np.count_nonzero(scored)
    squares = sum(band.samples * band.rmse_v**2 for band in bands if band.rmse_v is not None)
    assert squares == pytest.approx(np.sum(error_v[scored] ** 2))


def test_a_bands_figures_are_those_of_its_samples():
    soc, error_v = np.array([0.05, 0.1, 0.15, 0.2]), np.array([9.0, -3.0, 1.0, 9.0])
    middle = errors_by_soc(error_v, soc, np.full(4, True))[1]
    assert (middle.samples, middle.mean_v, middle.max_v) == (2, -1.0, 3.0)
    assert middle.rmse_v == pytest.approx(np.sqrt(5))


def test_a_band_without_samples_has_no_errors():
    empty = errors_by_soc(np.ones(3), np.full(3, 0.5), np.full(3, True))[0]
    assert (empty.samples, empty.rmse_v, empty.mean_v, empty.max_v) == (0, None, None, None)


def test_differences_are_of_mean_squares_and_of_rmse():
    rng = np.random.default_rng(1)
    first, second = rng.normal(0, 1, 2000), rng.normal(0, 2, 2000)
    found = compare_over_time(first, second)
    assert found.difference_v2 == pytest.approx(np.mean(first**2) - np.mean(second**2))
    rmse = np.sqrt([np.mean(first**2), np.mean(second**2)])
    assert found.difference_v == pytest.approx(rmse[0] - rmse[1])
    assert found.interval_v2[0] < found.difference_v2 < found.interval_v2[1] < 0
    assert found.interval_v[0] < found.difference_v < found.interval_v[1] < 0
    assert found.is_real


def test_the_interval_of_white_noise_is_the_normal_one():
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=(2, 20_000))
    found = compare_over_time(first, second)
    half = 1.96 * np.std(first**2 - second**2) / np.sqrt(20_000)
    assert np.ptp(found.interval_v2) / 2 == pytest.approx(half, rel=0.12)


def test_the_same_seed_draws_the_same_interval():
    first, second = np.random.default_rng(4).normal(size=(2, 500))
    assert compare_over_time(first, second, 7) == compare_over_time(first, second, 7)
    assert compare_over_time(first, second, 7) != compare_over_time(first, second, 8)


def test_seeds_are_paired_and_tested_by_wilcoxon():
    rng = np.random.default_rng(5)
    first, second = rng.normal(1.0, 0.1, 30), rng.normal(1.05, 0.1, 30)
    found = compare_over_seeds(first, second)
    assert found is not None
    assert found.median_v == np.median(first - second)
    assert found.wins + found.losses == 30
    assert found.p_value == pytest.approx(stats.wilcoxon(first, second).pvalue)


def test_one_answer_stands_beside_every_seed():
    first = np.array([1.0, 3.0, 2.0])
    found = compare_over_seeds(first, np.array([2.0]))
    assert found == compare_over_seeds(first, np.full(3, 2.0))
    assert found is not None
    assert (found.wins, found.losses) == (1, 1)


def test_two_answers_without_seeds_have_no_pairs():
    assert compare_over_seeds(np.array([1.0]), np.array([2.0])) is None
