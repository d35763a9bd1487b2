"""Files of one name in several folders are told apart, in results and in the stored command."""

from pathlib import Path

import pytest

from barnax.bundled import BUNDLED
from barnax.cli import identify as command
from barnax.cli.inputs import Files
from barnax.cli.session import command_line
from barnax.results import Result

from .conftest import BUDGET, OCV, run_command


def files_of(*records, validation=()):
    paths = [Path(path) for path in records], [Path("tests/ocv.csv")], [*map(Path, validation)]
    return Files(*paths, "auto", "auto", "auto", "auto")


@pytest.mark.parametrize(
    ("records", "validation", "names"),
    [
        (["cell/a.csv"], ["cell/b.csv"], ["a.csv", "b.csv"]),
        (["cell/a.csv"], ["other/a.csv"], ["cell/a.csv", "other/a.csv"]),
        (["x/cell/a.csv"], ["y/cell/a.csv", "b.csv"], ["x/cell/a.csv", "y/cell/a.csv", "b.csv"]),
        (["cell/a.csv"], ["cell/a.csv"], ["a.csv", "a.csv"]),
    ],
)
def test_a_name_is_as_short_as_it_can_be(records, validation, names):
    called = files_of(*records, validation=validation).names
    assert [called[Path(path)] for path in (*records, *validation)] == names


def test_the_stored_command_has_the_names_of_the_results(monkeypatch):
    words = ["identify", "x/a.csv", "--ocv=tests/ocv.csv", "--validate", "y/a.csv", "--out", "o"]
    monkeypatch.setattr("sys.argv", ["barnax", *words])
    names = files_of("x/a.csv", validation=["y/a.csv"]).names
    assert command_line(names) == [
        "barnax", "identify", "x/a.csv", "--ocv=ocv.csv", "--validate", "y/a.csv",
    ]  # fmt: skip


def test_validation_records_of_one_name_stand_side_by_side(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "cell_figures", lambda _: {})
    monkeypatch.setattr(command, "found_figures", lambda *_: {})
    for folder, source in (("a", BUNDLED.validation), ("b", BUNDLED.record)):
        Path(folder).mkdir()
        Path(folder, "drive.parquet").write_bytes(source.read_bytes())
    validation = ("--validate", "a/drive.parquet", "--validate", "b/drive.parquet")
    outcome = run_command("identify", BUNDLED.record, *OCV, *validation, *BUDGET, "--out", "o")
    assert outcome.status == 0
    result = Result.from_json("o/result.json")
    names = [metrics.record for metrics in result.metrics.validation]
    assert names == ["a/drive.parquet", "b/drive.parquet"]
    assert run_command("rerun", "o/result.json", "--data", BUNDLED.record.parent).status == 0
