"""`barnax validate`: stored parameters on another record, as identify itself would report them."""

import json

import polars as pl
import pytest

from barnax.bundled import BUNDLED
from barnax.results import Result

from .conftest import contents


@pytest.fixture
def stored(finished):
    return finished.folder / "result.json"


@pytest.fixture
def rewritten(stored, tmp_path):
    """The stored result with other fields in the windows of its records."""

    def write(**fields):
        document = json.loads(stored.read_text())
        for each in document["inputs"]:
            if each["window"] is not None:
                each["window"] |= fields
        (tmp_path / "changed.json").write_text(json.dumps(document))
        return "changed.json"

    return write


@pytest.fixture
def drive(tmp_path):
    """A record that the result does not know."""
    pl.read_parquet(BUNDLED.validation).head(1700).write_parquet(tmp_path / "drive.parquet")
    return "drive.parquet"


def test_json_reproduces_the_metrics_of_the_result_exactly(run, stored, tmp_path):
    metrics = json.loads(stored.read_text())["metrics"]
    outcome = run("validate", stored, BUNDLED.validation, "--json")
    assert (outcome.status, outcome.err) == (0, "")
    assert json.loads(outcome.out) == metrics["validation"][0]
    assert contents(tmp_path) == {}
    outcome = run("validate", stored, BUNDLED.record, "--json")
    # With another start too, which is told of records to validate on alone.
    moved = dict.fromkeys(("registered [V]", "start_moved_soc"))
    assert json.loads(outcome.out) | moved == metrics["identification"]
    assert (
        "warning: identification.parquet: the circuit was identified on this record" in outcome.err
    )
    assert "validate on another record" in outcome.err


def test_the_table_is_one_line_and_quiet_prints_warnings_alone(run, stored):
    outcome = run("validate", stored, BUNDLED.validation)
    metrics = Result.from_json(stored).metrics.validation[0]
    (line,) = (
        line for line in outcome.out.splitlines() if line.strip().startswith("validation.parquet")
    )
    assert float(line.split()[1]) == pytest.approx(1e3 * metrics.rmse_v, rel=1e-4)
    assert run("validate", stored, BUNDLED.validation, "-q") == (0, "", "")
    plain = pl.read_parquet(BUNDLED.validation).rename({"Current / A": "current"})
    plain.write_csv("plain.csv")
    for word in ("--quiet", "--json"):
        err = run("validate", stored, "plain.csv", word).err
        assert "note: plain.csv: " in err
        assert "assumed A for 'current'" in err


def told(run, *words):
    outcome = run("validate", *words, "--json")
    assert outcome.status == 0, outcome.err
    return json.loads(outcome.out)


def rmse_v(run, *words):
    return told(run, *words)["rmse [V]"]


def test_options_change_the_stored_window(run, stored, drive, rewritten):
    assert told(run, stored, drive, "--score-to", "1000")["samples"] == 1001
    assert told(run, stored, drive, "--whole-record", "--score-to", "900")["samples"] == 901
    narrow = rewritten(**{"start_time [s]": 5.0, "initial_soc": 0.5, "score_steps": [7]})
    whole = told(run, narrow, BUNDLED.validation, "--whole-record")
    assert whole["samples"] == pl.read_parquet(BUNDLED.validation).height


def test_the_stored_last_direction_applies_unless_another_is_given(run, stored, rewritten):
    own = BUNDLED.validation
    charged = rmse_v(run, stored, own, "--initial-soc", "0.9", "--initial-direction", "1")
    discharged = rewritten(initial_direction=-1, initial_soc=0.9)
    kept = rmse_v(run, discharged, own)
    assert kept != charged
    assert rmse_v(run, discharged, own, "--initial-direction", "1") == charged


def test_a_new_start_drops_the_stored_step_and_state_of_charge(run, stored, rewritten):
    own, start = BUNDLED.validation, ("--start-time", "5")
    from_the_voltage = rmse_v(run, stored, own, *start)
    stepped = rewritten(start_after_step=3, initial_soc=0.5)
    assert "step column" in run("validate", stepped, own).err
    assert rmse_v(run, stepped, own, *start) == from_the_voltage
    given = rmse_v(run, stepped, own, *start, "--initial-soc", "0.9")
    assert given == rmse_v(run, stored, own, *start, "--initial-soc", "0.9") != from_the_voltage


def test_what_was_said_of_one_record_is_not_another_s(run, stored, drive, rewritten):
    """A start that was given for all records of a run is not that of another record either."""
    own = rewritten(**{"initial_soc": 0.5, "initial_direction": -1, "score_to [s]": 500.0})
    assert rmse_v(run, own, drive) == rmse_v(run, stored, drive)


def test_the_choice_of_a_circuit_is_shown_where_there_was_one(run, stored, tmp_path):
    outcome = run("show", stored, "--choice")
    assert outcome.status == 2
    assert "its circuit was asked for, so none was chosen" in outcome.err
    document = json.loads(stored.read_text())
    sums = {"rmse_v": 0.012, "above_v": None}
    told = {"circuit": "1rc", "nodes": 1, "follows": [], "rmse_v": 0.01, "held_out": sums}
    more = told | {"circuit": "so-rc", "ladder": "pairs", "outcome": "no gain"}
    more |= {"gain": {"value": 0.004, "standard_error": 0.011}}
    first = told | {"ladder": None, "gain": None, "outcome": "kept"}
    (tmp_path / "result.json").write_text(json.dumps(document | {"tried": [first, more]}))
    shown = run("show", tmp_path, "--choice").out
    assert "(0.011)" in shown
    assert "no gain" in shown


@pytest.mark.slow
def test_a_window_is_recognized_by_content_and_not_by_name(run, rewritten, stored, drive, tmp_path):
    narrow = rewritten(**{"initial_soc": 0.5})
    again = tmp_path / "again.parquet"
    again.write_bytes(BUNDLED.validation.read_bytes())
    assert rmse_v(run, narrow, again) == rmse_v(run, narrow, BUNDLED.validation)
    plain = rmse_v(run, stored, drive)
    other = tmp_path / "other" / BUNDLED.validation.name
    other.parent.mkdir()
    other.write_bytes((tmp_path / drive).read_bytes())
    assert rmse_v(run, narrow, other) == plain


@pytest.mark.slow
def test_the_errors_are_written_as_a_page_with_figures(run, stored, drive, tmp_path):
    outcome = run("validate", stored, drive, "--report", "page.html")
    assert outcome.status == 0
    assert "page.html" in outcome.out
    page = (tmp_path / "page.html").read_text()
    assert page.count("<img") == 2
    assert "drive.parquet" in page
    assert "exists already" in run("validate", stored, drive, "--report", "page.html").err
