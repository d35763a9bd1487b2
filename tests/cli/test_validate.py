"""`barnax validate`: stored parameters on another record, as identify itself would report them."""

import json

import polars as pl
import pytest

import barnax
from barnax.bundled import BUNDLED
from barnax.results import Result

from .conftest import contents


@pytest.fixture
def stored(finished):
    return finished.folder / "result.json"


def test_json_reproduces_the_validation_metrics_of_the_result_exactly(run, stored, tmp_path):
    outcome = run("validate", stored, BUNDLED.validation, "--json")
    assert (outcome.status, outcome.err) == (0, "")
    metrics = json.loads(stored.read_text())["metrics"]
    assert json.loads(outcome.out) == metrics["validation"][0]
    assert contents(tmp_path) == {}


def test_json_reproduces_the_identification_metrics_too(run, stored):
    outcome = run("validate", stored, BUNDLED.record, "--json")
    metrics = json.loads(stored.read_text())["metrics"]
    assert json.loads(outcome.out) == metrics["identification"]


def test_the_table_gives_the_same_line_as_identify(run, finished, stored):
    outcome = run("validate", stored, BUNDLED.validation)
    (line,) = (line for line in outcome.out.splitlines() if "validation.parquet" in line)
    assert line.split() in [each.split() for each in finished.outcome.out.splitlines()]
    assert outcome.status == 0


def test_quiet_prints_nothing(run, stored):
    assert run("validate", stored, BUNDLED.validation, "-q") == (0, "", "")


@pytest.mark.parametrize("word", ["--quiet", "--json"])
def test_warnings_go_to_stderr_all_the_same(run, stored, tmp_path, word):
    plain = pl.read_parquet(BUNDLED.validation).rename({"Current / A": "current"})
    plain.write_csv(tmp_path / "plain.csv")
    err = run("validate", stored, "plain.csv", word).err
    assert "warning: column 'current' names no unit; A is assumed\n" in err


def test_options_change_the_stored_window(run, stored):
    outcome = run("validate", stored, BUNDLED.validation, "--score-to", "1000", "--json")
    assert json.loads(outcome.out)["samples"] == 1001


def test_the_stored_last_direction_applies_unless_another_is_given(run, stored, tmp_path):
    document = json.loads(stored.read_text())
    document["window"]["initial_direction"] = -1
    (tmp_path / "discharged.json").write_text(json.dumps(document))

    def rmse_v(path, *words):
        outcome = run(
            "validate", path, BUNDLED.validation, "--initial-soc", "0.9", "--json", *words
        )
        return json.loads(outcome.out)["rmse [V]"]

    kept = rmse_v("discharged.json")
    assert kept == rmse_v(stored, "--initial-direction", "-1")
    assert kept != rmse_v(stored)
    assert rmse_v("discharged.json", "--initial-direction", "1") == rmse_v(stored)


def test_a_start_time_takes_the_place_of_a_stored_start_step(run, stored, tmp_path):
    document = json.loads(stored.read_text())
    document["window"] |= {"start_after_step": 3, "initial_soc": 0.9}
    (tmp_path / "stepped.json").write_text(json.dumps(document))
    words = ("validate", "stepped.json", BUNDLED.validation)
    assert "step column" in run(*words).err
    assert run(*words, "--start-time", "5").status == 0


def test_a_new_start_drops_the_stored_state_of_charge(run, stored, tmp_path):
    document = json.loads(stored.read_text())
    document["window"]["initial_soc"] = 0.5
    (tmp_path / "half.json").write_text(json.dumps(document))
    start = ("--start-time", "5", "--json")
    from_the_voltage = run("validate", stored, BUNDLED.validation, *start)
    assert run("validate", "half.json", BUNDLED.validation, *start) == from_the_voltage
    given = (*start, "--initial-soc", "0.5")
    kept = run("validate", "half.json", BUNDLED.validation, *given)
    assert kept == run("validate", stored, BUNDLED.validation, *given) != from_the_voltage


def test_the_whole_record_leaves_the_stored_window(run, stored, tmp_path):
    document = json.loads(stored.read_text())
    whole = document["window"] | {"score_to_s": None}
    document["window"] |= {"start_time_s": 5.0, "initial_soc": 0.5, "score_steps": [7]}
    (tmp_path / "narrow.json").write_text(json.dumps(document))
    (tmp_path / "whole.json").write_text(json.dumps(document | {"window": whole}))
    words = (BUNDLED.validation, "--json")
    widened = run("validate", "narrow.json", *words, "--whole-record")
    assert widened.status == 0
    assert widened == run("validate", "whole.json", *words)
    assert json.loads(widened.out)["samples"] > 1501


def test_options_narrow_the_whole_record_again(run, stored):
    words = ("--whole-record", "--score-to", "1000", "--json")
    outcome = run("validate", stored, BUNDLED.validation, *words)
    assert json.loads(outcome.out)["samples"] == 1001


def test_a_result_of_the_python_interface_validates_alike(stored):
    result = Result.from_json(stored)
    evaluation = barnax.validate(
        barnax.read_record(BUNDLED.validation),
        result.cell_model,
        result.model,
        result.circuit_parameters,
        result.window,
    )
    assert evaluation.metrics.rmse_v == result.metrics.validation[0].rmse_v


@pytest.mark.parametrize(
    ("content", "part"),
    [(None, "cannot be read"), (b"", "Invalid JSON"), (b"\x89PNG\r\n\xff", "cannot be read")],
    ids=["absent", "empty", "binary"],
)
def test_a_result_that_is_none_is_refused(refuse, tmp_path, content, part):
    if content is not None:
        (tmp_path / "result.json").write_bytes(content)
    message = refuse("validate", "result.json", BUNDLED.validation)
    assert message.startswith("error: result.json: ")
    assert part in message
    assert "give the result.json that barnax identify wrote" in message


def test_a_bad_record_is_refused(refuse, stored, tmp_path):
    pl.read_parquet(BUNDLED.validation).head(2000).reverse().write_csv(tmp_path / "back.csv")
    assert "back.csv: row 3: time runs backwards" in refuse("validate", stored, "back.csv")


def test_a_sign_against_the_data_is_refused(refuse, stored):
    words = ("--current-sign", "discharge-positive")
    assert "validation.parquet: the sign" in refuse("validate", stored, BUNDLED.validation, *words)


def test_a_missing_record_is_a_usage_error(refuse):
    assert "Missing argument" in refuse("validate", "result.json")
