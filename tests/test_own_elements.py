"""Circuits with diffusion, and with an element of one's own, identified from end to end."""

import numpy as np
import pytest

import barnax
from barnax import InputError, TableSettings, Window, evaluate, fit_tables, make_problem
from barnax.cell import CircuitParameters, Element, make_circuit
from barnax.export import get_exporter
from barnax.filters.model import ErrorModel, make_model
from barnax.global_optimum.search import find_global_optimum
from barnax.identification.pipeline import identify_problem
from helpers.problems import drive_a
from helpers.reference import filtered_response, make_record

SAMPLES, INTERVAL_S = 3000, 2.0
TIME_S, CURRENT_A = INTERVAL_S * np.arange(SAMPLES), drive_a(SAMPLES, seed=4, interval=15)
TERMS = (np.arange(1, 3001) - 0.5) ** 2 * np.pi**2
TWO = Element("test-two", "T", "two pairs, one ten times as fast", (0.6, 0.4), (1.0, 0.1))
OWN = "tests/own"
R_OHM, TAU_S = (0.02, 0.03), (12.0, 300.0)


def series(tau_s):
    """Diffusion's answer to the current, by 3,000 terms of its series."""
    return sum(2 / each * filtered_response(INTERVAL_S, CURRENT_A, tau_s / each) for each in TERMS)


def two(tau_s):
    return 0.6 * filtered_response(INTERVAL_S, CURRENT_A, tau_s) + 0.4 * filtered_response(
        INTERVAL_S, CURRENT_A, tau_s / 10
    )


def made_problem(cell, circuit, answer, noise_v=0.0):
    charge_ah = np.append(0.0, np.cumsum(CURRENT_A[:-1] * INTERVAL_S)) / 3600
    pair_v = R_OHM[0] * filtered_response(INTERVAL_S, CURRENT_A, TAU_S[0])
    drop_v = 0.05 * CURRENT_A + pair_v + R_OHM[1] * answer(TAU_S[1])
    voltage_v = cell.average_ocv_v(0.8 - charge_ah / cell.capacity_ah) - drop_v
    voltage_v += noise_v * np.random.default_rng(0).standard_normal(SAMPLES)
    record = make_record(TIME_S, CURRENT_A, voltage_v)
    return make_problem(record, cell, circuit, window=Window(initial_soc=0.8))


# A circuit, its closed form's answer, and how near the mixture is to that.
CASES = [pytest.param("1rc+diffusion", series, 5e-4, marks=pytest.mark.slow), (OWN, two, 1e-6)]


@pytest.fixture(autouse=True)
def two_pair_circuit(registered_circuits):
    """The circuit of one's own."""
    return make_circuit(OWN, "rc", TWO)


@pytest.mark.parametrize(("circuit", "answer", "near"), CASES)
def test_the_global_optimum_is_the_circuit_that_made_the_record(
    bundled_cell, circuit, answer, near
):
    problem = made_problem(bundled_cell, circuit, answer, noise_v=1e-4)
    optimum = find_global_optimum(problem)
    assert optimum.status == "certified"
    actual = optimum.parameters
    assert (actual.r0, *actual.r) == pytest.approx((0.05, *R_OHM), rel=5e-3)
    assert actual.tau_s == pytest.approx(TAU_S, rel=1e-2)
    exact = CircuitParameters.of_tau(0.05, R_OHM, TAU_S, elements=actual.elements)
    noiseless = made_problem(bundled_cell, circuit, answer)
    rmse_v = evaluate(noiseless.prepared, exact).metrics.rmse_v
    assert rmse_v < near * np.sqrt(np.mean((R_OHM[1] * answer(TAU_S[1])) ** 2))


