"""`result.json`: what it holds agrees with the run behind it, and equal runs are equal bytes."""

import hashlib
import json
import math
from dataclasses import replace

import pytest

import barnax
from barnax import Result, Window, find_global_optimum
from barnax.bundled import BUNDLED
from barnax.identification.answer import best_of

SEARCH = {"method": "bmo", "coordinates": "log", "population": 8, "iterations": 4, "key": 3}
OPTIONS = {
    **SEARCH,
    "model": "so-rc",
    "ocv_fit": "polynomial",
    "window": Window(score_to_s=1500.0),
    "fix": {"tau1 [s]": 10.0},
    "bounds": {"R0 [Ohm]": (0.01, 0.1)},
    "seeds": 2,
    "trust": "none",
}


@pytest.fixture(scope="module")
def result():
    return barnax.identify(**OPTIONS)


@pytest.fixture(scope="module")
def document(result):
    return json.loads(result.to_json())


def test_the_search_is_stored_as_it_was_run(document, result):
    constant = document["constant"]
    search, actual = constant["search"], result.constant.search
    assert {name: search[name] for name in SEARCH} == SEARCH
    assert search["evaluations"] == actual.evaluations
    assert [seed["rmse [V]"] for seed in search["seeds"]] == [seed.rmse_v for seed in actual.seeds]
    optimum = constant["global_optimum"]
    assert (optimum["seeds_there"], optimum["best_gap"] >= 0) == (2, True)
    assert constant["fixed"] == {"tau1 [s]": 10.0}
    assert constant["bounds"]["R0 [Ohm]"] == [0.01, 0.1]


def test_the_parameters_and_every_metric_are_of_the_one_answer(document, result):
    answer, parameters = result.constant, document["constant"]["parameters"]
    assert parameters == answer.parameters.to_dict()
    assert parameters["R1 [Ohm]"] * parameters["C1 [F]"] == pytest.approx(10.0)
    metrics = document["metrics"]["identification"]
    assert metrics["rmse [V]"] == pytest.approx(answer.global_optimum.rmse_v, rel=1e-9)
    assert metrics["samples"] == 1501
    (evaluation,) = result.evaluations.identification
    again = barnax.evaluate(evaluation.prepared, answer.parameters)
    assert metrics["rmse [V]"] == again.metrics.rmse_v


def test_the_better_of_seeds_and_optimum_is_the_answer(result):
    refinement, optimum = result.constant.refined, result.constant.global_optimum
    assert best_of(refinement, optimum) is optimum
    assert best_of(refinement, None) is refinement
    best = replace(optimum.optima[0], rmse_v=1.01 * refinement.rmse_v)
    worse = replace(optimum, optima=(best,))
    assert best_of(refinement, worse) is refinement


def test_every_input_is_named_with_the_hash_of_its_bytes(document):
    stored = [(each["role"], each["name"], each["sha256"]) for each in document["inputs"]]
    files = [("identification", BUNDLED.record), ("validation", BUNDLED.validation)]
    files += [("ocv", path) for path in BUNDLED.ocv]
    assert sorted(stored) == sorted(
        (role, path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for role, path in files
    )


def test_equal_runs_are_equal_bytes_and_another_key_is_another_search(result):
    assert barnax.identify(**OPTIONS).to_json() == result.to_json()
    other = barnax.identify(**(OPTIONS | {"key": 4}))
    seeds, others = (one.constant.search.seeds for one in (result, other))
    assert others[0].rmse_v != seeds[0].rmse_v
    assert other.parameters == pytest.approx(result.parameters, rel=1e-6)


def test_to_dict_holds_plain_values_equal_to_the_file(result, document):
    # No subclass of a plain type has its representation.
    assert repr(result.to_dict()) == repr(document)


def test_a_seed_that_failed_altogether_is_stored(result):
    refinement, problem = result.constant.refined, result.constant.search.problem
    first, second = refinement.search.seeds
    lost = replace(second, rmse_v=math.inf)
    search = replace(refinement.search, seeds=(first, lost))
    refinement = replace(refinement, search=search)
    evaluations = (result.evaluations,)
    optimum = find_global_optimum(problem)
    made = barnax.make_result(problem, evaluations, optimum, refinement, warnings=())
    document = json.loads(made.to_json())
    assert document["constant"]["search"]["seeds"][1]["rmse [V]"] is None
    constant = Result.model_validate(document).constant
    assert (constant.search.seeds[1].rmse_v, constant.global_optimum.median_gap) == (math.inf,) * 2
    assert Result.model_validate(document).to_json() == made.to_json()


@pytest.mark.slow
def test_a_circuit_worse_than_a_constant_is_warned_of(result):
    assert "answer.worse-than-constant" not in {each.code for each in result.warnings}
    wrong = barnax.identify(**(OPTIONS | {"fix": {"R0 [Ohm]": 2.0}, "bounds": None}))
    assert "answer.worse-than-constant" in {each.code for each in wrong.warnings}
