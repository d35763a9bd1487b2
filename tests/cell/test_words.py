"""What is said of an OCV test that is refused, or that tells less than it should.

The words stand in `words.txt`, written anew with BARNAX_WRITE_GOLDEN=1.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from barnax.cell import characterize, read_ocv_table
from barnax.errors import InputError
from barnax.records import source_from_frame
from helpers.golden import require_golden
from helpers.ocv_tests import (
    CAPACITY_AH,
    ONE,
    REST,
    SOC,
    TWO,
    between_cutoffs,
    both_ways,
    charge_only,
    conditioned,
    discharge_only,
    driven,
    pulses,
    slow_sweep,
)
from helpers.records import pulse_frame

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
