"""The simulated cells of known truth follow their closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulated_cells.__main__ import CAUSES, Outcome
from benchmarks.simulated_cells.cells import draw, dynamic, ocv_v, voltage

from barnax.notices import Notice, kinds

PLAIN = replace(
    draw(0), r=(0.02,), tau_s=(30.0,), hysteresis="none", gap_v=0.0, lag=0.0, offset_a=0.0
)
TIME_S = np.arange(200) * 1.0
PULSE_A = np.where((TIME_S >= 10) & (TIME_S < 110), 2.0, 0.0)


def test_a_pulse_drops_by_r0_at_once_and_by_its_pair_with_its_time_constant():
    after, before = voltage(PLAIN, TIME_S, PULSE_A, 0.5, 1.0)
    into = TIME_S - 10
    soc = 0.5 - 2 * np.clip(into, 0, 100) / 3600 / PLAIN.capacity_ah
    open_v = ocv_v(soc, PLAIN.number)
    pair = 2 * 0.02 * (1 - np.exp(-into / 30))
    here = slice(10, 110)
    assert after[here] == pytest.approx((open_v - 2 * PLAIN.r0 - pair)[here], abs=1e-12)
    assert before[10] == pytest.approx(open_v[10], abs=1e-12)
    assert before[110] == pytest.approx((open_v - 2 * PLAIN.r0 - pair)[110], abs=1e-12)


@pytest.mark.parametrize(
    ("hysteresis", "left"),
    [("moving", lambda passed: np.exp(-40 * passed)), ("switched", np.zeros_like)],
)
def test_hysteresis_goes_to_the_other_branch_as_the_charge_passes(hysteresis, left):
    cell = replace(PLAIN, hysteresis=hysteresis, gap_v=0.04, rate=40.0)
    moved = (
        voltage(cell, TIME_S, PULSE_A, 0.5, 1.0)[1] - voltage(PLAIN, TIME_S, PULSE_A, 0.5, 1.0)[1]
    )
    passed = 2 * np.arange(1, 101) / 3600 / cell.capacity_ah
    assert moved[:11] == pytest.approx(0.02)
    assert moved[11:111] == pytest.approx(0.02 * (2 * left(passed) - 1))
    assert moved[111:] == pytest.approx(moved[110])


def test_a_backward_log_has_the_current_that_led_to_a_sample():
    forward, backward = (
        dynamic(replace(PLAIN, hold=hold, noise_v=0.0, step_a=1e-9))
        for hold in ("forward", "backward")
    )
    assert np.array_equal(forward["Current / A"][:-1], backward["Current / A"][1:])
    jump = np.flatnonzero(np.diff(forward["Current / A"].to_numpy()))[0]
    stepped = np.diff(forward["Voltage / V"].to_numpy())
    late = np.diff(backward["Voltage / V"].to_numpy())
    assert abs(stepped[jump]) > 5 * abs(late[jump])


@pytest.mark.parametrize("hold", [None, "backward"])
def test_a_net_counter_names_the_hold_only_where_the_other_explains_it(hold):
    values = {"ratio": 1.2, "column": "Ah", "inverse": 1 / 1.2, "hold": hold, "held_ratio": 1.0}
    warning = Notice("counters.net", values)
    cell = replace(PLAIN, hold="backward")
    wrong = Outcome(cell, "1rc", 0.1, 0.05, 0.15, (warning,))
    assert wrong.causes == ([] if hold is None else ["hold"])
    assert wrong.is_silently_wrong == (hold is None)


def test_every_code_that_names_a_cause_is_one_of_a_notice():
    assert set.union(*CAUSES.values()) <= {*kinds()}
