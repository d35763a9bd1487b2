"""The engine: what stops it, what it skips, and that a row has its bits wherever it is made."""

from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest

from barnax import InputError, Window, characterize, make_problem, read_record
from barnax.bundled import BUNDLED
from barnax.execution import AtOnce
from barnax.fleet import FleetCell, fleet_cell_from_row, identify_fleet, read_manifest
from barnax.fleet.dataset import read_rows
from barnax.fleet.rows import identify_rows

from .conftest import SAMPLES, require_equal

# What a row says in place of an identification, where only the engine is looked at.
ROW = {"error": None, "RMSE [V]": 0.01, "seconds": 1.0, "warnings": [], "warning codes": []}


@pytest.fixture
def computed(monkeypatch):
    """Rows without any identification: the ids that were computed, in order."""
    return made_rows(monkeypatch)


def made_rows(monkeypatch, before=lambda name: None):
    """The same, where `before` is called with each id, and may give an error or raise one."""
    computed = []

    def rows(cell, settings, out=None):
        error = before(cell.id)
        computed.append(cell.id)
        return [{"id": cell.id, **ROW, "error": error, **cell.carried}]

    monkeypatch.setattr("barnax.fleet.rows.identify_rows", rows)
    return computed


def cells_of(names):
    return [{"id": name, "records": "nowhere.csv", "age": 1} for name in names]


def test_a_finished_cell_is_skipped_and_a_changed_one_computed_again(tmp_path, computed):
    first = identify_fleet(cells_of("abc"), tmp_path, executor=AtOnce())
    assert (first.finished, first.skipped, computed) == (3, 0, ["a", "b", "c"])
    changed = [*cells_of("ab"), {"id": "c", "records": "nowhere.csv", "age": 2}]
    second = identify_fleet(changed, tmp_path, executor=AtOnce())
    assert (second.finished, second.skipped, computed[3:]) == (1, 2, ["c"])
    rows = read_rows(tmp_path)
    assert rows["id"].to_list() == ["a", "b", "c"]
    assert rows["age"].to_list() == [1, 1, 2]
    # Settings that come back have their own rows, and rows of other cells stay.
    for trust, finished in (("none", 3), ("basic", 3), ("none", 3), ("none", 0)):
        options = {"executor": AtOnce(), "settings": {"trust": trust}}
        assert identify_fleet(changed, tmp_path, **options).finished == finished
    identify_fleet(cells_of("d"), tmp_path, executor=AtOnce())
    assert read_rows(tmp_path)["id"].to_list() == ["a", "b", "c", "d"]
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["cells.parquet"]


class Stop(Exception):
    """Ends a command between two cells, or a worker."""


@pytest.mark.parametrize("shard", [None, (1, 1)])
@pytest.mark.parametrize("is_interrupted", [False, True])
def test_retry_repeats_what_failed_and_nothing_else(tmp_path, monkeypatch, is_interrupted, shard):
    failing = {"b"}
    computed = made_rows(monkeypatch, lambda name: "no" if name in failing else None)

    def stop(state):
        if is_interrupted and state.finished:
            raise Stop

    one_each = {"executor": AtOnce(), "shard": shard, "batch": 1}
    with suppress(Stop):
        identify_fleet(cells_of("abc"), tmp_path, report=stop, **one_each)
    assert computed == ["a", "b", "c"]
    failing.clear()
    state = identify_fleet(cells_of("abc"), tmp_path, retry=True, **one_each)
    assert (state.finished, state.failed, state.skipped, computed[3:]) == (1, 0, 2, ["b"])
    assert read_rows(tmp_path)["error"].to_list() == [None] * 3


def test_an_iterable_is_read_no_further_than_its_cells_wait(tmp_path, computed):
    taken = []

    def cells():
        for cell in cells_of("abcdefghij"):
            taken.append(cell["id"])
            yield cell

    def report(state):
        reports.append((state.finished, len(taken)))

    reports = []
    identify_fleet(cells(), tmp_path, executor=AtOnce(), workers=1, batch=1, report=report)
    # Two cells for the worker and two more.
    assert reports[1] == (1, 4)
    assert reports[-1] == (10, 10)


def test_shards_run_beside_each_other(tmp_path, computed):
    names = [f"cell {number}" for number in range(24)]

    def finished(shard):
        given = {"executor": AtOnce(), "shard": shard, "batch": 1}
        return identify_fleet(cells_of(names), tmp_path, **given).finished

    with ThreadPoolExecutor(4) as pool:
        assert sum(pool.map(finished, [(n, 4) for n in (1, 2, 3, 4)])) == len(names)
    assert identify_fleet(cells_of(names), tmp_path, executor=AtOnce()).skipped == len(names)


def test_two_commands_cannot_write_to_one_folder(tmp_path, monkeypatch):
    refused = []

    def begin_another(name):
        with pytest.raises(InputError, match="another command is writing there") as problem:
            identify_fleet(cells_of("z"), tmp_path, executor=AtOnce())
        refused.append(problem)

    made_rows(monkeypatch, begin_another)
    assert identify_fleet(cells_of("a"), tmp_path, executor=AtOnce()).finished == 1
    assert len(refused) == 1


def test_an_unknown_method_is_refused_before_any_cell(tmp_path, computed):
    with pytest.raises(InputError, match="`method` 'magic' is not known; there are"):
        identify_fleet(cells_of("a"), tmp_path, executor=AtOnce(), settings={"method": "magic"})
    assert computed == []


