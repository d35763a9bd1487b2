"""Records over time: voltage, current and state of charge; one circuit's voltage, or many."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .pictures import illustration
from .style import (
    ALONE,
    BLACK,
    COLUMNS,
    HEIGHT_IN,
    SHADE,
    SKY_BLUE,
    VERMILLION,
    RowLook,
    draw_line,
    finish,
    is_column,
    make_figure,
    row_looks,
    title,
)

if TYPE_CHECKING:
    from ..model.prepared import PreparedRecord
    from ..search.evaluate import Evaluation


FRAME: Final = "#7A7A7A"
NOT_SCORED = "not scored"
HOURS_FROM_S = 7200.0
STRETCH_SAMPLES = 200
STRETCHES_PER_RECORD = 5
SHORTEST_STRETCH = 20

Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class TimeUnit:
    """A unit of time and how many seconds it has."""

    name: str
    seconds: float

    @property
    def label(self) -> str:
        return f"Time [{self.name}]"


def choose_time_unit(time_s: Samples) -> TimeUnit:
    """Hours for records of two hours and more, else seconds.

    >>> choose_time_unit(np.array([0.0, 7200.0])).label
    'Time [h]'
    """
    if time_s[-1] - time_s[0] >= HOURS_FROM_S:
        return TimeUnit("h", 3600.0)
    return TimeUnit("s", 1.0)


def unscored_spans(
    time: Samples, scored: Bool[np.ndarray, "samples"]
) -> Float[np.ndarray, "spans 2"]:
    """From when to when samples are not scored.

    Gaps too narrow to be seen are left out: a record may hold tens of thousands of them.
    """
    changes = np.diff(~scored, prepend=False, append=False)
    starts, stops = np.flatnonzero(changes).reshape(-1, 2).T
    spans = np.stack([time[starts], time[np.minimum(stops, len(time) - 1)]], axis=1)
    return spans[np.diff(spans)[:, 0] >= (time[-1] - time[0]) / COLUMNS]


def shade_unscored(axes: Axes, time: Samples, scored: Bool[np.ndarray, "samples"]) -> None:
    """Shade the time between scored samples, over the whole height; one entry for the legend."""
    spans = [(left, right - left) for left, right in unscored_spans(time, scored)]
    if not spans:
        return
    bottom, top = axes.get_ylim()
    style = {"facecolor": SHADE, "edgecolor": "none", "zorder": 0, "label": NOT_SCORED}
    axes.broken_barh(spans, (0.0, 1.0), transform=axes.get_xaxis_transform(), **style)
    axes.set_ylim(bottom, top)


def worst_stretch(error_v: Samples, scored: Bool[np.ndarray, "samples"]) -> slice | None:
    """The short stretch with the largest RMSE of its scored samples, the first of several.

    `None` where the record is short.
    """
    length = min(STRETCH_SAMPLES, int(np.count_nonzero(scored)) // STRETCHES_PER_RECORD)
    if length < SHORTEST_STRETCH:
        return None
    squares = np.concatenate([[0.0], np.cumsum(np.where(scored, error_v, 0.0) ** 2)])
    start = int(np.argmax(squares[length:] - squares[:-length]))
    return slice(start, start + length)


def stretch_clock(time_s: Samples, span: slice, unit: TimeUnit) -> tuple[Samples, str]:
    """Seconds after a round time before a stretch, and what an axis of them is called.

    Hours would need too many digits on so short an axis.
    """
    origin = np.floor(time_s[span.start] / unit.seconds * 100) / 100
    return time_s - origin * unit.seconds, f"Time after {origin:g} {unit.name} [s]"


def _draw_current(axes: Axes, prepared: "PreparedRecord", time: np.ndarray, span: slice) -> None:
    """The current as it flowed between samples, by the record's hold."""
    drawn = {"forward": "steps-post", "backward": "steps-pre", "centered": "steps-mid"}
    steps = drawn[prepared.record.hold.value]
    current_a = prepared.current_a[span]
    draw_line(axes, time[span], current_a, color=VERMILLION, linewidth=0.8, drawstyle=steps)
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    axes.set_ylabel("Current [A]\n(discharge > 0)")


# More voltage lines than this hide each other even in the magnified stretch.
MAX_VOLTAGES: Final = 8
MARKERS_PER_LINE: Final = 8


def rows_of(evaluations: "Evaluation | Mapping[str, Evaluation]") -> "Mapping[str, Evaluation]":
    """The rows to draw, by label; one circuit's evaluation is a row too.

    Raises `ValueError` where there is nothing to draw, or not the same samples in every row.
    """
    if not isinstance(evaluations, Mapping):
        return {ALONE: evaluations}
    if not evaluations:
        raise ValueError("there is no row to draw; give at least one evaluation")
    simulated = {
        (row.prepared.record.name, row.prepared.first, len(row.simulated_v))
        for row in evaluations.values()
    }
    if len(simulated) > 1:
        names = ", ".join(sorted({name for name, _, _ in simulated}))
        raise ValueError(
            f"the rows are on different samples ({names}); draw one record and window at a time"
        )
    return evaluations


