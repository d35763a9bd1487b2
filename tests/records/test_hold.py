"""When a sample's current flowed is proved by the tester's counters, or taken from its make."""

import numpy as np
import polars as pl
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.dialects import WRITERS, pulse_table
from helpers.records import arbin_rows, parquet, pulse_frame, pulses_a, read, simulated_cell


def counted(hold, *, seed=0, dtype=pl.Float64, digits=None, resets=False, net=False, sign=1.0):
    """A charge-positive record whose counters integrate the current under the given hold."""
    rng = np.random.default_rng(seed)
    current = -pulses_a(400, seed=seed)
    clock = np.cumsum(rng.uniform(0.5, 1.5, 400))
    flowed = current[1:] if hold == "backward" else current[:-1]
    moved = np.concatenate([[0], flowed * np.diff(clock) / 3600])
    charged, taken = np.cumsum(np.maximum(moved, 0)), np.cumsum(np.maximum(-moved, 0))
    if resets:
        charged[200:] -= charged[200]
        taken[200:] -= taken[200]
    columns = {
        "Test Time / s": clock,
        "Current / A": sign * current,
        "Voltage / V": simulated_cell(-current),
    }
    if net:
        columns["Net Capacity / Ah"] = charged - taken
    else:
        columns |= {"Charging Capacity / Ah": charged, "Discharging Capacity / Ah": taken}
    frame = pl.DataFrame(columns)
    counters = [name for name in frame.columns if "Capacity" in name]
    frame = frame.with_columns(pl.col(counters).cast(dtype))
    return frame if digits is None else frame.with_columns(pl.col(counters).round(digits))


def decided(folder, frame, **options):
    return read(folder, parquet(frame), "cell.parquet", **options).hold


@given(
    hold=st.sampled_from(["forward", "backward"]),
    seed=st.integers(0, 2**32 - 1),
    dtype=st.sampled_from([pl.Float64, pl.Float32]),
    digits=st.sampled_from([None, 5]),
    resets=st.booleans(),
    net=st.booleans(),
    sign=st.sampled_from([1.0, -1.0]),
)
# The net counter begins anew at nearly zero, where its fall looks like any other interval.
@example("backward", 60545, pl.Float32, 5, True, True, -1.0)
def test_counters_prove_the_hold(tmp_path_factory, hold, seed, dtype, digits, resets, net, sign):
    frame = counted(hold, seed=seed, dtype=dtype, digits=digits, resets=resets, net=net, sign=sign)
    decision = decided(tmp_path_factory.mktemp("hold"), frame)
    assert (decision.value, decision.strength) == (hold, "strong")
    assert "counters" in decision.reason


def test_without_counters_the_hold_is_assumed_forward(tmp_path):
    decision = decided(tmp_path, pulse_frame())
    assert (decision.value, decision.strength) == ("forward", "assumed")


def test_without_proof_an_arbin_record_is_held_backward(tmp_path):
    header, *rows = arbin_rows(pulse_frame())
    frame = pl.DataFrame(rows, schema=header, orient="row").drop(
        "Charge_Capacity(Ah)", "Discharge_Capacity(Ah)"
    )
    decision = decided(tmp_path, frame)
    assert (decision.value, decision.strength) == ("backward", "weak")


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_one_change_of_step_counted_decides_before_the_make_does(tmp_path, hold):
    # A rest, and 2 A from the eleventh row on, whose first interval is or is not counted.
    current_a = np.repeat([0.0, 2.0], 10)
    flowed_a = current_a[1:] if hold == "backward" else current_a[:-1]
    charged_ah = np.concatenate([[0], np.cumsum(flowed_a)]) / 3600
    frame = pl.DataFrame(
        {
            "Data Point": np.arange(20),
            "Test Time (s)": np.arange(20.0),
            "Step Index": np.repeat([1, 2], 10),
            "Current (A)": current_a,
            "Voltage (V)": 3.7 + 0.05 * current_a + 1e-3 * np.arange(20),
            "Charge Capacity (Ah)": charged_ah,
            "Discharge Capacity (Ah)": 0.0,
        }
    )
    decision = decided(tmp_path, frame)
    assert (decision.value, decision.strength) == (hold, "weak")
    assert "at 1 change of step" in decision.reason


def test_a_column_of_mean_currents_is_held_backward(tmp_path):
    decision = read(tmp_path, WRITERS["BioLogic .mpt"](pulse_table())).hold
    assert (decision.value, decision.strength) == ("backward", "weak")
    assert "'<I>/mA' is the mean current" in decision.reason


def test_steps_in_time_with_the_log_outweigh_a_cycle_on_another_clock(tmp_path):
    frame = counted("backward")
    # Inside the cycle the current switches halfway between samples, at step changes with them.
    halfway = counted("forward")
    names = ["Charging Capacity / Ah", "Discharging Capacity / Ah"]
    mixed = frame.with_columns((frame[name] + halfway[name]) / 2 for name in names)
    step = np.ones(400, int)
    jumps = np.flatnonzero(np.diff(frame["Current / A"].to_numpy()))[:6] + 1
    for k, jump in enumerate(jumps):
        step[jump:] = k + 2
        for name in names:
            values, exact = mixed[name].to_numpy().copy(), frame[name].to_numpy()
            gain = exact[jump] - exact[jump - 1]
            values[jump:] += gain - (values[jump] - values[jump - 1])
            mixed = mixed.with_columns(pl.Series(name, values))
    decision = decided(tmp_path, mixed.with_columns(pl.Series("Step Index / 1", step)))
    assert (decision.value, decision.strength) == ("backward", "strong")
    assert "neither sampling agrees" in decision.reason


def test_counters_halfway_between_the_holds_prove_nothing(tmp_path):
    backward, forward = counted("backward"), counted("forward")
    names = ["Charging Capacity / Ah", "Discharging Capacity / Ah"]
    frame = backward.with_columns((backward[name] + forward[name]) / 2 for name in names)
    assert decided(tmp_path, frame).strength == "assumed"


def test_a_given_hold_is_taken_and_the_proof_against_it_reported(tmp_path):
    decision = decided(tmp_path, counted("backward"), current_hold="forward")
    assert (decision.value, decision.strength) == ("forward", "given")
    assert "although" in decision.reason
