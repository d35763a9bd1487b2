"""Which rests are OCV points, how far their sweeps reach, and how those of several files join."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell.ocv_points import find_rest_sweeps
from barnax.cell.soc_axis import Sweep, SweepPoint, join_sweeps
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
    return find_rest_sweeps(record, rest_current_a=size * CAPACITY_AH / 1000)


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
    np.testing.assert_allclose([p.discharged_ah for p in out.points], expected, atol=1e-12 * size)
    np.testing.assert_allclose(
        [p.discharged_ah for p in back.points], expected[::-1], atol=1e-12 * size
    )
    assert {point.rest_s for point in out.points + back.points} == {3600.0}


@pytest.mark.parametrize("direction", [-1, 1])
def test_pulses_against_the_sweep_neither_end_nor_extend_it(hold, size, direction):
    moves = turned(direction, [[0.005, -0.055]] * 20)
    (sweep,) = sweeps_of(moves, start_soc=START[direction], hold=hold, size=size)
    assert len(sweep.points) == 21
    np.testing.assert_allclose(extent(sweep, size), [0, -direction], atol=1e-12)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_sweep_that_begins_without_a_rest_begins_where_the_charge_turned(hold, direction):
    moves = turned(direction, [[0.4, -0.05], *DOWN[1:]])
    (sweep,) = sweeps_of(moves, start_soc=0.5 - 0.1 * direction, hold=hold)
    assert len(sweep.points) == 20
    np.testing.assert_allclose(extent(sweep), [0.4 * direction, -0.6 * direction], atol=1e-12)


@pytest.mark.parametrize("first_v", [(0.02, 0.0), (-0.02, 0.0), (-0.12, -0.12)])
def test_a_short_first_rest_that_drifts_or_lies_below_the_next_is_left_out(first_v):
    # As made, the first rests stand at 4.150, 4.071 and 4.001 V.
    record = driven(np.zeros(2), pulses(-1))
    voltage_v = record.voltage_v.copy()
    voltage_v[:2] += first_v
    (sweep,) = find_rest_sweeps(replace(record, voltage_v=voltage_v), CAPACITY_AH / 100)
    assert len(sweep.points) == 20


# Sweeps of several files


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
    steps = size * np.array([*[0.1] * 9, *last])
    assert by_pulses(*steps).stops_at_cutoff is stops
    assert by_pulses(*-steps).stops_at_cutoff is stops


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
