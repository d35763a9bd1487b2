"""Whether records support a circuit with a pair or a hysteresis more: before it is searched for,
and by what it then leaves."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from ..blas import one_blas_thread
from ..cell import get_circuit
from ..cell.parameters import RATE
from ..errors import InputError
from ..execution import in_float64, threads
from ..model.descent import LogScales
from ..model.prepared import PreparedRecord, prepare_record
from ..model.window import Window
from ..notices import Notice, notice
from .cross_validation import SocErrors, held_out_errors, squared_errors
from .dependence import searched
from .facts import LowEnd
from .level import with_own_ocv
from .objective import Solution, TableObjective
from .problem import box_of, reduced_objective
from .search import find_best
from .settings import TableSettings

# Logs as fast as this show a pair more, which is tried whatever it lowers.
FAST_S = 0.25
# A further pair that lowers the error by less is hardly worth it on what is held out. Where most of
# the error is noise, that of a simulated cell of three lowers it by 8 %; of measured cells that two
# pairs predict as well, by 1 to 5 %.
LEAST_LOWERED = 0.06
# Rates of a hysteresis that are tried: it is told nearly as well at half or twice its own.
TRIED_RATES = (20.0, 60.0, 200.0)
# So many times what further unknowns lower by chance, and the share of the noise that is taken for
# sure, from so many differences on.
BY_CHANCE, NOISE_SHARE, FEWEST_STEADY = 4.0, 0.98, 100
# A rate is at its highest from this share of it on.
NEARLY = 0.95


class Fitted(NamedTuple):
    """The best tables of some records' circuit, and the RMSE in V with the other direction of
    records whose direction before the start was found with them."""

    objective: TableObjective
    best: Solution
    directions: Mapping[str, float] = {}

    @property
    def circuit(self) -> str:
        return self.objective.prepared_records[0].circuit


def best_tables(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    simpler: Fitted | None = None,
    turned: Mapping[str, Window] | None = None,
) -> Fitted:
    """The best tables of some records, with the directions before the start that fit better where
    the circuit has a dynamic hysteresis, unless a simpler circuit's are known; `turned` as
    `directed` has it."""
    like, directions = (None, {}) if simpler is None else (simpler.objective, simpler.directions)
    has_rate = get_circuit(prepared_records[0].circuit).has_rate
    if not has_rate or (like is not None and RATE in like.ranges):
        return Fitted(*searched(prepared_records, settings, like), directions)
    if simpler is not None:
        found, directions = directed(prepared_records, settings, simpler.best.log_scales)
        return Fitted(*searched(found, settings, like), directions)
    objective, best = searched(prepared_records, settings)
    found, directions = directed(prepared_records, settings, best.log_scales, turned)
    if any(one is not other for one, other in zip(found, prepared_records, strict=True)):
        objective, best = searched(found, settings)
    return Fitted(objective, best, directions)


def with_further(
    found: Fitted,
    settings: TableSettings,
    beside: Mapping[str, Sequence[str]],
    begun: Callable[[str, TableSettings, Fitted], list[PreparedRecord]],
) -> tuple[Fitted, list[Notice]]:
    """The best tables of the circuit with as much more as the records support, and what speaks
    against what it leaves out.

    Args:
        found: The best tables of the simplest circuit.
        settings: How they were fitted.
        beside: By circuit, those that have more. A pair and a hysteresis can each imitate the
            other: of several that the records support, the one that leaves less is taken, and those
            beside it are tried.
        begun: Called with a circuit, its settings and what is fitted so far; gives the records
            made ready for it. One may be too short for it, with an `InputError`.
    """
    circuits = beside.get(found.circuit, ())
    held_out = held_out_errors(found.objective, found.best) if circuits else None
    if held_out is None:
        return found, []

    @one_blas_thread()
    def tried(circuit: str) -> tuple[Fitted | None, list[Notice]]:
        own = with_own_ocv(settings, circuit)
        try:
            if not shows_more(circuit, found, own):
                return None, []
            more = best_tables(begun(circuit, own, found), own, found)
        except InputError:
            return None, []
        if not is_supported(more, held_out_errors(more.objective, more.best), found, held_out):
            return None, []
        if told := list(turning_at_once(more)):
            # Beside a hysteresis that they support it says nothing.
            return None, [] if RATE in found.objective.ranges else told
        return more, []

    with threads(len(circuits)) as beside_each_other:
        supported, against = zip(*beside_each_other.map(tried, circuits), strict=True)
    supported = [more for more in supported if more is not None]
    if not supported:
        return found, list(chain.from_iterable(against))
    found = min(supported, key=lambda more: more.best.rms_v)
    return with_further(found, settings, beside, begun)


@in_float64
def is_worth_trying(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    simpler_v: float,
    low_end: LowEnd | None,
    like: TableObjective | None = None,
) -> bool:
    """True where a circuit's best tables leave so much less than a simpler one's that its further
    pair may be worth it on what is held out too, or the log is fast.

    Args:
        prepared_records: The records, made ready for the circuit, following what the simpler
            circuit's do.
        settings: How its tables are fitted.
        simpler_v: sqrt(J) of the simpler circuit.
        low_end: How errors below 10 % SOC count in that.
        like: An objective whose factors may serve.

    Raises `InputError` where a record is too short for so many pairs.
    """
    if all(prepared.median_interval_s <= FAST_S for prepared in prepared_records):
        return True
    objective = reduced_objective(prepared_records, settings, like=like)
    found = find_best(replace(objective, low_end=low_end))
    return found.rms_v < (1 - LEAST_LOWERED) * simpler_v


def shows_more(circuit: str, simpler: Fitted, settings: TableSettings) -> bool:
    """The same on the records of an objective, for another circuit than that of its best tables,
    with its settings; they may be too short for it. A hysteresis is tried at the time constants
    known and at a few rates, and half as much is asked of it."""
    objective, best, _ = simpler
    try:
        records = [
            prepare_record(told.record, told.cell, circuit, told.window).following(told.dependence)
            for told in objective.prepared_records
        ]
        if not get_circuit(circuit).has_rate or RATE in objective.ranges:
            return is_worth_trying(records, settings, best.rms_v, objective.low_end, objective)
        records, _ = directed(records, settings, best.log_scales)
        samples, noise_v2 = objective.reduced.scored, _noise_v2(records)
        for tried in at_rates(records, settings, best.log_scales, objective.low_end):
            found_v2 = tried.objective_v2
            gained_v2 = samples * (best.objective_v2 - found_v2)
            further = len(tried.unknowns) - len(best.unknowns)
            left = _left(found_v2, best.objective_v2, noise_v2)
            if left < 1 - LEAST_LOWERED / 2 and gained_v2 > BY_CHANCE * further * noise_v2:
                return True
        return False
    except InputError:
        return False


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
    low_end: LowEnd | None = None,
) -> Iterator[Solution]:
    """The best tables at known scales, without a known rate at each of those that are tried."""
    # What counts less below 10 % SOC is apart only where blocks are.
    is_even = low_end is None or low_end.weight == 1
    quick = replace(settings, folds=0) if is_even else settings
    names = list(box_of(records, quick))
    known = dict(zip(names, map(math.exp, log_scales), strict=False))
    for rate in [known[RATE]] if RATE in known else TRIED_RATES:
        scales = {**known, RATE: rate}
        held = {name: (scales[name], scales[name]) for name in names}
        tried = replace(reduced_objective(records, quick, held), low_end=low_end)
        yield tried.solve(tuple(math.log(scales[name]) for name in names), exact=True)


def is_supported(
    more: Fitted, errors: SocErrors | None, simpler: Fitted, simpler_errors: SocErrors | None
) -> bool:
    """True where a circuit with more is to be preferred.

    A pair is where it lowers the errors on blocks that are held out. These are mostly of an OCV
    that the other blocks do not show, and may hardly fall where the errors of all fits do, and a
    hysteresis that is none may lower them where such an OCV bends. So what lowers most blocks'
    errors in the fit is preferred too, or alone, unless it raises those on what is held out by as
    much. The voltage's noise is no error of a circuit.
    """
    if errors is None or simpler_errors is None:
        return False
    is_hysteresis, was_hysteresis = (
        fitted.objective.reduced.layout.has_amplitude for fitted in (more, simpler)
    )
    if is_hysteresis == was_hysteresis and errors.is_worth(simpler_errors):
        return True
    (own_v2, counts), (simpler_v2, _) = (
        squared_errors(fitted.objective, fitted.best) for fitted in (more, simpler)
    )
    own_v2, simpler_v2, counts = (sums.sum(axis=1) for sums in (own_v2, simpler_v2, counts))
    noise_v2 = _noise_v2(more.objective.prepared_records)
    further = len(more.best.unknowns) - len(simpler.best.unknowns)
    if np.sum(simpler_v2 - own_v2) <= BY_CHANCE * further * noise_v2:
        return False
    own_v2, simpler_v2, counts = (sums[counts > 0] for sums in (own_v2, simpler_v2, counts))
    lowered = float(np.median(_left(own_v2 / counts, simpler_v2 / counts, noise_v2)))
    pairs = (errors.rmse_v, simpler_errors.rmse_v), (errors.above_v, simpler_errors.above_v)
    raised = max((own / other for own, other in pairs if own and other), default=1.0)
    # One that turns as slowly as can be told from an OCV may be a part of that.
    most = 1.0 if is_hysteresis and not was_hysteresis and _turns_slowly(more) else 1 / lowered
    return lowered < 1 - LEAST_LOWERED and raised < most


def _turns_slowly(found: Fitted) -> bool:
    """True where a hysteresis ends at the slowest rate."""
    return math.exp(found.best.log_scales[-1]) < found.objective.ranges[RATE][0] / NEARLY


def turning_at_once(found: Fitted) -> Iterator[Notice]:
    """The warning where a hysteresis that the records support ends at the fastest rate: then it is
    none, for resistances that fall with the current look the same."""
    objective, best, _ = found
    if not objective.reduced.layout.has_amplitude:
        return
    highest = objective.ranges[RATE][1]
    if math.exp(best.log_scales[-1]) > NEARLY * highest:
        yield notice("tables.turns-at-once", turned_soc=3 / highest, instead=found.circuit)


def _left(own_v2: Any, simpler_v2: Any, noise_v2: float) -> Any:
    """The ratio of what two circuits leave beside the noise, as voltages, of one or of many blocks:
    none of them leaves less than the noise."""
    least_v2 = float(min(np.min(own_v2), np.min(simpler_v2)))
    own_v2, simpler_v2 = (
        each - NOISE_SHARE * min(noise_v2, least_v2) for each in (own_v2, simpler_v2)
    )
    tiny = np.finfo(float).tiny
    return np.sqrt((own_v2 + tiny) / (simpler_v2 + tiny))


def _noise_v2(prepared_records: Sequence[PreparedRecord]) -> float:
    """The variance of the voltage's white noise in V^2, the least of some records: by the third
    differences of even samples under one current, which have twenty times that; zero where there
    are few of them."""
    found = []
    for prepared in prepared_records:
        is_even = np.abs(np.diff(prepared.time_s, 2)) < 1e-6
        is_steady = np.diff(prepared.current_a) == 0
        here = is_even[:-1] & is_even[1:] & is_steady[:-2] & is_steady[1:-1] & is_steady[2:]
        thirds_v = np.diff(prepared.voltage_v, 3)[here]
        spread_v = 1.4826 * np.median(np.abs(thirds_v)) if len(thirds_v) >= FEWEST_STEADY else 0.0
        found.append(float(spread_v**2) / 20)
    return min(found)