def most_accurate(evaluations: Mapping[str, "Evaluation"], most: int) -> dict[str, "Evaluation"]:
    """At most `most` rows, those of the lowest RMSE, in their own order."""
    ranked = sorted(evaluations, key=lambda label: evaluations[label].metrics.rmse_v)
    kept = set(ranked[:most])
    return {label: row for label, row in evaluations.items() if label in kept}


def measured_color(rows: Mapping[str, "Evaluation"]) -> str:
    """Of what was measured: grey behind many colors."""
    return SKY_BLUE if ALONE in rows else "#BEBEBE"


def heading(record: str, kept: int, of: int) -> str:
    """The record's name, and what a title adds where not every row is drawn.

    >>> heading("cycle.csv", 8, 12)
    'cycle.csv: the 8 of 12 rows with the lowest RMSE'
    """
    return record if kept == of else f"{record}: the {kept} of {of} rows with the lowest RMSE"


@illustration(
    "Measured and simulated voltage on {}, and the current. On the right, the framed part with the "
    "largest error; of several circuits, of the one with the lowest RMSE.",
    "Measured and simulated voltage over time, above the current",
    is_main=True,
)
def plot_voltage(evaluations: "Evaluation | Mapping[str, Evaluation]") -> Figure:
    """Voltage over time, measured and simulated by one circuit or by many, above the current.

    Time is on the record's own clock, in seconds below two hours. Samples that do not count
    towards the metrics are shaded. At the right the framed stretch, magnified: the one with the
    largest error of the lowest RMSE; records under 100 scored samples go without. Of more than
    eight rows the eight with the lowest RMSE are drawn, and the title says so. Many rows are as
    Fig. 10 and 12 of Li et al. (2023). Raises `ValueError` where they are on different samples.

    Args:
        evaluations: A record's evaluation, or those of rows on one record, by label.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record, cell = read_record(bundled_file("identification")), characterize(tests)
    >>> rows = {name: validate(record, cell, name, circuit) for name in ("so-rc", "iso-rc")}
    >>> [plot_voltage(drawn).axes[0].get_ylabel() for drawn in (rows, rows["so-rc"])]
    ['Voltage [V]', 'Voltage [V]']
    """
    rows = rows_of(evaluations)
    looks, shown = row_looks(rows), most_accurate(rows, MAX_VOLTAGES)
    best = min(shown.values(), key=lambda row: row.metrics.rmse_v)
    prepared, unit = best.prepared, choose_time_unit(best.prepared.time_s)
    time = prepared.time_s / unit.seconds
    columns = [(time, unit.label, slice(None))]
    span = worst_stretch(best.error_v, prepared.scored)
    if span is not None:
        columns.append((*stretch_clock(prepared.time_s, span, unit), span))
    whole, height_in = (1.3 if is_column() else 1.9, HEIGHT_IN) if len(rows) == 1 else (1.0, 6.0)
    figure = make_figure(height_in)
    panels = figure.subplots(
        2,
        len(columns),
        sharex="col",
        squeeze=False,
        width_ratios=[whole, 1.0][: len(columns)],
        height_ratios=[2.0, 1.0],
    )
    for (voltage, current), (clock, label, samples) in zip(panels.T, columns, strict=True):
        is_close = samples is span or span is None
        draw_rows(voltage, clock, samples, shown, looks, is_close=is_close)
        _draw_current(current, prepared, clock, samples)
        current.set_xlabel(label)
    for axes in panels[:, 0]:
        shade_unscored(axes, time, prepared.scored)
    title(panels[0, 0], heading(prepared.record.name, len(shown), len(rows)))
    if span is not None:
        title(panels[0, 1], "largest error")
        edges = time[[span.start, span.stop - 1]]
        for left, right in panels:
            right.set_ylabel("")
            left.axvspan(*edges, facecolor="none", edgecolor=FRAME, linewidth=0.9, zorder=3)
    return finish(figure, *panels.flat)


def draw_rows(
    axes: Axes,
    time: np.ndarray,
    samples: slice,
    shown: Mapping[str, "Evaluation"],
    looks: Mapping[str, RowLook],
    *,
    is_close: bool,
) -> None:
    """The measured line and every row's; markers only where single samples can be seen."""
    measured_v = next(iter(shown.values())).prepared.voltage_v
    style = {"color": measured_color(shown), "linewidth": 2.9 if is_close else 1.8}
    draw_line(axes, time[samples], measured_v[samples], label="measured", **style)
    for place, (label, row) in enumerate(shown.items()):
        look = looks[label]
        name = f"{label} (RMSE {1e3 * row.metrics.rmse_v:.3g} mV)"
        style = {"color": look.color, "linewidth": 1.0 if is_close else 0.6}
        drawn = draw_line(axes, time[samples], row.simulated_v[samples], label=name, **style)
        if is_close:
            drawn.set(linestyle=look.line, marker=look.marker, markersize=3.6)
            drawn.set_markerfacecolor("white")
            # Shifted from row to row, so that markers of equal answers stay visible.
            spacing = max(1, np.size(drawn.get_xdata()) // MARKERS_PER_LINE)
            drawn.set_markevery((spacing * place // len(shown), spacing))
    axes.set_ylabel("Voltage [V]")
