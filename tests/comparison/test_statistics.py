"""Errors by SOC, differences over time and over seeds, and how their intervals are resampled."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from barnax.comparison.bootstrap import block_length, resampled_means
from barnax.comparison.result import SOC_EDGES, compare_over_seeds, compare_over_time
from barnax.uncertainty.assessment import soc_bands


def test_bands_hold_every_sample_once():
    rng = np.random.default_rng(0)
    soc, error_v = rng.uniform(-0.02, 1.02, 1000), rng.normal(size=1000)
    bands = soc_bands(soc, error_v, SOC_EDGES)
    assert [(band.low, band.high) for band in bands] == [(0, 0.1), (0.1, 0.2), (0.2, 1)]
    assert sum(band.samples for band in bands) == 1000
    squares = sum(band.samples * band.rmse_v**2 for band in bands)
    assert squares == pytest.approx(np.sum(error_v**2))
    assert sum(band.share for band in bands) == pytest.approx(1)

    soc, error_v = np.array([0.05, 0.1, 0.15, 0.2]), np.array([9.0, -3.0, 1.0, 9.0])
    middle = soc_bands(soc, error_v, SOC_EDGES)[1]
    assert (middle.samples, middle.mean_v) == (2, -1.0)
    assert middle.rmse_v == pytest.approx(np.sqrt(5))


def test_differences_are_of_mean_squares_and_of_rmse():
    rng = np.random.default_rng(1)
    first, second = rng.normal(0, 1, 2000), rng.normal(0, 2, 2000)
    actual = compare_over_time(first, second)
    assert actual.difference_v2 == pytest.approx(np.mean(first**2) - np.mean(second**2))
    rmse = np.sqrt([np.mean(first**2), np.mean(second**2)])
    assert actual.difference_v == pytest.approx(rmse[0] - rmse[1])
    assert actual.interval_v2[0] < actual.difference_v2 < actual.interval_v2[1] < 0
    assert actual.interval_v[0] < actual.difference_v < actual.interval_v[1] < 0
    assert actual.is_real


def test_the_interval_of_white_noise_is_the_normal_one():
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=(2, 20_000))
    actual = compare_over_time(first, second)
    half = 1.96 * np.std(first**2 - second**2) / np.sqrt(20_000)
    assert np.ptp(actual.interval_v2) / 2 == pytest.approx(half, rel=0.12)


def test_seeds_are_paired_and_tested_by_wilcoxon():
    rng = np.random.default_rng(5)
    first, second = rng.normal(1.0, 0.1, 30), rng.normal(1.05, 0.1, 30)
    actual = compare_over_seeds(first, second)
    assert actual is not None
    assert actual.median_v == np.median(first - second)
    assert actual.wins + actual.losses == 30
    assert actual.p_value == pytest.approx(stats.wilcoxon(first, second).pvalue)


def autoregressive(correlation, samples, seed, rows=1):
    """Noise whose neighbors are correlated, after a start that is forgotten."""
    white = np.random.default_rng(seed).standard_normal((rows, samples + 500))
    return lfilter([1.0], [1.0, -correlation], white, axis=1)[:, 500:]


# For such noise G / g(0) = 2 rho / (1 - rho^2) in the rule's own words: a closed form.
@pytest.mark.parametrize("correlation", [0.5, 0.8, 0.9])
def test_the_length_is_the_optimal_one_of_autoregressive_noise(correlation):
    samples = 20_000
    lengths = [block_length(autoregressive(correlation, samples, seed)[0])[0] for seed in range(10)]
    optimal = (1.5 * (2 * correlation / (1 - correlation**2)) ** 2 * samples) ** (1 / 3)
    assert np.mean(lengths) == pytest.approx(optimal, rel=0.1)


@pytest.mark.parametrize("length", [1, 7, 50])
def test_resampled_means_vary_as_block_means_do(length):
    series = autoregressive(0.5, 5000, 3)
    means = resampled_means(series, length, np.random.default_rng(0))[0]
    circle = np.concatenate([series[0], series[0, : length - 1]])
    blocks = np.lib.stride_tricks.sliding_window_view(circle, length).mean(axis=1)
    expected = np.std(blocks) / np.sqrt(np.ceil(5000 / length))
    # The standard deviation of 1000 draws is known to 1 / sqrt(2000).
    assert np.std(means) == pytest.approx(expected, rel=4 / np.sqrt(2000))
    assert np.mean(means) == pytest.approx(np.mean(blocks), abs=4 * expected / np.sqrt(1000))


def test_the_ends_of_a_series_count_as_much_as_its_middle():
    series = np.zeros((1, 3000))
    series[0, -200:] = 1.0
    means = resampled_means(series, 150, np.random.default_rng(0))[0]
    assert np.mean(means) == pytest.approx(200 / 3000, abs=4 * np.std(means) / np.sqrt(1000))


def test_errors_that_differ_by_rounding_are_no_real_difference():
    error_v = autoregressive(0.5, 3000, 6)[0]
    actual = compare_over_time(error_v, error_v * (1 + 1e-12))
    assert actual.interval_v[1] < 0
    assert not actual.is_real
    pairs = compare_over_seeds(np.full(30, 0.02), np.full(30, 0.02) * (1 + 1e-12))
    assert (pairs.wins, pairs.losses, pairs.p_value) == (0, 0, 1.0)


# Two rows of equal size of error: the truth is zero. 200 records; 95 % is 190, and four standard
# deviations are 12; blocks are known to cover a little less.
@pytest.mark.parametrize(
    "correlation", [*(pytest.param(each, marks=pytest.mark.slow) for each in (0.0, 0.95)), 0.7]
)
def test_intervals_cover_the_truth_as_often_as_they_say(correlation):
    covered = 0
    for seed in range(200):
        first, second = autoregressive(correlation, 3000, seed, rows=2)
        actual = compare_over_time(first, second, seed)
        (low_v, high_v), (low_v2, high_v2) = actual.interval_v, actual.interval_v2
        assert (low_v <= 0 <= high_v) == (low_v2 <= 0 <= high_v2)
        covered += not actual.is_real
    assert 172 <= covered <= 200
