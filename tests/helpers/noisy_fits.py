"""Records simulated from known circuits with correlated noise, and what is fitted to them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from barnax import Assessment, CircuitParameters, Window, assess, make_optimizer
from barnax.model.problem import Problem, make_problem
from barnax.records import Decision, Hold
from barnax.search.answers import SeedAnswer
from barnax.search.seeds import refine, search_of
from helpers.reference import drop_v, filtered_response

TRUTH = CircuitParameters.constant(r0=0.05, r=(0.02, 0.03), c=(10 / 0.02, 120 / 0.03))
SAMPLES = 1501


@dataclass(frozen=True, eq=False)
class Fit:
    """A problem, its optimum, and what is asked of both."""

    problem: Problem
    parameters: CircuitParameters
    rmse_v: float

    @cached_property
    def assessment(self) -> Assessment:
        return assess(self.problem, self.parameters)


def fit(problem: Problem, start: CircuitParameters = TRUTH) -> Fit:
    """The optimum next to `start`."""
    seed = SeedAnswer(1.0, start, 0, 0)
    refinement = refine(search_of(problem, make_optimizer("ibmo", 12, 40), 0, (seed,)))
    return Fit(problem, refinement.parameters, refinement.rmse_v)


def white_noise(seed: int, sd_v: float = 1e-3) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, sd_v, SAMPLES)


def colored_noise(
    rng: np.random.Generator, samples: int, correlation_s: float, sd_v: float, records: int = 1
) -> np.ndarray:
    """Stationary AR(1) noise at 1 s sampling, one row a record; white where the time is 0."""
    drawn = rng.standard_normal((records, samples))
    if correlation_s == 0:
        return sd_v * drawn
    rho = np.exp(-1 / correlation_s)
    # The first value has the stationary variance.
    drawn[:, 0] /= np.sqrt(1 - rho**2)
    return sd_v * np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], drawn, axis=1)


def made_problem(
    like: Problem,
    noise_v,
    truth: CircuitParameters = TRUTH,
    circuit: str = "so-rc",
    hold: Hold = "forward",
    **options,
) -> Problem:
    """The problem of finding `truth` on the current of `like`, its voltage simulated by SciPy."""
    prepared = like.prepared
    values = (truth.r0, truth.r, truth.tau_s)
    drop = drop_v(filtered_response, 1.0, prepared.current_a, values, hold)
    voltage_v = prepared.record.voltage_v.copy()
    voltage_v[prepared.span] = like.cell.average_ocv_v(prepared.soc) - drop + noise_v
    record = replace(prepared.record, voltage_v=voltage_v, hold=Decision(hold, "given", "made so"))
    window = Window(initial_soc=prepared.start.soc, score_to_s=prepared.window.score_to_s)
    return make_problem(record, like.cell, circuit, window=window, **options)
