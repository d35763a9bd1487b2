"""Results are written whole or not at all, and never over anything else."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from barnax.bundled import BUNDLED
from barnax.cell.parameters import ANYWHERE
from barnax.cli.output import _moved, require_free, write_file, write_folder
from barnax.errors import InputError
from barnax.files import aside, restore, unfinished
from barnax.fit.factor_file import factors_to_bytes
from barnax.fit.record_factors import Grid, factors_of, fit_factors
from barnax.model.prepared import Window, prepare_record

from .conftest import BUDGET, contents

IDENTIFY = ("identify", *BUDGET)
OLD = {"result.json": b"old", "timings.json": b"old", "figures/ocv.png": b"old"}
NEW = {"result.json": b"new", "figures/ocv.png": b"new", "figures/more/deep.png": b"new"}
MINE = {"thesis.tex": b"mine", "figures/mine.png": b"mine"}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "out", OLD, False)


def appear(folder: Path, files: dict[str, bytes]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def inside(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def written(folder: Path) -> dict[str, bytes]:
    """Every file but the list, which must name all that are ours."""
    files = inside(folder)
    if "files.json" in files:
        assert set(json.loads(files.pop("files.json"))) <= set(files)
    return files


def test_a_new_result_leaves_nothing_of_the_old_one_and_all_of_the_users(old):
    appear(old, MINE)
    assert write_folder(old, NEW, True) == old
    assert written(old) == NEW | MINE


def test_a_users_file_that_would_be_replaced_stays_and_the_results_go_beside_it(old):
    appear(old, {"figures/more/deep.png": b"mine"})
    assert write_folder(old, NEW, True) == old.with_name("out-2")
    assert written(old) == OLD | {"figures/more/deep.png": b"mine"}
    assert written(old.with_name("out-2")) == NEW


@pytest.mark.parametrize(
    "listed", [None, b"", b"[[]]", b'["result.json", "files.json"]', b'{"result.json": "0"}']
)
def test_a_result_that_barnax_did_not_list_with_its_hash_is_the_users(tmp_path, listed):
    """A foreign list is not believed, nor a name."""
    mine = OLD | MINE | ({} if listed is None else {"files.json": listed})
    appear(tmp_path / "out", mine)
    assert write_folder(tmp_path / "out", NEW, True) == tmp_path / "out-2"
    assert inside(tmp_path / "out") == mine


def test_a_file_that_was_changed_since_is_the_users(old):
    (old / "result.json").write_bytes(b"edited")
    assert write_folder(old, NEW, True) == old.with_name("out-2")
    assert (old / "result.json").read_bytes() == b"edited"
    with pytest.raises(InputError, match=r"'result.json' was changed since barnax wrote it"):
        require_free(old, True)


def test_factors_are_not_fitted_where_a_users_table_is_in_the_way(refuse, tmp_path):
    appear(tmp_path, {"a.factors.npz": b"", "mine/tables.csv": b"mine"})
    said = refuse("identify", "a.factors.npz", "--out", "mine", "--force")
    assert "mine: holds 'tables.csv', which barnax did not write" in said


def test_tables_of_factors_whose_folder_was_taken_meanwhile_say_where_they_are(
    run, tmp_path, monkeypatch, bundled_record, bundled_cell
):
    window = Window(score_to_s=2000.5)
    prepared = prepare_record(bundled_record, bundled_cell, "so-rc", window)
    factors = factors_of(prepared, Grid(low_s=4.0, high_s=250.0, nodes=ANYWHERE))
    (tmp_path / "a.factors.npz").write_bytes(factors_to_bytes([factors]))

    def slow(*given):
        appear(tmp_path, {"out/mine.txt": b"mine"})
        return fit_factors(*given)

    monkeypatch.setattr("barnax.fit.record_factors.fit_factors", slow)
    ended = run("identify", "a.factors.npz", "--out", "out")
    assert ended.status == 0, ended.err
    where = f"the results are in {tmp_path / 'out-2'}"
    assert f"warning: out: something else has appeared there; {where}" in ended.err.splitlines()
    assert [*written(tmp_path / "out-2")] == ["tables.csv"]
    assert written(tmp_path / "out") == {"mine.txt": b"mine"}


RACE = """
import sys
from contextlib import suppress
from pathlib import Path
from barnax.cli.output import write_folder
for turn in range(5):
    mark = f"{sys.argv[2]} {turn}".encode()
    files = {"result.json": mark, **{f"figures/{n}.png": mark for n in range(12)}}
    write_folder(Path(sys.argv[1]), files, True)
