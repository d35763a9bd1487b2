"""A start under load is found from ends, counters and rests elsewhere in the record."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import InputError, Window, make_problem
from barnax.model.prepared import prepare_record
from helpers.problems import simulated_record
from helpers.reference import make_record

INTERVAL_S = 10.0


def made(cell, pieces, soc):
    """A record of pieces of current in A and seconds, and its true state of charge."""
    current_a = np.concatenate([np.full(round(s / INTERVAL_S), a) for a, s in pieces])
    time_s = INTERVAL_S * np.arange(len(current_a))
    record = simulated_record(cell, time_s, current_a, soc, 1.0)
    return record, soc - record.discharged_ah / cell.capacity_ah


def start(cell, record, at):
    return prepare_record(record, cell, "so-rc", Window(start_time_s=record.time_s[at])).start


def assert_fitted(cell, record, soc, at):
    """Nothing but the record as a whole tells its start."""
    prepared = prepare_record(record, cell, "so-rc", Window(start_time_s=record.time_s[at]))
    fitted = prepared.start
    assert fitted.soc_source == "fitted"
    assert "start.fitted" in {notice.code for notice in prepared.warnings}
    # The record follows the hysteresis of a direction, the fit the average OCV.
    assert abs(fitted.soc - soc[at]) < max(3 * fitted.soc_sd, 0.01)


# 1 A are C/2; the pulses move little charge.
PULSES = [(1.5, 100), (-1.5, 100)] * 3


@pytest.mark.parametrize("at", [20, 800])
def test_a_discharge_to_empty_at_half_c_tells_the_charge_before_and_after_it(bundled_cell, at):
    pieces = [*PULSES, (1.0, 0.5 * 7200), (0.0, 300), (-1.0, 3000), (1.0, 2000)]
    record, soc = made(bundled_cell, pieces, 0.5)
    actual = start(bundled_cell, record, at)
    assert (actual.soc_source, actual.row) == ("empty end", record.row[419])
    assert actual.soc == pytest.approx(soc[at], abs=0.002)


@pytest.mark.parametrize(
    ("pieces", "soc", "at"),
    [
        # A fast discharge to the voltage of an empty cell.
        ([*PULSES, (2.0, 1750), (0.0, 300), (-1.0, 3000)], 0.5, 300),
        # A small current under the voltage of a full cell, and a larger one at it.
        ([(0.04, 100), *PULSES, (1.0, 900)], 0.95, 0),
        ([(0.4, 100), *PULSES, (1.0, 900)], 1.0, 0),
    ],
)
def test_a_load_at_the_voltage_of_an_end_tells_no_end(bundled_cell, pieces, soc, at):
    record, true_soc = made(bundled_cell, pieces, soc)
    assert_fitted(bundled_cell, record, true_soc, at)


def with_full_charge(cell, last_a=0.05):
    """A charge held at a voltage until its current has tapered, a short rest, and a discharge."""
    taper_a = -1.0 * last_a ** (np.arange(600) / 599)
    full_v = float(cell.charge(np.array([1.0]))[0])
    after, _ = made(cell, [(0.0, 300), (1.0, 1800), *PULSES], 1.0)
    current_a = np.concatenate([taper_a, after.current_a])
    voltage_v = np.concatenate([np.full(600, full_v + 0.01), after.voltage_v])
    return make_record(INTERVAL_S * np.arange(len(current_a)), current_a, voltage_v)


def test_a_charge_that_tapers_ends_full(bundled_cell):
    record = with_full_charge(bundled_cell)
    actual = start(bundled_cell, record, 720)
    assert (actual.soc_source, actual.row) == ("full end", record.row[599])
    # The last interval of the taper, and 90 intervals of the discharge.
    assert actual.soc == pytest.approx(1 - (90 - 0.05) * INTERVAL_S / 3600 / 2.0, abs=1e-4)
    assert start(bundled_cell, with_full_charge(bundled_cell, last_a=0.5), 720).row != actual.row


def from_empty_to_full(cell):
    """A charge of an empty cell, tapering at full, with some more after it; the cell that has just
    this charge, and the place of the last sample of the taper."""
    charge_a = np.concatenate([np.full(650, -1.0), -1.0 * 0.05 ** (np.arange(100) / 99)])
    full_at = len(charge_a) - 1
    after_a = np.concatenate([charge_a, np.zeros(30), np.resize(np.repeat([1.5, -1.5], 10), 60)])
    own = replace(cell, capacity_ah=float(-charge_a[:-1].sum()) * INTERVAL_S / 3600)
    time_s = INTERVAL_S * np.arange(len(after_a))
    record = simulated_record(own, time_s, after_a, 0.0, -1.0)
    voltage_v = record.voltage_v.copy()
    voltage_v[650 : full_at + 1] = float(cell.charge(np.array([1.0]))[0]) + 0.01
    return make_record(time_s, after_a, voltage_v), own, full_at


def test_a_record_of_more_charge_than_the_capacity_is_counted_over_its_charge(bundled_cell):
    record, own, full_at = from_empty_to_full(bundled_cell)
    cell = replace(own, capacity_ah=own.capacity_ah / 1.02)
    actual = prepare_record(record, cell, "so-rc", Window())
    assert actual.capacity_ah == pytest.approx(own.capacity_ah)
    assert actual.soc[[0, full_at]] == pytest.approx([0.0, 1.0])
    told = next(one for one in actual.warnings if one.code == "start.moves-more")
    assert told.values["moved_ah"] == pytest.approx(own.capacity_ah)
    assert told.values["capacity_ah"] == pytest.approx(cell.capacity_ah)


def test_a_start_beyond_the_capacity_that_was_given_leaves_full_where_it_is_shown(bundled_cell):
    record, own, full_at = from_empty_to_full(bundled_cell)
    given = Window(capacity_ah=own.capacity_ah / 1.02)
    actual = prepare_record(record, own, "so-rc", given)
    assert actual.soc[[0, full_at]] == pytest.approx([-0.02, 1.0])
    assert [one.code for one in actual.warnings][:1] == ["start.beyond-an-end"]


@pytest.mark.parametrize("share", [0.985, 1.0, 1.015])
def test_a_start_near_empty_is_placed_whatever_of_the_capacity_testers_lose(bundled_cell, share):
    record, own, full_at = from_empty_to_full(bundled_cell)
    cell = replace(own, capacity_ah=share * own.capacity_ah)
    actual = prepare_record(record, cell, "so-rc", Window())
    assert (actual.start.soc_source, actual.start.row) == ("full end", record.row[full_at])
    assert actual.soc[[0, full_at]] == pytest.approx([max(0.0, 1 - 1 / share), 1.0], abs=1e-9)


def test_the_voltage_of_a_full_cell_under_a_small_current_tells_a_full_cell(bundled_cell):
    record, _ = made(bundled_cell, [(0.04, 100), *PULSES, (1.0, 900)], 1.0)
    actual = start(bundled_cell, record, 0)
    assert (actual.soc, actual.soc_source, actual.row) == (1.0, "full voltage", record.row[0])


def counting(record, begun_ah):
    return replace(record, charge_ah=begun_ah + record.discharged_ah)


@pytest.mark.parametrize("begun", [0.3, -0.7])
def test_counters_that_began_at_an_end_tell_the_charge_if_the_voltage_agrees(bundled_cell, begun):
    record, soc = made(bundled_cell, [(1.0, 100), *PULSES], 0.7)
    begun_ah = begun * bundled_cell.capacity_ah
    actual = start(bundled_cell, counting(record, begun_ah), 0)
    assert actual.soc_source == "counters"
    assert actual.soc == pytest.approx(soc[0], abs=1e-9)
    assert_fitted(bundled_cell, counting(record, begun_ah + 0.4), soc, 0)


@pytest.mark.parametrize(("begun", "source"), [(0.3, "counters"), (0.26, "rested voltage")])
def test_counters_that_an_opening_rest_denies_began_elsewhere(bundled_cell, begun, source):
    record, soc = made(bundled_cell, [(0.0, 300), (1.0, 100), *PULSES], 0.7)
    actual = start(bundled_cell, counting(record, begun * bundled_cell.capacity_ah), 0)
    assert actual.soc_source == source
    # The rest is read on the curve of the branch, the record follows the fitted hysteresis.
    assert actual.soc == pytest.approx(soc[0], abs=0.01)


def test_a_long_rest_elsewhere_tells_the_charge(bundled_cell):
    record, soc = made(bundled_cell, [*PULSES, (1.0, 900), (0.0, 3600), *PULSES], 0.6)
    actual = start(bundled_cell, record, 0)
    assert (actual.soc_source, actual.row) == ("rest elsewhere", record.row[509])
    # The rest is read on the curve of the branch, the record follows the fitted hysteresis.
    assert actual.soc == pytest.approx(soc[0], abs=0.01)


@pytest.mark.parametrize(("current_a", "direction"), [(1.0, -1), (-1.0, 1)])
@pytest.mark.parametrize("rest_s", [900, 3600])
def test_an_opening_rest_that_relaxes_tells_the_charge_where_it_ends(
    bundled_cell, current_a, direction, rest_s
):
    before = [(current_a, 1000)]
    whole, soc = made(bundled_cell, [*before, (0.0, rest_s), *PULSES], 0.6)
    cut = 100
    record = make_record(
        whole.time_s[cut:] - whole.time_s[cut], whole.current_a[cut:], whole.voltage_v[cut:]
    )
    prepared = prepare_record(record, bundled_cell, "so-rc", Window())
    actual = prepared.start
    assert actual.direction == direction
    assert actual.row == record.row[rest_s // 10 - 1]
    at_its_first = bundled_cell.soc_from_rest_voltage(float(record.voltage_v[0]), direction)
    # The record is of no hysteresis, and the SOC of the branch: half of the gap is left.
    assert abs(actual.soc - soc[cut]) < abs(at_its_first - soc[cut]) / 3
    (notice,) = [each for each in prepared.warnings if "relaxing" in each.code]
    assert notice.counts == (rest_s < 1800)


@pytest.mark.parametrize("noise_v", [3e-3, 0.03])
@pytest.mark.parametrize("seed", range(12))
def test_noise_and_a_load_in_the_last_row_are_no_relaxation(bundled_cell, seed, noise_v):
    record, _ = made(bundled_cell, [(0.0, 2400), *PULSES], 0.6)
    voltage_v = record.voltage_v + noise_v * np.random.default_rng(seed).standard_normal(
        record.samples
    )
    # The row before the load holds the load's voltage.
    voltage_v[239] = voltage_v[240]
    noisy = make_record(record.time_s, record.current_a, voltage_v)
    actual = prepare_record(noisy, bundled_cell, "so-rc", Window()).start
    assert (actual.row, actual.direction_source) == (noisy.row[0], "assumed")


def test_the_voltage_of_a_load_tells_no_direction(bundled_cell):
    record, _ = made(bundled_cell, [(0.0, 2400), *PULSES], 0.6)
    window = Window(start_time_s=record.time_s[240], initial_soc=0.6)
    actual = prepare_record(record, bundled_cell, "so-rc", window).start
    assert actual.direction_source == "assumed"


def test_a_small_current_that_moves_the_charge_is_no_rest(bundled_cell):
    record, _ = made(bundled_cell, [(0.019, 14400), *PULSES], 0.6)
    assert prepare_record(record, bundled_cell, "so-rc", Window()).first == 0


def test_a_start_that_is_given_is_kept_in_a_rest_that_relaxes(bundled_cell):
    record, _ = made(bundled_cell, [(0.0, 900), *PULSES], 0.6)
    voltage_v = record.voltage_v + 0.02 * np.minimum(record.time_s / 900 - 1, 0.0)
    record = make_record(record.time_s, record.current_a, voltage_v)
    assert start(bundled_cell, record, 1).row == record.row[1]
    assert prepare_record(record, bundled_cell, "so-rc", Window()).start.row == record.row[89]


def part_of(whole, name, first, last, later_s=0.0):
    """Rows of a record with a voltage that no circuit follows, so that a load tells no start."""
    rows = slice(first, last)
    time_s = whole.time_s[rows] + later_s
    ripple_v = 0.1 * np.resize([1, -1], len(time_s)) * (np.arange(len(time_s)) > 9)
    return make_record(time_s, whole.current_a[rows], whole.voltage_v[rows] + ripple_v, name=name)


@pytest.mark.parametrize("shared", [0, 1])
def test_a_log_that_was_cut_is_named_whole_and_without_other_files(bundled_cell, shared):
    """Whether or not the row of a cut is in both files."""
    whole, _ = made(bundled_cell, [(0.0, 300), *PULSES * 4, (1.0, 1500)], 0.8)

    def part(*given):
        return part_of(whole, *given)

    log = [part("one", 0, 60), part("two", 60 - shared, 200), part("three", 200 - shared, None)]
    # A test of its own that ended an hour before, and one that began within the log.
    others = [part("before", 0, 100, -4600.0), part("within", 0, 100, 300.0)]
    with pytest.raises(InputError) as error:
        make_problem([others[0], log[2], log[0], others[1], log[1]], bundled_cell)
    assert error.value.code == "start.goes-on"
    assert error.value.notice.subject == "three"
    assert error.value.notice.values == {"others": "one, two", "files": "one, two, three"}
    with pytest.raises(InputError) as error:
        make_problem([log[0], log[2], *others], bundled_cell)
    assert error.value.code == "start.unrested"


@pytest.mark.parametrize("has_all_dates", [True, False])
def test_a_log_with_dates_is_recognized_by_them_for_each_clock_starts_at_zero(
    bundled_cell, has_all_dates
):
    whole, _ = made(bundled_cell, [(0.0, 300), *PULSES * 4, (1.0, 1500)], 0.8)

    def part(name, first, last, has_date=True):
        date_s = 1.7e9 + whole.time_s[first] if has_date else None
        record = part_of(whole, name, first, last, -whole.time_s[first])
        return replace(record, zero_date_s=date_s)

    log = [part("one", 0, 60, has_all_dates), part("two", 60, 200)]
    with pytest.raises(InputError) as error:
        make_problem([*log[::-1], part("later", 250, 300)], bundled_cell)
    code = "start.goes-on" if has_all_dates else "start.unrested"
    assert (error.value.notice.subject, error.value.code) == ("two", code)


def test_a_start_that_a_record_cannot_have_is_refused(bundled_cell):
    record, _ = made(bundled_cell, [(0.5, 3600), (0.0, 600)], 0.9)
    prepared = prepare_record(record, bundled_cell, "so-rc", Window(initial_soc=0.9))
    assert prepared.registered(0.85, bundled_cell.capacity_ah) is not None
    # By its charge it would end below empty.
    assert prepared.registered(0.1, bundled_cell.capacity_ah) is None
    for window in (Window(initial_soc=0.9, score_soc=(0.95, 1.0)), Window(start_time_s=1e6)):
        with pytest.raises(InputError):
            prepare_record(record, bundled_cell, "so-rc", window)
