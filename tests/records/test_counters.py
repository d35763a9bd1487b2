"""The tester's own charge: counters that run on, begin anew, or count without a sign."""

import numpy as np
import pytest

from barnax.records import record_from_frame
from barnax.records.counters import Counters
from barnax.records.record import OTHER_STATE

# Three steps of ten minutes: discharge at 2 A, rest, charge at 1 A, logged every 10 s.
CURRENT_A = np.repeat([2.0, 0.0, -1.0], 60)
STEP = np.repeat([1, 2, 3], 60)
CHARGE_AH = np.concatenate([[0], np.cumsum(CURRENT_A[1:])]) * 10 / 3600
FLOWED_AH = np.diff(CHARGE_AH)


def per_step(counter_ah):
    """The counter as one that begins anew with each step."""
    start = np.searchsorted(STEP, STEP)
    before = np.where(start > 0, counter_ah[start - 1], 0)
    return counter_ah - before


def parts():
    out = np.concatenate([[0], np.cumsum(np.maximum(FLOWED_AH, 0))])
    into = np.concatenate([[0], np.cumsum(np.maximum(-FLOWED_AH, 0))])
    return into, out


MEANINGS = {
    "net, discharge positive": Counters(net_ah=CHARGE_AH),
    "net, charge positive": Counters(net_ah=-CHARGE_AH),
    "net, not from zero": Counters(net_ah=0.7 - CHARGE_AH),
    "net of each step": Counters(net_ah=per_step(CHARGE_AH)),
    "of each step, without a sign": Counters(net_ah=np.abs(per_step(CHARGE_AH))),
    "in and out": Counters(*parts()),
    "in and out of each step": Counters(*map(per_step, parts())),
    "in and out, exchanged": Counters(*parts()[::-1]),
}


@pytest.mark.parametrize("counters", MEANINGS.values(), ids=MEANINGS)
def test_a_counter_gives_the_charge_whatever_it_begins_with(counters):
    charge_ah = counters.charge_ah(FLOWED_AH, FLOWED_AH != 0)
    np.testing.assert_allclose(charge_ah - charge_ah[0], CHARGE_AH, atol=1e-12)
    # It begins where the tester's does, in the sign of the current.
    begun_ah = -0.7 if counters is MEANINGS["net, not from zero"] else 0.0
    assert charge_ah[0] == pytest.approx(begun_ah)


@pytest.mark.parametrize(
    "counters",
    [
        Counters(),
        Counters(net_ah=1000 * CHARGE_AH),
        Counters(net_ah=np.round(CHARGE_AH)),
        Counters(*parts()[:1], np.random.default_rng(0).random(180)),
    ],
    ids=["none", "another unit", "too coarse", "noise"],
)
def test_what_does_not_count_the_current_is_no_charge(counters):
    assert counters.charge_ah(FLOWED_AH, FLOWED_AH != 0) is None


def test_a_record_has_the_charge_the_cycle_and_the_state_of_its_file():
    record = record_from_frame(
        {
            "Test Time / s": 10.0 * np.arange(180),
            "Current / A": -CURRENT_A,
            "Voltage / V": 3.7 - 0.05 * CURRENT_A - 0.5 * CHARGE_AH,
            "Net Capacity / Ah": -CHARGE_AH,
            "Cycle Count / 1": np.repeat([1, 2], 90),
            "Step Type / 1": np.repeat(["CC_DChg", "Rest", "CCCV Chg", "OCV", "SIM"], 36),
        }
    )
    np.testing.assert_allclose(record.charge_ah, CHARGE_AH, atol=1e-12)
    assert record.cycle.tolist() == [1] * 90 + [2] * 90
    assert record.state.tolist() == np.repeat([1, 0, -1, 0, OTHER_STATE], 36).tolist()


# Levels of a pulse test, logged every 10 s: a rest, a pulse, a rest, and a long discharge at 1 A
# that the logger leaves out.
LEVEL_A = np.repeat([0.0, 2.0, 0.0, 1.0], [30, 6, 24, 60])
LOAD_A = np.tile(LEVEL_A, 8)
OUT_AH = np.concatenate([[0], np.cumsum(LOAD_A[:-1])]) / 360
IS_LOGGED = np.tile(LEVEL_A != 1, 8)


def anew(counter_ah, *starts):
    """The counter set to nothing at some samples."""
    return counter_ah - np.select([np.arange(960) >= start for start in starts[::-1]],
                                  [counter_ah[start] for start in starts[::-1]])  # fmt: skip


def standing(counter_ah, first, last):
    """The counter without what it should have counted between two samples, until the later one."""
    still = counter_ah.copy()
    still[first:last] = counter_ah[first]
    return still


def recorded(counter_ah, is_logged):
    """The record of the pulse test with a counter of the net charge, and what truly flowed."""
    time_s = 10.0 * np.arange(960)
    voltage_v = 4.1 - 0.4 * OUT_AH - 0.05 * LOAD_A
    frame = {"Test Time / s": time_s, "Current / A": -LOAD_A, "Voltage / V": voltage_v}
    frame["Net Capacity / Ah"] = np.round(counter_ah, 5)
    record = record_from_frame({name: values[is_logged] for name, values in frame.items()})
    return record, OUT_AH[is_logged]


@pytest.mark.parametrize(
    "counter_ah",
    [-OUT_AH, OUT_AH, anew(-OUT_AH, 490, 611), standing(-OUT_AH, 500, 516)],
    ids=["charge positive", "discharge positive", "set to zero at rest", "late"],
)
def test_discharges_between_rests_are_counted_where_none_of_them_is_logged(counter_ah):
    record, out_ah = recorded(counter_ah, IS_LOGGED)
    np.testing.assert_allclose(record.discharged_ah, out_ah, atol=2e-4)


def test_a_counter_that_stands_still_and_catches_up_adds_nothing_to_what_was_logged():
    record, out_ah = recorded(standing(-OUT_AH, 300, 476), np.full(960, True))
    np.testing.assert_allclose(record.discharged_ah, out_ah, atol=1e-9)


def test_a_counter_tells_what_passed_between_a_rest_and_a_load():
    record, out_ah = recorded(-OUT_AH, ~np.isin(np.arange(960), np.r_[400:455, 715:760]))
    np.testing.assert_allclose(record.discharged_ah, out_ah, atol=2e-4)
