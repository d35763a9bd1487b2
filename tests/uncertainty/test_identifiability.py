"""What the data leave open, on circuits made to leave it open."""

import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.uncertainty.identifiability import are_one
from helpers.noisy_fits import SAMPLES, TRUTH, colored_noise, fit, made_problem, white_noise
from helpers.reference import filtered_response

# Li et al. (2023), Table 3, BMO-SO: its first pair has 0.0996 s.
BMO_SO = CircuitParameters.constant(0.0334, (0.0023, 0.0503), (43.31, 488.57))


HALF_A_SECOND = CircuitParameters.constant(0.05, (0.01, 0.03), (0.5 / 0.01, 120 / 0.03))
WIDE = {"tau1 [s]": (0.05, 1500.0), "tau2 [s]": (0.05, 1500.0)}
SEED = 20


def findings_of(problem, start=TRUTH):
    """The estimates, and the findings by kind."""
    assessment = fit(problem, start).assessment
    return assessment.uncertainty, {each.kind: each for each in assessment.identifiability.findings}


def test_what_the_data_determine_leaves_no_finding(white):
    assert white.assessment.identifiability.findings == ()


def relative_error_of_r1(problem, circuit, sd_v):
    """Its standard error by least squares with known time constants, in shares of its value."""
    current_a, hold = problem.prepared.current_a, problem.prepared.record.hold.value
    responses = [filtered_response(1.0, current_a, tau, hold) for tau in circuit.tau_s]
    columns = np.stack([current_a, *responses], axis=1)
    return sd_v * np.sqrt(np.linalg.inv(columns.T @ columns)[1, 1]) / circuit.r[0]


def test_the_paper_s_pair_of_a_tenth_of_a_second_is_a_resistance_at_1_s(short_problem):
    noise_v = white_noise(SEED)
    problem = made_problem(short_problem, noise_v, BMO_SO, bounds=WIDE, hold="backward")
    assert relative_error_of_r1(problem, BMO_SO, 1e-3) > 10
    _, findings = findings_of(problem, BMO_SO)
    fast = findings["too fast"]
    assert fast.parameters == ("tau1 [s]", "R1 [Ohm]", "R0 [Ohm]")
    assert fast.combined.name == "R0 + R1 [Ohm]"
    assert fast.combined.low < 0.0334 + 0.0023 < fast.combined.high
    assert fast.interval_s == 1.0


@pytest.mark.parametrize("bounds", [{}, WIDE], ids=["default box", "wide box"])
def test_where_it_responds_one_sample_late_its_resistance_is_determined_and_its_time_is_not(
    short_problem, bounds
):
    problem = made_problem(short_problem, white_noise(SEED), BMO_SO, bounds=bounds)
    assert relative_error_of_r1(problem, BMO_SO, 1e-3) < 0.1
    estimates, findings = findings_of(problem, BMO_SO)
    fast = findings["too fast"]
    assert fast.combined == estimates["R1 [Ohm]"]
    assert fast.combined.low <= BMO_SO.r[0] <= fast.combined.high
    assert fast.parameters == ("tau1 [s]",)
    assert fast.estimates[0].held == ("at lower bound" if bounds == {} else None)
    assert "at bound" not in findings


def test_a_pair_of_half_a_second_that_the_data_determine_is_no_finding(short_problem):
    problem = made_problem(short_problem, white_noise(24, 5e-3), HALF_A_SECOND, bounds=WIDE)
    assert relative_error_of_r1(problem, HALF_A_SECOND, 5e-3) < 0.1
    estimates, findings = findings_of(problem, HALF_A_SECOND)
    assert estimates["tau1 [s]"].value < 0.5
    assert findings == {}
    for name, value in {"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.01, "tau1 [s]": 0.5}.items():
        assert estimates[name].value / 2 < estimates[name].low <= value <= estimates[name].high


# R2 t / tau2: all that the first 1,500 s show of such a pair.
SLOW = CircuitParameters.constant(0.05, (0.02, 0.1), (10 / 0.02, 50_000))


def test_of_a_pair_slower_than_the_record_only_the_capacitance_is_determined(short_problem):
    wide = {f"R{pair} [Ohm]": (1e-4, 1e3) for pair in (1, 2)}
    wide |= {f"tau{pair} [s]": (0.5, 1e6) for pair in (1, 2)}
    problem = made_problem(short_problem, white_noise(SEED), SLOW, bounds=wide)
    estimates, findings = findings_of(problem, SLOW)
    slow = findings["too slow"]
    assert slow.combined == estimates["C2 [F]"]
    assert slow.combined.low <= 50_000 <= slow.combined.high
    assert slow.combined.relative_error < 0.2 * estimates["tau2 [s]"].relative_error
    assert slow.duration_s == pytest.approx(1500.0)


def test_of_two_pairs_with_one_time_constant_only_the_sum_is_determined(short_problem):
    alike = CircuitParameters.constant(0.05, (0.02, 0.03), (40 / 0.02, 40.2 / 0.03))
    noise_v = colored_noise(np.random.default_rng(4), SAMPLES, 12.0, 2e-3)[0]
    finding = findings_of(made_problem(short_problem, noise_v, alike), alike)[1]["alike"]
    assert finding.combined.name == "R1 + R2 [Ohm]"
    assert finding.combined.low < 0.05 < finding.combined.high


def test_a_parameter_at_a_bound_that_is_no_limit_of_the_record_is_a_finding(short_problem):
    problem = made_problem(short_problem, white_noise(SEED), bounds={"R0 [Ohm]": (0.01, 0.045)})
    (bound,) = findings_of(problem)[1]["at bound"].estimates
    assert (bound.name, bound.held) == ("R0 [Ohm]", "at upper bound")
    assert bound.value == pytest.approx(0.045, rel=2e-3)


def test_loose_parameters_and_directions_are_findings(short_problem):
    noise_v = colored_noise(np.random.default_rng(1), SAMPLES, 12.0, 50e-3)[0]
    estimates, findings = findings_of(made_problem(short_problem, noise_v))
    (loose,) = findings["loose"].estimates
    assert loose == estimates[loose.name]
    assert loose.low is None or loose.value / loose.low > 2
    direction = findings["direction"]
    assert len(direction.log_steps) == len(direction.estimates) > 1
    # The steps are within one standard error of each alone.
    for step, each in zip(direction.log_steps, direction.estimates, strict=True):
        assert abs(step) <= each.relative_error * (1 + 1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_pairs_are_one_whichever_is_slower(sign):
    assert are_one(0.3 * sign, 0.1, 0.01, 0.01, 0.01)
    # Far apart, and well told; and perhaps the same.
    assert not are_one(2.1 * sign, 0.1, 0.001, 0.1, 0.1)
    assert are_one(2.1 * sign, 3.0, 0.001, 0.1, 0.1)
