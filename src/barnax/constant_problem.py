"""The constant circuit on the records of a run: what the population searches, as the answer or
beside it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .cell import get_circuit
from .errors import InputError
from .global_optimum import (
    find_global_optimum,
    with_better_directions,
    with_better_hold,
    without_sweep_drop,
)
from .inputs import Inputs
from .model.prepared import PreparedRecord
from .model.problem import Kind, Problem, make_problem, require_enough
from .model.search_space import Range, ranges_of
from .model.window import Window
from .over_soc import OwnOcv, TableSettings
from .over_soc.registration import ROUNDS, SETTLED, with_start
from .select import limits_of
from .settings import Settings
from .uncertainty.covariance import Covariance, linearize

# The circuit that the population searches beside tables.
CONSTANT = "so-rc"
# A start is fitted with the circuit where its standard error is worth so much.
LEAST_DOUBT_V = 0.002


def first_problem(
    inputs: Inputs,
    windows: Mapping[str, Window],
    settings: Settings,
    own: OwnOcv | None,
    **box: Any,
) -> Problem:
    """A constant circuit on the records: with the OCV at rest where sweeps measured it under load,
    the directions before the start and the sampling of the current that the voltage shows."""
    circuit = own.circuit if own else settings.model or _start(inputs)
    problem = without_sweep_drop(problem_of(inputs, windows, settings, circuit, **box))
    if own is not None and get_circuit(circuit).has_rate:
        # A hysteresis of the records' own was fitted with the directions that fit better.
        problem = _with_directions(problem, own.directions)
    else:
        problem = with_better_directions(problem)
    return with_better_hold(problem)


def with_joint_starts(problem: Problem) -> Problem:
    """The problem of one record with the start that its voltages tell where that fits best together
    with the circuit, held to the rest's by its standard error, if that is worth millivolts."""
    first, *others = problem.prepared_records
    doubt_v = first.start.soc_sd * first.cell.ocv_slope(first.soc[:1])[0]
    # Several records tell each other's starts.
    for _ in range(ROUNDS if doubt_v >= LEAST_DOUBT_V and not others else 0):
        try:
            optimum = find_global_optimum(problem, prove=False)
            joint = Covariance.of(linearize(problem, optimum.parameters))
            (step,), (error,) = joint.starts_step.tolist(), joint.starts_error.tolist()
            record = _fitted(first, problem.prepared_records[0], step, error)
        except (InputError, ValueError, np.linalg.LinAlgError):
            # Too wide a box, beyond the OCV, or nothing that tells the start.
            break
        problem = replace(problem, prepared_records=[record])
        if np.all(np.abs(joint.starts_step) < SETTLED * joint.starts_error):
            break
    return problem


def _fitted(told: PreparedRecord, now: PreparedRecord, step: float, error: float) -> PreparedRecord:
    """The record with its start a step away, in standard errors of what was told, like `error`."""
    start, sd = told.start, float(told.start.soc_sd)
    where = start.soc, told.capacity_ah, now.start.soc + sd * step - start.soc, 0.0, sd * error, 0.0
    moved = with_start(told, *where, by="circuit", told_sd=sd)
    return replace(moved, start=replace(moved.start, direction_source=start.direction_source))


def _start(inputs: Inputs) -> str:
    return limits_of(inputs.cell, TableSettings()).start.replace("1rc", CONSTANT)


def _with_directions(problem: Problem, others: Mapping[str, float]) -> Problem:
    """The problem whose records say which directions before the start were found to fit better."""
    records = tuple(
        prepared.fitting_better(others[prepared.record.name])
        if prepared.record.name in others
        else prepared
        for prepared in problem.prepared_records
    )
    return problem.keeping_computed(prepared_records=records)


def problem_of(
    inputs: Inputs,
    windows: Mapping[str, Window],
    settings: Settings,
    circuit: str,
    bounds: Mapping[str, Range] | str | Path | None = None,
    fix: Mapping[str, float] | None = None,
) -> Problem:
    """The problem, compressed where the box allows it unless the objective is chosen."""
    source, ranges = ranges_of(bounds)

    def make(objective: Kind) -> Problem:
        return make_problem(
            inputs.records,
            inputs.cell,
            circuit,
            window=[windows[record.name] for record in inputs.records],
            bounds=ranges,
            fixed=fix,
            coordinates=settings.coordinates,
            objective=objective,
            source=source,
        )

    problem = make("scan" if settings.objective == "auto" else settings.objective)
    require_enough(problem)
    if settings.objective != "auto":
        return problem
    try:
        _ = problem.compressed
    except InputError:
        return problem
    return problem.keeping_computed(kind="compressed")
