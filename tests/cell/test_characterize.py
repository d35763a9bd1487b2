"""OCV tests of a cell whose OCV and hysteresis are known: branches, SOC and capacity."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.cell import OcvPoint, OcvTable, characterize, read_ocv_table
from barnax.errors import InputError
from barnax.records import source_from_frame
from helpers.golden import require_golden
from helpers.ocv_tests import (
    CAPACITY_AH,
    ONE,
    REST,
    SOC,
    TWO,
    W_NODES_V,
    average_v,
    between_cutoffs,
    both_ways,
    branch_v,
    charge_only,
    conditioned,
    discharge_only,
    driven,
    pulses,
    slow_sweep,
    steady,
)
from helpers.records import pulse_frame

GRID = np.linspace(0.0, 1.0, 21)
NODE_SOC = np.array([0.0, 0.1, 0.35, 0.95, 1.0])


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_a_test_both_ways_gives_branches_capacity_and_hysteresis_back(hold):
    cell = characterize([both_ways(hold)], ocv_fit="interpolated")
    np.testing.assert_allclose(cell.discharge(GRID), branch_v(GRID, -1), atol=1e-9)
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, +1), atol=1e-9)
    assert cell.capacity_ah == pytest.approx(CAPACITY_AH, rel=1e-9)
    np.testing.assert_allclose(cell.hysteresis_v(NODE_SOC), W_NODES_V, atol=1e-7)
    gap_v = branch_v(GRID, +1) - branch_v(GRID, -1)
    np.testing.assert_allclose(cell.branch_gap_v(GRID), gap_v, atol=1e-9)


def test_between_branches_lies_what_was_measured_unless_they_are_polynomials():
    """A bump that five segments cannot follow, as LFP has one at 30 %, and branches that cross."""
    soc = np.linspace(0.0, 1.0, 41)
    half_v = 0.01 + 0.03 * np.exp(-(((soc - 0.3) / 0.05) ** 2)) - 0.02 * (soc > 0.9)
    branches = {
        way: tuple(
            OcvPoint(x, v, "", 1, 3600.0)
            for x, v in zip(soc.tolist(), (3 + soc + way * half_v).tolist(), strict=True)
        )
        for way in (1, -1)
    }
    tests = [OcvTable("known", branches, "")]
    cell = characterize(tests, capacity_ah=2.0)
    np.testing.assert_allclose(cell.branch_gap_v(soc), np.maximum(2 * half_v, 0.0), atol=1e-12)
    assert cell.hysteresis_v(soc)[12] < 0.6 * cell.branch_gap_v(soc)[12]
    fitted = characterize(tests, capacity_ah=2.0, ocv_fit="polynomial")
    np.testing.assert_array_equal(fitted.branch_gap_v(soc), fitted.hysteresis_v(soc))
    # So between two temperatures.
    both = replace(
        fitted, temperature_degc=0.0, elsewhere=(replace(fitted, temperature_degc=25.0),)
    )
    np.testing.assert_allclose(both.at(12.5).branch_gap_v(soc), fitted.hysteresis_v(soc), atol=1e-9)


def test_between_temperatures_the_measured_points_are_those_of_the_nearer_test():
    cold, warm = (
        replace(characterize([OcvTable(name, branches, "")], capacity_ah=ah), temperature_degc=degc)
        for name, low, ah, degc in (("cold", 0.1, 1.8, 0.0), ("warm", 0.0, 2.0, 25.0))
        for soc in [np.linspace(low, 1.0, 41)]
        for branches in [{0: tuple(OcvPoint(x, 3 + x, name, 1, 3600.0) for x in soc.tolist())}]
    )
    cell = replace(cold, elsewhere=(warm,))
    for degc, low in ((10.0, 0.1), (15.0, 0.0)):
        between = cell.at(degc)
        assert between.temperature_degc == pytest.approx(degc)
        assert between.capacity_ah == pytest.approx(1.8 + 0.2 * degc / 25)
        assert between.soc_range == (low, 1.0)


@given(st.integers(8, 40), st.floats(0.3, 100.0))
def test_any_number_of_pulses_and_any_capacity_recover_the_average(count, size):
    record = both_ways(count=count)
    scaled = replace(record, current_a=record.current_a * size)
    cell = characterize([scaled], ocv_fit="interpolated")
    soc = np.array([point.soc for point in cell.discharge_points])
    assert cell.capacity_ah == pytest.approx(CAPACITY_AH * size, rel=1e-9)
    np.testing.assert_allclose(cell.average_ocv_v(soc), average_v(soc), atol=1e-8)


@pytest.mark.parametrize(("returned", "capacity_ah"), [(0.98, None), (0.5, 2.0)])
def test_one_file_keeps_one_axis_when_the_recharge_stops_short(returned, capacity_ah):
    test = both_ways(returned=returned)
    cell = characterize([test], capacity_ah=capacity_ah, ocv_fit="interpolated")
    assert cell.charge_points[0].soc == pytest.approx(0.0, abs=1e-9)
    assert cell.charge_points[-1].soc == pytest.approx(returned, abs=1e-9)


def test_the_errors_of_the_branches_cancel_in_the_average():
    # The average is a cubic, which its polynomial meets; the kinks of the hysteresis it misses.
    errors = characterize([both_ways()], ocv_fit="polynomial").errors
    assert set(errors) == {"charge", "discharge", "average", "hysteresis"}
    assert errors["average"].max_v < 1e-9
    assert errors["charge"].max_v > 1e-4


@pytest.mark.parametrize("minutes", [0, 10, 60])
def test_a_slow_conditioning_discharge_does_not_hide_the_pulses(minutes):
    cell = characterize([conditioned(np.zeros(minutes))], ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (21, 21)
    np.testing.assert_allclose(cell.discharge(GRID), branch_v(GRID, -1), atol=1e-9)
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, +1), atol=1e-9)


@pytest.mark.parametrize("slow", [steady(-1, 20), [*steady(-1, 20), *steady(+1, 20), *REST]])
def test_rests_of_both_directions_come_before_slow_sweeps(slow):
    full = [] if len(slow) > 1200 else steady(+1, 2)
    down, up = pulses(-1, 16, share=0.85), pulses(+1, 16, share=0.85)
    record = driven(REST, slow, full, REST, down, up)
    cell = characterize([record], capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (17, 17)


# Records that hold more than their OCV test, and testers that never read zero


def test_a_tester_that_reads_30_ma_at_rest_is_served_by_the_rest_current():
    clean = driven(REST, pulses(-1, rest=31))
    reads = np.where(clean.current_a == 0, 0.03, clean.current_a)
    record = replace(clean, current_a=reads)
    with pytest.raises(InputError, match="not an OCV test"):
        characterize([record])
    cell = characterize([record], rest_current_a=0.05)
    expected = characterize([clean])
    assert [p.voltage_v for p in cell.discharge_points] == [
        p.voltage_v for p in expected.discharge_points
    ]


# When a test tells the capacity, and what its SOC is scaled by


def scaled(record, factor: float):
    return replace(record, current_a=record.current_a * factor)


@pytest.mark.parametrize("test", [between_cutoffs, lambda: slow_sweep(-1)])
@pytest.mark.parametrize("ratio", [0.6, 0.9, 1.1, 1.9])
def test_the_record_s_capacity_does_not_stretch_a_test_that_spans_both_ends(test, ratio):
    whole = characterize([test()], ocv_fit="interpolated")
    other = characterize([test()], capacity_ah=ratio * whole.capacity_ah, ocv_fit="interpolated")
    assert other.capacity_ah == ratio * whole.capacity_ah
    assert other.discharge_points == whole.discharge_points
    assert other.charge_points == whole.charge_points


def test_the_capacity_of_the_ocv_test_scales_one_that_does_not_span_both_ends():
    test = driven(REST, pulses(-1, 10, share=0.5))
    cell = characterize([test], capacity_ah=1.8, ocv_capacity_ah=2.0)
    assert cell.capacity_ah == 1.8
    assert cell.soc_range == pytest.approx((0.5, 1.0))
    alone = characterize([test], ocv_capacity_ah=2.0)
    assert (alone.capacity_ah, alone.discharge_points) == (2.0, cell.discharge_points)


@pytest.mark.parametrize("share", [0.92, 0.979, 0.981, 1.0, 1.019])
def test_a_charge_is_scaled_by_itself_within_two_percent_and_else_by_the_capacity(share):
    is_short = share < 0.98
    records = [discharge_only(), scaled(charge_only(), share)]
    cell = characterize(records, capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(share if is_short else 1.0, abs=1e-9)
    texts = [each.what for each in cell.warnings if each.code == "ocv-test.scaled"]
    says = " Ah, the capacity is 2 Ah: its SOC is scaled by the capacity"
    assert [says in each for each in texts] == [True] * is_short


# What is said of an OCV test that is refused, or that tells less than it should.


PERCENT = ONE.select((pl.col("SOC [-]") * 100).alias("SOC"), "OCV [V]")


def part(share, start_soc, name, way=-1):
    moved = pulses(way, round(20 * share), share=share)
    return driven(REST, moved, start_soc=start_soc, direction=-way, name=name)


def table(frame):
    return read_ocv_table(source_from_frame(frame, "ocv"))


def restless():
    record = driven(np.tile([2.0] * 10 + [-1.5] * 10, 50))
    return replace(record, current_a=np.where(record.current_a == 0, 2.0, record.current_a))


def steep(soc, _):
    return 3.2 + np.tanh(30 * soc) + 0.01 * soc


NAN = float("nan")
# What is given, and with which options.
TESTS = {
    "nothing": lambda: [],
    "a whole test": lambda: [both_ways()],
    "a slow discharge": lambda: [slow_sweep(-1)],
    "one direction": lambda: [discharge_only()],
    "the other direction": lambda: [charge_only()],
    "half and back": lambda: [driven(REST, pulses(-1, 10, share=0.5), pulses(+1, 10, share=0.5))],
    "a test between cutoffs": lambda: [between_cutoffs()],
    "five points": lambda: [both_ways(count=5)],
    "short rests": lambda: [driven(pulses(-1, rest=20), name="drive.csv")],
    "two rests": lambda: [driven(pulses(-1, 2))],
    "no rests": lambda: [restless()],
    "halves that do not overlap": lambda: [part(0.55, 1.0, "upper.csv"), part(0.4, 0, "lower", 1)],
    "no current": lambda: [driven(np.zeros(100))],
    "one C": lambda: [driven(REST, np.full(60, 2.0), REST)],
    "parts that do not meet": lambda: [part(0.4, 1.0, "upper.csv"), part(0.4, 0.5, "lower.csv")],
    "a slow discharge twice": lambda: [slow_sweep(-1), slow_sweep(-1)],
    "a sweep in ten hours": lambda: [driven(REST, np.full(600, CAPACITY_AH / 10), REST)],
    "a slow charge beside rests": lambda: [discharge_only(), slow_sweep(+1)],
    "two tests in one record": lambda: [conditioned()],
    "a falling curve": lambda: [discharge_only(voltage=steep)],
    "a table": lambda: [table(ONE)],
    "a branch twice": lambda: [table(TWO), discharge_only()],
    "a curve beside a branch": lambda: [table(ONE), discharge_only()],
    "a table of percent": lambda: [table(PERCENT)],
    **{f"{returned} returned": lambda returned=returned: [both_ways(returned=returned)]
       for returned in (0.5, 0.89, 0.91, 0.97, 0.985)},
    "a SOC twice": lambda: [table(ONE.with_columns(pl.Series("SOC [-]", [0.5, *SOC[1:]])))],
    "a SOC beyond": lambda: [table(ONE.with_columns(pl.col("SOC [-]") + 0.2))],
    "a voltage beyond": lambda: [table(ONE.with_columns(pl.col("OCV [V]") * 10))],
    "a word for a voltage": lambda: [table(ONE.with_columns(pl.lit("x").alias("OCV [V]")))],
    "no SOC": lambda: [table(ONE.with_columns(pl.lit(None).alias("SOC [-]")))],
    "three rows": lambda: [table(ONE[:3])],
    "no table": lambda: [table(pulse_frame())],
}  # fmt: skip
RATIOS = (0.79, 0.81, 0.94, 0.96, 1.04, 1.06, 1.19, 1.21)
OPTIONS = [
    *((test, {}) for test in TESTS),
    *(("a whole test", {"capacity_ah": value}) for value in (20.0, 0.002, 0.0, -2.0, NAN, 2.0)),
    *(("a whole test", {"capacity_ah": CAPACITY_AH / ratio}) for ratio in RATIOS),
    *(
        ("a slow discharge", {"capacity_ah": CAPACITY_AH / ratio})
        for ratio in (0.49, 0.81, 0.96, 2.1)
    ),
    *(("one direction", {"capacity_ah": CAPACITY_AH / ratio}) for ratio in (0.4, 0.6, 1.21)),
    *(("a test between cutoffs", {"capacity_ah": value}) for value in (0.95, 4.0)),
    ("halves that do not overlap", {"capacity_ah": 2.0, "ocv_fit": "interpolated"}),
    *(("one direction", {"rest_current_a": value}) for value in (0.0, -0.1, NAN, 5.0)),
    ("a test between cutoffs", {"ocv_capacity_ah": 1.5}),
    ("a table", {"capacity_ah": 2.0}),
    ("a table of percent", {"capacity_ah": 2.0}),
    ("a branch twice", {"capacity_ah": 2.0}),
]


def said(test, options):
    try:
        cell = characterize(TESTS[test](), **{"ocv_fit": "polynomial", **options})
        return cell.warnings or ["nothing"]
    except InputError as problem:
        return [f"refused: {problem}"]


def test_every_warning_and_refusal_is_the_one_that_was_written_down():
    text = "".join(
        f"{test} {options}\n" + "".join(f"  {line}\n" for line in said(test, options))
        for test, options in OPTIONS
    )
    assert "--" not in text
    for quoted in re.findall(r"`([^`]*)`", text):
        assert re.fullmatch(r"[a-z_]+(='?[\w.,-]+'?)?", quoted)
    require_golden(Path(__file__).with_name("words.txt"), text)
