"""A dataset of known ageing: units of age, what is not determined, and what a record tells."""

import json
from functools import cache

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, TableSettings
from barnax.fit import ageing
from barnax.fit.ageing import CAPACITY, R0, SHIFT, R, measure_ageing, shows_both_ends
from barnax.life import QUANTITIES, life_of
from barnax.life.rows import ageing_row
from barnax.life.trends import judge
from barnax.model.prepared import prepare_record
from barnax.plots import plot_fleet_life
from barnax.reporting.life import life_frame, life_json, life_lines
from helpers.reference import drop_v, filtered_response


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


@pytest.fixture(scope="module")
def life():
    return life_of(dataset())


def test_dates_are_ages_in_days_and_trends_follow_the_truth(life):
    assert life.unit == "day"
    assert life.span == 731.0
    assert life.exposure == pytest.approx(9 * 731 / 365.25)
    (trend,) = life.of(R0, "C3")
    truth = 0.03 * (1 + 0.1 * trend.age / 365.25)
    np.testing.assert_allclose(trend.smooth[:, 0], truth, rtol=0.01)


@pytest.fixture
def one_quantity(monkeypatch):
    """One of the four is fitted: what is told of all of them goes by none."""
    monkeypatch.setattr("barnax.life.ageing.QUANTITIES", (R0,))


def test_what_no_record_tells_is_not_determined():
    ends = ("", " low", " high", " by OCV")
    nothing = {f"aged {CAPACITY}{end}": None for end in ends}
    life = life_of(dataset(cells=2).with_columns(**{k: pl.lit(v) for k, v in nothing.items()}))
    assert all(np.isnan(each.smooth).all() for each in life.of(CAPACITY))
    assert any(line.startswith("capacity: not determined") for line in life_lines(life))
    stored = json.loads(life_json(life))
    own = [each for each in stored["trends"] if each["quantity"] == CAPACITY]
    assert {each["trend"] for each in own} == {None}
    assert len(life_frame(life)) == 4 * 10


def test_the_quantities_share_the_false_alarms_of_all_cell_years(monkeypatch):
    asked = []

    def stated(series, expected, rng):
        asked.append(expected)
        return judge(series, expected, rng)

    monkeypatch.setattr("barnax.life.ageing.judge", stated)
    life = life_of(dataset(), false_alarms=0.02)
    assert asked == pytest.approx([0.02 * life.exposure / 4] * 4)


@pytest.mark.usefixtures("one_quantity")
def test_an_estimate_of_a_wide_interval_counts_little():
    is_wide = pl.int_range(pl.len()) == 7
    times = {"": 2.0, " low": 1.2, " high": 3.2}
    columns = [
        pl.when(is_wide).then(factor * pl.col(f"aged {R0}")).otherwise(f"aged {R0}{end}")
        for end, factor in times.items()
    ]
    named = {f"aged {R0}{end}": column for end, column in zip(times, columns, strict=True)}
    (trend,) = life_of(dataset(cells=3).with_columns(**named)).of(R0, "C1")
    assert trend.smooth[2, 0] == pytest.approx(0.03 * 1.1, rel=0.01)


@pytest.mark.usefixtures("one_quantity")
def test_throughput_is_in_the_unit_of_its_name_and_what_is_none_is_refused():
    passed = (pl.int_range(pl.len()) % 5 * 100.0).alias("ah_since_new")
    frame = dataset(cells=2).with_columns(passed)
    milli = frame.with_columns((1e3 * passed).alias("moved [mAh]"))
    cycles = life_of(frame, throughput="ah_since_new").cycles
    assert set(cycles.values()) == {100.0}
    # Without that, the records' own.
    own = life_of(frame)
    assert (set(own.cycles.values()), own.counts_cycles) == ({5.0}, False)
    assert life_of(milli, throughput="moved [mAh]").cycles == cycles
    # The last that is known counts.
    told = pl.when(passed < 400).then(passed.cast(pl.String)).alias("ah")
    cell = next(iter(cycles))
    assert life_of(frame.with_columns(told), throughput="ah").cycles[cell] == 0.75 * cycles[cell]
    with pytest.raises(InputError, match="`throughput` nothing: no such column; the dataset has"):
        life_of(frame, throughput="nothing")
    none = frame.with_columns(pl.lit("none").alias("ah"))
    with pytest.raises(InputError, match=f"`throughput` ah: no row of {cell} has ampere-hours"):
        life_of(none, throughput="ah")


