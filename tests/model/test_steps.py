"""What steps of the current show of R0, against the closed form of RC pairs."""

import numpy as np
import pytest

from barnax.model.prepared import prepare_record
from barnax.model.window import Window
from helpers.made_cell import cell_with_ocv, ocv_v
from helpers.reference import filtered_response, make_record

R0_OHM, R_OHM, TAU_S = 0.1, (0.01, 0.015, 0.02), (4.0, 60.0, 700.0)
# A second after the one in which the current changed, of a current that flows after its sample.
SHOWN_OHM = R0_OHM + sum(r * -np.expm1(-1 / tau) for r, tau in zip(R_OHM, TAU_S, strict=True))


def titrated(noise_v=0.0, seed=0, rest_s=2400):
    """Pulses of six minutes, each with a rest, from full down to 20 % SOC."""
    current_a = np.tile(np.repeat([0.0, 1.0], [rest_s, 360]), 16)
    time_s = np.arange(float(len(current_a)))
    soc = 1.0 - np.append(0.0, np.cumsum(current_a[:-1])) / 7200
    voltage_v = ocv_v(soc) - R0_OHM * current_a
    for r_ohm, tau_s in zip(R_OHM, TAU_S, strict=True):
        voltage_v -= r_ohm * filtered_response(1.0, current_a, tau_s, "forward")
    voltage_v += noise_v * np.random.default_rng(seed).standard_normal(len(soc))
    record = make_record(time_s, current_a, voltage_v)
    window = Window(initial_soc=1.0, capacity_ah=2.0)
    return prepare_record(record, cell_with_ocv(half_gap_v=0.0), "so-rc", window)


def test_steps_show_r0_and_what_pairs_answer_in_a_second():
    prepared = titrated()
    before, after = prepared.steps
    assert len(before) == 31
    assert set(after - before) == {2}
    step_a = prepared.current_a[after] - prepared.current_a[before]
    answer_v = prepared.voltage_v[before] - prepared.voltage_v[after]
    assert np.median(answer_v / step_a) == pytest.approx(SHOWN_OHM, rel=0.03)


def test_an_answer_is_read_a_second_later_where_samples_are_dense_after_steps():
    """A row every 5 s, and several within a second of each step."""
    starts_s = np.arange(0.0, 6000.0, 60.0)
    since_s = np.array([0.0, 0.01, 0.02, 0.1, 1.0, 10.0, *np.arange(15.0, 60.0, 5.0)])
    time_s = np.add.outer(starts_s, since_s).ravel()
    current_a = np.where(time_s // 60 % 2, 0.5, 0.0)
    record = make_record(time_s, current_a, 3.7 - 0.1 * current_a)
    window = Window(initial_soc=0.9, capacity_ah=2.0)
    before, after = prepare_record(record, cell_with_ocv(half_gap_v=0.0), "so-rc", window).steps
    assert len(before) > 90
    np.testing.assert_allclose(time_s[after] - time_s[before + 1], 1.0, atol=0.02)
