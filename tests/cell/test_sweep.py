"""When a sweep shows that it stopped at a cut-off, and how sweeps of several files join."""

import numpy as np
import pytest

from barnax.cell.soc_axis import Sweep, SweepPoint, join_sweeps
from barnax.errors import InputError


def sweep_at(discharged_ah, *, kind="rests", shift_ah=0.0, name="test.csv") -> Sweep:
    """A sweep with its points there; the voltage falls by half a volt an ampere-hour.

    `shift_ah` moves its axis of charge, not its voltage.
    """
    points = tuple(
        SweepPoint(float(at_ah) + shift_ah, 4.0 - 0.5 * float(at_ah), name, row, 3600.0)
        for row, at_ah in enumerate(discharged_ah)
    )
    direction = -1 if discharged_ah[-1] > discharged_ah[0] else 1
    start_ah, end_ah = points[0].discharged_ah, points[-1].discharged_ah
    return Sweep(kind, direction, name, start_ah, end_ah, points)


def by_pulses(*pulses_ah: float) -> Sweep:
    return sweep_at(np.concatenate([[0.0], np.cumsum(pulses_ah)]))


@pytest.mark.parametrize("size", [0.01, 100.0])
@pytest.mark.parametrize(
    ("last", "stops"),
    [
        ((0.1,), False),
        ((0.06,), True),
        # A taper at constant voltage follows the pulse that the cut-off shortened.
        ((0.06, 0.01), True),
        # What is no thousandth of the sweep is no pulse.
        ((1e-4,), False),
        ((0.06, 1e-4), True),
        ((0.06, 0.01, 1e-4), True),
    ],
)
def test_a_pulse_below_all_before_it_stops_at_the_cutoff(size, last, stops):
    pulses = size * np.array([*[0.1] * 9, *last])
    assert by_pulses(*pulses).stops_at_cutoff is stops
    assert by_pulses(*-pulses).stops_at_cutoff is stops


def test_a_test_with_finer_pulses_toward_both_ends_shows_no_cutoff():
    assert not by_pulses(0.05, 0.05, *[0.1] * 8, 0.05, 0.05).stops_at_cutoff


def test_a_slow_sweep_stops_at_the_cutoff():
    assert sweep_at([0.0, 1.0, 2.0], kind="slow").stops_at_cutoff


@pytest.mark.parametrize("direction", [-1, 1])
def test_parts_on_axes_of_their_own_are_joined_to_the_whole(direction):
    at_ah = np.linspace(0, 2, 10)[::-direction]
    parts = [
        sweep_at(at_ah[6:], shift_ah=0.3, name="c.csv"),
        sweep_at(at_ah[:4], name="a.csv"),
        sweep_at(at_ah[3:7], shift_ah=-0.7, name="b.csv"),
    ]
    joined = join_sweeps(parts)
    np.testing.assert_allclose([point.discharged_ah for point in joined.points], at_ah, atol=1e-12)
    assert (joined.start_ah, joined.end_ah) == pytest.approx((at_ah[0], at_ah[-1]), abs=1e-12)
    assert [point.source for point in joined.points] == ["a.csv"] * 4 + ["b.csv"] * 3 + [
        "c.csv"
    ] * 3


@pytest.mark.parametrize("begins_ah", [0.95, 1.05])
def test_parts_that_overlap_or_leave_a_gap_are_refused(begins_ah):
    upper = sweep_at(np.linspace(0, 1, 5), name="upper.csv")
    lower = sweep_at(np.linspace(begins_ah, 2, 5), name="lower.csv")
    with pytest.raises(InputError, match=r"upper.csv and lower.csv do not join"):
        join_sweeps([lower, upper])


def test_a_slow_sweep_joins_nothing():
    rests, slow = sweep_at([0.0, 1.0]), sweep_at([1.0, 2.0], kind="slow")
    with pytest.raises(InputError, match="2 discharge sweeps"):
        join_sweeps([rests, slow])
