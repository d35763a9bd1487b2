"""Which rests are OCV points, how far their sweeps reach, and how those of several files join."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell.ocv_points import find_rest_sweeps
from barnax.cell.soc_axis import OcvPoint, Sweep, by_direction
from barnax.errors import InputError
from helpers.ocv_tests import CAPACITY_AH, driven, pulses, stepwise

DOWN, UP = [[-0.05]] * 20, [[0.05]] * 20
# What a sweep in the other direction begins with; the SOC it begins at.
START = {-1: 1.0, +1: 0.0}


@pytest.fixture(params=["forward", "backward"])
def hold(request):
    return request.param


@pytest.fixture(params=[0.01, 100.0])
def size(request):
    """The size of the cell: what is small is small against its capacity."""
    return request.param


def sweeps_of(moves, *, size=1.0, **options):
    record = stepwise(moves, size=size, **options)
    return find_rest_sweeps(record.segments(size * CAPACITY_AH / 1000))


def extent(sweep, size=1.0):
    """Begin and end of a sweep as discharged shares of the capacity."""
    return np.array([sweep.start_ah, sweep.end_ah]) / (size * CAPACITY_AH)


def turned(direction, moves):
    """The moves, made for a discharge, in `direction`."""
    return [[-direction * share for share in shares] for shares in moves]


def test_each_rest_is_a_point_at_the_charge_moved_until_then(hold, size):
    out, back = sweeps_of(DOWN + UP, start_soc=1.0, hold=hold, size=size)
    assert (out.direction, back.direction) == (-1, 1)
    expected = np.linspace(0, 1, 21) * size * CAPACITY_AH
    np.testing.assert_allclose(out.discharged_ah, expected, atol=1e-12 * size)
    np.testing.assert_allclose(back.discharged_ah, expected[::-1], atol=1e-12 * size)
    assert {point.rest_s for point in out.points + back.points} == {3600.0}


def test_a_rest_programmed_as_30_minutes_may_end_early_by_the_clock(hold):
    (sweep,) = sweeps_of(DOWN, start_soc=1.0, hold=hold, rest_s=1799.95)
    assert len(sweep.points) == 21
    missing = sweeps_of(DOWN, start_soc=1.0, hold=hold, first_rest_s=60.0, rest_s=1790.0)
    assert missing == "its longest rest is 29.8 min"


def test_four_points_are_a_sweep_and_three_are_none(hold):
    (sweep,) = sweeps_of([[-0.1]] * 3, start_soc=1.0, hold=hold)
    assert len(sweep.points) == 4
    (sweep,) = sweeps_of([*DOWN, [0.05], [0.05]], start_soc=1.0, hold=hold)
    assert sweep.direction == -1


def test_of_several_sweeps_of_a_direction_the_one_with_the_most_points_counts():
    out, _ = sweeps_of(DOWN + UP + DOWN[:4], start_soc=1.0)
    assert len(out.points) == 21


@pytest.mark.parametrize("share", [-5e-4, 5e-4])
def test_rests_with_next_to_no_charge_between_are_one(hold, size, share):
    moves = [*DOWN[:8], [share], *DOWN[8:]]
    (sweep,) = sweeps_of(moves, start_soc=1.0, hold=hold, size=size)
    assert len(sweep.points) == 21
    # The later rest counts: it is the one that the next pulse ends.
    assert sweep.discharged_ah[8] == pytest.approx((0.4 - share) * size * CAPACITY_AH)


def test_pulses_below_a_hundredth_of_the_capacity_are_separate_points(size):
    moves = [[-1 / 150]] * 150 + [[1 / 150]] * 150
    sweeps = sweeps_of(moves, start_soc=1.0, size=size)
    assert [len(sweep.points) for sweep in sweeps] == [151, 151]


# Moves of a discharge and the SOC before them; its points, and where it begins and ends.
SWEEPS = {
    "pulses against the sweep": ([[0.005, -0.055]] * 20, 1.0, 21, (0, 1)),
    "a cycle that begins with a discharge": (
        [*DOWN[:12], [-0.02, 0.02], *DOWN[:8]],
        1.0,
        13,
        (0, 0.62),
    ),
    "a cycle that begins with a charge": (
        [*DOWN[:12], [0.02, -0.02], *DOWN[:8]],
        1.0,
        13,
        (0, 0.6),
    ),
    "no rest before it": ([[0.4, -0.05], *DOWN[1:]], 0.6, 20, (-0.4, 0.6)),
    "no rest after it": ([*DOWN[1:], [-0.05, 0.4]], 1.0, 20, (0, 1)),
}


@pytest.mark.parametrize("direction", [-1, 1])
@pytest.mark.parametrize("case", SWEEPS)
def test_a_sweep_reaches_as_far_as_its_charge_went_one_way(hold, size, direction, case):
    moves, soc, points, ends = SWEEPS[case]
    start_soc = soc if direction < 0 else 1 - soc
    (sweep,) = sweeps_of(turned(direction, moves), start_soc=start_soc, hold=hold, size=size)
    assert len(sweep.points) == points
    np.testing.assert_allclose(extent(sweep, size), -direction * np.array(ends), atol=1e-12)


def test_neighboring_sweeps_end_and_begin_at_the_rest_between_them(hold):
    # The last discharge goes a little too far and comes back before the rest.
    moves = [*DOWN[1:], [-0.055, 0.005], *UP]
    out, back = sweeps_of(moves, start_soc=1.0, hold=hold)
    np.testing.assert_allclose([extent(out), extent(back)], [[0, 1], [1, 0]], atol=1e-12)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_short_first_rest_counts_in_either_direction(hold, size, direction):
    moves, start_soc = turned(direction, DOWN), START[direction]
    (sweep,) = sweeps_of(moves, start_soc=start_soc, hold=hold, size=size, first_rest_s=60.0)
    assert len(sweep.points) == 21
    assert sweep.points[0].rest_s == 60.0


@pytest.mark.parametrize("first_v", [(0.02, 0.0), (-0.02, 0.0), (-0.12, -0.12)])
def test_a_short_first_rest_that_drifts_or_lies_below_the_next_is_left_out(first_v):
    # As made, the first rests stand at 4.150, 4.071 and 4.001 V.
    record = driven(np.zeros(2), pulses(-1))
    voltage_v = record.voltage_v.copy()
    voltage_v[:2] += first_v
    (sweep,) = find_rest_sweeps(replace(record, voltage_v=voltage_v).segments(CAPACITY_AH / 100))
    assert len(sweep.points) == 20


# Sweeps of several files


def sweep_at(discharged_ah, *, kind="rests", shift_ah=0.0, name="test.csv") -> Sweep:
    """A sweep with its points there; the voltage falls by half a volt an ampere-hour.

    `shift_ah` moves its axis of charge, not its voltage.
    """
    points = tuple(
        OcvPoint(np.nan, 4.0 - 0.5 * float(at_ah), name, row, 3600.0)
        for row, at_ah in enumerate(discharged_ah)
    )
    direction = -1 if discharged_ah[-1] > discharged_ah[0] else 1
    moved_ah = tuple(float(at_ah) + shift_ah for at_ah in discharged_ah)
    return Sweep(kind, direction, name, moved_ah[0], moved_ah[-1], moved_ah, points)


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
    steps = size * np.array([*[0.1] * 9, *last])
    assert by_pulses(*steps).stops_at_cutoff is stops
    assert by_pulses(*-steps).stops_at_cutoff is stops


def test_a_test_with_finer_pulses_toward_both_ends_shows_no_cutoff():
    assert not by_pulses(0.05, 0.05, *[0.1] * 8, 0.05, 0.05).stops_at_cutoff


@pytest.mark.parametrize("direction", [-1, 1])
def test_parts_on_separate_axes_are_joined_to_the_whole(direction):
    at_ah = np.linspace(0, 2, 10)[::-direction]
    parts = [
        sweep_at(at_ah[6:], shift_ah=0.3, name="c.csv"),
        sweep_at(at_ah[:4], name="a.csv"),
        sweep_at(at_ah[3:7], shift_ah=-0.7, name="b.csv"),
    ]
    (joined,) = by_direction(parts).values()
    np.testing.assert_allclose(joined.discharged_ah, at_ah, atol=1e-12)
    assert (joined.start_ah, joined.end_ah) == pytest.approx((at_ah[0], at_ah[-1]), abs=1e-12)
    assert [point.source for point in joined.points] == ["a.csv"] * 4 + ["b.csv"] * 3 + [
        "c.csv"
    ] * 3


@pytest.mark.parametrize("begins_ah", [0.95, 1.05])
def test_parts_that_overlap_or_leave_a_gap_are_refused(begins_ah):
    upper = sweep_at(np.linspace(0, 1, 5), name="upper.csv")
    lower = sweep_at(np.linspace(begins_ah, 2, 5), name="lower.csv")
    with pytest.raises(InputError, match=r"upper\.csv and lower\.csv do not join"):
        by_direction([lower, upper])


def test_a_slow_sweep_joins_nothing():
    rests, slow = sweep_at([0.0, 1.0]), sweep_at([1.0, 2.0], kind="slow")
    with pytest.raises(InputError, match="2 discharge sweeps"):
        by_direction([rests, slow])
