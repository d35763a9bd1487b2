"""Whether a circuit with a pair or a hysteresis more may be worth it, before it is searched for."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..cell import get_circuit
from ..cell.parameters import RATE
from ..errors import InputError
from ..execution import in_float64
from ..model.prepared import PreparedRecord, prepare_record
from .cross_validation import SocErrors, squared_errors
from .facts import LowEnd
from .objective import Solution, TableObjective
from .problem import held_at, reduced_objective
from .search import find_best
from .settings import TableSettings

# Logs as fast as this show a pair more, which is tried whatever it lowers.
FAST_S = 0.25
# A further pair that lowers the error by less is hardly worth it on what is held out. Where most of
# the error is noise, that of a simulated cell of three lowers it by 8 %; of measured cells that two
# pairs predict as well, by 1 to 5 %.
LEAST_LOWERED = 0.06
# Rates of a hysteresis that are tried: it is told nearly as well at half or twice its own.
TRIED_RATES = (20.0, 60.0, 300.0)

Fitted = tuple[TableObjective, Solution]


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


def shows_more(
    circuit: str, objective: TableObjective, best: Solution, settings: TableSettings
) -> bool:
    """The same on the records of an objective, for another circuit than that of its best tables,
    with its settings; they may be too short for it. A hysteresis is tried at the time constants
    known and at a few rates, and half as much is asked of it."""
    try:
        records = [
            prepare_record(told.record, told.cell, circuit, told.window).following(told.dependence)
            for told in objective.prepared_records
        ]
        if not get_circuit(circuit).has_rate:
            return is_worth_trying(records, settings, best.rms_v, objective.low_end, objective)
        quick, known = replace(settings, folds=0), held_at(objective, best.log_scales)
        for rate in TRIED_RATES:
            tried = reduced_objective(records, quick, known | {RATE: (rate, rate)})
            tried = replace(tried, low_end=objective.low_end)
            found = tried.solve((*best.log_scales, math.log(rate)), exact=True)
            if found.rms_v < (1 - LEAST_LOWERED / 2) * best.rms_v:
                return True
        return False
    except InputError:
        return False


def is_supported(
    more: Fitted, errors: SocErrors | None, simpler: Fitted, simpler_errors: SocErrors | None
) -> bool:
    """True where a circuit with more is to be preferred.

    A pair is where it lowers the errors on blocks that are held out. These are mostly of an OCV
    that the other blocks do not show, and may hardly fall where the errors of all fits do, and a
    hysteresis that is none may lower them where such an OCV bends. So what lowers most blocks'
    errors in the fit is preferred too, or alone, unless it raises those on what is held out by as
    much.
    """
    if errors is None or simpler_errors is None:
        return False
    is_hysteresis = more[0].reduced.layout.has_amplitude
    if not is_hysteresis and errors.is_worth(simpler_errors):
        return True
    own_v2, simpler_v2 = (squared_errors(*fitted)[0].sum(axis=1) for fitted in (more, simpler))
    lowered = float(np.median(np.sqrt(own_v2 / simpler_v2)))
    pairs = (errors.rmse_v, simpler_errors.rmse_v), (errors.above_v, simpler_errors.above_v)
    raised = max(own / other for own, other in pairs if own and other)
    return lowered < 1 - LEAST_LOWERED and lowered * raised < 1
