"""Trust as `result.json` and the terminal hold it: the same numbers, exact round trips."""

import jax
import numpy as np
import pytest
from rich.console import Console

from barnax.reporting.terminal import trust_report
from barnax.results import Result, make_result, trust_part
from barnax.search.evaluate import evaluate
from barnax.search.refine import Refinement
from barnax.uncertainty import Assessment, Examination, assess, examine


@pytest.fixture(scope="module")
def assessment(refinement: Refinement) -> Assessment:
    return assess(refinement)


@pytest.fixture(scope="module")
def examination(refinement: Refinement, assessment: Assessment) -> Examination:
    return examine(refinement, assessment, key=jax.random.key(0))


@pytest.fixture(scope="module")
def result(refinement, assessment, examination) -> Result:
    identified = evaluate(refinement.search.problem.prepared, refinement.parameters)
    return make_result(refinement, [identified], assessment=assessment, examination=examination)


def told(blocks) -> str:
    console = Console(width=80, force_terminal=False)
    with console.capture() as capture:
        for block in blocks:
            console.print(block)
    return capture.get()


def test_a_result_with_all_of_it_is_read_back_as_it_was(result, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(result.to_json())
    assert Result.from_json(path) == result


def test_the_stored_errors_are_the_assessment_s_in_the_parameters_units(result, assessment):
    stored = result.trust.uncertainty.parameters
    for each in assessment.uncertainty.estimates:
        assert stored[each.name].value == each.value
        assert stored[each.name].low == each.low
        if each.relative_error is not None:
            assert stored[each.name].standard_error == each.value * each.relative_error
    assert (
        np.array(result.trust.uncertainty.correlation).shape
        == (len(assessment.uncertainty.names),) * 2
    )


def test_keys_carry_units(result):
    stored = result.to_dict()["trust"]
    assert set(stored) == {"uncertainty", "identifiability", "diagnostics", "examination"}
    assert "integrated_time [s]" in stored["diagnostics"]
    assert "rmse [V]" in stored["diagnostics"]["by_soc"][0]
    assert "block [s]" in stored["examination"]["bootstrap"]
    assert "rmse [V]" in stored["examination"]["suggestions"][0]


def test_without_an_examination_there_is_null(assessment):
    assert trust_part(assessment, None).examination is None


def test_the_examination_profiles_every_parameter_that_has_an_error(assessment, examination):
    with_errors = [each.name for each in assessment.uncertainty.estimates if each.relative_error]
    assert [each.name for each in examination.profiles] == with_errors
    assert set(examination.bootstrap.parameters) == set(with_errors)


def test_the_terminal_fits_80_columns_and_shows_both_errors(assessment, examination):
    text = told(trust_report(assessment, examination))
    assert max(map(len, text.splitlines())) <= 80
    each = assessment.uncertainty["R0 [Ohm]"]
    assert f"{1e3 * each.value:.5g}" in text
    assert f"{1e3 * each.low:.4g}" in text
    assert f"{each.inflation:.1f}" in text
    assert "What would lower the error: " in text


def test_a_held_parameter_says_so_in_the_table(assessment):
    text = told(trust_report(assessment))
    for name in assessment.linearization.held:
        assert f"{name.split(' [')[0]} " in text
    assert ("bound" in text) == bool(assessment.linearization.held)
