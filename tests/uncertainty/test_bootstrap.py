"""The block bootstrap against the sandwich's errors, its rule against a closed form."""

from dataclasses import replace

import jax
import numpy as np

from barnax.uncertainty.refitted import block_length, bootstrap

from .made import TRUTH, made_problem, white_noise


def test_it_agrees_with_the_standard_errors(colored):
    key = jax.random.key(1)
    found = bootstrap(colored.problem, colored.parameters, key=key, **colored.known)
    assert found.replicates == found.converged == 200
    for name, each in found.parameters.items():
        estimate = colored.assessment.uncertainty[name]
        # Each is itself known to 20 or 30 %, as simulation shows.
        assert 0.5 < each.relative_error / estimate.relative_error < 1.6
        assert each.low < estimate.value < each.high


def test_the_same_key_draws_the_same_blocks(colored):
    given = (colored.problem, colored.parameters)
    first, again, other = (
        bootstrap(*given, key=jax.random.key(key), replicates=16, **colored.known)
        for key in (0, 0, 1)
    )
    assert first == again
    assert first != other


def test_the_block_length_is_that_of_the_rule_for_first_order_autoregression(colored):
    covariance = colored.assessment.covariance
    rho = np.exp(-1 / covariance.noise.correlation_s[6])
    only = np.zeros_like(covariance.noise.variance_v2)
    only[6] = 1.0
    pure = replace(covariance, noise=replace(covariance.noise, variance_v2=only))
    length, is_cut = block_length(pure)
    # Sum of |lag| rho^|lag| over that of rho^|lag|.
    ratio = 2 * rho / (1 - rho) ** 2 / ((1 + rho) / (1 - rho))
    assert length == np.ceil((1.5 * ratio**2 * covariance.linearization.samples) ** (1 / 3))
    assert not is_cut


def test_held_parameters_are_not_resampled(short_problem):
    problem = made_problem(short_problem, white_noise(5), fixed={"R0 [Ohm]": 0.05})
    found = bootstrap(problem, TRUTH, key=jax.random.key(0), replicates=8)
    assert "R0 [Ohm]" not in found.parameters
    assert set(found.parameters) >= {"R1 [Ohm]", "tau2 [s]", "C2 [F]"}
