"""What every registered method promises."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import OPTIMIZERS, evaluate
from barnax.baselines import BESIDE_OPTIMIZERS, METHODS, Budget, MethodFailure
from barnax.baselines.method import generator_of, latin_hypercube

# One budget and one length of record, so that all tests share each method's compiled program.
BUDGET = Budget(population=8, iterations=60, seeds=3, key=7)
# All optimizers come in by one function, and have a contract of their own: one of two evaluations a
# candidate stands for them.
NAMES = [name for name in METHODS if name not in OPTIMIZERS.keys() - {"igwo"}]
BOXED = ("varpro", "lm", "pso-lm", "de")


def test_no_optimizer_takes_the_name_of_another_method():
    assert len(METHODS) == len(OPTIMIZERS) + len(BESIDE_OPTIMIZERS)


# Each is made of others here, or of an optimizer.
COMPOSED = ("igwo", "pso-lm", "dual-ukf")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(each, marks=[pytest.mark.slow] if each in COMPOSED else []) for each in NAMES
    ],
)
def ran(request, filtered_problem):
    """A method's name, the problem, its answers, and what it told of its progress."""
    problem = filtered_problem((0.05, (0.02, 0.03), (8.0, 90.0)), noise_v=1e-5)
    told = []
    return request.param, problem, METHODS[request.param].run(problem, BUDGET, told.append), told


def test_there_is_one_answer_a_seed_with_its_error_within_the_budget(ran):
    name, problem, answers, told = ran
    assert sum(told) == len(answers) == (1 if METHODS[name].is_deterministic else BUDGET.seeds)

    for answer in answers:
        rmse_v = evaluate(problem.prepared, answer.parameters).metrics.rmse_v
        assert answer.rmse_v == pytest.approx(rmse_v, rel=1e-9)
        assert 0 <= answer.evaluations <= BUDGET.evaluations


@pytest.mark.slow
@pytest.mark.parametrize("name", BOXED)
def test_answers_lie_in_the_box(name, filtered_problem):
    bounds = {"R1 [Ohm]": (0.001, 0.01), "tau2 [s]": (20.0, 60.0)}
    problem = filtered_problem((0.05, (0.02, 0.03), (8.0, 90.0)), bounds=bounds)
    for answer in METHODS[name].run(problem, BUDGET, lambda gained: None):
        values = answer.parameters.to_dict() | answer.parameters.named_tau_s
        for bound, (low, high) in problem.bounds.ranges.items():
            assert low * (1 - 1e-9) <= values[bound] <= high * (1 + 1e-9)


@pytest.mark.parametrize("name", ["lm", pytest.param("pso-lm", marks=pytest.mark.slow), "de"])
def test_the_same_key_gives_the_same_answers_whatever_the_number_of_seeds(name, filtered_problem):
    problem = filtered_problem((0.05, (0.02, 0.03), (8.0, 90.0)), noise_v=1e-3)
    few, many = (
        METHODS[name].run(problem, replace(BUDGET, seeds=seeds), lambda gained: None)
        for seeds in (2, 3)
    )
    assert [each.parameters for each in few] == [each.parameters for each in many[:2]]


def test_the_compressed_objective_gives_the_scans_errors(filtered_problem):
    circuit = (0.05, (0.02, 0.03), (8.0, 90.0))
    problem = filtered_problem(circuit, noise_v=1e-3, objective="compressed")
    for name in ("de", "lm", "pso"):
        (answer,) = METHODS[name].run(problem, replace(BUDGET, seeds=1), lambda gained: None)
        rmse_v = evaluate(problem.prepared, answer.parameters).metrics.rmse_v
        assert answer.rmse_v == pytest.approx(rmse_v, rel=1e-12)


def test_starts_are_spread_over_the_logarithms_of_the_box(short_problem):
    points = latin_hypercube(generator_of(0, 0), 64, short_problem.log_coordinates)
    low, high = np.log(short_problem.bounds.ranges["R0 [Ohm]"])
    places = np.sort((points[:, 0] - low) / (high - low))
    assert np.all(np.floor(places * 64) == np.arange(64))


@pytest.mark.parametrize("name", ["n4sid", "varpro"])
def test_what_needs_a_record_compressed_refuses_a_box_too_wide_for_it(name, filtered_problem):
    problem = filtered_problem((0.05, (0.02,), (8.0,)), "1rc", bounds={"tau1 [s]": (1e-6, 1e9)})
    assert not problem.is_compressible
    with pytest.raises(MethodFailure, match="too wide for it; narrow the bounds"):
        METHODS[name].run(problem, Budget(), lambda gained: None)
