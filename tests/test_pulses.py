"""Pulses found in made records, and their resistances against the closed form of RC pairs."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.pulses import STANDARD_S, find_pulses, levels, pulse_samples
from helpers.reference import drop_v, filtered_response, make_record

REST_A = 0.02
ONE_RC = (0.05, ((0.03, 12.0),))
TWO_RC = (0.05, ((0.01, 2.0), (0.03, 25.0)))


def record_of(loads, circuit=ONE_RC, hold="forward", interval_s=0.1, noise_v=0.0):
    """A record of (seconds, A) after each other at 4 V, its RC pairs solved exactly."""
    r0, pairs = circuit
    current_a = np.concatenate([np.full(round(s / interval_s), a) for s, a in loads])
    time_s = interval_s * np.arange(len(current_a))
    drop = drop_v(filtered_response, interval_s, current_a, (r0, *zip(*pairs, strict=True)), hold)
    noise = np.random.default_rng(0).normal(0, noise_v, len(time_s)) if noise_v else 0.0
    return make_record(time_s, current_a, 4.0 - drop + noise, hold=hold)


def pulses_of(record):
    return find_pulses(record, 1 - record.discharged_ah / 2.0, REST_A)


def closed_form(circuit, time_s):
    r0, pairs = circuit
    return r0 + sum(r * (1 - np.exp(-time_s / tau_s)) for r, tau_s in pairs)


@pytest.mark.parametrize("circuit", [ONE_RC, TWO_RC], ids=["one RC", "two RC"])
@pytest.mark.parametrize("current_a", [2.0, -4.0])
@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_resistances_are_those_of_the_closed_form(circuit, current_a, hold):
    record = record_of([(600, 0), (32, current_a), (60, 0)], circuit, hold)
    (pulse,) = pulses_of(record)
    # A sample that ends its interval shows the step 0.1 s late.
    assert pulse.delay_s == pytest.approx(0.0 if hold == "forward" else 0.1)
    times_s = [pulse.delay_s, *STANDARD_S[1:]]
    expected = [closed_form(circuit, time_s) for time_s in times_s]
    # Linear between samples 0.1 s apart.
    assert pulse.resistance_ohm == pytest.approx(expected, rel=1e-5)
    assert pulse.current_a == pytest.approx(current_a)
    assert pulse.duration_s == pytest.approx(32.0)
    assert pulse.rest_s == pytest.approx(600.0, abs=0.11)


@pytest.mark.parametrize("share", [0.0, 0.7, 0.99])
def test_a_first_voltage_from_within_the_edge_is_no_resistance_at_once(share):
    record = record_of([(600, 0), (32, 3.0), (60, 0)], TWO_RC, noise_v=1e-4)
    first = int(np.flatnonzero(record.current_a)[0])
    voltage_v = record.voltage_v.copy()
    voltage_v[first] += (1 - share) * (voltage_v[first - 1] - voltage_v[first])
    (whole,), (pulse,) = (
        pulses_of(replace(record, voltage_v=v)) for v in (record.voltage_v, voltage_v)
    )
    assert whole.resistance_ohm[0] == pytest.approx(0.05, rel=0.01)
    assert (pulse.resistance_ohm[0] is None) == (share < 0.98)
    assert pulse.resistance_ohm[1:] == whole.resistance_ohm[1:]


def test_pulses_of_both_directions_and_rates_are_distinguished():
    one_level = [(30, 2.0), (40, 0), (10, -1.5), (40, 0), (10, 4.0), (40, 0), (10, -3.0)]
    loads = [(600, 0), *one_level, (600, 0), (1000, 1.0), (600, 0), *one_level, (600, 0)]
    pulses = pulses_of(record_of(loads, noise_v=1e-4))
    assert [round(pulse.current_a, 3) for pulse in pulses] == 2 * [2.0, -1.5, 4.0, -3.0]
    assert [round(each[0].current_a, 3) for each in levels(pulses)] == [2.0, 4.0, -1.5, -3.0]
    assert all(len(each) == 2 and each[0].soc > each[1].soc for each in levels(pulses))


def test_without_short_ones_loads_of_up_to_a_quarter_of_the_charge_are_pulses():
    loads = [part for seconds in (490, 530, 490, 490) for part in ((600, 0), (seconds, 2.0))]
    pulses = pulses_of(record_of([*loads, (600, 0)], interval_s=1.0))
    assert [round(pulse.duration_s) for pulse in pulses] == [490] * 3


def test_a_ramp_belongs_to_its_pulse_and_counts_from_its_begin():
    (pulse,) = pulses_of(record_of([(600, 0), (0.2, 0.9), (0.2, 1.5), (9.6, 2.0), (60, 0)]))
    assert pulse.current_a == pytest.approx(2.0)
    assert (pulse.duration_s, pulse.delay_s) == pytest.approx((10.0, 0.4))
    assert not pulse.is_limited


def test_a_short_pulse_ends_with_its_samples_which_begin_with_the_rest_before_it():
    record = record_of([(600, 0), (10, 2.0), (60, 0)])
    (pulse,) = pulses_of(record)
    assert [ohm is None for ohm in pulse.resistance_ohm] == [False, False, False, True, True]
    span = pulse_samples(record, pulse)
    assert record.current_a[span][0] == 0
    assert (record.current_a[span][1:-1] == 2.0).all()
    assert len(record.time_s[span]) == pytest.approx(102, abs=1)


def test_a_pulse_logged_as_means_has_no_resistance_at_once():
    fine = record_of([(600, 0), (60, 2.0), (60, 0)])
    columns = (fine.time_s, fine.current_a, fine.voltage_v)
    means = [column.reshape(-1, 50).mean(axis=1) for column in columns]
    (pulse,) = pulses_of(make_record(*means, hold="centered"))
    assert pulse.delay_s == pytest.approx(2.5)
    # The voltage's curve bends little within 5 s; there is none at once.
    shown = dict(zip(STANDARD_S, pulse.resistance_ohm, strict=True))
    assert shown[STANDARD_S[0]] is None
    times_s = [time_s for time_s, ohm in shown.items() if ohm is not None]
    assert times_s
    for time_s in times_s:
        assert shown[time_s] == pytest.approx(closed_form(ONE_RC, time_s), rel=0.02)
