"""The rule of choice against a slow one, written out block by block."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.fit.cross_validation import HeldOut
from barnax.select.policy import Gain, Policy

POLICY = Policy()


def slow_loss(loss):
    """L = 1 / (2 B) sum log S_b + 1 / (2 K) sum log S_k, with the floor of a voltmeter."""
    blocks = zip(loss.squares_v2[:, 0], loss.counts[:, 0], strict=True)
    bands = zip(loss.squares_v2.sum(axis=0), loss.counts.sum(axis=0), strict=True)
    total = 0.0
    for sums in (blocks, bands):
        logs = [math.log(squares / n + POLICY.floor_v**2) for squares, n in sums if n]
        total += sum(logs) / len(logs) / 2
    return total


def drawn(seed, blocks=40):
    """Two circuits' errors on the same blocks, of which some are empty in a band."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 90, (blocks, 3))
    counts[:, 0] += counts[:, 1:].sum(axis=1)
    counts[3] = 0
    spread = np.exp(rng.standard_normal((2, blocks, 3))) * 1e-6
    return [HeldOut(counts * own, counts) for own in spread]


@pytest.mark.parametrize("seed", range(5))
def test_the_gain_is_the_difference_of_the_losses(seed):
    simpler, richer = drawn(seed)
    gain = POLICY.gain(simpler, richer)
    assert gain.value == pytest.approx(slow_loss(simpler) - slow_loss(richer), rel=1e-12)


def test_its_standard_error_is_that_of_resampled_blocks():
    simpler, richer = drawn(1, blocks=400)
    rng, gains = np.random.default_rng(0), []
    for _ in range(400):
        own = rng.integers(0, 400, 400)
        pair = (HeldOut(loss.squares_v2[own], loss.counts[own]) for loss in (simpler, richer))
        gains.append(POLICY.gain(*pair).value)
    error = POLICY.gain(simpler, richer).standard_error
    assert error == pytest.approx(np.std(gains), rel=0.12)


@given(st.integers(0, 10_000))
def test_a_circuit_gains_nothing_on_itself_and_what_one_gains_the_other_loses(seed):
    simpler, richer = drawn(seed)
    there, back = POLICY.gain(simpler, richer), POLICY.gain(richer, simpler)
    assert there.value == pytest.approx(-back.value, abs=1e-12)
    assert there.standard_error == pytest.approx(back.standard_error, rel=1e-9)
    assert POLICY.gain(simpler, simpler).value == 0.0
    assert not (POLICY.is_better(there) and POLICY.is_better(back))


def test_errors_below_the_voltmeter_are_no_reason_for_another_circuit():
    counts = np.full((50, 3), 100)
    tiny, tinier = (HeldOut(counts * error_v**2, counts) for error_v in (1e-6, 1e-8))
    assert POLICY.gain(tiny, tinier).value < POLICY.least_gain


@pytest.mark.parametrize(
    ("gain", "is_better"),
    [(Gain(0.2, 0.1), True), (Gain(0.2, 0.14), False), (Gain(0.02, 0.001), False)],
)
def test_a_gain_is_worth_it_beyond_its_noise_and_a_trifle(gain, is_better):
    assert POLICY.is_better(gain) is is_better
