"""A dataset of known ageing: units of age, what is not determined, and what a record tells."""

import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.signal import lfilter

import barnax
from barnax.errors import InputError
from barnax.fleet.rows import ageing_row, another_capacity
from barnax.life import QUANTITIES, life_of
from barnax.model.prepared import prepare_record
from barnax.over_soc import TableSettings
from barnax.over_soc.ageing import CAPACITY, R0, SHIFT, R, measure_ageing
from barnax.plots import plot_fleet_life
from barnax.reporting.life import life_frame, life_json, life_lines


def dataset(cells=9, ages=5, **columns):
    """Rows whose R0 rises by 10 % a year, without noise to speak of."""
    rng = np.random.default_rng(0)
    rows = []
    for cell in range(cells):
        for place in range(ages):
            years = 0.5 * place
            row = {"id": f"{cell}-{place}", "error": None, "specimen": f"C{cell}",
                   "date": f"20{20 + place // 2}-{1 + 6 * (place % 2):02d}-01",
                   "capacity [A.h]": 2.0, "temperature [degC]": 25.0,
                   "record throughput [A.h]": 4.0, "aged beside OCV": "new",
                   "aged capacity to empty": place > 0}  # fmt: skip
            for name in QUANTITIES:
                value = 0.03 * (1 + 0.1 * years) * np.exp(0.005 * rng.standard_normal())
                row |= {f"aged {name}": value, f"aged {name} low": 0.99 * value,
                        f"aged {name} high": 1.01 * value,
                        f"aged {name} by OCV": [1e-4 * value, 0.0]}  # fmt: skip
            rows.append(row)
    frame = pl.DataFrame(rows, infer_schema_length=None)
    return frame.with_columns(**{name: pl.lit(value) for name, value in columns.items()})


def test_dates_are_ages_in_days_and_trends_follow_the_truth():
    life = life_of(dataset())
    assert life.unit == "day"
    assert life.span == 731.0
    assert life.exposure == pytest.approx(9 * 731 / 365.25)
    (trend,) = life.of(R0, "C3")
    truth = 0.03 * (1 + 0.1 * trend.age / 365.25)
    np.testing.assert_allclose(trend.smooth[:, 0], truth, rtol=0.01)


@pytest.mark.parametrize(
    ("name", "unit", "years"), [("age_months", "month", 1 / 12), ("cycles", "cycle", 1 / 365)]
)
def test_the_unit_is_in_the_column_s_name(name, unit, years):
    frame = dataset().with_columns(pl.int_range(pl.len()).mod(5).alias(name))
    life = life_of(frame, age=name)
    assert life.unit == unit
    assert life.exposure == pytest.approx(9 * 4 * years)


def test_what_no_record_tells_is_not_determined():
    ends = ("", " low", " high", " by OCV")
    nothing = {f"aged {CAPACITY}{end}": None for end in ends}
    life = life_of(dataset().with_columns(**{k: pl.lit(v) for k, v in nothing.items()}))
    assert all(np.isnan(each.smooth).all() for each in life.of(CAPACITY))
    assert any(line.startswith("capacity: not determined") for line in life_lines(life))
    stored = json.loads(life_json(life))
    own = [each for each in stored["trends"] if each["quantity"] == CAPACITY]
    assert {each["trend"] for each in own} == {None}
    assert len(life_frame(life)) == 4 * 45


@pytest.mark.slow
def test_equivalent_full_cycles_count_what_passed():
    passed = dataset().with_columns((pl.int_range(pl.len()) % 5 * 100.0).alias("ah_since_new"))
    assert life_of(passed, throughput="ah_since_new").cycles["C1"] == 100.0
    known = life_of(passed)
    assert (known.cycles["C1"], known.cycles_known) == (5.0, False)


def test_capacities_without_a_rest_near_empty_assume_the_shape_of_the_ocv():
    assert any(
        "in 9 rows; an electrode may lose" in line for line in life_lines(life_of(dataset()))
    )
    told = dataset().with_columns(pl.lit(True).alias("aged capacity to empty"))
    assert not any(line.startswith("Assumed") for line in life_lines(life_of(told)))


def test_few_cells_are_not_judged():
    assert any("No cell is judged" in line for line in life_lines(life_of(dataset(cells=3))))


