"""The journal keeps what is finished, whole or not at all, for the same run alone."""

import json
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from barnax.cli.journal import Journal, fingerprint, journal_path
from barnax.errors import InputError

PIECE = (np.arange(6.0).reshape(2, 3), np.array([1, 2]), np.array([True, False]))
RUN = fingerprint("this run")
# Every example begins by writing the file anew.
ON_ONE_FILE: dict[str, Any] = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture],
}


@pytest.fixture
def path(tmp_path):
    return journal_path(tmp_path / "out")


def same(first, second) -> bool:
    return all(
        one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
        for one, other in zip(first, second, strict=True)
    )


def test_a_piece_comes_back_bit_for_bit_after_the_process_is_gone(path):
    Journal(path, RUN)["3"] = PIECE
    again = Journal(path, RUN)
    assert list(again) == ["3"]
    assert same(again["3"], PIECE)


def test_another_run_starts_anew(path):
    Journal(path, RUN)["0"] = PIECE
    assert not Journal(path, fingerprint("another run"))
    assert not Journal(path, RUN)


@settings(max_examples=60, **ON_ONE_FILE)
@given(data=st.data())
def test_a_journal_cut_anywhere_keeps_its_whole_pieces_and_goes_on(path, data):
    path.unlink(missing_ok=True)
    journal = Journal(path, RUN)
    sizes = []
    for name in "abc":
        journal[name] = PIECE
        sizes.append(path.stat().st_size)
    kept = data.draw(st.integers(0, sizes[-1]))
    path.write_bytes(path.read_bytes()[:kept])
    again = Journal(path, RUN)
    assert list(again) == [name for name, size in zip("abc", sizes, strict=True) if size <= kept]
    again["d"] = PIECE
    assert "d" in Journal(path, RUN)


@settings(max_examples=100, **ON_ONE_FILE)
@given(content=st.binary(max_size=300))
def test_any_bytes_in_its_place_are_no_journal(path, content):
    path.write_bytes(content)
    assert not Journal(path, RUN)


def test_a_flipped_bit_is_noticed(path):
    Journal(path, RUN)["0"] = PIECE
    content = bytearray(path.read_bytes())
    content[-20] ^= 1
    path.write_bytes(content)
    assert not Journal(path, RUN)


def test_an_array_of_another_kind_is_not_taken(path):
    journal = Journal(path, RUN)
    entry = json.dumps(
        {"piece": "0", "arrays": [{"dtype": "|O", "shape": [1], "data": "AAAA"}]}
    ).encode()
    with journal.path.open("ab") as file:
        file.write(b"%08x %s\n" % (zlib.crc32(entry), entry))
    assert not Journal(path, RUN)


def test_a_removed_journal_leaves_nothing(path):
    journal = Journal(path, RUN)
    journal["0"] = PIECE
    journal.remove()
    assert not path.exists()
    journal.remove()


def test_a_place_that_cannot_be_written_to_is_named(tmp_path):
    with pytest.raises(InputError, match="cannot be written to"):
        Journal(tmp_path, RUN)
