"""Results are written whole or not at all, and never over anything else."""

import os
import sys
import tempfile
from pathlib import Path

import pytest

from barnax.cli import identify as command
from barnax.cli import output
from barnax.cli.output import write_folder
from barnax.cli.session import Session
from barnax.errors import InputError

from .conftest import BUDGET, contents

SESSION = Session(is_quiet=True)
IDENTIFY = ("identify", *BUDGET)
OLD = {"result.json": b"old", "timings.json": b"old", "figures/ocv.png": b"old"}
NEW = {"result.json": b"new", "figures/ocv.png": b"new", "figures/more/deep.png": b"new"}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    write_folder(folder, OLD, True, SESSION)
    return folder


def written(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_fresh_folder_is_made_with_its_parents(tmp_path):
    write_folder(tmp_path / "a" / "b", NEW, True, SESSION)
    assert written(tmp_path) == {f"a/b/{name}": content for name, content in NEW.items()}


def test_a_new_result_leaves_nothing_of_the_old_one(old):
    write_folder(old, NEW, True, SESSION)
    assert written(old.parent) == {f"out/{name}": content for name, content in NEW.items()}


@pytest.mark.parametrize("cause", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("nth", [0, 1], ids=["old-away", "new-in"])
def test_a_stop_while_folders_are_moved_leaves_the_old_result(old, monkeypatch, cause, nth):
    before, replace, calls = contents(old.parent), os.replace, []

    def stopped(source, target):
        calls.append(target)
        if len(calls) == nth + 1:
            raise cause
        replace(source, target)

    monkeypatch.setattr(output, "_exchange", lambda first, second: False)
    monkeypatch.setattr(os, "replace", stopped)
    with pytest.raises(InputError if isinstance(cause, OSError) else KeyboardInterrupt):
        write_folder(old, NEW, True, SESSION)
    assert contents(old.parent) == before


@pytest.mark.skipif(sys.platform != "linux", reason="renameat2 is Linux's")
def test_where_the_system_can_old_and_new_change_places_in_one_step(old, monkeypatch):
    monkeypatch.setattr(os, "replace", lambda *_: pytest.fail("the folder was away for a moment"))
    write_folder(old, NEW, True, SESSION)
    assert written(old.parent) == {f"out/{name}": content for name, content in NEW.items()}


def test_a_full_disk_while_files_are_written_leaves_the_old_result(old, monkeypatch):
    before = contents(old.parent)

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"No space left on device.*nothing was changed"):
        write_folder(old, NEW, True, SESSION)
    assert contents(old.parent) == before


def test_a_place_that_refuses_a_folder_is_a_message(tmp_path, monkeypatch):
    def forbidden(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "TemporaryDirectory", forbidden)
    with pytest.raises(InputError, match=r"Permission denied.*give --out another folder"):
        write_folder(tmp_path / "out", NEW, True, SESSION)
    assert contents(tmp_path) == {}


def test_results_go_to_where_a_link_points(tmp_path, old):
    link = tmp_path / "link"
    link.symlink_to(old, target_is_directory=True)
    write_folder(link, NEW, True, SESSION)
    assert link.is_symlink()
    assert written(old) == NEW


def test_a_name_that_is_just_not_too_long_is_written(tmp_path):
    write_folder(tmp_path / (255 * "x"), NEW, True, SESSION)
    assert written(tmp_path / (255 * "x")) == NEW


@pytest.mark.parametrize("name", [300 * "x", f"{300 * 'x'}/out", f"out/{300 * 'x'}"])
def test_a_name_too_long_for_a_folder_is_refused_before_any_work(refuse, monkeypatch, name):
    monkeypatch.setattr(command, "choose_files", None)
    message = refuse(*IDENTIFY, "--out", name)
    assert f"{name}: cannot be used (File name too long); give --out another folder" in message


def test_a_link_that_leads_to_itself_is_refused(refuse, tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    assert "give --out another folder" in refuse(*IDENTIFY, "--out", "loop")


def test_another_result_is_refused_and_force_is_named(refuse, old):
    message = refuse(*IDENTIFY, "--out", old)
    assert f"{old}: holds a result" in message
    assert "--force" in message


def test_the_default_folder_is_guarded_too(refuse, tmp_path):
    write_folder(tmp_path / "barnax-out", OLD, True, SESSION)
    assert "barnax-out: holds a result" in refuse(*IDENTIFY)


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["", "force"])
@pytest.mark.parametrize("name", ["thesis.tex", "figures/mine.png"])
def test_a_folder_of_somebody_elses_is_refused_even_with_force(refuse, tmp_path, name, force):
    write_folder(tmp_path / "out", {name: b"mine"}, True, SESSION)
    message = refuse(*IDENTIFY, "--out", "out", *force)
    assert f"out: holds {name.split('/')[0]!r}, which barnax did not write" in message


def test_a_file_in_the_folders_place_is_refused(refuse, tmp_path):
    (tmp_path / "out").write_text("mine")
    assert "out: is a file" in refuse(*IDENTIFY, "--out", "out")
    assert "cannot be written to" in refuse(*IDENTIFY, "--out", "out/deeper")


@pytest.mark.parametrize("name", [".", ""])
def test_the_working_folder_itself_is_not_replaced(refuse, name):
    assert "give --out one in it" in refuse(*IDENTIFY, "--out", name, "--force")


def test_a_read_only_place_is_refused_before_any_work(refuse, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(command, "choose_files", None)
    message = refuse(*IDENTIFY, "--out", "out")
    assert "cannot be written to; give --out another folder" in message


def test_an_interruption_exits_130_and_writes_nothing(run, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "choose_files", interrupted)
    outcome = run(*IDENTIFY, "--out", "out")
    assert outcome.status == 130
    assert "earlier results are as they were" in outcome.err
    # Nothing is kept yet that it could go on from.
    assert "goes on" not in outcome.err
    assert contents(tmp_path) == {}


def appear(folder: Path, files: dict[str, bytes]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


FOREIGN = {"thesis.tex": b"mine"}


@pytest.mark.parametrize(
    ("files", "is_forced"), [(OLD, False), (FOREIGN, False), (FOREIGN, True), (FOREIGN | OLD, True)]
)
def test_what_appears_during_a_run_stays_and_the_results_go_beside_it(
    tmp_path, capsys, files, is_forced
):
    appear(tmp_path / "out", files)
    place = write_folder(tmp_path / "out", NEW, is_forced, SESSION)
    assert place == tmp_path / "out-2"
    assert written(tmp_path / "out") == files
    assert written(place) == NEW
    assert "out-2" in capsys.readouterr().err.replace("\n", "")


def test_the_first_free_name_beside_it_is_taken(tmp_path):
    appear(tmp_path / "out", OLD)
    appear(tmp_path / "out-2", FOREIGN)
    (tmp_path / "out-3").write_bytes(b"a file")
    assert write_folder(tmp_path / "out", NEW, False, SESSION) == tmp_path / "out-4"
    assert written(tmp_path / "out-2") == FOREIGN
    assert (tmp_path / "out-3").read_bytes() == b"a file"


def test_a_file_that_appears_in_the_folders_place_stays(tmp_path):
    (tmp_path / "out").write_bytes(b"mine")
    assert write_folder(tmp_path / "out", NEW, True, SESSION) == tmp_path / "out-2"
    assert (tmp_path / "out").read_bytes() == b"mine"


def test_an_empty_folder_is_used(tmp_path, capsys):
    (tmp_path / "out").mkdir()
    assert write_folder(tmp_path / "out", NEW, False, SESSION) == tmp_path / "out"
    assert written(tmp_path) == {f"out/{name}": content for name, content in NEW.items()}
    assert capsys.readouterr().err == ""


def test_a_command_loses_nothing_that_appears_while_it_runs(run, tmp_path, monkeypatch):
    real = command.read_inputs

    def meanwhile(*arguments, **options):
        appear(tmp_path / "out", OLD)
        return real(*arguments, **options)

    monkeypatch.setattr(command, "read_inputs", meanwhile)
    monkeypatch.setattr(command, "cell_figures", lambda _: {})
    monkeypatch.setattr(command, "found_figures", lambda *_: {})
    outcome = run(*IDENTIFY, "--out", "out", "--quiet")
    assert outcome.status == 0
    assert written(tmp_path / "out") == OLD
    assert (tmp_path / "out-2" / "result.json").is_file()
    assert "something else has appeared there" in outcome.err
