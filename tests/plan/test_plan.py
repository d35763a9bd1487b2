"""What a folder's files are found to be for, whatever they are called."""

import shutil
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, Reading
from barnax.bundled import BUNDLED, bundled_file
from barnax.plan import looking, plan, plan_of, planned_window
from barnax.records import read_source
from helpers.ocv_tests import slow_sweep
from helpers.records import CURRENT, TIME, VOLTAGE, frame, logged, once, with_counters

TEMPERATURE = "Ambient Temperature / degC"
# Names that tell nothing.
NAMES = {
    "a.parquet": BUNDLED.validation,
    "b.parquet": BUNDLED.ocv[0],
    "c.parquet": BUNDLED.record,
    "d.parquet": BUNDLED.ocv[1],
}


@pytest.fixture(scope="module", autouse=True)
def looked_at_once():
    """Folders have the bundled files under the same names."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("check_file", "read_ocv_test"):
            patch.setattr(looking, name, once(getattr(looking, name)))
        yield


@pytest.fixture
def folder(tmp_path):
    for name, path in NAMES.items():
        shutil.copy(path, tmp_path / name)
    return tmp_path


def change(folder, names, *columns):
    """Write other columns to these files, of which each letter of `names` is one."""
    for name in names:
        path = folder / f"{name}.parquet"
        pl.read_parquet(path).with_columns(*columns).write_parquet(path)


def at(degc):
    return pl.lit(degc).alias(TEMPERATURE)


def roles(found):
    return {part.name: part.role for part in found.parts}


def by_name(found):
    """The windows and options of the same files where their roles are given."""
    roles = "identification", "OCV test", "validation"
    records, ocv, validate = ([part.path for part in found.of_role(role)] for role in roles)
    named = plan_of(barnax.Job(records, ocv=list(dict.fromkeys(ocv)), validate=validate))
    told = [part.reason for part in named.parts if part.plans_soc and part.is_simulated]
    assert all(" ends" in reason or "is full" in reason for reason in told)
    return windows(named), named.options


def windows(found):
    return {part.name: part.window for part in found.parts if part.is_simulated}


def reason(found, name):
    (part,) = (part for part in found.parts if part.name == name)
    return part.reason


def test_all_suitable_records_are_identified_on_the_one_of_the_widest_range_first(folder):
    actual = plan(folder)
    assert roles(actual) == {
        "a.parquet": "identification",
        "b.parquet": "OCV test",
        "c.parquet": "identification",
        "d.parquet": "OCV test",
    }
    assert [part.name for part in actual.of_role("identification")] == ["c.parquet", "a.parquet"]
    # What is given to validate on is not identified on; a comparison is of one record.
    kept = plan(folder, validate=folder / "a.parquet")
    assert roles(kept)["a.parquet"] == "validation"
    assert roles(actual.on_one) == roles(kept)
    assert (actual.command, actual.missing) == ("identify", "")
    # Where they start they show themselves, and nothing is given in their place.
    assert [part.window.initial_soc for part in actual.parts if part.is_simulated] == [None, None]


def test_a_record_given_to_validate_on_too_is_refused_where_no_other_is_left(folder):
    record, again = folder / "c.parquet", folder / "again.parquet"
    with pytest.raises(InputError, match="given twice; give each once, and validate on"):
        plan([record], validate=record)
    shutil.copy(record, again)
    with pytest.raises(InputError, match=r"the same as again.*, byte for byte; give each"):
        plan([record], validate=again)
    kept = plan([record, folder / "a.parquet"], validate=again)
    assert roles(kept)["a.parquet"] == "identification"
    assert roles(kept)["again.parquet"] == "validation"


def test_what_cannot_be_read_is_reported_and_the_rest_is_planned(folder):
    (folder / "notes.txt").write_text("the cell got warm\n")
    (folder / ".hidden").write_text("x")
    shutil.copy(BUNDLED.record, folder / "again.parquet")
    pl.read_parquet(BUNDLED.record)[:17_000].write_csv(folder / "a-part.csv")
    actual = plan(folder)
    assert roles(actual)["notes.txt"] == "not used"
    assert "columns" in reason(actual, "notes.txt")
    assert reason(actual, "c.parquet") == "the same as again.parquet, byte for byte"
    assert reason(actual, "a-part.csv") == "of the same samples as again.parquet"
    assert ".hidden" not in roles(actual)
    assert len(actual.of_role("OCV test")) == 2


def test_records_are_joined_with_an_ocv_test_of_their_temperature_only(folder):
    cold = frame().with_columns(at(-30.0), pl.col(VOLTAGE) - 0.03 * pl.col(CURRENT))
    change(folder, "bcd", at(0.0))
    cold.write_parquet(folder / "cold.parquet")
    actual = plan(folder)
    assert roles(actual)["c.parquet"] == "identification"
    assert reason(actual, "cold.parquet") == "measured at -30 degC, the OCV test at 0 degC"
    (folder / "c.parquet").unlink()
    (folder / "a.parquet").unlink()
    lacking = plan(folder)
    assert roles(lacking)["cold.parquet"] == "identification"
    assert "there is no OCV test" in reason(lacking, "cold.parquet")
    assert reason(lacking, "b.parquet") == "measured at 0 degC, and cold.parquet at -30 degC"
    given = plan(folder, ocv=[folder / "b.parquet", folder / "d.parquet"])
    assert roles(given)["cold.parquet"] == "identification"


def test_a_record_alone_shows_an_ocv_and_a_slow_sweep_alone_lacks_a_record(tmp_path):
    sweep = slow_sweep(-1)
    lone = plan(BUNDLED.record)
    assert not lone.missing
    assert "its OCV is identified with it" in reason(lone, "identification.parquet")
    # Its pulses are enough of a load; a slow sweep has none.
    both = plan(BUNDLED.ocv)
    assert both.command == "hppc"
    assert [part.name for part in both.of_role("identification")] == ["ocv_discharge.parquet"]
    assert {part.name for part in both.of_role("OCV test")} == {path.name for path in BUNDLED.ocv}
    columns = {TIME: sweep.time_s, CURRENT: -sweep.current_a, VOLTAGE: sweep.voltage_v}
    pl.DataFrame(columns).write_parquet(tmp_path / "sweep.parquet")
    assert "measure a drive" in plan(tmp_path).missing


def test_what_is_said_of_a_record_counts_before_roles_are_chosen(folder):
    for name in ("a", "c"):
        path = folder / f"{name}.parquet"
        # Under load, far from full.
        whole = pl.read_parquet(path)[1500:]
        loaded = whole[CURRENT].abs().to_numpy() > 0.5
        whole[int(loaded.argmax()) :].write_parquet(path)
    # Its start is fitted.
    assert roles(plan(folder))["c.parquet"] == "identification"
    said = {"c.parquet": barnax.Window(initial_soc=0.88)}
    actual = plan(folder, window=said)
    assert roles(actual)["c.parquet"] == "identification"
    assert actual.of_role("identification")[0].window.initial_soc == 0.88
    # What is measured elsewhere by what is said of it is not joined.
    said["c.parquet"] = barnax.Window(initial_soc=0.88, temperature_degc=-10.0)
    for name in ("b", "d"):
        said[f"{name}.parquet"] = barnax.Window(temperature_degc=25.0)
    apart = plan(folder, window=said)
    assert reason(apart, "c.parquet") == "measured at -10 degC, the OCV test at 25 degC"
    # On the screen files of all other temperatures have one line.
    cold = [part for part in apart.parts if part.name == "c.parquet"]
    colder = replace(cold[0], name="d.parquet", temperature_degc=-20.0)
    colder = replace(colder, reason="measured at -20 degC, the OCV test at 25 degC")
    assert replace(apart, parts=(*cold, colder)).unused == {
        "measured at another temperature, the OCV test at 25 degC": "c.parquet (drive cycle at -10 "
        "degC), d.parquet (drive cycle at -20 degC)"
    }


def test_a_table_is_an_ocv_test_whose_capacity_a_discharge_or_the_user_tells(tmp_path):
    shutil.copy(BUNDLED.record, tmp_path / "record.parquet")
    soc = [0.0, 0.1, 0.3, 0.6, 1.0]
    table = pl.DataFrame({"SOC [-]": soc, "OCV [V]": [3.0, 3.4, 3.6, 3.8, 4.19]})
    table.write_csv(tmp_path / "table.csv")
    actual = plan(tmp_path)
    assert roles(actual)["table.csv"] == "OCV test"
    assert actual.options["capacity"] == pytest.approx(1.89, abs=0.005)
    told = plan(tmp_path, capacity=2.0)
    assert (told.options["capacity"], told.reasons["capacity"]) == (2.0, "given")


@pytest.mark.slow
def test_a_charge_of_a_flat_ocv_is_identified_on_beside_the_drive(real_data):
    actual = plan(real_data / "plett-a123-26650")
    names = [part.name for part in actual.of_role("identification")]
    assert names == ["dyn-s1_25degC.parquet", "dyn-s3_25degC.parquet"]
    assert "for the other direction" in reason(actual, "dyn-s3_25degC.parquet")


def test_a_record_that_only_charges_tells_no_capacity(tmp_path):
    time_s = np.arange(4000.0)
    current_a = np.where((time_s > 600) & (time_s // 60 % 2 == 1), 1.0, 0.0)
    soc = 0.2 + np.cumsum(current_a) / 3600 / 2
    voltage_v = np.interp(soc, [0.0, 0.3, 0.6, 1.0], [3.0, 3.5, 3.7, 4.2]) + 0.05 * current_a
    logged(time_s, current_a, voltage_v).write_csv(tmp_path / "charge.csv")
    (tmp_path / "table.csv").write_text("SOC [-],OCV [V]\n0,3.0\n0.3,3.5\n0.6,3.7\n1,4.2\n")
    with pytest.raises(InputError, match="an OCV table has no capacity; give it as `capacity`"):
        plan(tmp_path / "charge.csv", ocv=tmp_path / "table.csv")
    assert roles(plan(tmp_path))["charge.csv"] == "identification"


def test_a_folder_in_a_folder_is_looked_into_unless_it_holds_a_result(folder):
    (folder / "cold").mkdir()
    shutil.move(folder / "a.parquet", folder / "cold")
    (folder / "cold" / "back").symlink_to(folder)
    (folder / "barnax-out").mkdir()
    (folder / "barnax-out" / "result.json").write_text("{}")
    shutil.copy(BUNDLED.record, folder / "barnax-out")
    actual = plan(folder)
    assert roles(actual).keys() == NAMES.keys()
    assert roles(actual)["a.parquet"] == "identification"


def test_a_record_that_takes_more_out_of_the_full_cell_than_the_ocv_test_tells_its_capacity(folder):
    change(folder, "ac", pl.col(CURRENT) * 1.08)
    taken_ah = 1.08 * barnax.read_record(BUNDLED.record).discharged_ah.max()
    assert taken_ah > 2.0
    actual = plan(folder)
    assert actual.options["capacity"] == pytest.approx(taken_ah, abs=5e-4)
    assert by_name(actual) == (windows(actual), actual.options)


def test_records_of_several_temperatures_have_no_capacity_in_common(folder):
    change(folder, "ac", pl.col(CURRENT) * 1.08)
    shutil.copy(folder / "c.parquet", folder / "cold.parquet")
    change(folder, "abcd", at(25.0))
    change(folder, ["cold"], at(0.0))
    ocv, cold, warm = [folder / "b.parquet", folder / "d.parquet"], "cold.parquet", "c.parquet"
    assert plan_of(barnax.Job(folder / warm, ocv=ocv)).options
    for names in ((cold, warm), (warm, cold)):
        records = [folder / name for name in names]
        assert plan_of(barnax.Job(records, ocv=ocv, over="soc,temperature")).options == {}
    # A temperature that only a name tells is told, as in a folder.
    named = folder / "drive_10degC.parquet"
    pl.read_parquet(folder / warm).drop(TEMPERATURE).write_parquet(named)
    (window, *_) = windows(plan_of(barnax.Job(named, ocv=ocv, over="soc,temperature"))).values()
    assert window.temperature_degc == 10.0


def test_a_record_that_goes_on_where_another_ends_starts_from_there(folder):
    # Its counters began at neither full nor empty.
    table = with_counters(frame()).with_columns(pl.col("Discharging Capacity / Ah") + 0.7)
    half = len(table) // 2
    while abs(table[CURRENT][half]) < 0.5:
        half += 1
    table[: half + 1].write_parquet(folder / "first.parquet")
    # By its counters alone: its clock was stopped.
    later = table[half:].with_columns(pl.col(TIME) + 600.0)
    later.write_parquet(folder / "second.parquet")
    for name in ("a", "c"):
        (folder / f"{name}.parquet").unlink()
    actual = plan(folder)
    second = next(part for part in actual.parts if part.name == "second.parquet")
    assert second.plans_soc
    assert not actual.changed(barnax.Window(initial_soc=0.6)).of_role(second.role)[0].plans_soc
    assert second.is_simulated
    assert "it starts under load, where first.parquet ends" in second.reason
    whole = barnax.read_record(bundled_file("identification"))
    expected = 1 - whole.discharged_ah[half] / 2.0
    assert second.window.initial_soc == pytest.approx(expected, abs=0.005)
    assert by_name(actual) == (windows(actual), actual.options)


def test_a_record_that_takes_a_little_more_than_its_test_has_another_capacity(folder):
    change(folder, "bd", pl.col(CURRENT) * 0.85)
    actual = plan(folder)
    assert by_name(actual) == (windows(actual), actual.options)
    part = next(part for part in actual.parts if part.name == "c.parquet")
    assert part.role == "identification"
    moved_ah = barnax.read_record(folder / "c.parquet").discharged_ah.max()
    assert part.window.capacity_ah == pytest.approx(moved_ah, rel=1e-3)


def test_a_profile_has_one_window_by_folder_by_name_and_beside_a_given_cell(tmp_path, real_data):
    (path,) = real_data.glob("calce*/us06_25degC_80soc*.parquet")
    (test,) = real_data.glob("calce*/ocv-incremental_25degC*.parquet")
    for each in (path, test):
        shutil.copy(each, tmp_path)
    actual = plan(tmp_path)
    own = barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
    assert windows(actual) == {path.name: own}
    assert by_name(actual) == ({path.name: own}, actual.options)
    source = read_source(path)
    cell = barnax.characterize([barnax.read_record(test)])
    assert planned_window(source, cell, Reading(), barnax.Window()) == own
    job = barnax.Job(
        source, ocv=barnax.read_record(test), window=barnax.Window(score_soc=(0.1, 1.0))
    )
    assert windows(plan_of(job)) == {path.name: replace(own, score_soc=(0.1, 1.0))}


def test_records_of_another_cell_than_the_ocv_test_s_say_so(folder):
    change(folder, "bd", pl.col(CURRENT) / 100)
    change(folder, "a", at(0.0))
    change(folder, "c", at(25.0))
    (folder / "b.bdf.json").write_text("{}")
    actual = plan(folder)
    assert actual.missing.startswith("no record can be identified on with the OCV test d.parquet")
    assert "the cell of the OCV test holds 0.02 Ah" in reason(actual, "a.parquet")
    assert "b.bdf.json" not in roles(actual)
