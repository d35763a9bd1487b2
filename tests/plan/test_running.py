"""A folder and a plan identified: the same answer as by hand, from Python and by the command."""

import hashlib
import shutil
from pathlib import Path

import pytest

import barnax
from barnax import InputError, Result, read_record
from barnax.bundled import BUNDLED
from barnax.plan import Plan, plan, plan_from_toml, plan_to_toml
from barnax.plan.document import FileRole
from barnax.plan.running import planned
from barnax.reporting.wording import table
from cli.conftest import run_command
from helpers.records import pulse_frame

SMALL = {"model": "so-rc", "seeds": 0, "trust": "none"}
WORDS = ("--model", "so-rc", "--trust", "none", "--score-to", "1500", "--seeds", "0")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    for path in (BUNDLED.record, BUNDLED.validation, *BUNDLED.ocv):
        shutil.copy(path, folder)
    return folder


@pytest.fixture(scope="module")
def by_hand():
    window = barnax.Window(score_to_s=1500.0)
    return barnax.identify(
        [BUNDLED.record, BUNDLED.validation], ocv=BUNDLED.ocv, window=window, **SMALL
    )


def test_python_takes_a_folder(folder, by_hand):
    actual = barnax.identify(folder, window=barnax.Window(score_to_s=1500.0), **SMALL)
    assert actual.parameters == by_hand.parameters
    assert actual.metrics == by_hand.metrics


@pytest.mark.slow
def test_the_command_takes_a_folder_and_stores_how_to_do_it_by_hand(
    folder, by_hand, tmp_path, monkeypatch
):
    monkeypatch.setattr("barnax.cli.identify.result_files", lambda *_: {})
    outcome = run_command("identify", folder, *WORDS, "--out", tmp_path / "out")
    assert outcome.status == 0
    assert "identification.parquet (drive cycle)" in outcome.out
    stored = Result.from_json(tmp_path / "out" / "result.json")
    assert stored.parameters == by_hand.parameters
    assert str(folder) not in stored.to_json()
    assert {file.name: file.role for file in stored.plan} == {
        "identification.parquet": "identification",
        "validation.parquet": "identification",
        "ocv_discharge.parquet": "OCV test",
        "ocv_charge.parquet": "OCV test",
    }
    planned = table("result.plan", stored.plan)
    assert planned.rows[0][:3] == ("identification.parquet", "identification", "drive cycle")
    assert "752 current steps" in planned.rows[0][3]
    # The plan that the run stored does the same, wherever it is run.
    outcome = run_command("identify", tmp_path / "out" / "plan.toml", "--out", tmp_path / "again")
    assert outcome.status == 0
    written = [(tmp_path / place / "result.json").read_bytes() for place in ("out", "again")]
    assert written[0] == written[1]


def test_the_sampling_that_a_design_shows_is_of_its_logger_alone(tmp_path):
    record, ocv = pulse_frame(), pulse_frame().rename({"Voltage / V": "Voltage [V]"})
    record.write_csv(tmp_path / "test.csv")
    ocv.write_csv(tmp_path / "ocv.csv")
    parts = (
        FileRole(
            path=tmp_path / "test.csv", name="test.csv", role="identification", sampling="backward"
        ),
        FileRole(path=tmp_path / "ocv.csv", name="ocv.csv", role="OCV test"),
    )
    path = tmp_path / "plan.toml"
    path.write_text(plan_to_toml(Plan("identify", parts)))
    job = planned(plan_from_toml(path), barnax.Job())
    holds = [read_record(source).hold for source in (*job.records, *job.ocv)]
    assert [hold.value for hold in holds] == ["backward", "forward"]
    assert "the steps of the designed test show it" in holds[0].reason
    # What a user gives holds for all, and another word is none.
    given = [read_record(each, current_hold="centered") for each in job.records]
    assert [one.hold.value for one in given] == ["centered"]
    path.write_text(path.read_text().replace('"backward"', '"late"'))
    with pytest.raises(InputError, match="sampling is 'late'; give 'forward', 'backward' or 'cent"):
        plan_from_toml(path)


def test_a_plan_written_and_read_is_the_same(folder, tmp_path):
    lags = ["0.1", "validation.parquet=0.3"]
    actual = plan(folder).changed(
        {"validation.parquet": barnax.Window(start_time_s=10.5, score_steps=(7, 8))},
        model="so-rc",
        voltage_lag=lags,
    )
    path = tmp_path / "plan.toml"
    path.write_text(plan_to_toml(actual))
    read = plan_from_toml(path)
    assert (read.command, dict(read.options)) == (actual.command, dict(actual.options))
    assert [(each.path, each.name, each.role, each.window) for each in read.parts] == [
        (each.path, each.name, each.role, each.window) for each in actual.parts
    ]
    # A start that is chosen replaces the planned one as a whole.
    assert read.of_role("identification")[1].window.initial_soc is None


