"""Names in a file lead to no other folder than the one that was asked for."""

from pathlib import Path

import pytest

from barnax.export import EXPORTERS
from barnax.results import Result
from cli.conftest import contents, run_command
from helpers.records import pulse_frame

from .stored import good_result

NAMES = ["../../escaped", "/escaped", "..", "a/../../escaped.csv", "~/escaped", "C:\\escaped"]


@pytest.fixture
def inner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder, deep enough that a way out of it is seen."""
    folder = tmp_path / "one" / "two"
    folder.mkdir(parents=True)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return folder


def named(name: str) -> Result:
    """A result whose every text is this name."""
    good = good_result().to_dict()

    def renamed(value: object) -> object:
        if isinstance(value, dict):
            return {key: renamed(each) for key, each in value.items()}
        if isinstance(value, list):
            return [renamed(each) for each in value]
        return name if value in ("words", "anything", "drive.csv") else value

    return Result.model_validate(renamed(good))


@pytest.mark.parametrize("name", NAMES)
def test_an_export_goes_where_it_is_told_whatever_the_result_names(inner, tmp_path, name):
    (inner / "result.json").write_text(named(name).to_json(), encoding="utf-8")
    for exporter in EXPORTERS.values():
        assert run_command("export", "result.json", "--to", exporter.name).status == 0
    written = {f"one/two/{exporter.file_name}" for exporter in EXPORTERS.values()}
    assert set(contents(tmp_path)) == {"one", "one/two", "one/two/result.json", *written}


@pytest.mark.parametrize("name", NAMES)
def test_a_repeated_run_reads_no_file_that_the_result_was_not_made_from(inner, tmp_path, name):
    (tmp_path / "escaped").write_text(pulse_frame().write_csv())
    command = ("barnax", "identify", name, "--out", str(tmp_path / "escaped"), "--force", "--")
    stored = named(name).model_copy(update={"command": command})
    (inner / "result.json").write_text(stored.to_json(), encoding="utf-8")
    before = contents(tmp_path)
    assert run_command("rerun", "result.json").status == 2
    assert contents(tmp_path) == before