def test_capacities_without_a_rest_near_empty_assume_the_shape_of_the_ocv(life):
    shown = dataset(cells=2, **{"aged capacity to empty": True})
    assumed = [
        [line for line in life_lines(each) if "Assumed" in line] for each in (life, life_of(shown))
    ]
    assert ["in 9 rows" in line for line in assumed[0]] == [True]
    assert not assumed[1]


def test_few_cells_are_drawn_by_name_and_not_judged(life):
    few = life_of(dataset(cells=2))
    assert any("No cell is judged" in line for line in life_lines(few))
    names, many = (
        [text.get_text() for text in plot_fleet_life(each).legends[0].get_texts()]
        for each in (few, life)
    )
    assert (names, many) == (["C0", "C1"], ["median 95 % interval"])


def test_a_dataset_without_ageing_or_column_is_refused():
    with pytest.raises(InputError, match="says nothing of ageing"):
        life_of(dataset().select("id", "error", "specimen", "date"))
    with pytest.raises(InputError, match="`by` nosuch: no such column; the dataset has"):
        life_of(dataset(), by="nosuch")
    with pytest.raises(InputError, match="row 1 is 'soon'; give a number in every row"):
        life_of(dataset(date="soon"))


OWN_AH, SHIFT_V, OWN_R0, PAIRS = 1.7, 0.006, 0.04, (0.012, 0.02)


@pytest.fixture(scope="module")
def cell():
    tests = [barnax.read_record(barnax.bundled_file(n)) for n in ("ocv_charge", "ocv_discharge")]
    return barnax.characterize(tests)


