"""What the page's script draws interactive figures from: plain numbers, ready for JSON."""

import base64
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from jaxtyping import Float, Int
from matplotlib.colors import to_hex

from .error import LABEL
from .search import COLOR_MAP, STEPS_PERCENT, least_over_gamma
from .soc_tables import drawn_tables
from .style import BLACK, BLUE, GREY, SKY_BLUE, SOC_LABEL, VERMILLION, decimate, row_looks
from .voltage import MEASURED, MOST_VOLTAGES, choose_time_unit, most_accurate, unscored_spans

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..global_optimum import Landscape
    from ..over_soc import TableFit
    from ..search.evaluate import Evaluation

Live = dict[str, Any]
Columns = Sequence[Float[np.ndarray, "samples"]]

# All records of a report share so many numbers, which take 5.3 bytes each in the page.
MOST_NUMBERS: Final = 480_000
# How circuits are marked in a landscape.
SEED: Final = "●"
SIGNS: Final = {"refined": "✚", "other local optima": "○", "global optimum": "★"}
BAND: Final = "rgba(86, 180, 233, 0.3)"


def live_record(rows: "Mapping[str, Evaluation]", most_numbers: int = MOST_NUMBERS) -> Live:
    """Measured and simulated voltage, errors and current of one record, on one axis of time.

    `rows` are the circuits' evaluations under their labels. Every sample is held, as float32,
    unless that takes more than `most_numbers`; then those that `decimate` keeps of any line. The
    first column is the time since the first sample in s, `origin` that sample's own.
    """
    shown = most_accurate(rows, MOST_VOLTAGES)
    looks = row_looks(rows)
    first = next(iter(shown.values()))
    prepared = first.prepared
    columns = [prepared.voltage_v, prepared.current_a]
    columns += [each.simulated_v for each in shown.values()]
    lines = [*columns, *(each.error_v for each in shown.values())]
    kept = enough_samples(prepared.time_s, lines, most_numbers // (len(columns) + 1))
    unit = choose_time_unit(prepared.time_s)
    is_one = len(rows) == 1
    colors = [BLACK if is_one else looks[label].color for label in shown]
    voltage = [_line("measured [V]", 1, SKY_BLUE if is_one else MEASURED, width=2.5)]
    voltage += [
        _line(f"{label} [V]", 3 + place, color)
        for place, (label, color) in enumerate(zip(shown, colors, strict=True))
    ]
    errors = [
        _line(f"error{'' if is_one else f' of {label}'} [mV]", 1, color) | {"minus": 3 + place}
        for place, (label, color) in enumerate(zip(shown, colors, strict=True))
    ]
    if is_one:
        errors[0]["color"] = BLUE
    hold = "after" if prepared.record.hold.value == "forward" else "before"
    current = _line("current [A]", 2, VERMILLION) | {"step": hold}
    rmse_mv = 1e3 * first.metrics.rmse_v
    return {
        "kind": "time",
        "label": unit.label,
        "origin": float(prepared.time_s[0]),
        "seconds": unit.seconds,
        "columns": [
            base64.b64encode(np.asarray(each[kept], "<f4").tobytes()).decode()
            for each in (prepared.time_s - prepared.time_s[0], *columns)
        ],
        "shaded": [
            list(map(float, span)) for span in unscored_spans(prepared.time_s, prepared.scored)
        ],
        "panels": [
            {"label": "Voltage [V]", "height": 260, "lines": voltage},
            {
                "label": LABEL.partition("\n")[0],
                "height": 200,
                "lines": errors,
                "levels": [-rmse_mv, rmse_mv] if is_one else [],
            },
            {"label": "Current [A]", "height": 170, "lines": [current]},
        ],
        "samples": len(prepared.time_s),
        "held": len(kept),
    }


def enough_samples(
    time_s: Float[np.ndarray, "samples"], lines: Columns, most: int
) -> Int[np.ndarray, "kept"]:
    """Indices of all samples, or of at most about `most` with every peak of every line.

    >>> enough_samples(np.arange(5.0), [np.zeros(5)], 10)
    array([0, 1, 2, 3, 4])
    """
    if len(time_s) <= most:
        return np.arange(len(time_s))
    columns = max(most // (2 + 2 * len(lines)), 1)
    return np.unique(np.concatenate([decimate(time_s, line, columns) for line in lines]))


def live_tables(fit: "TableFit", constant: "CircuitParameters | None" = None) -> Live:
    """Every table over SOC with the intervals of its nodes, on the scale of the still figure."""
    nodes = np.array(fit.tables.nodes)
    columns, panels = [nodes], []
    for place, table in enumerate(drawn_tables(fit).values()):
        label = table.label
        if table.is_resistance and place > 0:
            label += f", tau{place} = {fit.tables.tau_s[place - 1]:.3g} s"
        at = len(columns)
        hollow = np.where(table.is_visited, np.nan, table.values)
        columns += [table.values, table.low, table.high, hollow]
        lines = [
            _line("95 % from", at + 1, SKY_BLUE),
            _line("to", at + 2, SKY_BLUE),
            _line("node", at, BLUE, width=1.5) | {"marks": "filled"},
            _line("near no sample", at + 3, BLUE, width=0.0) | {"marks": "open"},
        ]
        if constant is not None and table.is_resistance and place <= constant.pairs:
            value = 1e3 * (constant.r0, *constant.r)[place]
            lines.append(_line("constant", len(columns), GREY, width=1.5))
            columns.append(np.full(len(nodes), value))
        panel = {"label": label, "height": 230, "lines": lines, "band": [2, 1, BAND]}
        panels.append(panel | {"range": table.scale})
    return {
        "kind": "soc",
        "label": SOC_LABEL,
        "columns": [_with_gaps(each) for each in columns],
        "panels": panels,
    }


def live_landscape(
    landscape: "Landscape",
    answers: "Mapping[str, Sequence[CircuitParameters]]",
    named: "Mapping[str, Sequence[CircuitParameters]]",
) -> Live:
    """The RMSE over both time constants, cell by cell, and circuits as marks.

    `answers` are each row's circuits, one a seed, and `named` those with a sign of their own in
    `SIGNS`. RMSE in mV is a row for each tau1; circuits beyond the box stand at its edge.
    """
    tau1_s, tau2_s = landscape.tau_s
    rmse_mv = 1e3 * least_over_gamma(landscape)
    is_ordered = bool(np.isnan(rmse_mv[-1, 0]))
    names = ("Shorter time constant", "Longer time constant") if is_ordered else ("", "")
    names = [f"{name or 'Time constant'} tau{k} [s]" for k, name in enumerate(names, start=1)]
    box = ((tau1_s[0], tau2_s[0]), (tau1_s[-1], tau2_s[-1]))
    looks = row_looks(answers)
    marks = [(label, SEED, looks[label].color, each) for label, each in answers.items()]
    marks += [(label, SIGNS[label], "#ffffff", each) for label, each in named.items()]
    colors = matplotlib.colormaps[COLOR_MAP](np.linspace(0.0, 1.0, len(STEPS_PERCENT)))
    return {
        "kind": "map",
        "labels": [*names, "RMSE [mV]", "above the lowest [%]"],
        "taus": [_rounded(tau1_s), _rounded(tau2_s)],
        "rmse": [_rounded(row) for row in rmse_mv],
        "steps": STEPS_PERCENT,
        "colors": [to_hex(each) for each in colors],
        "marks": [
            {
                "label": label,
                "shape": shape,
                "color": color,
                "points": [
                    _rounded(np.clip(sorted(c.tau_s) if is_ordered else c.tau_s, *box))
                    for c in circuits
                ],
            }
            for label, shape, color, circuits in marks
            if circuits
        ],
    }


def _line(label: str, column: int, color: str, width: float = 1.0) -> dict[str, Any]:
    return {"label": label, "column": column, "color": color, "width": width}


def _with_gaps(values: Float[np.ndarray, "nodes"]) -> list[float | None]:
    return [float(each) if np.isfinite(each) else None for each in values]


def _rounded(values: Sequence[float] | np.ndarray) -> list[float | None]:
    """Six digits, more than a screen shows."""
    return [float(f"{each:.6g}") if np.isfinite(each) else None for each in values]
