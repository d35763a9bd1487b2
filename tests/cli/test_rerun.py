"""`barnax rerun` repeats a result from its own record of the command."""

import json
import shutil

import pytest

from barnax.bundled import BUNDLED

from .conftest import BUDGET


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


def test_a_result_that_cannot_be_reached_any_more_is_a_finding(run, finished, tmp_path):
    def change(document):
        document["refined"]["rmse [V]"] *= 1.01
        document["parameters"]["R0 [Ohm]"] *= 1.5

    outcome = run("rerun", altered(finished, tmp_path, change))
    assert outcome.status == 1
    assert "The refined error differs by" in outcome.out
    assert "R0" in outcome.out


def test_other_versions_with_the_same_error_agree(run, finished, tmp_path):
    def change(document):
        document["versions"]["jax"] = "0.0.1"

    outcome = run("rerun", altered(finished, tmp_path, change))
    assert outcome.status == 0
    assert "jax was 0.0.1" in outcome.out
    assert "agrees to" in outcome.out


def test_files_are_found_by_name_and_known_by_content(run, tmp_path):
    files = tmp_path / "files"
    files.mkdir()
    names = [shutil.copy(path, files / path.name) for path in (BUNDLED.record, *BUNDLED.ocv)]
    out = tmp_path / "out"
    words = ("identify", names[0], "--ocv", names[1], "--ocv", names[2], *BUDGET)
    assert run(*words, "--out", out).status == 0
    result = out / "result.json"

    assert "is in none of" in run("rerun", result).err
    outcome = run("rerun", result, "--data", files)
    assert (outcome.status, "same bytes" in outcome.out) == (0, True)
    shutil.copy(BUNDLED.validation, files / BUNDLED.record.name)
    outcome = run("rerun", result, "--data", files)
    assert outcome.status == 2
    assert "SHA-256 differs" in outcome.err


@pytest.mark.parametrize("command", [[], ["barnax"]])
def test_a_result_without_a_command_says_so(refuse, finished, tmp_path, command):
    path = altered(finished, tmp_path, lambda document: document.update(command=command))
    assert "stores no command to repeat" in refuse("rerun", path)
