"""Two fits that most tests share, one examined."""

import numpy as np
import pytest

from helpers.noisy_fits import SAMPLES, Fit, colored_noise, fit, made_problem, white_noise


@pytest.fixture(scope="session")
def white(short_problem) -> Fit:
    """A known circuit under 1 mV of white noise."""
    return fit(made_problem(short_problem, white_noise(5)))


@pytest.fixture(scope="session")
def colored(short_problem) -> Fit:
    """A known circuit under 1 mV of noise with a correlation time of 12 s."""
    noise_v = colored_noise(np.random.default_rng(8), SAMPLES, 12.0, 1e-3)[0]
    return fit(made_problem(short_problem, noise_v))