"""


def test_racing_writers_leave_the_files_of_one_of_them(old):
    command = [sys.executable, "-c", RACE, str(old)]
    racing = [subprocess.Popen([*command, str(number)]) for number in range(3)]
    assert [one.wait() for one in racing] == [0, 0, 0]
    left = written(old)
    assert len(left) == 13
    assert len(set(left.values())) == 1
    assert unfinished(old.parent) == []


def test_an_empty_folder_that_stays_in_use_is_passed_over(tmp_path, monkeypatch):
    fresh, target, replace = tmp_path / "fresh", tmp_path / "out", os.replace
    fresh.mkdir()
    target.mkdir()

    def busy(*given):
        if given[-1] == target or len(given) == 1:
            raise OSError(16, "in use")
        replace(*given)

    monkeypatch.setattr(Path, "rmdir", busy)
    monkeypatch.setattr(os, "replace", busy)
    assert _moved(fresh, target) == tmp_path / "out-2"
    assert sorted(tmp_path.iterdir()) == [target, tmp_path / "out-2"]


def stop(monkeypatch, name, cause, nth=0):
    """The nth call of a function of `os` stops."""
    real, calls = getattr(os, name), []

    def stopped(*given, **more):
        calls.append(given)
        if len(calls) == nth + 1:
            raise cause
        return real(*given, **more)

    monkeypatch.setattr(os, name, stopped)
    return calls


FULL = OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        *((name, FULL) for name in ("mkdir", "fsync", "link", "replace", "unlink", "rmdir")),
        ("replace", KeyboardInterrupt()),
    ],
)
def test_a_stop_at_any_step_leaves_the_old_folder_or_the_new_one(tmp_path, cause, name):
    """Without room for a link there is a copy, and what is not deleted is no failure."""
    outcomes, nth, is_stopped = set(), 0, True
    while is_stopped:
        out = tmp_path / str(nth) / "out"
        appear(write_folder(out, OLD, False), MINE)
        with pytest.MonkeyPatch.context() as patched, suppress(InputError, KeyboardInterrupt):
            calls = stop(patched, name, cause, nth)
            write_folder(out, NEW, True)
        outcomes.add(written(out)["result.json"])
        assert written(out) in (OLD | MINE, NEW | MINE)
        is_left = name in ("unlink", "rmdir") and written(out) == NEW | MINE
        assert is_left or list(out.parent.iterdir()) == [out]
        assert write_folder(out, OLD, True) == out
        assert written(out) == OLD | MINE
        is_stopped, nth = len(calls) > nth, nth + 1
    assert nth > 1
    assert b"new" in outcomes


@pytest.mark.parametrize("cause", [FULL, KeyboardInterrupt()])
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_stop_while_a_file_is_written_leaves_the_old_one(tmp_path, monkeypatch, cause, step):
    path = tmp_path / "cell.h"
    path.write_text("old")
    stop(monkeypatch, step, cause)
    with pytest.raises(InputError if isinstance(cause, OSError) else KeyboardInterrupt):
        write_file(path, b"new")
    assert path.read_text() == "old"
    assert list(contents(tmp_path)) == ["cell.h"]


KILLED = """
import itertools, os, signal, sys
from pathlib import Path
from barnax.cli.output import write_folder

def killing(step):
    steps = itertools.count()
    for name in ("mkdir", "open", "fsync", "link", "rename", "replace", "unlink", "rmdir"):
        def counted(*given, _real=getattr(os, name), **more):
            if next(steps) == step:
                os.kill(os.getpid(), signal.SIGKILL)
            return _real(*given, **more)
        setattr(os, name, counted)