def test_what_a_plan_names_is_read_where_it_moved_with_the_plan(tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    files = [old / "cold" / "drive.csv", old / "warm" / "drive.csv", old / "slow.csv"]
    table = '[[files]]\nfile = "{}"\nrole = "identification"\n'
    text = f'bounds = "{(old / "box.toml").as_posix()}"\n'
    text += "".join(table.format(path.as_posix()) for path in files)
    (new / "out").mkdir(parents=True)
    for path in ("cold/drive.csv", "warm/drive.csv", "out/slow.csv", "box.toml"):
        (new / path).parent.mkdir(exist_ok=True)
        (new / path).touch()
    (new / "box.toml").write_text("[bounds]\n")
    (new / "out" / "plan.toml").write_text(text)
    read = plan_from_toml(new / "out" / "plan.toml")
    names = ("cold/drive.csv", "warm/drive.csv", "out/slow.csv")
    assert [part.path for part in read.parts] == [new / name for name in names]
    assert [part.name for part in read.parts] == [*names[:2], "slow.csv"]
    assert read.options["bounds"] == new / "box.toml"
    # The plan does not say what was in them.
    assert [one.code for one in read.warnings] == ["plan.other-file"] * 4
    # What is where the plan says is taken from there.
    files[0].parent.mkdir(parents=True)
    files[0].touch()
    assert plan_from_toml(new / "out" / "plan.toml").parts[0].path == files[0]


def test_a_file_of_the_name_that_is_not_the_planned_one_is_not_taken(tmp_path, monkeypatch):
    above, work = tmp_path / "above", tmp_path / "above" / "work"
    work.mkdir(parents=True)
    (above / "drive.csv").write_text("another cell")
    digest = hashlib.sha256(b"this cell").hexdigest()
    table = '[[files]]\nfile = "/gone/drive.csv"\nrole = "identification"\n'
    (work / "plan.toml").write_text(f'{table}sha256 = "{digest}"\n')
    monkeypatch.chdir(work)
    # The folder above a working folder, too, is looked in.
    for plan_file in (Path("plan.toml"), work / "plan.toml"):
        (above / "drive.csv").write_text("another cell")
        read = plan_from_toml(plan_file)
        assert read.parts[0].path == Path("/gone/drive.csv")
        assert not read.warnings
        (above / "drive.csv").write_text("this cell")
        read = plan_from_toml(plan_file)
        assert read.parts[0].path.samefile(above / "drive.csv")
        assert not read.warnings
        assert digest in plan_to_toml(read)
    # Where the plan says it lies, it may be another one by now, and is told.
    (work / "plan.toml").write_text(f'{table}sha256 = "{digest}"\n'.replace("/gone/", ""))
    Path("drive.csv").write_text("this cell")
    assert not plan_from_toml("plan.toml").warnings
    Path("drive.csv").write_text("another cell")
    (notice,) = plan_from_toml("plan.toml").warnings
    assert (notice.code, notice.subject) == ("plan.other-file", "drive.csv")
    assert "path" not in notice.values

    # Beside the plan lies another file of that name.
    (above / "drive.csv").write_text("this cell")
    monkeypatch.chdir(above)
    read = plan_from_toml(work / "plan.toml")
    assert (read.parts[0].path, read.warnings) == (Path("drive.csv"), ())
    monkeypatch.chdir(work)
    Path("plan.toml").write_text(table)
    (notice,) = plan_from_toml("plan.toml").warnings
    assert notice.values["path"] == str(Path("drive.csv").absolute())
    assert notice.subject == "/gone/drive.csv"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("capacity = ", r"cannot be read as a plan in TOML \(error at its end\)"),
        ("\ncapacity = x\n", r"\(error at line 2, column 12\)"),
        ("model = '2rc'\n", "plan.toml: model '2rc' is not known; there are iso-rc, so-rc"),
        ("capacity = 'x'\n", "plan.toml: capacity is 'x'; give a valid number"),
        ("colour = 1\n", "'colour' is not a key of a plan"),
        ("reasons = 3\n", "plan.toml: reasons is 3; give a table"),
        ("[[files]]\nrole = 'validation'\n", r"has no 'file'"),
        (
            "[[files]]\nfile = 'a'\nrole = 'other'\n",
            "role is 'other'; give 'identification', 'OCV test'",
        ),
        ("[[files]]\nfile = 'a'\nrole = 'validation'\n", "no file has the role identification"),
        (
            "[[files]]\nfile = 'a'\nrole = 'validation'\ninitial_soc = 7\n",
            "a: initial_soc 7.0 is not a fraction",
        ),
    ],
)
def test_a_plan_that_cannot_be_used_is_refused_with_the_key(tmp_path, text, message):
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        plan_from_toml(path)
