"""Whatever is in a file: it is read, or refused with an InputError, and nothing else happens."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from barnax.checks import check_file
from barnax.errors import InputError
from barnax.records import Record, read_record

from .hostile import GOOD_FILES, absurd_frames, absurd_texts, damaged, parquet, sheet
from .repeated import EXAMPLES, repeated


def survive(folder: Path, content: bytes) -> None:
    """Read and examine a file. What is refused has an error that the doctor names too."""
    path = folder / "cell.csv"
    path.write_bytes(content)
    record, refusal = None, "cell.csv: "
    try:
        record = read_record(path)
    except InputError as problem:
        refusal = str(problem)
    assert refusal.startswith("cell.csv: ")
    assert len(refusal) < 5000
    if record is not None:
        require_record(record)
    try:
        diagnosis = check_file(path)
    except InputError:
        assert record is None
    else:
        has_errors = any(finding.severity == "error" for finding in diagnosis.findings)
        assert has_errors or record is not None


def require_record(record: Record) -> None:
    """What every record promises."""
    assert record.samples >= 10
    assert len(record.time_s) == len(record.current_a) == len(record.voltage_v) == record.samples
    for values in (record.current_a, record.voltage_v, record.discharged_ah):
        assert np.isfinite(values).all()
    assert (np.diff(record.time_s) > 0).all()
    assert np.abs(record.voltage_v).max() <= 100


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("start", [b"", b"PAR1", b"PK\3\4xl/", b"\xff\xfe"])
def test_random_bytes(tmp_path: Path, start: bytes, examples: int):
    contents = st.binary(max_size=300).map(lambda content: start + content + start[:4])
    repeated(examples, lambda content: survive(tmp_path, content), contents)


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("kind", GOOD_FILES)
def test_damaged_files(tmp_path: Path, kind: str, examples: int):
    repeated(examples, lambda content: survive(tmp_path, content), damaged(GOOD_FILES[kind]))


@pytest.mark.parametrize("examples", EXAMPLES)
def test_absurd_texts(tmp_path: Path, examples: int):
    repeated(examples, lambda content: survive(tmp_path, content), absurd_texts())


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("write", [parquet, sheet])
def test_absurd_numbers(tmp_path: Path, write: Callable, examples: int):
    repeated(examples, lambda frame: survive(tmp_path, write(frame)), absurd_frames())