folder, old, new, mine = Path(sys.argv[1]), *map(eval, sys.argv[2:])
is_killed, step = True, 0
while is_killed:
    out = folder / str(step) / "out"
    if old:
        write_folder(out, old, False)
    for name, content in mine.items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_bytes(content)
    child = os.fork()
    if child == 0:
        killing(step)
        write_folder(out, new, True)
        os._exit(0)
    is_killed, step = os.WIFSIGNALED(os.waitpid(child, 0)[1]), step + 1
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no process can kill itself there")
@pytest.mark.parametrize(("before", "mine"), [({}, {}), (OLD, MINE)], ids=["fresh", "replaced"])
def test_a_kill_at_any_step_leaves_the_old_result_or_the_new_one_whole(tmp_path, before, mine):
    """Between the two steps of a replacement the next command restores the new one; what the
    process left stays, and so does what only looks like it."""
    words = map(repr, (before, NEW, mine))
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), *words], check=True)
    wholes, absent, states, left = [before | mine, NEW | mine], 0, [], []
    for parent in sorted(tmp_path.iterdir(), key=lambda path: int(path.name)):
        out = parent / "out"
        left = unfinished(parent)
        absent += bool(before) and not out.exists()
        restore(out / "result.json")
        states.append(wholes.index(written(out)))
        assert write_folder(out, OLD, True) == out
        assert written(out) == OLD | mine
        assert unfinished(parent) == left
    assert (left, absent) == ([], bool(before))
    assert (states[0], states[-1], len(states) > 10) == (0, 1, True)
    assert states == sorted(states)


def test_a_command_restores_the_folder_that_it_is_to_read(run, tmp_path):
    left = aside(tmp_path)
    stored = (Path(__file__).parents[1] / "golden" / "result.json").read_bytes()
    appear(left, {"new/result.json": stored, "old/out/result.json": b"old"})
    assert run("show", tmp_path / "out").status == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [left.name, "out"]


def test_what_is_saved_while_a_folder_is_replaced_stays_beside_it(old, monkeypatch):
    appear(old, MINE)
    real = os.replace

    def late(source, target):
        if Path(source) == old:
            appear(old, {"figures/late.png": b"mine"})
        real(source, target)

    monkeypatch.setattr(os, "replace", late)
    assert write_folder(old, NEW, True) == old
    assert written(old) == NEW | MINE
    assert inside(old.with_name("out-2"))["figures/late.png"] == b"mine"


def test_a_users_folders_and_links_stay_as_they_are(old):
    (old / "empty").mkdir(mode=0o700)
    (old / "away").symlink_to("nowhere")
    appear(old, MINE)
    stamp = (old / "thesis.tex").stat()
    write_folder(old, {"result.json": b"new"}, True)
    assert (old / "empty").stat().st_mode & 0o777 == 0o700
    assert os.readlink(old / "away") == "nowhere"
    assert (old / "thesis.tex").stat().st_mtime_ns == stamp.st_mtime_ns
    assert sorted(path.name for path in (old / "figures").iterdir()) == ["mine.png"]


def test_what_a_killed_command_left_is_reported_and_stays(run, tmp_path):
    left = aside(tmp_path)
    appear(left, {"old/out/result.json": b"old"})
    appear(tmp_path, {".barnax-2024-11/thesis.tex": b"mine"})
    told = run("convert", BUNDLED.record).err
    assert f"{left}: left by a command that was stopped while it wrote, with the result" in told
    assert "2024-11" not in told
    assert (left / "old/out/result.json").read_bytes() == b"old"


def test_a_list_that_names_what_lies_elsewhere_takes_nothing_away(tmp_path, old):
    appear(tmp_path, MINE)
    names = ["../thesis.tex", str(tmp_path / "thesis.tex"), "figures", "."]
    listed = {name: hashlib.sha256(b"mine").hexdigest() for name in names}
    listed["result.json"] = hashlib.sha256(b"old").hexdigest()
    (old / "files.json").write_text(json.dumps(listed))
    write_folder(old, {"result.json": b"new"}, True)
    assert {name: (tmp_path / name).read_bytes() for name in MINE} == MINE
    assert written(old) == {**OLD, "result.json": b"new"}


