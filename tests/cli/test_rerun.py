"""`barnax rerun` repeats a result from its own record of the command."""

import json
import os
import shutil

import pytest

from barnax.bundled import BUNDLED
from barnax.cli import results
from barnax.results import Result


@pytest.fixture
def altered(finished, tmp_path):
    """A copy of the finished result with something changed."""

    def write(change):
        document = json.loads((finished.folder / "result.json").read_text())
        change(document)
        (tmp_path / "result.json").write_text(json.dumps(document))
        return tmp_path / "result.json"

    return write


@pytest.fixture
def repeats(finished, monkeypatch):
    """The stored command gives the finished result again; the words it was run with."""
    words = []

    def again(command, folder):
        words.append(command)
        return Result.from_json(finished.folder / "result.json")

    monkeypatch.setattr(results, "_run", again)
    return words


@pytest.mark.slow
def test_the_same_machine_gives_the_same_bytes(run, finished):
    outcome = run("rerun", finished.folder / "result.json")
    assert (outcome.status, outcome.out) == (0, "The result is the same, byte for byte.\n")


@pytest.mark.usefixtures("repeats")
def test_a_result_that_cannot_be_reached_any_more_is_a_finding(run, altered):
    def change(document):
        document["metrics"]["identification"]["rmse [V]"] *= 1.01
        document["constant"]["parameters"]["R0 [Ohm]"] *= 1.5

    outcome = run("rerun", altered(change))
    assert outcome.status == 1
    text = " ".join(outcome.out.split())
    assert "constant.parameters.R0 [Ohm], metrics.identification.rmse [V]" in text
    assert "The error differs by -0.99 %" in text


@pytest.mark.usefixtures("repeats")
def test_other_versions_with_the_same_error_agree(run, altered):
    outcome = run("rerun", altered(lambda document: document["versions"].update(jax="0.0.1")))
    assert outcome.status == 0
    assert "jax was 0.0.1" in outcome.out
    assert "agrees to" in outcome.out


@pytest.fixture
def moved(altered, tmp_path):
    """A result of a file in a folder of its own, that folder, and the words of its command."""
    files = tmp_path / "files"
    files.mkdir()
    shutil.copy(BUNDLED.record, files / "own.parquet")
    (tmp_path / "box.toml").write_text("")
    words = ["identify", "own.parquet", "--initial-soc=own.parquet=1", "--bounds=box.toml"]

    def change(document):
        document["command"] = ["barnax", *words]
        document["inputs"][0]["name"] = "own.parquet"

    return altered(change), files, words


def test_files_are_found_by_name_and_known_by_content(run, moved, repeats):
    result, files, words = moved
    outcome = run("rerun", result)
    assert outcome.status == 2
    assert "not found in" in outcome.err
    assert "give its folder with --data" in outcome.err
    run("rerun", result, "--data", files)
    bounds = f"--bounds={files.parent / 'box.toml'}"
    assert repeats == [[words[0], str(files / words[1]), words[2], bounds]]
    shutil.copy(BUNDLED.validation, files / words[1])
    outcome = run("rerun", result, "--data", files)
    assert outcome.status == 2
    assert "SHA-256 differs" in outcome.err


def test_files_are_found_where_the_plan_beside_a_result_says(run, moved, repeats):
    result, files, words = moved
    plan = f'[[files]]\nfile = "{(files / words[1]).as_posix()}"\nrole = "identification"\n'
    (result.parent / "plan.toml").write_text(plan)
    run("rerun", result)
    bounds = f"--bounds={files.parent / 'box.toml'}"
    assert repeats == [[words[0], str(files / words[1]), words[2], bounds]]
    # Another's plan may name what it likes: only the record itself is taken.
    shutil.copy(BUNDLED.validation, files / words[1])
    assert "SHA-256 differs" in run("rerun", result).err
    # And what it names is no file of bounds.
    shutil.copy(BUNDLED.record, files / words[1])
    shutil.move(result.parent / "box.toml", files)
    outcome = run("rerun", result)
    assert "box.toml: not found in" in outcome.err


PIPE = pytest.param(
    None,
    id="pipe",
    marks=pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes"),
)


@pytest.mark.parametrize(
    "plan", ["files = 3", "reasons = 3", "a = " + 3000 * "[", "a = " + "9" * 5000, PIPE]
)
def test_a_plan_that_cannot_be_read_names_no_folders(run, moved, plan):
    result, *_ = moved
    place = result.parent / "plan.toml"
    os.mkfifo(place) if plan is None else place.write_text(plan)
    assert "not found in" in run("rerun", result).err


@pytest.mark.parametrize("command", [[], ["barnax"]])
def test_a_result_without_a_command_says_so(refuse, altered, command):
    path = altered(lambda document: document.update(command=command))
    assert "has no stored command" in refuse("rerun", path)
