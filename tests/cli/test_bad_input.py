"""What cannot be used: exit status 2, one message with file, row, value and remedy, no files.

The messages themselves stand in `golden/refusals-files.txt`, `golden/refusals-options.txt` and
`golden/refusals-commands.txt`.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from barnax import inputs
from barnax.__main__ import _complain
from barnax.bundled import BUNDLED
from barnax.plan import looking
from helpers.golden import GOLDEN, RESULT, require_golden, without_blanks
from helpers.records import CURRENT, TIME, VOLTAGE, changed, frame, once

from .conftest import BUDGET, OCV

RECORD, VALIDATION = BUNDLED.record, BUNDLED.validation


PART = frame()[:2000]


def discharging_without_rests() -> pl.DataFrame:
    moving = frame(BUNDLED.ocv[1].stem).filter(pl.col(CURRENT).abs() > 0.02)
    return moving.with_columns(pl.Series(TIME, np.arange(len(moving)) * 2.0))


FRAMES = {
    "no_current.csv": PART.drop(CURRENT),
    "nan [v2].csv": changed(PART, VOLTAGE, np.nan, [98]),
    "backward.csv": changed(PART, TIME, 3.5, [98]),
    "zero_volts.csv": changed(frame("validation")[:2000], VOLTAGE, 0.0, [98]),
    "no_rests.csv": discharging_without_rests(),
}
CONTENTS = {
    "empty.csv": b"",
    "noise.csv": np.random.default_rng(0).bytes(4096),
    "table.toml": b'[box]\n"R0 [Ohm]" = [1, 2]',
    "broken.toml": b"[bounds\n",
}

FILES = [
    *((name, *OCV) for name in (*FRAMES, *CONTENTS) if name.endswith(".csv")),
    (RECORD, "--ocv", "no_rests.csv"),
    (RECORD, "--ocv", "absent.csv"),
    (RECORD, *OCV, "--validate", "zero_volts.csv"),
    (RECORD, *OCV, "--validate", RECORD),
    (RECORD, *OCV, "--validate", "part.csv"),
    (RECORD, "copy.parquet", *OCV),
    (300 * "x", *OCV),
    OCV,
    ("--current-sign", "discharge-positive"),
    ("--ocv-current-sign", "discharge-positive"),
    ("--validate-current-sign", "discharge-positive"),
]
OPTIONS = [
    ("--method", "nope"),
    ("--model", "nope"),
    ("--population", "100000000"),
    ("--seeds", "-1"),
    ("--score-from", "2000"),
    ("--score-from", "1e9", "--score-to", "2e9"),
    ("--score-steps", "7;8"),
    ("--score-steps", "7"),
    ("--score-soc", "0.9,0.1"),
    ("--score-soc", "0.2:0.8"),
    ("--start-time", "-5"),
    ("--start-time", "5", "--start-after-step", "3"),
    ("--initial-soc", "80"),
    ("--initial-soc", "0.02"),
    ("--initial-soc", "other.csv=0.9"),
    ("--initial-direction", "0"),
    ("--rest-current", "50"),
    ("--rest-current", "nan"),
    ("--capacity", "nan"),
    ("--capacity", "20"),
    ("--fix", "C1 [F]=lots"),
    ("--fix", "R9 [Ohm]=1"),
    ("--fix", "R0 [Ohm]=-1"),
    ("--fix", "C1 [F]=5", "--fix", "tau1 [s]=5"),
    ("--bounds", "wide.toml", "--objective", "compressed"),
    *(("--bounds", name) for name in (*CONTENTS, "absent.toml", ".") if "csv" not in name),
]
READING = [
    *(("--voltage-lag", lag) for lag in ("other.csv=1", "late", "part.csv=nan", "1e9")),
    *(("--series", count) for count in ("0", "100000")),
    ("--columns", "strom=I"),
]
COMMANDS = [
    ("export", "result.json", "--to", "spice"),
    ("export", "result.json", "--to", "csv", "--verify"),
    ("export", "result.json", "--to", "csv", "--out", "result.json", "--force"),
    *(("export", "result.json", "--to", "csv", "--out", out) for out in ("x", ".", "empty.csv/in")),
    *(("export", name, "--to", "csv") for name in ("absent.json", "other.json", "noise.csv")),
    ("compare", "--models", "so-rc,rc"),
    ("compare", "--methods", "ls,guess"),
    ("compare", "folder"),
    ("compare", "plan.toml"),
    ("hppc", VALIDATION),
    ("soc", "result.json", VALIDATION, "--estimate", "offset,R9"),
    ("soc", "result.json", VALIDATION, "--voltage-lag", "other.csv=1"),
    ("validate", "result.json", "backward.csv"),
    ("validate", "result.json", VALIDATION, "--current-sign", "discharge-positive"),
    ("validate", "result.json", VALIDATION, "--initial-soc", "other.csv=1"),
    ("pack", RECORD, "--validate", VALIDATION),
    *(("identify", "part.csv", *OCV, *words) for words in READING),
    *(("identify", *words) for words in (("--nodes", "5"), ("--folds=0",), ("--no-rising-ocv",))),
]


@pytest.fixture
def bad_files(tmp_path: Path) -> None:
    for name, table in FRAMES.items():
        table.write_csv(tmp_path / name)
    for name, content in CONTENTS.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "folder").mkdir()
    shutil.copy(RESULT, tmp_path)
    (tmp_path / "copy.parquet").write_bytes(RECORD.read_bytes())
    PART.write_csv(tmp_path / "part.csv")
    (tmp_path / "wide.toml").write_text('[bounds]\n"tau1 [s]" = [1e-6, 1e9]\n')


@pytest.mark.usefixtures("bad_files")
@pytest.mark.parametrize(
    ("cases", "golden"), [(FILES, "files"), (OPTIONS, "options"), (COMMANDS, "commands")]
)
def test_every_refusal_is_one_message_that_says_what_to_do(
    refuse, monkeypatch, tmp_path, cases, golden
):
    # Nothing is searched for before everything was looked at.
    monkeypatch.setattr("barnax.identification.answer.search_seeds", None)
    # The bundled cell is the same in every case.
    looks = {inputs: ("read_record", "read_ocv_test"), looking: ("read_ocv_test", "check_file")}
    for module, name in ((module, name) for module, names in looks.items() for name in names):
        monkeypatch.setattr(module, name, once(getattr(module, name)))
    told = []
    for case in cases:
        words = [word.name if isinstance(word, Path) else word for word in case]
        given = [] if golden == "commands" else ["identify"]
        message = refuse(*given, *(BUDGET if given else ()), *case)
        assert message.lower().count("error: ") == 1
        assert message.startswith(("error: ", "Error: "))
        told += [f"$ barnax {' '.join([*given, *words])}", message.replace(str(tmp_path), ".")]
    require_golden(GOLDEN / f"refusals-{golden}.txt", without_blanks("\n".join(told)))


@pytest.mark.parametrize(
    ("words", "platform"),
    [(("identify",), "nonsense"), pytest.param(("fleet", "m.csv"), "rocm", marks=pytest.mark.slow)],
    ids=str,
)
def test_a_platform_that_is_not_there_is_one_line_with_the_remedy(tmp_path, words, platform):
    (tmp_path / "m.csv").write_text("id,records\na,nowhere.csv\n")
    run = [sys.executable, "-m", "barnax", *words]
    environment = os.environ | {"JAX_PLATFORMS": platform}
    done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True)
    *_, last = done.stderr.splitlines()
    assert last.startswith(f"error: JAX_PLATFORMS={platform}: JAX cannot compute there")
    assert "unset JAX_PLATFORMS" in last
    assert (done.returncode, done.stderr.count("\n")) == (2, len(words))


def test_a_name_between_colons_is_printed_as_it_stands(capsys):
    _complain("give `columns='time=Zeit:x:s'`")
    assert "Zeit:x:s" in capsys.readouterr().err