@pytest.mark.parametrize("kind", ["link", "folder"])
def test_nothing_is_written_through_a_users_link_or_over_a_users_folder(tmp_path, old, kind):
    (tmp_path / "elsewhere").mkdir()
    if kind == "link":
        shutil.rmtree(old / "figures")
        (old / "figures").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    else:
        (old / "figures/more/deep.png").mkdir(parents=True)
    assert write_folder(old, NEW, True) == old.with_name("out-2")
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_two_runs_that_end_at_once_both_keep_their_results(tmp_path, monkeypatch):
    replace = os.replace

    def late(source, target):
        if Path(target) == tmp_path / "out" and not Path(target).exists():
            appear(Path(target), MINE)
            monkeypatch.setattr(os, "replace", replace)
        replace(source, target)

    monkeypatch.setattr(os, "replace", late)
    assert write_folder(tmp_path / "out", NEW, False) == tmp_path / "out-2"
    assert (written(tmp_path / "out"), written(tmp_path / "out-2")) == (MINE, NEW)


def test_results_go_to_where_a_link_points(tmp_path, old):
    (tmp_path / "link").symlink_to(old, target_is_directory=True)
    write_folder(tmp_path / "link", NEW, True)
    assert (tmp_path / "link").is_symlink()
    assert written(old) == NEW
    (tmp_path / "link.h").symlink_to("real.h")
    write_file(tmp_path / "link.h", b"new")
    assert (tmp_path / "real.h").read_text() == "new"


def test_our_files_have_the_permissions_any_new_file_has(tmp_path):
    (tmp_path / "plain").write_text("")
    write_file(tmp_path / "ours", b"")
    write_folder(tmp_path / "out", NEW, False)
    modes = {path.stat().st_mode for path in (tmp_path / "ours", tmp_path / "out/result.json")}
    assert modes == {(tmp_path / "plain").stat().st_mode}
    (tmp_path / "folder").mkdir()
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "folder").stat().st_mode


REFUSED = {
    "out": "out: holds a result; replace it with --force or give --out another folder",
    "foreign": "foreign: holds 'figures', which barnax did not write",
    "file": "file: cannot be used (Not a directory); give --out another folder",
    "file/deeper": "file/deeper: {tmp}/file cannot be written to; give --out another folder",
    "loop": "give --out another folder",
    ".": "results replace their folder as a whole; give --out one in it",
    300 * "x": "cannot be used (File name too long); give --out another folder",
    f"out/{300 * 'x'}": "cannot be used (File name too long); give --out another folder",
}


@pytest.mark.usefixtures("without_work")
@pytest.mark.parametrize(("name", "message"), REFUSED.items(), ids=lambda text: text[:12])
def test_a_path_that_takes_no_folder_is_refused_before_any_work(
    refuse, tmp_path, old, name, message
):
    appear(tmp_path / "foreign", MINE)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "loop").symlink_to("loop")
    forced = () if name == "out" else ("--force",)
    assert message.format(tmp=tmp_path) in refuse(*IDENTIFY, "--out", name, *forced)


def test_a_full_disk_is_refused_before_any_work(tmp_path, monkeypatch):
    usage = {"total": 0, "free": 123_456}
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(**usage))
    require_free(tmp_path / "fresh", False)
    usage["total"] = 10**9
    full = f"fresh: the disk of {tmp_path} has 0.1 MB left, and results take about 4 MB; make room"
    with pytest.raises(InputError, match=re.escape(full)):
        require_free(tmp_path / "fresh", False)


@pytest.mark.parametrize(("files", "is_forced"), [(OLD, False), (MINE, False), (MINE, True)])
def test_what_appears_during_a_run_stays_and_the_results_go_beside_it(tmp_path, files, is_forced):
    appear(tmp_path / "out", files)
    appear(tmp_path / "out-2", MINE)
    (tmp_path / "out-3").write_bytes(b"a file")
    assert write_folder(tmp_path / "out", NEW, is_forced) == tmp_path / "out-4"
    assert written(tmp_path / "out") == files
    assert written(tmp_path / "out-4") == NEW
