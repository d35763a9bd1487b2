"""Rests, their threshold, and the direction of the current through them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from helpers.reference import make_record

CURRENTS = arrays(
    float, st.integers(1, 60), elements=st.sampled_from([0.0, 0.01, -0.01, 0.5, -0.5, 0.1])
)


def record_of(current_a):
    return make_record(np.arange(len(current_a)), current_a)


def test_the_rest_current_is_a_hundredth_of_the_capacity_for_a_quiet_tester():
    noise = 2e-3 * np.random.default_rng(0).standard_normal(2000)
    assert record_of(noise).rest_current_a(2.0) == 0.02


def test_the_rest_current_is_five_times_the_noise_of_a_loud_tester():
    rng = np.random.default_rng(1)
    current = np.concatenate([8e-3 * rng.standard_normal(3000), np.full(500, 2.0)])
    assert record_of(current).rest_current_a(2.0) == pytest.approx(5 * 8e-3, rel=0.1)


def test_slow_sweeps_and_their_steps_are_no_noise():
    current = np.repeat([0.0, 2 / 30, 0.0, -2 / 30, 0.0], 500)
    assert record_of(current).rest_current_a(2.0) == 0.02


@given(current=CURRENTS, initial=st.sampled_from([-1, 1]), threshold=st.sampled_from([0.0, 0.05]))
def test_the_direction_is_that_of_a_plain_loop(current, initial, threshold):
    last, expected = initial, []
    for value in current:
        if value != 0 and abs(value) >= threshold:
            last = -1 if value > 0 else 1
        expected.append(last)
    segments = record_of(current).segments(threshold)
    np.testing.assert_array_equal(segments.directions(initial), expected)


@given(current=CURRENTS)
def test_rests_cover_every_rested_sample_once_and_never_touch(current):
    segments = record_of(current).segments(0.05)
    covered = np.zeros(len(current), int)
    for first, last, _ in segments.rests:
        assert first <= last
        covered[first : last + 1] += 1
    np.testing.assert_array_equal(covered, segments.is_rested.astype(int))
    assert all(after[0] > before[1] + 1 for before, after in pairwise(segments.rests))
