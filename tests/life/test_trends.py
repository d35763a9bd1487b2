"""Trends against the same model written out by SciPy, and faults against what was planted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from barnax.life.trends import Fit, Series, Spread, fit, judge, wiener

CELLS, AGES = 30, 10
SPREAD = Spread(level=0.02, slope=0.03, bend=0.05, fleet_bend=0.1, scatter=0.004)


def fleet(rng, cells=CELLS, planted=0.0, shared=0.0):
    """A fleet whose cells have levels and slopes of their own, and its truth; the first one bends
    away by `planted` in the middle. Two errors that all estimates have in common add about
    `shared` to each."""
    age = np.sort(rng.uniform(0, 1, (cells, AGES)), axis=1)
    own = 0.01 * rng.standard_normal((cells, 1)) + 0.02 * rng.standard_normal((cells, 1)) * age
    truth = own - 0.1 * age - 0.05 * age**2
    truth[0] += planted * np.maximum(age[0] - 0.5, 0)
    variance = rng.uniform(0.003, 0.008, age.shape) ** 2
    value = truth + np.sqrt(variance + 0.003**2) * rng.standard_normal(age.shape)
    of_fleet = shared * np.stack([1 + 0.2 * rng.standard_normal(age.shape), age], axis=-1)
    value = value + of_fleet @ rng.standard_normal(2)
    known, none = np.ones(age.shape, bool), np.zeros((*age.shape, 0))
    return Series(age, value, variance, known, np.zeros_like(age), of_fleet, none), truth


def written_out(series, spread):
    """Columns of the fleet's line, the covariance of all estimates, and the fleet's part of it."""
    age, cells = series.age.ravel(), np.repeat(np.arange(len(series.age)), series.age.shape[1])
    knots = np.linspace(0, 1, 9)[1:]
    to_knots = wiener(knots, age).T @ np.linalg.inv(wiener(knots, knots))
    common = spread.fleet_bend**2 * to_knots @ wiener(knots, age)
    own = spread.level**2 + spread.slope**2 * np.outer(age, age)
    own = own + spread.bend**2 * wiener(age, age)
    noise = np.diag(spread.share**2 * series.variance.ravel() + spread.scatter**2)
    errors = [each.reshape(len(age), -1) for each in (series.of_fleet, series.of_cell)]
    of_fleet, of_cell = (each @ each.T for each in errors)
    covariance = common + of_fleet + (own + of_cell) * (cells[:, None] == cells) + noise
    return np.stack([np.ones_like(age), age], axis=1), covariance, common


@pytest.mark.parametrize("is_shared", [False, True])
def test_the_restricted_likelihood_is_that_of_the_contrasts(is_shared):
    series, _ = fleet(np.random.default_rng(0), 4, shared=0.01 * is_shared)
    if is_shared:
        series = replace(series, of_cell=0.02 * series.of_fleet[..., :1])
    value = series.value.ravel()
    collected = []
    for spread in (SPREAD, Spread(0.01, 0.02, 0.03, 0.04, 0.005, 0.7)):
        columns, covariance, _ = written_out(series, spread)
        contrasts = np.linalg.qr(columns, mode="complete")[0][:, 2:]
        density = multivariate_normal(cov=contrasts.T @ covariance @ contrasts)
        own = Fit(series, spread, np.ones(4, bool)).minus_two_log_likelihood
        collected.append(own + 2 * density.logpdf(contrasts.T @ value))
    # Up to a constant.
    assert collected[0] == pytest.approx(collected[1], abs=1e-6)


@pytest.mark.parametrize("shared", [0.0, 0.02])
def test_a_trend_is_the_best_prediction_of_the_model(shared):
    series, _ = fleet(np.random.default_rng(1), 4, shared=shared)
    columns, covariance, common = written_out(series, SPREAD)
    inverse = np.linalg.inv(covariance)
    normal = columns.T @ inverse @ columns
    beta = np.linalg.solve(normal, columns.T @ inverse @ series.value.ravel())
    here = slice(0, AGES)
    age = series.age[0]
    own = SPREAD.level**2 + SPREAD.slope**2 * np.outer(age, age) + SPREAD.bend**2 * wiener(age, age)
    link = common[here].copy()
    link[:, here] += own
    gain = link @ inverse
    value = columns[here] @ beta + gain @ (series.value.ravel() - columns @ beta)
    rest = columns[here] - gain @ columns
    variance = np.diag(common[here, here] + own - gain @ link.T)
    variance = variance + np.diag(rest @ np.linalg.inv(normal) @ rest.T)
    actual, error = Fit(series, SPREAD, np.ones(4, bool)).trend(0, age)
    np.testing.assert_allclose(actual, value, rtol=1e-7)
    np.testing.assert_allclose(error, np.sqrt(variance), rtol=1e-6)


def test_what_is_missing_changes_nothing():
    series, _ = fleet(np.random.default_rng(2), 5)
    padding = ((0, 0), (0, 3), (0, 0))
    filled = Series(*(np.pad(each, padding[: each.ndim]) for each in vars(series).values()))
    one, other = (Fit(each, SPREAD, np.ones(5, bool)) for each in (series, filled))
    assert other.minus_two_log_likelihood == pytest.approx(one.minus_two_log_likelihood)
    np.testing.assert_allclose(one.trend(2, series.age[2]), other.trend(2, series.age[2]))


@pytest.mark.parametrize("shared", [0.0, pytest.param(0.02, marks=pytest.mark.slow)])
def test_intervals_of_trends_hold_the_truth(shared):
    held = []
    # An error in common is one draw a fleet, so of that there are more and smaller ones.
    for seed in range(20 if shared else 1):
        cells = 10 if shared else 60
        series, truth = fleet(np.random.default_rng([3, seed]), cells, shared=shared)
        model = fit(series)
        for cell in range(cells):
            value, error = model.trend(cell, series.age[cell])
            held.append(np.abs(value - truth[cell]) < 1.96 * error)
    assert 0.9 <= np.mean(held) <= 0.99


def test_estimates_that_scatter_less_than_is_stated_have_narrower_trends():
    series, _ = fleet(np.random.default_rng(8))
    stated = replace(series, variance=4 * (series.variance + 0.003**2))
    actual = fit(stated)
    assert 0.5 <= actual.spread.share < 0.7
    np.testing.assert_allclose(
        actual.trend(1, series.age[1])[1], fit(series).trend(1, series.age[1])[1], rtol=0.3
    )


@pytest.mark.parametrize("planted", [-0.3, pytest.param(0.3, marks=pytest.mark.slow)])
def test_a_planted_knee_is_detected_and_its_trend_follows_it(planted):
    series, truth = fleet(np.random.default_rng(4), planted=planted)
    judged = judge(series, 0.1, np.random.default_rng(0))
    assert set(judged.faults) == {0}
    assert judged.faults[0].kind == "knee"
    assert abs(judged.faults[0].age - 0.5) < 0.15
    value, error = judged.fit.trend(0, series.age[0])
    assert np.mean(np.abs(value - truth[0]) < 3 * error) >= 0.9


@pytest.mark.slow
def test_intervals_of_an_odd_cell_hold_although_it_bends_as_no_other():
    held = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        series, truth = fleet(rng)
        bent = 0.4 * series.age[0] - 0.12 * series.age[0] ** 2
        series.value[0] += bent
        judged = judge(series, 0.1, rng)
        assert 0 in judged.faults
        value, error = judged.fit.trend(0, series.age[0])
        held.append(np.abs(value - truth[0] - bent) < 1.96 * error)
    assert np.mean(held) >= 0.85


@pytest.mark.slow
def test_a_fleet_without_faults_is_flagged_as_often_as_is_said():
    expected, fleets = 0.5, 16
    flagged = 0
    for seed in range(fleets):
        rng = np.random.default_rng([seed, 5])
        flagged += len(judge(fleet(rng)[0], expected, rng).faults)
    # Poisson of mean 8: more than 18, or none, in fewer than one of a thousand.
    assert 1 <= flagged <= 18


def test_nothing_is_odd_where_nothing_may_be_flagged():
    series, _ = fleet(np.random.default_rng(6), 3, planted=5.0)
    assert not judge(series, 0.0, np.random.default_rng(0)).faults
