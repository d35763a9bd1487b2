"""The block bootstrap against the trusted errors, its rule against a closed form."""

import jax
import numpy as np
import pytest

from barnax.uncertainty.assessment import assess
from barnax.uncertainty.bootstrap import block_length, bootstrap
from barnax.uncertainty.refit import Refit

from .made import colored_noise, cross_check, made_problem


@pytest.fixture(scope="module")
def colored(short_problem):
    """A known circuit under noise that remembers 12 s: cross-check, assessment and refits."""
    noise_v = colored_noise(np.random.default_rng(8), 1501, 12.0, 1e-3)[0]
    checked = cross_check(made_problem(short_problem, noise_v))
    return checked, assess(checked), Refit(checked.search.problem)


def test_it_agrees_with_the_trusted_errors(colored):
    checked, assessment, refit = colored
    found = bootstrap(checked, key=jax.random.key(1), assessment=assessment, refit=refit)
    assert found.replicates == found.converged == 200
    for name, each in found.parameters.items():
        trusted = assessment.uncertainty[name].relative_error
        # Each is itself known to 20 or 30 %, as simulation shows.
        assert 0.5 < each.relative_error / trusted < 1.6
        assert each.low < assessment.uncertainty[name].value < each.high


def test_the_same_key_draws_the_same_blocks(colored):
    checked, assessment, refit = colored
    settings = {"replicates": 16, "assessment": assessment, "refit": refit}
    first, again, other = (
        bootstrap(checked, key=jax.random.key(key), **settings).to_dict() for key in (0, 0, 1)
    )
    assert first == again
    assert first != other


def test_the_block_length_is_that_of_the_rule_for_first_order_autoregression(colored):
    _, assessment, _ = colored
    linearization, noise = assessment.linearization, assessment.uncertainty.noise
    rho = np.exp(-1 / noise.correlation_s[6])
    only = np.zeros_like(noise.variance_v2)
    only[6] = 1.0
    pure = type(noise)(**{**vars(noise), "variance_v2": only})
    length, is_cut = block_length(linearization, pure)
    # Sum of |lag| rho^|lag| over that of rho^|lag|.
    ratio = 2 * rho / (1 - rho) ** 2 / ((1 + rho) / (1 - rho))
    assert length == np.ceil((1.5 * ratio**2 * linearization.samples) ** (1 / 3))
    assert not is_cut


def test_held_parameters_are_not_resampled(short_problem):
    noise_v = np.random.default_rng(5).normal(0, 1e-3, 1501)
    problem = made_problem(short_problem, noise_v, fixed={"R0 [Ohm]": 0.05})
    found = bootstrap(cross_check(problem), key=jax.random.key(0), replicates=8)
    assert "R0 [Ohm]" not in found.parameters
    assert set(found.parameters) >= {"R1 [Ohm]", "tau2 [s]", "C2 [F]"}
