"""What an assessment and an examination hold, as it is stored."""

import pytest

from barnax.cell import CircuitParameters
from barnax.errors import InputError
from barnax.schema import Part
from barnax.uncertainty import Examination, assess

from .made import fit, made_problem, white_noise


class Stored(Part):
    """A part of a result."""

    examination: Examination


def test_an_examination_is_read_back_as_it_was_written(examination):
    stored = Stored(examination=examination)
    assert Stored.model_validate_json(stored.model_dump_json(by_alias=True)) == stored


def test_the_examination_is_of_every_parameter_that_has_an_error(white, examination):
    uncertainty = white.assessment.uncertainty
    with_errors = [each.name for each in uncertainty.estimates if each.relative_error]
    assert [each.name for each in examination.profiles] == with_errors
    assert set(examination.bootstrap.parameters) == set(with_errors)
    assert examination.rmse_v == white.rmse_v


@pytest.mark.parametrize("seed", [1, 3])
def test_where_two_pairs_are_one_every_parameter_has_an_error(short_problem, seed):
    # Rounding then leaves variances below zero where the data determine most.
    same = CircuitParameters(0.05, (0.02, 0.03), (40 / 0.02, 40 / 0.03))
    found = fit(made_problem(short_problem, white_noise(seed), same), same).assessment
    for estimate in found.uncertainty.estimates:
        assert estimate.relative_error is not None
    assert not found.uncertainty["R1 [Ohm]"].is_determined
    assert found.uncertainty["R0 [Ohm]"].is_determined


def test_a_resistance_too_small_to_be_seen_has_no_interval(short_problem):
    problem = made_problem(short_problem, white_noise(0), bounds={"R1 [Ohm]": (1e-300, 1e-299)})
    circuit = CircuitParameters(0.05, (3e-300, 0.03), (10 / 3e-300, 4000))
    uncertainty = assess(problem, circuit).uncertainty
    assert uncertainty["R1 [Ohm]"].held == uncertainty["tau1 [s]"].held == "unseen"
    assert uncertainty["R0 [Ohm]"].is_determined


@pytest.mark.parametrize(
    ("bounds", "circuit"),
    [
        ({"tau1 [s]": (1e-300, 1e-299)}, CircuitParameters(0.05, (0.02, 0.03), (2e-298, 4000))),
        ({"R1 [Ohm]": (1e150, 1e151)}, CircuitParameters(0.05, (2e150, 0.03), (5e-150, 4000))),
    ],
)
def test_what_is_no_number_any_more_is_refused_in_one_message(short_problem, bounds, circuit):
    problem = made_problem(short_problem, white_noise(0), bounds=bounds)
    with pytest.raises(InputError, match="narrow the bounds"):
        assess(problem, circuit)
