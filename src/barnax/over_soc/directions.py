"""The best tables of records, with the directions before their starts that fit better where the
circuit has a dynamic hysteresis."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..cell import get_circuit
from ..cell.parameters import RATE
from ..model.descent import LogScales
from ..model.prepared import PreparedRecord, prepare_record
from ..model.window import Window
from .objective import Solution, TableObjective
from .problem import box_of, reduced_objective
from .search import find_best
from .settings import TableSettings

# Rates of a hysteresis that are tried: it is told nearly as well at half or twice its own.
TRIED_RATES = (20.0, 60.0, 200.0)


class WithDirections(NamedTuple):
    """The best tables of some records' circuit, and the RMSE in V with the other direction of
    records whose direction before the start was found with them."""

    objective: TableObjective
    best: Solution
    directions: Mapping[str, float] = {}


def best_tables(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    turned: Mapping[str, Window] | None = None,
) -> WithDirections:
    """The best tables of some records, with the directions before the start that fit better where
    the circuit has a dynamic hysteresis; `turned` as `directed` has it."""
    objective = reduced_objective(prepared_records, settings)
    best = find_best(objective)
    if not get_circuit(prepared_records[0].circuit).has_rate:
        return WithDirections(objective, best)
    found, directions = directed(prepared_records, settings, best.log_scales, turned)
    if any(one is not other for one, other in zip(found, prepared_records, strict=True)):
        objective = reduced_objective(found, settings)
        best = find_best(objective)
    return WithDirections(objective, best, directions)


def directed(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    log_scales: LogScales,
    turned: Mapping[str, Window] | None = None,
) -> tuple[list[PreparedRecord], dict[str, float]]:
    """Records made ready for a circuit with a hysteresis, those whose direction before the start is
    not known with the one that fits better at some scales; and the RMSE in V, by name, with the
    other one. Their windows with the other direction may be known, by name."""
    found, others = list(prepared_records), dict[str, float]()

    def left_v(records: Sequence[PreparedRecord]) -> float:
        tried = at_rates(records, settings, log_scales)
        return min(float(np.linalg.norm(solution.error)) for solution in tried)

    for place, one in enumerate(prepared_records):
        if one.start.direction_source != "assumed":
            continue
        window = replace(one.window, initial_direction=-one.start.direction)
        window = (turned or {}).get(one.record.name, window)
        other = prepare_record(one.record, one.cell, one.circuit, window)
        tried = [*found[:place], other.following(one.dependence), *found[place + 1 :]]
        own_v, other_v = left_v(found), left_v(tried)
        if other_v < own_v:
            found, other_v = tried, own_v
        others[one.record.name] = other_v
    return found, others


def at_rates(
    records: Sequence[PreparedRecord],
    settings: TableSettings,
    log_scales: LogScales,
) -> Iterator[Solution]:
    """The best tables at known scales, without a known rate at each of those that are tried."""
    quick = replace(settings, folds=0)
    names = list(box_of(records, quick))
    known = dict(zip(names, map(math.exp, log_scales), strict=False))
    for rate in [known[RATE]] if RATE in known else TRIED_RATES:
        scales = {**known, RATE: rate}
        held = {name: (scales[name], scales[name]) for name in names}
        tried = reduced_objective(records, quick, held)
        yield tried.solve(tuple(math.log(scales[name]) for name in names), exact=True)
