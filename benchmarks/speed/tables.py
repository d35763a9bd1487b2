"""The search of tables over SOC against NumPy and SciPy."""

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import lfilter

from barnax.cell.tables import hats
from barnax.fit.objective import TableObjective
from barnax.fit.settings import TableSettings
from barnax.fit.table_problem import find_best, reduced_objective
from barnax.model.descent import LogScales
from barnax.model.prepared import PreparedRecord, Window, prepare_record

from .case import bundled_cell, bundled_record
from .row import Row
from .sizes import Sizes
from .turns import Run, take_turns

SETTINGS = TableSettings(folds=0, max_boxes=0)
TAU_RANGE_S = (2.0, 1000.0)
# Seconds between samples of the bundled record.
INTERVAL_S = 1.0
AIM = 10.0


def time_tables(sizes: Sizes) -> list[Row]:
    """The whole search, reduction included, and the same number of SciPy's solutions."""
    prepared = prepare_record(bundled_record(), bundled_cell(), "so-rc", Window())
    counted = 0

    class Counting(TableObjective):
        def solve(self, *given, **more):
            nonlocal counted
            counted += 1
            return super().solve(*given, **more)

    objective = _objective(prepared, Counting)
    best = find_best(objective)
    evaluations = counted
    root_v = np.sqrt(2 * _solved(prepared, objective, best.log_scales).cost)
    if not abs(root_v / best.rms_v - 1) < 1e-7:
        raise SystemExit(f"SciPy's sqrt(J) is {root_v} V, not {best.rms_v} V")
    runs = {
        "ours": Run(lambda: find_best(_objective(prepared, TableObjective))),
        "scipy": Run(lambda: _solved(prepared, objective, best.log_scales)),
    }
    taken = take_turns(runs, sizes.turns)
    return [
        Row(
            "tables over SOC, the whole search, the reduction included",
            taken["ours"],
            f"lfilter + lsq_linear on all samples, {evaluations} times",
            evaluations * taken["scipy"],
            evaluations * taken.ratio("scipy", "ours"),
            "times faster",
            AIM,
            f"{evaluations} time constants are tried; SciPy's own time is of one of them",
        )
    ]


def _objective(prepared: PreparedRecord, kind: type[TableObjective]) -> TableObjective:
    ranges = dict.fromkeys(("tau1 [s]", "tau2 [s]"), TAU_RANGE_S)
    objective = reduced_objective([prepared], SETTINGS, ranges)
    return kind(**vars(objective))


def _solved(prepared: PreparedRecord, objective: TableObjective, log_scales: LogScales):
    """SciPy's tables for given time constants, from every sample's columns."""
    spread = hats(prepared.soc, SETTINGS.nodes)
    columns = [spread * prepared.current_a[:, None]]
    for tau_s in np.exp(log_scales):
        decay = np.exp(-INTERVAL_S / tau_s)
        held = spread * prepared.held_a[:, None]
        columns.append(lfilter([0.0, 1 - decay], [1.0, -decay], held, axis=0))
    matrix = np.concatenate([*columns, -spread], axis=1)[prepared.scored] @ objective.to_tables
    unit, penalty = np.sqrt(len(matrix)), objective.penalty
    target = (prepared.source_v - prepared.voltage_v)[prepared.scored]
    return lsq_linear(
        np.concatenate([matrix / unit, penalty]),
        np.append(target / unit, np.zeros(len(penalty))),
        objective.box,
        method="bvls",
        tol=1e-12,
    )
