"""Results made by hand, whose every number a test knows."""

from typing import Any, cast

import numpy as np

from barnax.cell import CircuitParameters
from barnax.metrics import measure
from barnax.model.inputs import PreparedRecord
from barnax.optimizers import make_optimizer
from barnax.records.record import Decision, Record
from barnax.search.evaluate import Evaluation
from barnax.search.refine import Optimum, Refinement
from barnax.search.seeds import Search, SeedAnswer

CIRCUIT = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1000.0, 5000.0))


def make_record(samples: int, interval_s: float = 1.0, name: str = "cycle.csv") -> Record:
    """A repeated square wave of current, and a voltage that falls with ripple."""
    number = np.arange(samples)
    current_a = np.where(number % 20 < 10, 2.0, -1.0)
    given = Decision("forward", "given", "made so")
    return Record(
        name=name,
        time_s=1000.0 + interval_s * number,
        current_a=current_a,
        voltage_v=4.0 - 0.5 * number / samples - 0.05 * current_a,
        temperature_degc=None,
        step=None,
        row=number + 2,
        sign=Decision("discharge-positive", "given", "made so"),
        hold=given,
        sha256="",
    )


def make_evaluation(
    record: Record, scored: np.ndarray | None = None, error_v: np.ndarray | None = None
) -> Evaluation:
    """An evaluation of all samples of `record`, off by `error_v` (a slow wave by default)."""
    number = np.arange(record.samples)
    scored = np.ones(record.samples, bool) if scored is None else scored
    error_v = 5e-3 * np.sin(number / 50) if error_v is None else error_v
    prepared = PreparedRecord(
        record=record,
        circuit="so-rc",
        first=0,
        soc=1.0 - number / record.samples,
        direction=np.full(record.samples, -1.0),
        source_v=record.voltage_v,
        hysteresis_amplitude_v=None,
        scored=scored,
        rest_current_a=0.02,
        initial_soc=1.0,
        initial_soc_reason="given",
        warnings=(),
    )
    simulated_v = record.voltage_v - error_v
    return Evaluation(prepared, simulated_v, measure(record.voltage_v[scored], simulated_v[scored]))


def make_identification(histories_v: list[list[float]], population: int = 10) -> Search:
    """Seeds with these histories, each generation as large as the population."""
    seeds = tuple(
        SeedAnswer(history[-1], CIRCUIT, np.array(history), population * len(history), 0)
        for history in histories_v
    )
    generations = len(histories_v[0]) - 1
    optimizer = make_optimizer("bmo", population, generations)
    return Search(cast(Any, None), optimizer, 0, seeds)


def make_cross_check(found: Search, rmse_v: float) -> Refinement:
    optimum = Optimum(rmse_v, CIRCUIT, len(found.seeds), is_family=False)
    return Refinement(found, (), (optimum,), (), "", "scan", 0)