def test_an_edited_result_is_another_cell(tmp_path, monkeypatch):
    given = []

    def identify(job):
        given.append(job.cell)
        raise InputError("only the cell is looked at")

    monkeypatch.setattr("barnax.fleet.rows.identify", identify)
    monkeypatch.setattr(
        "barnax.fleet.rows.Result.from_json",
        lambda path: SimpleNamespace(cell=Path(path).read_text()),
    )
    path = tmp_path / "result.json"
    for text in ("2 A.h", "1.5 A.h"):
        path.write_text(text)
        for name in "ab":
            identify_rows(FleetCell(name, records=("drive.csv",), cell=str(path)), {})
    assert given == ["2 A.h", "2 A.h", "1.5 A.h", "1.5 A.h"]


class Fragile(AtOnce):
    """Breaks for good, as a pool of processes does, where a cell ends the worker."""

    is_broken, asked = False, 0

    def submit(self, fn, /, *args, **kwargs):
        self.asked += 1
        assert self.asked < 100, "an endless loop"
        if self.is_broken:
            raise BrokenProcessPool("broken")
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Stop:
            self.is_broken = True
            future.set_exception(BrokenProcessPool("a worker died"))
        return future


class Dead(Fragile):
    """No worker of it ever begins."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenProcessPool("no worker started"))
        return future


def test_a_cell_that_kills_its_worker_costs_one_row(tmp_path, monkeypatch):
    deaths = []

    def die(name):
        if name == "deadly":
            deaths.append(name)
            raise Stop

    made_rows(monkeypatch, die)
    monkeypatch.setattr("barnax.fleet.engine.ProcessPoolExecutor", lambda *_, **__: Fragile())
    names = ["a", "b", "deadly", "c", "d", "e"]
    state = identify_fleet(cells_of(names), tmp_path, batch=3)
    assert (state.finished, state.failed, len(deaths)) == (6, 1, 2)
    rows = read_rows(tmp_path)
    assert sorted(rows["id"]) == sorted(names)
    failed = rows.filter(pl.col("error").is_not_null())
    assert failed["id"].to_list() == ["deadly"]
    assert "the worker died" in failed["error"].item()


def test_an_executor_that_stays_broken_is_no_endless_loop(tmp_path, monkeypatch):
    dies = [True]

    def die_once(name):
        if name == "deadly" and dies.pop():
            raise Stop

    computed = made_rows(monkeypatch, die_once)
    cells = cells_of(["a", "deadly", "b"])
    with pytest.raises(InputError, match="the executor is broken"):
        identify_fleet(cells, tmp_path, executor=Fragile(), batch=1)
    dies.append(False)
    state = identify_fleet(cells, tmp_path, executor=AtOnce(), batch=1)
    assert (state.finished, state.skipped, computed) == (2, 1, ["a", "deadly", "b"])


def test_workers_that_never_begin_are_no_endless_loop(tmp_path, monkeypatch):
    monkeypatch.setattr("barnax.fleet.engine.ProcessPoolExecutor", lambda *_, **__: Dead())
    with pytest.raises(RuntimeError, match="workers die before they begin"):
        identify_fleet(cells_of("ab"), tmp_path)


@pytest.fixture(scope="module")
def alone(small_fleet, tmp_path_factory):
    """The rows of the small fleet, made one by one in this process."""
    out = tmp_path_factory.mktemp("alone")
    cells, _ = read_manifest(small_fleet / "manifest.csv")
    state = identify_fleet(cells, out, executor=AtOnce(), batch=1)
    assert (state.finished, state.failed) == (6, 2)
    return read_rows(out)


def test_a_row_says_what_was_identified_or_why_nothing_was(alone):
    rows = {row["id"]: row for row in alone.to_dicts()}
    assert "corrupt.parquet" in rows["corrupt"]["error"]
    assert "nowhere*.parquet" in rows["missing"]["error"]
    for seed in range(len(SAMPLES)):
        row = rows[f"cell {seed}"]
        assert row["error"] is None
        assert row["age"] == 100 * seed
        assert row["certified"]
        # One pair of the two, so that R0 is the true one with what is as fast as a sample.
        assert row["R0 [Ohm] low"] < row["R0 [Ohm]"] < row["R0 [Ohm] high"]
        assert row["R0 [Ohm]"] == pytest.approx(0.05 + 0.01 * seed, abs=0.004)
        assert row["RMSE [V]"] < 0.01


def test_no_column_of_a_manifest_can_be_one_of_the_dataset(alone):
    more = {"C4 [F] high", "gamma low", "tables RMSE [V]", "tables R1 [Ohm] low"}
    for name in more | {*alone.columns} - {"id", "age", "circuit", "records"}:
        with pytest.raises(InputError, match="the dataset has its own"):
            fleet_cell_from_row({"id": "a", "records": "a.csv", name: 1})


def test_a_row_has_the_same_bits_in_a_batch_and_in_another_order(alone, small_fleet, tmp_path):
    cells, _ = read_manifest(small_fleet / "manifest.csv")
    with ThreadPoolExecutor(2) as pool:
        identify_fleet(cells[::-1], tmp_path, executor=pool, batch=4)
    require_equal(read_rows(tmp_path), alone)


def test_a_problem_in_memory_has_a_row_too(small_fleet, alone, tmp_path):
    cell = characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="interpolated")
    record = read_record(small_fleet / "cell0.parquet")
    window = Window(initial_soc=0.8)
    problem = make_problem(record, cell, "1rc", window=window, objective="compressed")
    identify_fleet([{"id": "here", "problem": problem, "age": 3}], tmp_path, executor=AtOnce())
    (row,) = read_rows(tmp_path).to_dicts()
    assert (row["error"], row["age"]) == (None, 3)
    expected = alone.filter(pl.col("id") == "cell 0").to_dicts()[0]
    assert row["R0 [Ohm]"] == expected["R0 [Ohm]"]