def test_few_cells_are_drawn_by_name_with_what_their_records_tell():
    few, many = (plot_fleet_life(life_of(dataset(cells=cells))) for cells in (3, 9))
    names = [text.get_text() for text in few.legends[0].get_texts()]
    assert names == ["C0", "C1", "C2"]
    assert [text.get_text() for text in many.legends[0].get_texts()] == ["median 95 % interval"]
    (bar,) = many.axes[1].containers
    assert many.axes[1].get_xlim()[0] < 0 < 731 < bar[0].get_xdata()[0] < many.axes[1].get_xlim()[1]
    # Intervals of 1 % of 0.03 Ohm are in the scale.
    low, high = few.axes[1].get_ylim()
    assert low < 0.992 * 30
    assert high > 1.008 * 30 * 1.2


def test_a_dataset_without_ageing_or_column_is_refused():
    with pytest.raises(InputError, match="says nothing of ageing"):
        life_of(dataset().select("id", "error", "specimen", "date"))
    with pytest.raises(InputError, match="`by` nosuch: no such column; the dataset has"):
        life_of(dataset(), by="nosuch")
    with pytest.raises(InputError, match="neither numbers nor dates"):
        life_of(dataset(date="soon"))


OWN_AH, SHIFT_V, OWN_R0, PAIRS = 1.7, 0.006, 0.04, (0.012, 0.02)


@pytest.fixture(scope="module")
def cell():
    tests = [barnax.read_record(barnax.bundled_file(n)) for n in ("ocv_charge", "ocv_discharge")]
    return barnax.characterize(tests)


def aged(cell, bent_v=0.0, to_empty=False):
    """A drive from full of an aged cell, whose OCV is lower toward empty by so much, and
    which goes on to empty and rests there."""
    rng, samples = np.random.default_rng(7), 1200
    current_a = np.repeat(rng.gamma(0.8, 1.0, samples), rng.integers(2, 30, samples))[:samples]
    current_a *= 0.75 * OWN_AH * 3600 / (5 * current_a.sum())
    if to_empty:
        emptying = np.full(round(0.245 * OWN_AH * 3600 / (5 * 0.3)), 0.3)
        current_a = np.concatenate([current_a, emptying, np.zeros(700)])
    soc = 1 - 5 * np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / OWN_AH
    voltage_v = cell.average_ocv_v(soc) + SHIFT_V - bent_v * (1 - soc) - OWN_R0 * current_a
    for own, tau_s in zip(PAIRS, (20.0, 160.0), strict=True):
        kept = np.exp(-5 / tau_s)
        drive = np.append(0.0, (own * current_a)[:-1])
        voltage_v = voltage_v - lfilter([1 - kept], [1, -kept], drive)
    voltage_v = voltage_v + 5e-4 * rng.standard_normal(len(soc))
    columns = {"Time [s]": 5.0 * np.arange(len(soc)), "Current [A]": -current_a}
    record = barnax.record_from_frame(
        columns | {"Voltage [V]": voltage_v},
        name="aged", current_sign="charge-positive", current_hold="forward",
    )  # fmt: skip
    window = barnax.Window(initial_soc=1.0, capacity_ah=2.0)
    return prepare_record(record, cell, "so-rc", window)


def told_of(cell, bent_v=0.0, to_empty=False):
    """What such a drive tells."""
    return measure_ageing([aged(cell, bent_v, to_empty)], TableSettings())


def test_a_row_with_another_capacity_than_its_record_shows_says_so(cell):
    prepared = aged(cell)
    (told,) = another_capacity(ageing_row([prepared]), prepared)
    assert told.code == "ageing.other-capacity"
    right = replace(prepared, capacity_ah=OWN_AH)
    assert not [*another_capacity(ageing_row([right]), right)]


def test_a_record_of_an_aged_cell_tells_capacity_resistances_and_shift(cell):
    found = told_of(cell)
    truth = {CAPACITY: OWN_AH, SHIFT: SHIFT_V, R0: OWN_R0, R: OWN_R0 + sum(PAIRS)}
    assert found[CAPACITY].value == pytest.approx(OWN_AH, rel=0.01)
    assert found[R0].value == pytest.approx(OWN_R0, rel=0.02)
    for name, value in truth.items():
        assert found[name].low <= value <= found[name].high


def test_an_ocv_of_another_shape_is_within_the_interval_of_a_capacity(cell):
    found = told_of(cell, bent_v=0.03)
    if CAPACITY in found:
        assert found[CAPACITY].low <= OWN_AH <= found[CAPACITY].high
    assert found[R0].value == pytest.approx(OWN_R0, rel=0.02)


def test_a_rest_near_empty_tells_the_capacity_of_an_ocv_of_another_shape(cell):
    capacity = told_of(cell, bent_v=0.03, to_empty=True)[CAPACITY]
    assert capacity.value == pytest.approx(OWN_AH, rel=0.01)
    assert capacity.low <= OWN_AH <= capacity.high
    assert capacity.high - capacity.low < 0.03 * OWN_AH
