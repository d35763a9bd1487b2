"""`barnax rerun` repeats a result from its own record of the command."""

import json
import shutil

import pytest

from barnax.bundled import BUNDLED
from barnax.cli import rerun
from barnax.result import Result


def altered(finished, folder, change):
    """A copy of the finished result with something changed."""
    document = json.loads((finished.folder / "result.json").read_text())
    change(document)
    path = folder / "result.json"
    path.write_text(json.dumps(document))
    return path


def test_the_same_machine_gives_the_same_bytes(run, finished):
    outcome = run("rerun", finished.folder / "result.json")
    assert outcome.status == 0
    assert "The same bytes came out" in outcome.out


@pytest.fixture
def repeats(finished, monkeypatch):
    """The stored command gives the finished result again; the words it was run with."""
    words = []

    def again(command, folder):
        words.append(command)
        return Result.from_json(finished.folder / "result.json")

    monkeypatch.setattr(rerun, "_run", again)
    return words


def test_a_result_that_cannot_be_reached_any_more_is_a_finding(run, finished, tmp_path, repeats):
    def change(document):
        document["refined"]["rmse [V]"] *= 1.01
        document["parameters"]["R0 [Ohm]"] *= 1.5

    outcome = run("rerun", altered(finished, tmp_path, change))
    assert outcome.status == 1
    assert "The refined error differs by" in outcome.out
    assert "R0" in outcome.out


def test_other_versions_with_the_same_error_agree(run, finished, tmp_path, repeats):
    def change(document):
        document["versions"]["jax"] = "0.0.1"

    outcome = run("rerun", altered(finished, tmp_path, change))
    assert outcome.status == 0
    assert "jax was 0.0.1" in outcome.out
    assert "agrees to" in outcome.out


def test_files_are_found_by_name_and_known_by_content(run, finished, tmp_path, repeats):
    files = tmp_path / "files"
    files.mkdir()
    shutil.copy(BUNDLED.record, files)

    def change(document):
        document["command"] = ["barnax", "identify", BUNDLED.record.name, "--seeds=2"]

    result = altered(finished, tmp_path, change)
    assert "is in none of" in run("rerun", result).err
    run("rerun", result, "--data", files)
    assert repeats == [["identify", str(files / BUNDLED.record.name), "--seeds=2"]]
    shutil.copy(BUNDLED.validation, files / BUNDLED.record.name)
    outcome = run("rerun", result, "--data", files)
    assert outcome.status == 2
    assert "SHA-256 differs" in outcome.err


@pytest.mark.parametrize("command", [[], ["barnax"]])
def test_a_result_without_a_command_says_so(refuse, finished, tmp_path, command):
    path = altered(finished, tmp_path, lambda document: document.update(command=command))
    assert "stores no command to repeat" in refuse("rerun", path)
