"""Fuzz what is read, guided by the code that each input reaches: `python tests/fuzz/guided.py`.

`python tests/fuzz/guided.py [SECONDS A TARGET] [TARGET...]` needs the package atheris (Google's
binding of libFuzzer). Anything but a documented error, an end of the process, 20 s or 4 GB for one
input is a finding, kept in the folder that is named. Writes benchmarks/results/fuzz.md when all
targets were run.
"""

import re
import subprocess
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parents[2])]

from fuzz.bombs import SHEET  # noqa: E402
from fuzz.hostile import FRAME, GOOD_FILES, sheet  # noqa: E402

PAGE = HERE.parents[2] / "benchmarks" / "results" / "fuzz.md"
SECONDS = 600
LIMITS = ("-timeout=20", "-rss_limit_mb=4096", "-max_len=20000")


@dataclass(frozen=True)
class Target:
    """What reads the bytes, and good ones to begin with."""

    name: str
    what: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path, bytes], None]


def read_record_of(path: Path, content: bytes) -> None:
    from barnax.doctor import diagnose
    from barnax.errors import InputError
    from barnax.records import read_record

    path.write_bytes(content)
    for read in (read_record, diagnose):
        try:
            read(path)
        except InputError:
            continue


def read_sheet_of(path: Path, content: bytes) -> None:
    """A workbook whose sheet is these bytes: an archive's check sums stop changes of its own."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, part in PARTS.items():
            archive.writestr(name, content if name == SHEET else part)
    read_record_of(path, path.read_bytes())


def read_bounds_of(path: Path, content: bytes) -> None:
    from barnax.bounds import Bounds, read_bounds
    from barnax.errors import InputError

    path.write_bytes(content)
    try:
        Bounds.default(2.0, 1.0, 1000.0).with_changes(read_bounds(path), {}, "box")
    except InputError:
        return


def read_result_of(path: Path, content: bytes) -> None:
    from barnax.comparison import ComparisonResult
    from barnax.errors import InputError
    from barnax.export import EXPORTERS
    from barnax.result import Result

    path.write_bytes(content)
    for kind in (Result, ComparisonResult):
        try:
            stored = kind.from_json(path)
        except InputError:
            continue
        if isinstance(stored, Result):
            for exporter in EXPORTERS.values():
                exporter.write(stored)


def stored_results() -> list[bytes]:
    from fuzz.stored import good_comparison, good_result

    return [good.to_json().encode() for good in (good_result(), good_comparison())]


PARTS: dict[str, bytes] = {}
BOX = b'[bounds]\n"R0 [Ohm]" = [0.001, 0.1]\n"tau1 [s]" = [1, 20]\n"C2 [F]" = [100.0, 2e4]\n'
TARGETS = {
    target.name: target
    for target in (
        Target("text", "delimited text", lambda: GOOD_FILES["csv"], read_record_of),
        Target("parquet", "Parquet table", lambda: GOOD_FILES["parquet"], read_record_of),
        Target("archive", "workbook, its archive", lambda: GOOD_FILES["workbook"], read_record_of),
        Target("sheet", "workbook, a sheet in it", lambda: [PARTS[SHEET]], read_sheet_of),
        Target("bounds", "file of bounds", lambda: [BOX], read_bounds_of),
        Target("result", "result and comparison", stored_results, read_result_of),
    )
}


def fuzz(name: str, folder: Path, seconds: int) -> None:
    """Fuzz one target in this process, until the time is over or something is found."""
    import atheris

    with atheris.instrument_imports(include=["barnax"]):
        import barnax.comparison
        import barnax.doctor
        import barnax.export
        import barnax.records  # noqa: F401
    warnings.simplefilter("error")
    with zipfile.ZipFile(folder / "good.xlsx", "w") as archive:
        archive.comment = b""
    (folder / "good.xlsx").write_bytes(sheet(FRAME))
    with zipfile.ZipFile(folder / "good.xlsx") as archive:
        PARTS.update({part: archive.read(part) for part in archive.namelist()})
    target = TARGETS[name]
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, seed in enumerate(target.seeds()):
        (corpus / str(number)).write_bytes(seed)
    path = folder / "cell.csv"
    options = [*LIMITS, f"-max_total_time={seconds}", f"-artifact_prefix={folder}/found-"]
    atheris.Setup(
        [sys.argv[0], *options, str(corpus)], lambda content: target.read(path, bytes(content))
    )
    atheris.Fuzz()


def run(target: Target, seconds: int) -> tuple[str, str]:
    """A row of the page, and what was found."""
    folder = Path(tempfile.mkdtemp(prefix=f"barnax-fuzz-{target.name}-"))
    done = subprocess.run(
        [sys.executable, str(HERE), "--one", target.name, str(folder), str(seconds)],
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )
    status = re.findall(r"#(\d+)\s+\w+\s+cov: (\d+)", done.stderr)
    inputs, reached = status[-1] if status else ("0", "0")
    first = status[0][1] if status else "0"
    kept = len(list((folder / "corpus").iterdir()))
    found = sorted(path.name for path in folder.glob("found-*"))
    if done.returncode or found:
        print(done.stderr[-4000:], f"kept in {folder}", file=sys.stderr)
    cells = [target.what, seconds, inputs, kept, first, reached, len(found)]
    return f"| {' | '.join(map(str, cells))} |", ", ".join(found)


def main() -> None:
    """Fuzz one target after the other, print the page and write it."""
    if sys.argv[1:2] == ["--one"]:
        _, _, name, folder, seconds = sys.argv
        fuzz(name, Path(folder), int(seconds))
        return
    from benchmarks.pages import save_page
    from benchmarks.table2.provenance import as_markdown, provenance

    words = sys.argv[1:]
    seconds = int(words.pop(0)) if words and words[0].isdigit() else SECONDS
    chosen = words or list(TARGETS)
    rows = [run(TARGETS[name], seconds)[0] for name in chosen]
    page = "\n".join(
        [
            "# Fuzzed with an eye on the code",
            "",
            as_markdown(provenance("python tests/fuzz/guided.py", 0, "atheris", "polars")),
            "",
            "Each target is given good files and whatever libFuzzer makes of them, one process "
            "each. A finding is anything but a documented error, the end of the process, or more "
            "than 20 s or 4 GB for one input. `lines reached` counts what libFuzzer counts in "
            "barnax's own code, by the good files alone and in the end.",
            "",
            "| target | seconds | inputs | kept inputs | reached first | reached last | findings |",
            "|---|---|---|---|---|---|---|",
            *rows,
            "",
        ]
    )
    print(page)
    if chosen == list(TARGETS):
        save_page(PAGE, page)


if __name__ == "__main__":
    main()
