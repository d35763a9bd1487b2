"""Records made from known circuits with noise that remembers, and their cross-checks."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from barnax.cell import CircuitParameters
from barnax.model.inputs import Window
from barnax.model.problem import Problem, make_problem
from barnax.optimizers import make_optimizer
from barnax.records.record import Decision, Hold
from barnax.search.refine import Refinement, refine
from barnax.search.seeds import Search, SeedAnswer
from reference import drop_v, filtered_response

TRUTH = CircuitParameters(r0=0.05, r=(0.02, 0.03), c=(10 / 0.02, 120 / 0.03))


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
    window = Window(initial_soc=prepared.initial_soc, score_to_s=like.window.score_to_s)
    return make_problem(record, like.cell, circuit, window=window, **options)


def cross_check(problem: Problem, start: CircuitParameters = TRUTH) -> Refinement:
    """The refined answer of a search that has ended at `start`."""
    seed = SeedAnswer(1.0, start, np.ones(1), 0, 0)
    return refine(Search(problem, make_optimizer("ibmo", 12, 40), 0, (seed,)))
