"""`result.json`: the keys the contract lists, exact round trips."""

import hashlib
import json
import math
from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest
from pydantic import ValidationError

from barnax.bundled import BUNDLED
from barnax.cell import CellModel
from barnax.export.tables import tables_of
from barnax.model.inputs import Window
from barnax.model.problem import make_problem
from barnax.optimizers import make_optimizer
from barnax.records import Record, read_record
from barnax.results import Result, describe, make_result
from barnax.search.evaluate import evaluate, validate
from barnax.search.refine import Refinement, refine
from barnax.search.seeds import search_seeds

PARAMETERS = {"R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R2 [Ohm]", "C2 [F]"}
METRICS = {
    "record", "rmse [V]", "r2", "r2_paper", "mape [%]", "ce [V]", "max [V]", "samples",
}  # fmt: skip


@pytest.fixture(scope="module")
def refinement(bundled_record: Record, bundled_cell: CellModel) -> Refinement:
    """A small search with one RC pair held, so that the file shows a fixed value too."""
    problem = make_problem(
        bundled_record,
        bundled_cell,
        "so-rc",
        window=Window(score_to_s=900.0),
        fixed={"tau1 [s]": 10.0},
        bounds={"R0 [Ohm]": (0.01, 0.1)},
        coordinates="log",
    )
    optimizer = make_optimizer("bmo", 8, 4)
    return refine(search_seeds(problem, optimizer, key=jax.random.key(3), seeds=2))


@pytest.fixture(scope="module")
def result(refinement: Refinement) -> Result:
    problem = refinement.search.problem
    measured = read_record(BUNDLED.validation)
    parameters = refinement.parameters
    return make_result(
        refinement,
        [evaluate(problem.prepared, parameters)],
        [validate(measured, problem.cell, problem.circuit, parameters, problem.window)],
        ocv=[read_record(path) for path in BUNDLED.ocv],
        command=["barnax", "identify"],
    )


@pytest.fixture
def document(result: Result) -> dict[str, Any]:
    return json.loads(result.to_json())


def test_the_file_has_the_parts_that_the_contract_lists(document):
    contract = {
        "schema_version", "model", "parameters", "search", "refined", "metrics", "cell", "bounds",
        "window", "inputs", "command", "versions",
    }  # fmt: skip
    assert contract <= set(document)
    assert document["schema_version"] == 1
    assert set(document["parameters"]) == PARAMETERS
    search = {
        "method", "coordinates", "objective", "population", "iterations", "key", "evaluations",
        "seeds",
    }  # fmt: skip
    assert search <= set(document["search"])
    for seed in document["search"]["seeds"]:
        assert {"rmse [V]", "parameters"} <= set(seed)
        assert any(key.startswith("history") for key in seed)
    assert {"rmse [V]", "at_bound", "optima", "verdict"} <= set(document["refined"])
    assert set(document["metrics"]) == {"identification", "validation"}
    for metrics in (document["metrics"]["identification"], *document["metrics"]["validation"]):
        assert set(metrics) == METRICS
    for source in document["inputs"]:
        assert {"name", "sha256", "sign", "hold"} <= set(source)
        assert source["sign"]["reason"]
        assert source["hold"]["reason"]


def test_the_numbers_are_those_of_the_run(document, refinement):
    found = refinement.search
    assert document["parameters"] == refinement.parameters.to_dict()
    assert document["refined"]["rmse [V]"] == refinement.rmse_v
    assert document["search"]["key"] == 3
    assert document["search"]["method"] == "bmo"
    assert document["search"]["evaluations"] == found.evaluations == 2 * (8 + 4 * 8)
    for stored, seed in zip(document["search"]["seeds"], found.seeds, strict=True):
        assert stored["rmse [V]"] == seed.rmse_v == stored["history"][-1]
        assert len(stored["history"]) in (4, 5)
    refined, stored = refinement.refined, document["refined"]
    assert stored["moved"] == [seed.moved for seed in refined]
    assert stored["converged"] == [seed.has_converged for seed in refined]
    assert document["fixed"] == {"tau1 [s]": 10.0}
    assert document["bounds"]["R0 [Ohm]"] == [0.01, 0.1]


def test_the_direction_and_rest_current_the_simulation_starts_with_are_stored(
    document, refinement, bundled_record, bundled_cell
):
    assert document["initial_direction"] == 1
    assert document["rest_current [A]"] == pytest.approx(bundled_cell.capacity_ah / 100)
    # From 5,000 s on the cell comes from a discharge, whatever was before the record.
    window = Window(start_time_s=5000.0, score_to_s=5900.0, initial_soc=0.7)
    problem = make_problem(bundled_record, bundled_cell, "iso-rc", window=window)
    later = replace(refinement, found=replace(refinement.search, problem=problem))
    evaluation = evaluate(problem.prepared, refinement.parameters)
    stored = make_result(later, [evaluation])
    assert stored.window.initial_direction == 1
    assert stored.start_direction == stored.initial_direction == problem.prepared.direction[0] == -1
    # An export starts where the simulation does.
    away_v = tables_of(stored).initial_hysteresis_v
    assert problem.prepared.source_v[0] == pytest.approx(
        bundled_cell.average_ocv_v(problem.prepared.soc[:1])[0] + away_v, abs=1e-6
    )
    assert away_v < -1e-3


