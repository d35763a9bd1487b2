"""The numbers of interactive figures, ready for JSON, as the page's script takes them."""

import base64
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float, Int

from .error import LABEL
from .style import ALONE, BLUE, VERMILLION, decimate, row_looks
from .voltage import (
    MAX_VOLTAGES,
    choose_time_unit,
    measured_color,
    most_accurate,
    unscored_spans,
)

if TYPE_CHECKING:
    from ..search.evaluate import Evaluation

Live = dict[str, Any]
Columns = Sequence[Float[np.ndarray, "samples"]]

# Numbers that all records of a report share, each of 5.3 bytes in the page.
MAX_NUMBERS: Final = 480_000


def live_record(rows: "Mapping[str, Evaluation]", max_numbers: int = MAX_NUMBERS) -> Live:
    """Measured and simulated voltage, errors and current of one record, on one axis of time.

    `rows` are the circuits' evaluations under their labels. Every sample is held, as float32,
    unless that takes more than `max_numbers`; then those that `decimate` keeps of any line. The
    first column is the time since the first sample in s, `origin` that sample's own.
    """
    shown = most_accurate(rows, MAX_VOLTAGES)
    looks = row_looks(rows)
    first = next(iter(shown.values()))
    prepared = first.prepared
    columns = [prepared.voltage_v, prepared.current_a]
    columns += [row.simulated_v for row in shown.values()]
    lines = [*columns, *(row.error_v for row in shown.values())]
    kept = enough_samples(prepared.time_s, lines, max_numbers // (len(columns) + 1))
    unit = choose_time_unit(prepared.time_s)
    is_one = ALONE in rows
    colors = [looks[label].color for label in shown]
    voltage = [_line("measured [V]", 1, measured_color(rows), width=2.5)]
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
    hold = {"forward": "after", "backward": "before"}.get(prepared.record.hold.value, "")
    current = _line("current [A]", 2, VERMILLION) | {"step": hold}
    rmse_mv = 1e3 * first.metrics.rmse_v
    return {
        "label": unit.label,
        "origin": float(prepared.time_s[0]),
        "seconds": unit.seconds,
        "columns": [
            base64.b64encode(np.asarray(column[kept], "<f4").tobytes()).decode()
            for column in (prepared.time_s - prepared.time_s[0], *columns)
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


def _line(label: str, column: int, color: str, width: float = 1.0) -> dict[str, Any]:
    return {"label": label, "column": column, "color": color, "width": width}
