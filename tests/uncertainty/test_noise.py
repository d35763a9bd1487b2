"""The fitted noise against dense covariance matrices, AR(1) theory and simulation."""

import numpy as np
import pytest
from scipy.special import stdtrit

from barnax.uncertainty.noise import Slots, fit_gathered, fit_noise
from helpers.noisy_fits import colored_noise


def orthonormal(columns):
    return np.linalg.qr(columns)[0]


def followed_and_fitted(noise_v, columns, time_s, slots):
    """What a fit follows of every noise, and the noises fitted to what it leaves."""
    moved = noise_v @ columns
    left_v = (noise_v - moved @ columns.T).T
    return moved, fit_gathered(
        slots,
        counts=slots.gathered(time_s, np.ones(len(time_s))),
        errors_v=slots.gathered(time_s, left_v),
        columns=slots.gathered(time_s, columns),
        squares_v2=np.sum(left_v**2, axis=0),
    )


@pytest.fixture
def waves():
    """Columns of different speed over 400 samples: what a fit could follow."""
    time = np.arange(400.0)
    return orthonormal(np.stack([np.sin(time / 3), np.sin(time / 40), 1 + time / 400], axis=1))


@pytest.mark.parametrize("clock", ["even", "jitters", "has a gap"])
def test_every_part_spreads_over_the_columns_as_its_dense_covariance_says(waves, clock):
    time_s = np.arange(400.0)
    if clock == "jitters":
        time_s += np.random.default_rng(0).uniform(-0.02, 0.02, 400)
    if clock == "has a gap":
        time_s[250:] += 75.0
    noise = fit_noise(np.random.default_rng(1).normal(size=400), waves, time_s)
    slots = np.round(time_s - time_s[0])
    lag = np.abs(slots[:, None] - slots)
    for correlation_s, spread in zip(noise.correlation_s, noise.parts_spread, strict=True):
        dense = np.where(lag == 0, 1.0, 0.0) if correlation_s == 0 else np.exp(-lag / correlation_s)
        # The clock's slot is its median interval, which the jitter moves a little.
        np.testing.assert_allclose(spread, waves.T @ dense @ waves, rtol=5e-3, atol=5e-3)


@pytest.mark.parametrize("correlation_s", [0.0, 5.0, 60.0])
def test_the_correlation_time_is_that_of_first_order_autoregression(correlation_s):
    error_v = colored_noise(np.random.default_rng(0), 60_000, correlation_s, 5e-3)[0]
    constant = np.full((60_000, 1), 1 / np.sqrt(60_000))
    noise = fit_noise(error_v, constant, np.arange(60_000.0))
    rho = np.exp(-1 / correlation_s) if correlation_s else 0.0
    # 60,000 samples hold 500 correlation lengths of 120 s: about 10 % of error are usual.
    assert noise.correlation_time_s(1.0) == pytest.approx((1 + rho) / (1 - rho), rel=0.3)
    assert np.sqrt(noise.variance_v2.sum()) == pytest.approx(5e-3, rel=0.1)


@pytest.fixture(scope="module")
def simulated():
    """True and fitted variances of Q'u, and the degrees of freedom, over 300 noisy records."""
    time = np.arange(2000.0)
    columns = orthonormal(np.stack([np.sin(time / 30), np.sin(time / 150), time / 2000 - 0.5], 1))
    rng = np.random.default_rng(7)
    noise_v = colored_noise(rng, 2000, 60.0, 1.0, records=300)
    followed = noise_v @ columns
    fits = [
        fit_noise(each - columns @ inside, columns, time)
        for each, inside in zip(noise_v, followed, strict=True)
    ]
    lag = np.abs(time[:, None] - time)
    true = np.diag(columns.T @ np.exp(-lag / 60.0) @ columns)
    fitted = np.array([np.diag(fit.spread_v2) for fit in fits])
    freedom = np.array([[fit.degrees_of_freedom(row) for row in np.eye(3)] for fit in fits])
    return true, fitted, freedom


def test_what_the_fit_has_followed_is_given_back(simulated):
    true, fitted, _ = simulated
    ratio = np.mean(fitted, axis=0) / true
    # 300 records tell the mean to a few percent. The slowest column reads a fifth too high: parts
    # slower than the noise have variances that cannot be negative.
    assert np.all((ratio > 0.9) & (ratio < 1.3))


def test_the_degrees_of_freedom_tell_how_much_the_fitted_variance_scatters(simulated):
    _, fitted, freedom = simulated
    scatter = np.var(fitted, axis=0) / np.mean(fitted, axis=0) ** 2
    # Satterthwaite: a variance known to nu degrees of freedom scatters by 2 / nu.
    np.testing.assert_allclose(np.median(freedom, axis=0) * scatter / 2, 1.0, atol=0.5)