@pytest.mark.parametrize(("circuit", "answer", "near"), CASES)
def test_no_circuit_of_the_box_is_below_the_proved_bound(bundled_cell, circuit, answer, near):
    problem = made_problem(bundled_cell, circuit, answer, noise_v=2e-3)
    optimum = find_global_optimum(problem)
    rng, box = np.random.default_rng(1), problem.bounds
    best = optimum.parameters
    for _ in range(40):
        tau_s = np.array(best.tau_s) * np.exp(0.3 * rng.standard_normal(2))
        limits = np.array([box.tau_range_s(index) for index in range(2)]).T
        r = np.array(best.r) * np.exp(0.1 * rng.standard_normal(2))
        tried = CircuitParameters.of_tau(best.r0, r, np.clip(tau_s, *limits), None, best.elements)
        assert evaluate(problem.prepared, tried).metrics.rmse_v >= optimum.lower_bound_v
    assert evaluate(problem.prepared, best).metrics.rmse_v == pytest.approx(optimum.rmse_v)


@pytest.mark.parametrize(("circuit", "answer", "near"), CASES)
def test_tables_of_one_node_are_the_constant_circuit(bundled_cell, circuit, answer, near):
    problem = made_problem(bundled_cell, circuit, answer, noise_v=1e-3)
    constant = find_global_optimum(problem).parameters
    settings = TableSettings(nodes=(0.5,), ocv_correction=False, folds=0, rising_ocv=False)
    fit = fit_tables(problem.prepared_records, settings)
    assert fit.status == "certified"
    assert fit.tables.elements == constant.elements
    assert fit.tables.tau_s == pytest.approx(constant.tau_s, rel=1e-3)
    actual = fit.tables.ohm[:, 0]
    assert actual == pytest.approx([constant.r0, *constant.r], rel=1e-3)
    # Its error by the reduction is that by the scan.
    error_v = fit.errors[0].rmse_v
    assert error_v == pytest.approx(fit.objective_v, rel=1e-4)
    interval = {each.name: each for each in fit.intervals}["R0 [Ohm]"]
    assert interval.low < 0.05 < interval.high


@pytest.mark.parametrize(("circuit", "answer", "near"), CASES)
def test_intervals_searches_and_exports_know_the_element(bundled_cell, circuit, answer, near):
    problem = made_problem(bundled_cell, circuit, answer, noise_v=1e-3)
    result = identify_problem(problem, barnax.Settings(seeds=1, population=8, iterations=5))
    refined, optimum = result.constant.refined, result.constant.global_optimum
    (seed,) = result.constant.search.seeds
    assert optimum.rmse_v * (1 - 1e-9) < refined.rmse_v < seed.rmse_v
    assert seed.parameters.elements == problem.bounds.elements
    actual = evaluate(problem.prepared, seed.parameters)
    assert actual.metrics.rmse_v == pytest.approx(seed.rmse_v, rel=1e-6)
    resistance, tau, _ = problem.bounds.element_names[1]
    known = {each.name: each for each in result.constant.assessment.uncertainty.estimates}
    assert known[tau].low < TAU_S[1] < known[tau].high
    assert known[resistance].low < R_OHM[1] < known[resistance].high
    again = barnax.Result.model_validate_json(result.to_json())
    assert again.constant.parameters.elements == problem.bounds.elements
    # The filter's model at rest moves as the circuit does.
    own = result.constant.parameters
    model = make_model(result.cell, circuit, own, ErrorModel(1e-3))
    assert model.pairs == len(own.laddered().r)
    written = get_exporter("json").write(result).content.decode()
    assert f'"circuit": "{circuit}"' in written


@pytest.mark.slow
def test_what_holds_a_ladder_says_so_and_what_cannot_refuses_it(bundled_cell):
    problem = made_problem(bundled_cell, "1rc+diffusion", series, noise_v=1e-3)
    result = identify_problem(problem, barnax.Settings(seeds=0))
    header = get_exporter("c-header").write(result)
    assert "R_D and tau_D, finite-length diffusion" in "".join(header.caveats)
    assert b"#define BARNAX_RC_PAIRS 15" in header.content
    with pytest.raises(InputError, match=r"at most 5 RC pairs, and 1rc\+diffusion takes 15"):
        get_exporter("simscape").write(result)