def aged(cell, bent_v=0.0, to_empty=False, begun=1.0, rests=1, opening_s=0, shift_v=SHIFT_V):
    """A drive from full, or another SOC, of an aged cell, whose OCV is lower toward empty by so
    much, and which goes on to empty and rests there so many times. It starts as is given, or after
    an opening rest, whose voltage tells."""
    rng, samples = np.random.default_rng(7), 1200
    current_a = np.repeat(rng.gamma(0.8, 1.0, samples), rng.integers(2, 30, samples))[:samples]
    current_a *= 0.75 * begun * OWN_AH * 3600 / (5 * current_a.sum())
    if to_empty:
        emptying = np.full(round(0.245 * begun * OWN_AH * 3600 / (5 * 0.3)), 0.3)
        resting = np.tile(np.append(np.zeros(700 // rests + 200), [0.05] * 4), rests)
        current_a = np.concatenate([current_a, emptying, resting])
    current_a = np.append(np.zeros(opening_s // 5), current_a)
    soc = begun - 5 * np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / OWN_AH
    voltage_v = cell.average_ocv_v(soc) + shift_v - bent_v * (1 - soc)
    voltage_v -= drop_v(filtered_response, 5.0, current_a, (OWN_R0, PAIRS, (20.0, 160.0)))
    voltage_v += 5e-4 * rng.standard_normal(len(soc))
    columns = {"Time [s]": 5.0 * np.arange(len(soc)), "Current [A]": -current_a}
    record = barnax.record_from_frame(
        columns | {"Voltage [V]": voltage_v},
        name="aged", current_sign="charge-positive", current_hold="forward",
    )  # fmt: skip
    window = barnax.Window(initial_soc=None if opening_s else begun, capacity_ah=2.0)
    return prepare_record(record, cell, "so-rc", window)


def measured(cell, **how):
    """What such a drive tells."""
    return measure_ageing([aged(cell, **how)], TableSettings())


@pytest.fixture(scope="module")
def once_measured(cell):
    return cache(lambda **how: measured(cell, **how))


def test_a_row_whose_ageing_has_not_settled_says_so(cell, monkeypatch):
    monkeypatch.setattr(ageing, "ROUNDS", 1)
    _, warnings = ageing_row([aged(cell)])
    assert "ageing.not-settled" in {warning.code for warning in warnings}


def test_a_record_of_an_aged_cell_tells_capacity_resistances_and_shift(once_measured):
    actual = once_measured()
    assert all(actual[name].is_determined for name in (CAPACITY, SHIFT, R0, R))
    truth = {CAPACITY: OWN_AH, SHIFT: SHIFT_V, R0: OWN_R0, R: OWN_R0 + sum(PAIRS)}
    assert actual[CAPACITY].value == pytest.approx(OWN_AH, rel=0.01)
    assert actual[R0].value == pytest.approx(OWN_R0, rel=0.02)
    for name, value in truth.items():
        assert actual[name].low <= value <= actual[name].high


def test_an_ocv_of_another_shape_is_within_the_interval_of_a_capacity(once_measured):
    actual = once_measured(bent_v=0.03)
    assert actual[CAPACITY].low <= OWN_AH <= actual[CAPACITY].high
    # A change of shape is this cell's at this age: no other record shares that error.
    variance = ((actual[CAPACITY].high - actual[CAPACITY].low) / (2 * 1.96)) ** 2
    assert np.sum(np.square(actual[CAPACITY].by_ocv)) < 0.25 * variance
    assert actual[R0].value == pytest.approx(OWN_R0, rel=0.02)


@pytest.mark.slow
def test_a_rest_near_empty_tells_the_capacity_of_an_ocv_of_another_shape(once_measured):
    capacity = once_measured(bent_v=0.03, to_empty=True)[CAPACITY]
    assert capacity.is_determined
    assert capacity.value == pytest.approx(OWN_AH, rel=0.01)
    assert capacity.low <= OWN_AH <= capacity.high
    assert capacity.high - capacity.low < 0.03 * OWN_AH


def test_both_ends_are_shown_by_a_record_from_full_to_a_rest_near_empty(cell):
    assert shows_both_ends([aged(cell, to_empty=True)], OWN_AH)
    assert not shows_both_ends([aged(cell, to_empty=True, begun=0.6)], OWN_AH)
    assert not shows_both_ends([aged(cell)], OWN_AH)


def test_a_charge_from_a_rest_near_empty_is_full_by_the_capacity_that_it_shows(cell):
    for reached, is_full in ((0.98, True), (0.9, False)):
        charge_a = np.full(round((reached - 0.01) * OWN_AH * 3600 / (5 * 0.4)), -0.4)
        current_a = np.concatenate([np.zeros(800), charge_a, np.zeros(100)])
        soc = 0.01 - 5 * np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / OWN_AH
        columns = {"Time [s]": 5.0 * np.arange(len(soc)), "Current [A]": -current_a,
                   "Voltage [V]": cell.average_ocv_v(soc) - 0.06 * current_a}  # fmt: skip
        record = barnax.record_from_frame(
            columns, name="charge", current_sign="charge-positive", current_hold="forward"
        )
        window = barnax.Window(initial_soc=0.01, capacity_ah=2.0)
        prepared = prepare_record(record, cell, "so-rc", window)
        assert np.max(prepared.soc) < 0.9
        assert shows_both_ends([prepared], OWN_AH) == is_full


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"bent_v": 0.03}, {"bent_v": 0.03, "to_empty": True}])
def test_a_descent_goes_on_until_a_step_is_small_beside_the_errors(
    cell, once_measured, how, monkeypatch
):
    ended = once_measured(**how)
    # As many rounds again move nothing by what its interval would show.
    monkeypatch.setattr(ageing, "SETTLED", 0.0)
    further = measured(cell, **how)
    determined = {name: own for name, own in further.items() if own.is_determined}
    assert determined
    for name, own in determined.items():
        assert abs(own.value - ended[name].value) < 0.15 * (own.high - own.low) / 2


@pytest.mark.slow
def test_the_voltage_that_gave_a_start_moves_with_a_shift_of_the_ocv(cell):
    actual = measured(cell, begun=0.98, opening_s=4000, shift_v=0.025)
    assert all(actual[name].is_determined for name in ("start SOC", SHIFT))
    for name, value in {"start SOC": 0.98, SHIFT: 0.025}.items():
        assert actual[name].low <= value <= actual[name].high
