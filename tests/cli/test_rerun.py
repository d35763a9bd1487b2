"""`barnax rerun` repeats a result from its own record of the command."""

import json
import shutil

import pytest

from barnax.bundled import BUNDLED
from barnax.cli import rerun
from barnax.results import Result


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
    assert (
        "The bytes differ: 2 entries are not what is stored, such as parameters.R0 [Ohm], "
        "refined.rmse [V]." in " ".join(outcome.out.split())
    )


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


BOUNDS = '[bounds]\n"R0 [Ohm]" = [0.001, 0.1]\n"C1 [F]" = [100, 9000]\n"R1 [Ohm]" = [1e-4, 0.2]\n'


def bounded(finished, folder, words):
    """The result of a command that ends in these words, searched within `BOUNDS`."""

    def change(document):
        document["command"] = ["barnax", "identify", *words]
        document["bounds"]["R0 [Ohm]"] = [0.001, 0.1]
        del document["bounds"]["tau1 [s]"]
        document["bounds"]["C1 [F]"] = [100.0, 9000.0]
        # Narrowed to the time constants that can be seen.
        document["bounds"]["R1 [Ohm]"] = [2e-4, 0.1]

    return altered(finished, folder, change)


@pytest.mark.parametrize("words", [["--bounds", "box.txt"], ["--bounds=box.txt"]])
def test_the_bounds_file_is_the_one_that_sets_the_results_bounds(
    run, finished, tmp_path, repeats, words
):
    result = bounded(finished, tmp_path, words)
    assert "box.txt: is in none of" in run("rerun", result).err
    for name in ("wrong", "right"):
        (tmp_path / name).mkdir()
    (tmp_path / "wrong" / "box.txt").write_text(BOUNDS.replace("0.001", "0.002"))
    (tmp_path / "right" / "box.txt").write_text(BOUNDS)
    outcome = run("rerun", result, "--data", "wrong")
    assert outcome.status == 2
    assert "it sets other bounds" in outcome.err
    assert repeats == []
    run("rerun", result, "--data", "wrong", "--data", "right")
    assert "".join(repeats[0]).endswith("right/box.txt")


@pytest.mark.parametrize(
    "text",
    [
        BOUNDS.replace("9000", "9001"),
        BOUNDS.replace("1e-4", "3e-4"),
        BOUNDS.replace("C1 [F]", "tau1 [s]"),
    ],
)
def test_a_bounds_file_that_sets_something_else_is_refused(refuse, finished, tmp_path, text):
    result = bounded(finished, tmp_path, ["--bounds", "box.toml"])
    (tmp_path / "box.toml").write_text(text)
    assert "it sets other bounds" in refuse("rerun", result)


def test_bounds_that_the_file_left_out_are_told_of(run, finished, tmp_path, repeats):
    result = bounded(finished, tmp_path, ["--bounds", "box.toml"])
    (tmp_path / "box.toml").write_text('[bounds]\n"R0 [Ohm]" = [0.001, 0.1]\n')
    outcome = run("rerun", result)
    assert "bounds of R0 [Ohm] were 0.001 to 0.1" in " ".join(outcome.out.split())
    assert "bounds of C1 [F] were 100 to 9000, are none" in " ".join(outcome.out.split())
