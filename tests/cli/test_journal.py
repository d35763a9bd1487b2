"""The journal keeps what is finished, whole or not at all, for the same run alone."""

import json
import os
import subprocess
import sys
import zlib
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from barnax.cli import journal as module
from barnax.cli.journal import Journal, fingerprint, journal_path
from barnax.errors import InputError

PIECE = (np.arange(6.0).reshape(2, 3), np.array([1, 2]), np.array([True, False]))
RUN, OTHER = fingerprint("this run"), fingerprint("another run")
# Every example begins by writing the file anew.
ON_ONE_FILE: dict[str, Any] = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture],
}


@pytest.fixture
def folder(tmp_path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def path(folder) -> Path:
    return journal_path(folder)


def finish(folder: Path, *names: str, run: str = RUN) -> None:
    """A run that finishes these pieces and stops."""
    with closing(Journal(folder, run)) as journal:
        for name in names:
            journal[name] = PIECE


def kept(folder: Path, run: str = RUN) -> dict[str, Any]:
    """What a run finds."""
    with closing(Journal(folder, run)) as journal:
        return dict(journal)


def same(first, second) -> bool:
    return all(
        one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
        for one, other in zip(first, second, strict=True)
    )


def test_a_piece_comes_back_bit_for_bit_after_the_process_is_gone(folder):
    finish(folder, "3")
    again = kept(folder)
    assert list(again) == ["3"]
    assert same(again["3"], PIECE)


def test_another_run_starts_anew_and_takes_the_place_with_its_first_piece(folder):
    finish(folder, "0")
    assert not kept(folder, OTHER)
    # It was refused, or interrupted, before it had anything to keep.
    assert list(kept(folder)) == ["0"]
    finish(folder, "5", run=OTHER)
    assert list(kept(folder, OTHER)) == ["5"]
    assert not kept(folder)


def test_no_line_of_another_run_is_ever_taken(folder, path):
    finish(folder, "0", run=OTHER)
    theirs = path.read_bytes().splitlines(keepends=True)
    finish(folder, "1")
    # As where the system has no locks, and the other run goes on writing.
    with path.open("ab") as file:
        file.writelines(theirs[1:])
    assert list(kept(folder)) == ["1"]


def test_a_journal_that_another_process_has_open_is_refused(folder):
    code = (
        "import sys; from pathlib import Path; from barnax.cli.journal import Journal\n"
        "journal = Journal(Path(sys.argv[1]), 'its run'); print('open', flush=True); input()"
    )
    words = [sys.executable, "-c", code, str(folder)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdin
        assert other.stdout
        assert other.stdout.readline() == "open\n"
        with pytest.raises(InputError, match=r"another run .*--out") as refused:
            Journal(folder, RUN)
        assert str(folder) in str(refused.value)
        other.kill()
    finish(folder, "0")
    assert list(kept(folder)) == ["0"]


def test_a_file_that_its_owner_removes_meanwhile_is_not_the_journal(folder, path, monkeypatch):
    lock, calls = module._lock, []

    def removed_just_before(file):
        calls.append(file)
        if len(calls) == 1:
            path.unlink()
        lock(file)

    monkeypatch.setattr(module, "_lock", removed_just_before)
    finish(folder, "0")
    assert len(calls) == 2
    assert list(kept(folder)) == ["0"]


@settings(max_examples=60, **ON_ONE_FILE)
@given(data=st.data())
def test_a_journal_cut_anywhere_keeps_its_whole_pieces_and_goes_on(folder, path, data):
    path.unlink(missing_ok=True)
    sizes = []
    for name in "abc":
        finish(folder, name)
        sizes.append(path.stat().st_size)
    length = data.draw(st.integers(0, sizes[-1]))
    path.write_bytes(path.read_bytes()[:length])
    whole = [name for name, size in zip("abc", sizes, strict=True) if size <= length]
    assert list(kept(folder)) == whole
    finish(folder, "d")
    assert list(kept(folder)) == [*whole, "d"]


@settings(max_examples=100, **ON_ONE_FILE)
@given(content=st.binary(max_size=300))
def test_any_bytes_in_its_place_are_no_journal(folder, path, content):
    path.write_bytes(content)
    assert not kept(folder)


def test_a_flipped_bit_is_noticed(folder, path):
    finish(folder, "0")
    content = bytearray(path.read_bytes())
    content[-20] ^= 1
    path.write_bytes(content)
    assert not kept(folder)


@pytest.mark.parametrize(("dtype", "names"), [("|O", ["0"]), ("|b1", ["0", "1"])])
def test_an_array_of_another_kind_is_not_taken(folder, path, dtype, names):
    finish(folder, "0")
    entry = json.dumps(
        {"piece": "1", "arrays": [{"dtype": dtype, "shape": [3], "data": "AAAA"}]}
    ).encode()
    with path.open("ab") as file:
        file.write(b"%08x %s\n" % (zlib.crc32(entry, zlib.crc32(RUN.encode())), entry))
    assert list(kept(folder)) == names


def test_a_removed_journal_leaves_nothing(folder, path):
    with closing(Journal(folder, RUN)) as journal:
        journal["0"] = PIECE
        journal.remove()
        assert not path.exists()
        journal.remove()


def test_a_run_that_finished_nothing_leaves_nothing(folder, path):
    with closing(Journal(folder, RUN)):
        pass
    assert not path.exists()


def test_a_place_that_cannot_be_written_to_is_named(folder, path):
    path.mkdir()
    with pytest.raises(InputError, match="cannot be written to"):
        Journal(folder, RUN)


def test_a_full_disk_is_a_warning_and_the_run_goes_on(folder, path, monkeypatch):
    told = []
    with closing(Journal(folder, RUN, told.append)) as journal:
        journal["0"] = PIECE
        with monkeypatch.context() as patch:

            def full(_):
                raise OSError(28, "No space left on device")

            patch.setattr(os, "fsync", full)
            journal["1"] = PIECE
        journal["2"] = PIECE
        assert list(journal) == ["0", "1", "2"]
        assert journal.is_kept
    assert len(told) == 1
    assert "No space left on device" in told[0]
    assert str(path) in told[0]
    assert list(kept(folder)) == ["0"]


def test_a_piece_that_only_half_fits_is_cut_off_again(folder, path):
    resource = pytest.importorskip("resource", reason="not on Windows")
    told = []
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    finish(folder, "0")
    size = path.stat().st_size
    with closing(Journal(folder, RUN, told.append)) as journal:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 50, before[1]))
        try:
            journal["1"] = PIECE
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(told) == 1
    assert path.stat().st_size == size
    assert list(kept(folder)) == ["0"]


def test_a_disk_that_was_full_from_the_start_keeps_nothing(folder, path, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    told = []
    with closing(Journal(folder, RUN, told.append)) as journal:
        journal["0"] = PIECE
        assert list(journal) == ["0"]
        assert not journal.is_kept
    assert len(told) == 1
    assert not path.exists()
