"""What the data leave open, said in words, on circuits made to leave it open."""

import math

import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.uncertainty.assessment import assess
from barnax.uncertainty.identifiability import _times, collinearity
from reference import filtered_response

from .made import TRUTH, colored_noise, cross_check, made_problem

# Li et al. (2023), Table 3, BMO-SO: its first pair has 0.0996 s.
BMO_SO = CircuitParameters(0.0334, (0.0023, 0.0503), (43.31, 488.57))
HALF_A_SECOND = CircuitParameters(0.05, (0.01, 0.03), (0.5 / 0.01, 120 / 0.03))
WIDE = {"tau1 [s]": (0.05, 1500.0), "tau2 [s]": (0.05, 1500.0)}


def white(seed=20, sd_v=1e-3):
    return np.random.default_rng(seed).normal(0, sd_v, 1501)


def findings_of(problem, start=TRUTH):
    assessment = assess(cross_check(problem, start))
    return assessment, {each.kind: each for each in assessment.identifiability.findings}


@pytest.mark.parametrize("degrees", [90.0, 30.0, 1.0])
def test_the_collinearity_index_is_that_of_two_columns_at_an_angle(degrees):
    angle = np.radians(degrees)
    columns = np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)], [0.0, 0.0]])
    # The smaller eigenvalue of [[1, cos], [cos, 1]] is 1 - cos (Brun et al., 2001, Eq. 11).
    assert collinearity(columns) == pytest.approx(1 / np.sqrt(1 - np.cos(angle)))


def test_what_the_data_determine_is_said_to_be_determined(short_problem):
    assessment, findings = findings_of(made_problem(short_problem, white()))
    assert findings == {}
    assert assessment.identifiability.words == "The data determine every free parameter."


def relative_error_of_r1(problem, circuit, sd_v):
    """Its standard error by least squares with known time constants, in shares of its value."""
    current_a, hold = problem.prepared.current_a, problem.prepared.record.hold.value
    answers = [filtered_response(1.0, current_a, tau, hold) for tau in circuit.tau_s]
    columns = np.stack([current_a, *answers], axis=1)
    return sd_v * np.sqrt(np.linalg.inv(columns.T @ columns)[1, 1]) / circuit.r[0]


def test_the_paper_s_pair_of_a_tenth_of_a_second_is_a_resistance_at_1_s(short_problem):
    problem = made_problem(short_problem, white(), BMO_SO, bounds=WIDE, hold="backward")
    assert relative_error_of_r1(problem, BMO_SO, 1e-3) > 10
    assessment, findings = findings_of(problem, BMO_SO)
    fast = findings["too fast"]
    tau1_s = assessment.uncertainty["tau1 [s]"].value
    assert fast.text.startswith(
        f"tau1 = {tau1_s:.2f} s cannot be told from a resistance at 1 s sampling: "
        "only R0 + R1 is determined (35.6 mOhm, between 35.5 mOhm and 35.7 mOhm)"
    )
    assert "tau1 [s]" in fast.parameters


@pytest.mark.parametrize("bounds", [{}, WIDE], ids=["default box", "wide box"])
def test_where_it_answers_one_sample_late_its_resistance_is_told_and_its_time_is_not(
    short_problem, bounds
):
    problem = made_problem(short_problem, white(), BMO_SO, bounds=bounds)
    assert relative_error_of_r1(problem, BMO_SO, 1e-3) < 0.1
    assessment, findings = findings_of(problem, BMO_SO)
    told = assessment.uncertainty["R1 [Ohm]"]
    assert told.low <= BMO_SO.r[0] <= told.high
    text = findings["too fast"].text
    assert "s is shorter than 1 s sampling can show: R1 is determined (2." in text
    assert "tau1 is not" in text
    assert ("at its lower bound" in text) == (bounds == {})
    assert "at bound" not in findings
    assert findings["too fast"].parameters == ("tau1 [s]",)


