"""The search of tables over SOC against NumPy and SciPy: `python -m benchmarks.speed.tables`."""

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import lfilter

from barnax.cell.tables import hats
from barnax.model.inputs import PreparedRecord, Window, prepare_record
from barnax.over_soc.cross_validation import blocks_of
from barnax.over_soc.objective import Objective
from barnax.over_soc.reduced import layout_of, reduce_records, together
from barnax.over_soc.search import find_best
from barnax.over_soc.settings import TableSettings

from .case import bundled_cell, bundled_record
from .row import Row
from .sizes import Sizes
from .turns import Run, take_turns

SETTINGS = TableSettings(folds=0, most_cells=0)
TAU_RANGE_S = (2.0, 1000.0)
# Seconds between samples of the bundled record.
INTERVAL_S = 1.0
AIM = 10.0


def time_tables(sizes: Sizes) -> list[Row]:
    """The whole search, reduction included, and the same number of SciPy's solutions."""
    prepared = prepare_record(bundled_record(), bundled_cell(), "so-rc", Window())
    counted = 0

    class Counting(Objective):
        def solve(self, *given, **more):
            nonlocal counted
            counted += 1
            return super().solve(*given, **more)

    objective = _objective(prepared, Counting)
    best = find_best(objective)
    evaluations = counted
    whole = np.zeros(len(objective.penalty))
    root_v = np.sqrt(2 * _solved(prepared, objective.penalty, whole, best.place).cost)
    if not abs(root_v / best.root - 1) < 1e-7:
        raise SystemExit(f"SciPy's sqrt(J) is {root_v} V, not {best.root} V")
    runs = {
        "ours": Run(lambda: find_best(_objective(prepared, Objective))),
        "scipy": Run(lambda: _solved(prepared, objective.penalty, whole, best.place)),
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


def _objective(prepared: PreparedRecord, kind: type[Objective]) -> Objective:
    layout = layout_of(SETTINGS.nodes, TAU_RANGE_S, None, True, False)
    groups, count = blocks_of([prepared], SETTINGS)
    reduced = together(reduce_records([prepared], layout, groups, count))
    return kind(reduced, SETTINGS, (TAU_RANGE_S,) * 2, None, prepared.capacity_ah)


def _solved(prepared: PreparedRecord, penalty, whole, place):
    """SciPy's tables for given time constants, from every sample's columns."""
    spread = hats(prepared.soc, SETTINGS.nodes)
    columns = [spread * prepared.current_a[:, None]]
    for tau_s in np.exp(place):
        decay = np.exp(-INTERVAL_S / tau_s)
        held = spread * prepared.held_a[:, None]
        columns.append(lfilter([0.0, 1 - decay], [1.0, -decay], held, axis=0))
    matrix = np.concatenate([*columns, -spread], axis=1)[prepared.scored]
    unit = np.sqrt(len(matrix))
    target = (prepared.source_v - prepared.voltage_v)[prepared.scored]
    low = np.repeat([0.0, 0.0, 0.0, -np.inf], len(SETTINGS.nodes))
    return lsq_linear(
        np.concatenate([matrix / unit, penalty]),
        np.append(target / unit, whole),
        (low, np.inf),
        method="bvls",
        tol=1e-12,
    )


if __name__ == "__main__":
    for row in time_tables(Sizes()):
        print(row, row.verdict)
