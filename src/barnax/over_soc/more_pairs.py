"""Whether a circuit with one pair more may be worth it, before it is searched for and checked."""

from collections.abc import Sequence
from dataclasses import replace

from ..errors import InputError
from ..execution import in_float64
from ..model.prepared import PreparedRecord, prepare_record
from .facts import LowEnd
from .objective import Solution, TableObjective
from .problem import reduced_objective
from .search import find_best
from .settings import TableSettings

# Logs as fast as this show a pair more, which is tried whatever it lowers.
FAST_S = 0.25
# A further pair that lowers the error by less is hardly worth it on what is held out. Where most of
# the error is noise, that of a simulated cell of three lowers it by 8 %; of measured cells that two
# pairs predict as well, by 1 to 5 %.
LEAST_LOWERED = 0.06


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


def shows_more(circuit: str, objective: TableObjective, best: Solution) -> bool:
    """The same on the records of an objective, for another circuit than that of its best tables;
    they may be too short for it."""
    try:
        records = [
            prepare_record(told.record, told.cell, circuit, told.window).following(told.dependence)
            for told in objective.prepared_records
        ]
        return is_worth_trying(
            records, objective.settings, best.rms_v, objective.low_end, objective
        )
    except InputError:
        return False
