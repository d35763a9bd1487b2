"""Starts and capacities that records of one cell tell of each other, against a known truth."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import barnax
from barnax import TableSettings, Window, characterize, read_record
from barnax.cell.parameters import RATE
from barnax.fit.current_offset import reads_zero_at_rest
from barnax.fit.registration import FAR_V, register_on_ocv_test, rest_warnings, with_common_capacity
from barnax.fit.starts import RecordsWithoutOcvTest
from barnax.fit.table_fit import fit_tables, pooled_errors
from barnax.identification.pipeline import _between_ends
from barnax.identification.setup import register_all
from barnax.model.prepared import prepare_record
from benchmarks import operation
from helpers.made_cell import FEW_NODES, R0_OHM, R_OHM, SMALL, TAU_S, cell_with_ocv, made, ocv_v
from helpers.problems import drive_a, simulated_record
from helpers.reference import drop_v, filtered_response, make_record

TRUE_SOC, TRUE_AH = np.array([1.0, 0.994, 0.988]), np.array([2.0, 2.004, 1.996])
ALONE = {**SMALL, "resistances_follow": "none"}


@pytest.fixture(scope="module")
def records():
    """Drives that are all said to start full on 2 Ah, and do not."""
    return [
        made(seed, start=soc, capacity_ah=capacity_ah)[0]
        for seed, (soc, capacity_ah) in enumerate(zip(TRUE_SOC, TRUE_AH, strict=True))
    ]


def identified(records, **options):
    window = Window(initial_soc=1.0, capacity_ah=2.0)
    return barnax.identify(records, window=window, **ALONE, **options)


@pytest.fixture(scope="module")
def registered(records):
    return identified(records, folds=0, nodes=FEW_NODES)


@pytest.mark.slow
def test_a_charge_beside_a_drive_leaves_blocks_out_and_not_the_drive(records):
    time_s = 4.0 * np.arange(3000)
    current_a = np.where(time_s > 60, -0.55, 0.0)
    soc = 0.05 + np.append(0.0, np.cumsum(-current_a[:-1] * 4.0)) / 7200
    voltage_v = ocv_v(soc) - drop_v(filtered_response, 4.0, current_a, (R0_OHM, R_OHM, TAU_S))
    charge = make_record(time_s, current_a, voltage_v, name="charge.csv")
    windows = {
        records[0].name: Window(initial_soc=1.0, capacity_ah=2.0),
        charge.name: Window(initial_soc=0.05, capacity_ah=2.0),
    }
    alone = {**ALONE, "keep_starts": True}
    beside = barnax.identify([records[0], charge], window=windows, **alone)
    held = beside.fit.cross_validation
    # No drive follows from a charge alone.
    assert held.block_s is not None
    assert held.by_record == ()
    # Blocks near full leave out what the OCV does between its closest nodes.
    assert held.tables.rmse_v < 5e-3
    assert len(identified(records).fit.cross_validation.by_record) == 3


def test_starts_and_capacities_are_identified_up_to_the_axis(registered):
    windows = [each.window for each in registered.of_role("identification")]
    soc = np.array([each.initial_soc for each in windows])
    capacity_ah = np.array([each.capacity_ah for each in windows])
    # Where the axis begins and how long it is no record tells.
    np.testing.assert_allclose(soc - soc.mean(), TRUE_SOC - TRUE_SOC.mean(), atol=1e-3)
    np.testing.assert_allclose(
        capacity_ah / capacity_ah.mean(), TRUE_AH / TRUE_AH.mean(), atol=2e-3
    )
    for each, soc, capacity_ah in zip(windows, TRUE_SOC, TRUE_AH, strict=True):
        known = each.registration
        assert known.soc_low < soc - TRUE_SOC.mean() + 1 < known.soc_high
        assert known.capacity_low_ah < 2 * capacity_ah / TRUE_AH.mean() < known.capacity_high_ah
        # What is left open of the axis itself is no error of a start on it.
        assert known.soc_high - known.soc_low < 1e-3
        assert known.capacity_high_ah - known.capacity_low_ah < 5e-3
        assert (known.given_soc, known.given_capacity_ah) == (1.0, 2.0)
        assert each.unregistered.initial_soc == 1.0


@pytest.mark.slow
def test_intervals_of_starts_hold_what_straight_lines_between_nodes_leave_out():
    # Of a flat OCV that is steep at its ends; by the noise alone two capacities are outside.
    cell = operation.Cell("LFP", False, 2)
    logs, window = [*cell.logs()], Window(initial_soc=1.0, capacity_ah=2.0)
    windows = {log.name: window for log in logs}
    with jax.enable_x64(True):
        starts = RecordsWithoutOcvTest.of(logs, windows, TableSettings(folds=0)).starts("so-rc")
    true_soc, true_ah = cell.starts
    for name, soc, capacity_ah in zip(windows, true_soc, true_ah, strict=True):
        known = starts.windows[name].registration
        assert known.soc_low < soc - true_soc.mean() + 1 < known.soc_high
        assert known.capacity_low_ah < 2 * capacity_ah / true_ah.mean() < known.capacity_high_ah


def test_a_record_to_validate_on_is_scored_with_its_start_moved_too(registered):
    record, _ = made(7, start=0.98)
    actual = registered.validate(record, Window(initial_soc=0.99, capacity_ah=2.0))
    moved_soc, rmse_v = actual.registered
    soc = [each.window.initial_soc for each in registered.of_role("identification")]
    axis = np.mean(soc) - TRUE_SOC.mean()
    assert moved_soc == pytest.approx(-0.01 + axis, abs=2e-3)
    assert rmse_v < 0.5 * actual.metrics.rmse_v
    stays = registered.validate(record, Window(initial_soc=0.99 + moved_soc, capacity_ah=2.0))
    assert abs(stays.registered[0]) < 1e-3


@pytest.mark.parametrize("given", [{"bounds": {RATE: (50.0, 100.0)}}, {"fix": {RATE: 100.0}}])
def test_a_bound_of_gamma_is_no_bound_of_a_circuit_without_it(emptied, given):
    told = prepared_with(*emptied)
    assert register_all(barnax.Job(**given), [told]) == register_all(barnax.Job(), [told])


@pytest.fixture(scope="module")
def emptied():
    """A drive from full to 1.5 % of a cell that is flat in between, with a rest at its end."""
    interval_s, last = 1.5, 400
    current_a = np.append(0.7 * drive_a(5600, seed=3, interval=20), np.zeros(last))
    time_s = interval_s * np.arange(len(current_a))
    out_ah = np.append(0.0, np.cumsum(current_a[:-1] * interval_s)) / 3600
    capacity_ah = float(out_ah[-1]) / 0.985
    drop = drop_v(filtered_response, interval_s, current_a, (R0_OHM, R_OHM, TAU_S))
    voltage_v = flat_v(1 - out_ah / capacity_ah) - drop
    return make_record(time_s, current_a, voltage_v, name="emptied.csv"), capacity_ah


def flat_v(soc):
    """As of LFP: flat, but near empty and full."""
    soc = np.minimum(soc, 1.0)
    return 3.2 + 0.1 * soc - 0.6 * np.exp(-soc / 0.02) + 0.15 * np.exp(-(1 - soc) / 0.01)


def prepared_with(record, capacity_ah, points=401):
    cell = cell_with_ocv(capacity_ah, curve=flat_v, points=points)
    return prepare_record(record, cell, "so-rc", Window(initial_soc=1.0))


@pytest.mark.slow
def test_charge_that_an_ocv_test_and_a_record_do_not_share_is_identified_by_its_rests(emptied):
    record, capacity_ah = emptied
    told = prepared_with(record, 1.03 * capacity_ah)
    actual = register_on_ocv_test(told, TableSettings())
    known = actual.window.registration
    assert known.by == "OCV test"
    assert (known.given_soc, known.given_capacity_ah) == (1.0, told.capacity_ah)
    assert actual.capacity_ah == pytest.approx(capacity_ah, rel=2e-3)
    assert actual.start.soc == pytest.approx(1.0, abs=2e-3)
    error_v, told_v = (
        fit_tables([each], TableSettings(max_boxes=0, folds=0)).errors[0].rmse_v
        for each in (actual, told)
    )
    assert error_v < 0.3 * told_v
    right = prepared_with(record, capacity_ah)
    assert register_on_ocv_test(right, TableSettings()) is right


@pytest.mark.slow
def test_what_an_ocv_test_tells_of_the_capacity_counts_for_records_to_validate_on(emptied):
    """Two testers count 3 % apart, and both drives are of one of them."""
    record, capacity_ah = emptied
    hours, tested_ah = np.arange(0.0, 40.0, 1 / 60), 1.03 * capacity_ah
    swept_a = np.full(len(hours), tested_ah / 40)
    sweep = make_record(3600 * hours, swept_a, flat_v(1 - hours / 40), name="ocv.csv")
    options = {**ALONE, "folds": 0, "window": Window(initial_soc=1.0)}
    other = replace(record, name="other.csv", voltage_v=record.voltage_v + 1e-5)
    actual = barnax.identify([record], ocv=[sweep], validate=[other], **options)
    assert actual.cell.capacity_ah == pytest.approx(capacity_ah, rel=3e-3)
    assert actual.cell_at().capacity_ah == actual.cell.capacity_ah
    own_v = actual.candidates[0].identification.rmse_v
    assert actual.candidates[0].validation_v[0] < 1.2 * own_v
    assert actual.validate(other, Window(initial_soc=1.0)).metrics.rmse_v < 1.2 * own_v
    # Where a capacity is given, that is what others have.
    given = barnax.identify([record], ocv=[sweep], capacity=tested_ah, **options)
    assert given.cell.capacity_ah == pytest.approx(tested_ah)


def test_a_charge_is_counted_over_the_capacity_that_the_test_tells_of_a_drive_beside_it(
    bundled_cell,
):
    time_s, whole_ah = 4.0 * np.arange(1500), bundled_cell.capacity_ah

    def prepared(current_a, soc):
        record = simulated_record(bundled_cell, time_s, current_a, soc, 1.0)
        return prepare_record(record, bundled_cell, "so-rc", Window(initial_soc=soc))

    drive, other = (prepared(drive_a(1500, seed), 1.0) for seed in (0, 1))
    charge = prepared(np.full(1500, -1.0), 0.1)
    told, moved = [drive, other, charge], drive.registered(0.99, 0.97 * whole_ah)
    actual = with_common_capacity(told, [moved, other, charge])
    capacities = [one.capacity_ah / whole_ah for one in actual]
    assert capacities == pytest.approx([0.97, 1.0, 0.97])
    # What is fitted is prepared from the windows.
    assert actual[2].window.capacity_ah == pytest.approx(0.97 * whole_ah)
    assert actual[2].window.registration.by == "OCV test"
    assert actual[2].window.unregistered == charge.window
    given = charge.in_window(replace(charge.window, capacity_ah=1.01 * whole_ah))
    assert with_common_capacity([drive, given], [moved, given])[1] is given
    assert np.ptp(actual[2].soc) == pytest.approx(np.ptp(charge.soc) / 0.97)
    # Where the test tells nothing of any, all stay as told.
    assert with_common_capacity(told, told) == told


@pytest.mark.slow
def test_tables_of_an_lfp_drive_hold_on_its_charge_once_both_are_on_one_axis(real_data):
    """As told they are 48 mV off, 110 to 360 of that below 5 % SOC."""
    folder = real_data / "plett-a123-26650"
    tests = [read_record(folder / f"ocv-s{part}_25degC.parquet") for part in (1, 3)]
    cell = characterize(tests, ocv_fit="interpolated")

    def prepared(part, **window):
        record = read_record(
            folder / f"dyn-s{part}_25degC.parquet", current_sign="discharge-positive"
        )
        return prepare_record(record, cell, "esc", Window(**window))

    drive = register_on_ocv_test(prepared(1, initial_soc=1.0), TableSettings())
    given = {"initial_soc": 0.0, "score_steps": (11,), "score_soc": (0.03, 0.95)}
    charge, counted = prepared(3, **given), prepared(3, capacity_ah=drive.capacity_ah, **given)
    assert drive.capacity_ah == pytest.approx(2.0, abs=0.01)
    tables = fit_tables([drive], TableSettings(max_boxes=0, folds=0)).tables
    assert pooled_errors([charge], tables).rmse_v < 12e-3
    actual = pooled_errors([counted], tables)
    assert actual.rmse_v < 8e-3
    assert actual.above_v < 8e-3
    together = fit_tables([drive, charge], TableSettings(max_boxes=0, folds=0)).errors
    assert max(each.rmse_v for each in together) < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("offset_a", [-0.02, 0.0, 0.02])
def test_records_of_different_rates_tell_an_offset_of_their_current(offset_a):
    fast, slow = made(0, 0.98, 2.4, 1e-3)[0], made(1, 0.98, 4.8, 1e-3, scale=0.5)[0]
    records = [replace(each, current_a=each.current_a + offset_a) for each in (fast, slow)]
    # What is told of the starts is not quite right either.
    started = zip(records, (0.983, 0.978), strict=True)
    windows = {each.name: Window(initial_soc=soc, capacity_ah=2.0) for each, soc in started}
    actual = barnax.identify(records, window=windows, folds=0, **ALONE)
    notices = [each for each in actual.warnings if each.code == "answer.current-offset"]
    assert len(notices) == (offset_a != 0)
    for each in notices:
        # 95 % of the time within this; the sign is that of the files, which charge positive.
        assert each.values["error_a"] < 4e-3
        assert each.values["offset_a"] == pytest.approx(offset_a, abs=each.values["error_a"])


# What tells an offset has tests of its own, in `test_current_offset`.
@pytest.mark.parametrize(("rest_a", "is_zero"), [(0.0, True), (0.02, False), (None, False)])
def test_a_load_that_passes_zero_is_no_rest_that_reads_zero(rest_a, is_zero):
    draw = np.random.default_rng(3)
    current_a = draw.normal(0, 0.5, 9000)
    if rest_a is not None:
        current_a[::4] = rest_a + draw.normal(0, 5e-4, 2250)
    assert np.count_nonzero(np.abs(current_a) < 0.01) > 60
    read = SimpleNamespace(current_a=current_a, capacity_ah=2.0, median_interval_s=1.0)
    assert reads_zero_at_rest(read) is is_zero


def test_a_rest_far_from_the_ocv_of_a_record_to_validate_on_is_reported(emptied):
    record, capacity_ah = emptied
    (notice,) = rest_warnings(prepared_with(record, 1.03 * capacity_ah))
    assert notice.code == "soc.rest-off-ocv"
    assert notice.values["own_ah"] == pytest.approx(capacity_ah, rel=5e-3)
    assert not rest_warnings(prepared_with(record, capacity_ah))


def test_a_rest_between_far_points_of_a_steep_ocv_speaks_for_no_other_capacity(emptied):
    record, capacity_ah = emptied
    right = prepared_with(record, capacity_ah, points=11)
    last_soc = right.soc[-1]
    assert abs(right.cell.average_ocv_v(last_soc) - flat_v(last_soc)) > FAR_V
    assert not rest_warnings(right)
    assert register_on_ocv_test(right, TableSettings()) is right


@pytest.fixture(scope="module")
def flat_cell():
    return cell_with_ocv(2.0, 0.015, lambda soc: flat_v(soc) - 0.07 * soc, 401)


def counted_between(cell, **records):
    """The limits and the warnings of made records, each a current in A and the SOC at its start."""
    time_s = 4.0 * np.arange(3000)
    made_of = {
        name: simulated_record(cell, time_s, current_a * np.ones(3000), soc, 1.0, name=name)
        for name, (current_a, soc) in records.items()
    }
    told = [
        prepare_record(record, cell, "so-rc", Window(initial_soc=records[name][1]))
        for name, record in made_of.items()
    ]
    counted, warnings = _between_ends(cell, told)
    return {one.record.name: one.window.score_soc for one in counted}, warnings


def test_a_charge_beside_a_load_does_not_count_at_the_ends_that_it_reaches(flat_cell):
    drive, ampere = (0.3 * drive_a(3000, 0), 1.0), 2.0 * 3600 / (4.0 * 2999)
    charges = {
        "whole": (-0.99 * ampere, 0.005),
        "upper": (-0.6 * ampere, 0.4),
        "lower": (-0.6 * ampere, 0.01),
        "inner": (-0.5 * ampere, 0.2),
        "discharge": (0.98 * ampere, 1.0),
    }
    assert flat_cell.has_flat_ocv
    limits, warnings = counted_between(flat_cell, drive=drive, **charges)
    limited = {name: ends for name, ends in limits.items() if ends is not None}
    assert limited == {"whole": (0.03, 0.95), "upper": (0.0, 0.95), "lower": (0.03, 1.0)}
    assert [one.subject for one in warnings] == [*limited]
    # Without a load nothing else would count there.
    limits, warnings = counted_between(flat_cell, **charges)
    assert set(limits.values()) == {None}
    assert not warnings