def test_a_result_without_direction_and_rest_current_still_reads(document, tmp_path):
    del document["initial_direction"], document["rest_current [A]"]
    path = tmp_path / "result.json"
    path.write_text(json.dumps(document))
    old = Result.from_json(path)
    assert (old.initial_direction, old.start_direction) == (None, 1)
    assert old.start_rest_current_a == pytest.approx(old.cell_model.capacity_ah / 100)


def test_the_refined_rmse_is_the_identification_metric(document):
    metrics = document["metrics"]["identification"]
    assert metrics["rmse [V]"] == pytest.approx(document["refined"]["rmse [V]"], rel=1e-9)
    assert metrics["samples"] == 901


def test_every_input_is_named_with_the_hash_of_its_bytes(document):
    stored = {(each["role"], each["name"]): each["sha256"] for each in document["inputs"]}
    files = [
        ("identification", BUNDLED.record),
        ("validation", BUNDLED.validation),
        *(("ocv", path) for path in BUNDLED.ocv),
    ]
    assert stored == {
        (role, path.name): hashlib.sha256(path.read_bytes()).hexdigest() for role, path in files
    }


def test_the_parameters_load_as_a_pybamm_mapping(result):
    values = dict(result.parameters)
    assert set(values) == PARAMETERS
    assert values["R1 [Ohm]"] * values["C1 [F]"] == pytest.approx(10.0)


def test_a_round_trip_through_a_file_is_equal_in_value_and_bytes(result, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(result.to_json(), encoding="utf-8")
    back = Result.from_json(path)
    assert back == result
    assert back.to_json() == result.to_json()


def test_to_dict_holds_plain_values_equal_to_the_file(result):
    def is_plain(value: Any) -> bool:
        if isinstance(value, dict):
            return all(type(key) is str and is_plain(each) for key, each in value.items())
        if isinstance(value, list):
            return all(map(is_plain, value))
        return value is None or type(value) in (bool, int, float, str)

    assert is_plain(result.to_dict())
    assert result.to_dict() == json.loads(result.to_json())


def test_the_same_run_twice_gives_the_same_bytes(result, refinement):
    problem = refinement.search.problem
    again = refine(
        search_seeds(problem, refinement.search.optimizer, key=jax.random.key(3), seeds=2)
    )
    parameters = again.parameters
    repeated = make_result(
        again,
        [evaluate(problem.prepared, parameters)],
        [
            validate(
                read_record(BUNDLED.validation),
                problem.cell,
                problem.circuit,
                parameters,
                problem.window,
            )
        ],
        ocv=[read_record(path) for path in BUNDLED.ocv],
        command=["barnax", "identify"],
    )
    assert repeated.to_json() == result.to_json()


def test_the_stored_cell_gives_the_curves_back(result, bundled_cell):
    soc = np.linspace(-0.1, 1.1, 101)
    stored = result.cell_model
    assert stored.capacity_ah == bundled_cell.capacity_ah
    np.testing.assert_array_equal(stored.charge(soc), bundled_cell.charge(soc))
    np.testing.assert_array_equal(stored.discharge(soc), bundled_cell.discharge(soc))


def test_a_result_cannot_be_changed(result):
    with pytest.raises(ValidationError, match="frozen"):
        result.model = "iso-rc"
    with pytest.raises(TypeError, match="does not support item assignment"):
        result.search.seeds[0].history_v[0] = 0.0


def test_an_optimizer_with_other_settings_goes_by_its_class():
    registered = make_optimizer("ibmo", 8, 4)
    assert describe(registered)[0] == "ibmo"
    name, settings = describe(replace(registered, pl=3))
    assert name == type(registered).__name__
    assert settings["pl"] == 3


def test_a_seed_that_failed_at_first_or_altogether_is_stored(refinement, result, tmp_path):
    first, second = refinement.search.seeds
    late = replace(first, history_v=np.array([math.inf, *first.history_v[1:]]))
    lost = replace(second, rmse_v=math.inf, history_v=np.full(len(second.history_v), math.inf))
    found = replace(refinement.search, seeds=(late, lost))
    prepared = refinement.search.problem.prepared
    made = make_result(
        replace(refinement, found=found), [evaluate(prepared, refinement.parameters)]
    )
    path = tmp_path / "result.json"
    path.write_text(made.to_json())
    assert json.loads(path.read_text())["search"]["seeds"][0]["history"][0] is None
    read = Result.from_json(path)
    assert read.search.seeds[0].history_v == tuple(late.history_v)
    assert read.search.seeds[1].rmse_v == math.inf


def test_a_circuit_worse_than_a_constant_is_warned_of(refinement):
    prepared = refinement.search.problem.prepared
    wrong = replace(refinement.parameters, r0=50.0)
    made = make_result(refinement, [evaluate(prepared, wrong)])
    assert any("worse than a constant" in text for text in made.warnings)
    right = make_result(refinement, [evaluate(prepared, refinement.parameters)])
    assert not any("worse than a constant" in text for text in right.warnings)
