"""Folders as the field has them: C/20, HPPC and drive; long pulses; folders in folders; cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import barnax
from barnax import InputError, check_file, read_record
from barnax.plan import plan
from barnax.pulses import first_pulse
from helpers.made_cell import FEW_NODES, SMALL
from helpers.shared import CASES, needs_cases
from helpers.three_tests import (
    CAPACITY_AH,
    R0_OHM,
    R_OHM,
    TAU_S,
    drive,
    long_pulses,
    made,
    pulses,
    slow_sweep,
    write,
)


def roles(planned):
    return {part.name: part.role for part in planned.parts}


def reason(planned, name):
    return next(part.reason for part in planned.parts if part.name == name)


ONE, BOTH, HPPC, DRIVE = slow_sweep(), slow_sweep(back=True), pulses(), drive(small_s=300)
# Names say nothing, and come in any order.
FORMS = {
    "both directions in one file": {"a": DRIVE, "b": BOTH, "c": HPPC},
    "both directions in two files": {
        "a": ONE,
        "b": HPPC,
        "c": DRIVE,
        "d": slow_sweep(only_back=True),
    },
    "a discharge alone": {"a": HPPC, "b": ONE, "c": DRIVE},
    "pulses after a charge": {"a": pulses(charged=True), "b": DRIVE, "c": BOTH},
    "a drive after a rest": {"a": drive(rest_s=600), "b": BOTH, "c": HPPC},
}


@pytest.mark.parametrize("form", FORMS)
def test_c20_hppc_and_drive_are_ocv_test_record_and_validation(form, tmp_path):
    for name, test in FORMS[form].items():
        write(tmp_path / f"{name}.csv", test)
    planned = plan(tmp_path)
    sweeps = {f"{name}.csv" for name, test in FORMS[form].items() if len(test[0]) < 2000}
    assert (planned.command, planned.missing) == ("identify", "")
    assert {part.name for part in planned.of_role("OCV test")} == sweeps
    (record,), (other,) = map(planned.of_role, ("identification", "validation"))
    assert (record.kind, other.kind) == ("drive cycle", "pulse test")
    assert "current steps" in record.reason
    assert "pulses, to predict from the drive" in other.reason


def test_a_small_current_before_a_drive_is_no_offset(tmp_path):
    write(tmp_path / "drive.csv", DRIVE)
    assert not [one for one in check_file(tmp_path / "drive.csv").findings if one.counts]


# Tables of two pairs as fast as they are fitted.
FAST = SMALL | {"folds": 0, "resistances_follow": "none", "nodes": FEW_NODES}


def check_cell(result, soc):
    """The result is of the made cell, and its pulses have the resistances of the closed form."""
    tables = result.fit.tables
    assert tables.tau_s == pytest.approx(TAU_S, rel=0.05)
    for name, ohm in zip(("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]"), (R0_OHM, *R_OHM), strict=True):
        assert np.mean(tables.at(name, soc)) == pytest.approx(ohm, rel=0.05)
    at_30_s = R0_OHM + sum(r * -np.expm1(-30 / t) for r, t in zip(R_OHM, TAU_S, strict=True))
    middle = next(pulse for pulse in result.pulses if pulse.soc < 0.55)
    # The OCV moves by some millivolts in 30 s of C/2 or 1C.
    assert middle.resistance_ohm[-1] == pytest.approx(at_30_s, abs=4e-3)


def test_pulses_of_12_min_show_the_circuit_and_their_resistances(tmp_path):
    time_s, current_a, voltage_v = long_pulses(minutes=12.0, rate=0.5)
    # In other units than the case, too.
    test = time_s / 3600, current_a, voltage_v
    write(tmp_path / "x.csv", test, ("time [h]", "current [mA]", "voltage [V]"), scale=1e3)
    result = barnax.identify(tmp_path / "x.csv", **FAST)
    assert len(result.pulses) == 10
    check_cell(result, np.linspace(0.2, 0.9, 20))


@needs_cases
@pytest.mark.parametrize(
    "run", [pytest.param(barnax.identify, marks=pytest.mark.slow), barnax.hppc]
)
def test_pulses_of_6_min_show_the_circuit_either_way(run):
    result = run(CASES / "cells" / "01_pulse_discharge_6min" / "pulses.csv", **FAST)
    assert len(result.pulses) == 10
    check_cell(result, np.linspace(0.2, 0.9, 20))


@given(count=st.integers(5, 14), minutes=st.sampled_from([6.0, 8.0, 12.0]))
@settings(max_examples=4)
def test_check_identify_and_hppc_agree_what_long_pulses_serve_as(count, minutes, tmp_path_factory):
    path = tmp_path_factory.mktemp("pulses") / "x.csv"
    write(path, long_pulses(minutes, rate=0.95 / count / minutes * 60, count=count))
    identification = next(role for role in check_file(path).roles if role.name == "identification")
    planned = plan(path)
    assert bool(planned.missing) != identification.is_usable
    if identification.is_usable:
        assert (planned.command, planned.parts[0].role) == ("hppc", "identification")
        pulse = first_pulse(read_record(path))
        assert pulse is not None
        assert pulse.duration_s == pytest.approx(60 * minutes, rel=0.01)
    else:
        assert identification.reason


def test_long_pulses_down_and_up_in_two_files_are_one_ocv_test_and_a_record(tmp_path):
    down = long_pulses()
    loads = [(1900, 0.0, 10), *[(360, -CAPACITY_AH, 1.0), (2400, 0.0, 10)] * 10]
    write(tmp_path / "a.csv", down)
    write(tmp_path / "b.csv", made(loads, 0.0))
    planned = plan(tmp_path)
    assert planned.command == "hppc"
    assert {part.name for part in planned.of_role("OCV test")} == {"a.csv", "b.csv"}
    (record,) = planned.of_role("identification")
    assert "current steps" in record.reason


@pytest.mark.parametrize("depth", ["", "lab/2024"])
def test_folders_with_an_ocv_test_and_a_record_each_are_cells_of_which_one_is_asked_for(
    depth, tmp_path
):
    place = tmp_path / depth
    for cell, capacity_ah in (("A", 2.5), ("B", 2.4)):
        write(place / cell / "slow" / "x.csv", slow_sweep(capacity_ah, back=True))
        write(place / cell / "fast.csv", drive(capacity_ah, rest_s=60, seed=ord(cell)))
    write(place / "B" / "more.csv", drive(2.4, rest_s=60, seed=9))
    write(place / "notes.csv", drive(2.4, rest_s=60, seed=7))
    planned = plan(tmp_path)
    assert {part.role for part in planned.parts} == {"not used"}
    assert f"of 2 cells, {place / 'A'} (2.488 Ah, 2 files), {place / 'B'} (" in planned.missing
    assert "give the folder of one" in planned.missing
    assert reason(planned, "A/slow/x.csv") == "of the cell in A"
    assert reason(planned, "notes.csv") == "beside the folders of several cells"
    with pytest.raises(InputError, match="these are files of 2 cells"):
        barnax.identify(planned)
    one = plan(place / "B")
    assert {part.name for part in one.of_role("identification")} == {"fast.csv", "more.csv"}


@pytest.mark.parametrize(
    ("scale", "stays"), [pytest.param(1.0, 2.5, marks=pytest.mark.slow), (6.8e-4, 1.7e-3)]
)
def test_a_test_of_a_cell_of_44_ah_serves_no_small_one(scale, stays, tmp_path):
    write(tmp_path / "a.csv", slow_sweep(44.0, back=True))
    write(tmp_path / "b.csv", drive(2.5, rest_s=60), scale=scale)
    write(tmp_path / "c.csv", slow_sweep(2.5), scale=scale)
    planned = plan(tmp_path)
    assert roles(planned) == {"a.csv": "not used", "b.csv": "identification", "c.csv": "OCV test"}
    assert reason(planned, "a.csv").startswith("of a cell of 43.8 Ah, and ")
    other = plan(tmp_path, capacity=44.0)
    assert other.missing
    assert "the one identified holds 43.8 Ah" in reason(other, "b.csv")


def test_files_of_other_columns_start_each_where_the_one_before_ends(tmp_path):
    test = drive(rest_s=600, minutes=120)
    write(tmp_path / "ocv.csv", BOTH)
    columns = [("time [s]", "current [A]", f"{volts} [V]") for volts in ("voltage", "U", "voltage")]
    for number, part in enumerate(np.array_split(np.arange(len(test[0])), 3)):
        test_part = tuple(values[part] for values in test)
        write(tmp_path / f"log{number}.csv", test_part, columns[number])
    planned = plan(tmp_path)
    windows = {part.name: part.window for part in planned.of_role("identification")}
    assert windows.keys() == {"log0.csv", "log1.csv", "log2.csv"}
    passed_ah = np.append(0.0, np.cumsum(test[1][:-1] * np.diff(test[0]))) / 3600
    first, second = (windows[f"log{number}.csv"].initial_soc for number in (1, 2))
    assert first is not None
    assert second is not None
    begin = len(np.array_split(np.arange(len(test[0])), 3)[0])
    assert first == pytest.approx(1 + passed_ah[begin] / CAPACITY_AH, abs=0.02)
    # The sweep counts 99.5 % of the capacity.
    moved_ah = passed_ah[2 * begin] - passed_ah[begin]
    assert second - first == pytest.approx(moved_ah / (0.995 * CAPACITY_AH), abs=1e-3)


UNEQUAL = [(1900, 0.0, 10), *[(360, CAPACITY_AH, 1.0), (2400, 0.0, 10)] * 9]


def test_of_two_sweeps_of_unequal_charge_the_longer_is_the_ocv_test_and_its_capacity_assumed(
    tmp_path,
):
    loads = [(1900, 0.0, 10), *[(360, -CAPACITY_AH, 1.0), (2400, 0.0, 10)] * 6]
    write(tmp_path / "down.csv", made(UNEQUAL))
    write(tmp_path / "up.csv", made(loads, 0.1))
    write(tmp_path / "drive.csv", drive(rest_s=600))
    planned = plan(tmp_path)
    assert roles(planned)["down.csv"] == "OCV test"
    assert roles(planned)["up.csv"] == "not used"
    assert planned.options == {}


def test_the_reason_of_an_assumed_capacity_is_what_the_ocv_test_passed(tmp_path):
    loads = [*UNEQUAL, *[(360, -CAPACITY_AH, 1.0), (2400, 0.0, 10)] * 6]
    write(tmp_path / "both.csv", made(loads))
    write(tmp_path / "drive.csv", drive(rest_s=600))
    planned = plan(tmp_path, window=barnax.Window(initial_soc=0.9))
    why = "the Ah of the longest discharge, because the OCV test passed 2.25 and 1.5 Ah"
    assert planned.reasons["capacity"] == why
