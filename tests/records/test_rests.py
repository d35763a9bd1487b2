"""Rests, their threshold, and the direction of the current through them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from barnax.records import current_direction, is_rested, rest_blocks, rest_current_a
from helpers.reference import make_record

CURRENTS = arrays(
    float, st.integers(1, 60), elements=st.sampled_from([0.0, 0.01, -0.01, 0.5, -0.5, 0.1])
)


def record_of(current_a):
    return make_record(np.arange(len(current_a)), current_a)


def test_the_rest_current_is_a_hundredth_of_the_capacity_for_a_quiet_tester():
    noise = 2e-3 * np.random.default_rng(0).standard_normal(2000)
    assert rest_current_a(record_of(noise), 2.0) == 0.02


def test_the_rest_current_is_five_times_the_noise_of_a_loud_tester():
    rng = np.random.default_rng(1)
    current = np.concatenate([8e-3 * rng.standard_normal(3000), np.full(500, 2.0)])
    assert rest_current_a(record_of(current), 2.0) == pytest.approx(5 * 8e-3, rel=0.1)


def test_slow_sweeps_and_their_steps_are_no_noise():
    current = np.repeat([0.0, 2 / 30, 0.0, -2 / 30, 0.0], 500)
    assert rest_current_a(record_of(current), 2.0) == 0.02


def test_an_offset_of_the_tester_is_a_rest():
    rested = is_rested(record_of([19e-6, -19e-6, 0.0, 0.02, 1.0]), 0.02)
    assert rested.tolist() == [True] * 3 + [False] * 2


def test_the_direction_holds_through_rests_and_starts_as_told():
    current = [0.0, 0.001, 1.0, 0.0, -0.001, -2.0, 0.001, 1.0]
    expected = [1, 1, -1, -1, -1, 1, 1, -1]
    np.testing.assert_array_equal(current_direction(record_of(current), 0.02), expected)
    assert current_direction(record_of(current), 0.02, initial=-1)[:2].tolist() == [-1, -1]


@given(current=CURRENTS, initial=st.sampled_from([-1, 1]), threshold=st.sampled_from([0.0, 0.05]))
def test_the_direction_is_that_of_a_plain_loop(current, initial, threshold):
    last, expected = initial, []
    for value in current:
        if value != 0 and abs(value) >= threshold:
            last = -1 if value > 0 else 1
        expected.append(last)
    np.testing.assert_array_equal(
        current_direction(record_of(current), threshold, initial), expected
    )


@given(current=CURRENTS)
def test_rest_blocks_cover_every_rested_sample_once_and_never_touch(current):
    record = record_of(current)
    blocks = rest_blocks(record, 0.05)
    covered = np.zeros(record.samples, int)
    for first, last in blocks:
        assert first <= last
        covered[first : last + 1] += 1
    np.testing.assert_array_equal(covered, is_rested(record, 0.05).astype(int))
    assert all(after[0] > before[1] + 1 for before, after in pairwise(blocks))