def test_a_fit_that_follows_much_of_every_burst_knows_its_noise_as_well_as_it_scatters():
    """As tables do in a pulse test: three unknowns a burst, and ten samples read in one slot."""
    burst, rest = np.arange(0.0, 60.0, 0.5), np.arange(90.0, 900.0, 60.0)
    here = np.append(burst, rest)
    time_s = np.concatenate([900.0 * level + here for level in range(8)])
    step = np.where(here < 60.0, np.sign(np.sin(here / 5)), 0.0)
    own = np.stack([step, np.ones(len(here)), here / 900.0 - 0.5], axis=1)
    columns = orthonormal(np.kron(np.eye(8), own))
    slots = Slots.of(time_s, max_slots=1440)
    lag = np.abs(time_s[:, None] - time_s)
    covariance = 0.3 * np.eye(len(time_s)) + np.exp(-lag / 20.0) + np.exp(-lag / 2e3)
    rng = np.random.default_rng(9)
    noise_v = rng.normal(size=(60, len(time_s))) @ np.linalg.cholesky(covariance).T
    moved, fits = followed_and_fitted(noise_v, columns, time_s, slots)
    # The step of one burst, which slow noise hardly moves, and its mean, which that does.
    for place in (0, 1):
        variance = np.array(
            [each.parts_spread[:, place, place] @ each.variance_v2 for each in fits]
        )
        knows = [each.degrees_of_freedom(np.eye(24)[place]) for each in fits[:20]]
        # No single record says that it knows next to nothing.
        assert min(knows) > 1.0
        # Satterthwaite: a variance known to nu degrees of freedom scatters by 2 / nu.
        scatter = np.var(variance) / np.mean(variance) ** 2
        assert np.median(knows) * scatter / 2 == pytest.approx(1.0, abs=0.5)
        reach = stdtrit(max(float(np.median(knows)), 1.0), 0.975) * np.sqrt(variance)
        assert np.mean(np.abs(moved[:, place]) < reach) > 0.92


def test_slow_noise_that_tables_would_follow_leaves_what_is_fast_well_determined():
    """As tables in a test of two hours: each level's mean, slope and pulses, on an even clock."""
    level = np.arange(400.0)
    own = np.stack([np.sign(np.sin(level / 6)), np.sin(level / 40), np.ones(400), level - 200], 1)
    columns = orthonormal(np.kron(np.eye(10), own))
    time_s = np.arange(4000.0)
    rng = np.random.default_rng(12)
    noise_v = sum(colored_noise(rng, 4000, each, 1e-3, records=100) for each in (0.0, 20.0, 200.0))
    moved, fits = followed_and_fitted(noise_v, columns, time_s, Slots.of(time_s))
    for place in (0, 1):
        variance = np.array([each.spread_v2[place, place] for each in fits])
        knows = np.array([each.degrees_of_freedom(np.eye(40)[place]) for each in fits])
        factor = stdtrit(np.maximum(knows, 1.0), 0.975)
        held = np.abs(moved[:, place]) < factor * np.sqrt(variance)
        # A share of 95 % scatters by 2 % over 100 records.
        assert np.mean(held) > 0.89
        # What is told is not lost to a quantile of one degree of freedom, which is 12.7.
        assert np.median(factor) < 2.7


LENGTHS = (400, 250, 300)


def joined_clock():
    """Three records on one clock, each further from the next than the longest lasts."""
    starts = np.cumsum([0, *(length - 1 + 401 for length in LENGTHS[:-1])])
    return np.concatenate(
        [start + np.arange(float(length)) for start, length in zip(starts, LENGTHS, strict=True)]
    )


def test_records_on_one_clock_are_not_joined_by_their_noise():
    rng = np.random.default_rng(4)
    samples = sum(LENGTHS)
    columns = orthonormal(np.cumsum(rng.normal(size=(samples, 3)), axis=0))
    noise = fit_noise(rng.normal(size=samples), columns, joined_clock(), longest_s=399.0)
    assert noise.correlation_s.max() == pytest.approx(100.0)
    assert noise.lags_s.max() < 200.0
    of_record = np.repeat(np.arange(len(LENGTHS)), LENGTHS)
    lag = np.abs(joined_clock()[:, None] - joined_clock())
    is_one = of_record[:, None] == of_record
    for correlation_s, spread in zip(noise.correlation_s[1:], noise.parts_spread[1:], strict=True):
        dense = np.where(is_one, np.exp(-lag / correlation_s), 0.0)
        np.testing.assert_allclose(spread, columns.T @ dense @ columns, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_empty_time_between_records_adds_no_degrees_of_freedom():
    rng = np.random.default_rng(6)
    noise_v = np.concatenate(
        [colored_noise(rng, length, 5.0, 1.0, records=400) for length in LENGTHS], axis=1
    )
    wave = orthonormal(np.sin(joined_clock() / 10)[:, None])
    fits = [
        fit_noise(each - wave[:, 0] * (each @ wave), wave, joined_clock(), longest_s=399.0)
        for each in noise_v
    ]
    fitted = np.array([fit.spread_v2[0, 0] for fit in fits])
    freedom = np.median([fit.degrees_of_freedom(np.ones(1)) for fit in fits])
    # 400 variances tell their own scatter to 7 %; counting the empty time would add 84 %.
    assert freedom * np.var(fitted) / np.mean(fitted) ** 2 / 2 == pytest.approx(1.0, abs=0.35)


def test_a_perfect_fit_leaves_no_noise(waves):
    noise = fit_noise(np.zeros(400), waves, np.arange(400.0))
    assert not noise.variance_v2.any()
    assert not noise.spread_v2.any()
    assert noise.correlation_time_s(1.0) == 1.0