def test_a_pair_of_half_a_second_that_the_data_determine_is_not_spoken_of(short_problem):
    noise_v = white(seed=24, sd_v=5e-3)
    problem = made_problem(short_problem, noise_v, HALF_A_SECOND, bounds=WIDE)
    assert relative_error_of_r1(problem, HALF_A_SECOND, 5e-3) < 0.1
    assessment, findings = findings_of(problem, HALF_A_SECOND)
    assert assessment.uncertainty["tau1 [s]"].value < 0.5
    assert findings == {}
    for name, value in {"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.01, "tau1 [s]": 0.5}.items():
        told = assessment.uncertainty[name]
        assert told.value / 2 < told.low <= value <= told.high


# R2 t / tau2: all that the first 1,500 s show of such a pair.
SLOW = CircuitParameters(0.05, (0.02, 0.1), (10 / 0.02, 50_000))


def test_of_a_pair_slower_than_the_record_only_the_capacitance_is_told(short_problem):
    wide = {f"R{pair} [Ohm]": (1e-4, 1e3) for pair in (1, 2)}
    wide |= {f"tau{pair} [s]": (0.5, 1e6) for pair in (1, 2)}
    problem = made_problem(short_problem, white(), SLOW, bounds=wide)
    assessment, findings = findings_of(problem, SLOW)
    assert "only R2/tau2 is determined, which is the capacitance C2" in findings["too slow"].text
    told = assessment.uncertainty["C2 [F]"]
    assert told.low <= 50_000 <= told.high
    assert told.relative_error < 0.2 * assessment.uncertainty["tau2 [s]"].relative_error


def test_at_the_bound_of_the_default_box_its_capacitance_is_told_with_reserve(short_problem):
    _, findings = findings_of(made_problem(short_problem, white(), SLOW), SLOW)
    assert "held there; a wider box would tell it better" in findings["too slow"].text


def test_of_two_pairs_with_one_time_constant_only_the_sum_is_told(short_problem):
    alike = CircuitParameters(0.05, (0.02, 0.03), (40 / 0.02, 40.2 / 0.03))
    noise_v = colored_noise(np.random.default_rng(4), 1501, 12.0, 2e-3)[0]
    assessment, findings = findings_of(made_problem(short_problem, noise_v, alike), alike)
    assert "cannot be told apart: of R1 and R2 only the sum is determined" in findings["alike"].text
    assert assessment.identifiability.collinearity_index > 15


def test_a_parameter_at_a_bound_that_is_no_limit_of_the_record_is_named(short_problem):
    problem = made_problem(short_problem, white(), bounds={"R0 [Ohm]": (0.01, 0.045)})
    _, findings = findings_of(problem)
    assert findings["at bound"].text.startswith("R0 = 45 mOhm is at its upper bound")


def test_a_loose_parameter_is_given_with_its_range(short_problem):
    noise_v = colored_noise(np.random.default_rng(1), 1501, 12.0, 50e-3)[0]
    assessment, findings = findings_of(made_problem(short_problem, noise_v))
    loose = [each for each in assessment.identifiability.findings if each.kind == "loose"]
    assert loose
    assert "loose" in findings
    assert all("only known to lie between" in each.text or "at all" in each.text for each in loose)
    assert findings["direction"].text.endswith(".")


def test_the_stored_findings_are_plain(short_problem):
    stored = assess(cross_check(made_problem(short_problem, white()))).to_dict()
    assert stored["identifiability"]["findings"] == []
    assert stored["identifiability"]["condition_number"] > 1


@pytest.mark.parametrize(
    ("step", "said"),
    [(math.log(3), "times 3"), (99.0, "100 times higher and beyond"),
     (-99.0, "100 times lower and beyond")],
)  # fmt: skip
def test_a_change_beyond_all_measure_is_said_to_be_one(step, said):
    assert _times(step) == said
