"""Records over time: voltage, current and state of charge, measured, simulated and designed."""

import base64
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import style

if TYPE_CHECKING:
    from ..experiment import Design
    from ..model.prepared import PreparedRecord
    from ..search.evaluate import Evaluation

Samples = Float[np.ndarray, "samples"]

FRAME: Final = "#7A7A7A"
NOT_SCORED: Final = "not scored"
ERROR_LABEL: Final = "Error [mV]\n(measured − simulated)"
CURRENT_LABEL: Final = "Current [A]\n(discharge > 0)"
HOURS_FROM_S: Final = 7200.0
STRETCH_SAMPLES: Final = 200
STRETCHES_PER_RECORD: Final = 5
SHORTEST_STRETCH: Final = 20
# More voltage lines than this hide each other even in the magnified stretch.
MAX_VOLTAGES: Final = 8
MARKERS_PER_LINE: Final = 8
# Line styles for the current between samples, by the record's hold, in lines and scripts.
STEPS: Final = {
    "forward": ("steps-post", "after"),
    "backward": ("steps-pre", "before"),
    "centered": ("steps-mid", ""),
}
# Numbers that all records of a report share, each of 5.3 bytes in the page.
MAX_NUMBERS: Final = 480_000


class Clock:
    """Times of samples in hours for two hours and more, else in seconds.

    >>> Clock(np.array([0.0, 7200.0])).label
    'Time [h]'
    """

    def __init__(self, time_s: Samples):
        is_long = time_s[-1] - time_s[0] >= HOURS_FROM_S
        self.unit, self.seconds = ("h", 3600.0) if is_long else ("s", 1.0)
        self.label = f"Time [{self.unit}]"
        self.time = time_s / self.seconds


class Rows:
    """The circuits drawn on one record: of the given rows, the `most` with the lowest RMSE.

    One evaluation is a row too. Raises `ValueError` if there is nothing to draw, or the rows have
    different samples.

    Attributes:
        shown: The rows by their labels, in the order given.
        best: The row with the lowest RMSE.
        looks: The looks of all rows given.
        title: The record's name, with a note if not every row is drawn.
    """

    def __init__(self, evaluations: "Evaluation | Mapping[str, Evaluation]", most: int):
        rows = evaluations
        if not isinstance(rows, Mapping):
            rows = {style.ALONE: rows}
        if not rows:
            raise ValueError("there is no row to draw; give at least one evaluation")
        simulated = {
            (row.prepared.record.name, row.prepared.first, len(row.simulated_v))
            for row in rows.values()
        }
        names = sorted({name for name, _, _ in simulated})
        if len(simulated) > 1:
            raise ValueError(
                f"the rows are on different samples ({', '.join(names)}); draw one record and "
                "window at a time"
            )
        ranked = sorted(rows, key=lambda label: rows[label].metrics.rmse_v)[:most]
        self.shown = {label: row for label, row in rows.items() if label in ranked}
        self.best = rows[ranked[0]]
        self.prepared = self.best.prepared
        self.looks = style.row_looks(rows)
        self.is_one = style.ALONE in rows
        self.title = names[0]
        if len(rows) > most:
            self.title += f": the {most} of {len(rows)} rows with the lowest RMSE"
        # Grey behind many colors.
        self.measured_color = style.SKY_BLUE if self.is_one else "#BEBEBE"


def unscored_spans(
    time: Samples, scored: Bool[np.ndarray, "samples"]
) -> Float[np.ndarray, "spans 2"]:
    """Spans of time in which samples are not scored.

    Gaps too narrow to be seen are left out: a record may hold tens of thousands of them.
    """
    changes = np.diff(~scored, prepend=False, append=False)
    starts, stops = np.flatnonzero(changes).reshape(-1, 2).T
    spans = np.stack([time[starts], time[np.minimum(stops, len(time) - 1)]], axis=1)
    return spans[np.diff(spans)[:, 0] >= (time[-1] - time[0]) / style.COLUMNS]


def shade_unscored(axes: Axes, time: Samples, scored: Bool[np.ndarray, "samples"]) -> None:
    """Shade the time between scored samples, over the whole height; one entry for the legend."""
    spans = [(left, right - left) for left, right in unscored_spans(time, scored)]
    if not spans:
        return
    bottom, top = axes.get_ylim()
    look = {"facecolor": style.SHADE, "edgecolor": "none", "zorder": 0, "label": NOT_SCORED}
    axes.broken_barh(spans, (0.0, 1.0), transform=axes.get_xaxis_transform(), **look)
    axes.set_ylim(bottom, top)


def worst_stretch(error_v: Samples, scored: Bool[np.ndarray, "samples"]) -> slice | None:
    """The short stretch with the largest RMSE of its scored samples, the first of several.

    `None` if the record is short.
    """
    length = min(STRETCH_SAMPLES, int(np.count_nonzero(scored)) // STRETCHES_PER_RECORD)
    if length < SHORTEST_STRETCH:
        return None
    squares = np.concatenate([[0.0], np.cumsum(np.where(scored, error_v, 0.0) ** 2)])
    start = int(np.argmax(squares[length:] - squares[:-length]))
    return slice(start, start + length)


@style.figure_style()
def plot_voltage(evaluations: "Evaluation | Mapping[str, Evaluation]") -> Figure:
    """Voltage over time, measured and simulated by one circuit or many, above the current.

    Time is on the record's own clock, in seconds below two hours. Samples that are not scored are
    shaded. The framed stretch is magnified at the right: the one with the largest RMSE of the best
    row; omitted for records under 100 scored samples. Of more than eight rows the eight with the
    lowest RMSE are drawn, and the title says so. Many rows are as in Fig. 10 and 12 of Li et al.
    (2023). Raises `ValueError` if they are on different samples.

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
    rows = Rows(evaluations, MAX_VOLTAGES)
    prepared, clock = rows.prepared, Clock(rows.prepared.time_s)
    columns = [(clock.time, clock.label, slice(None))]
    stretch = worst_stretch(rows.best.error_v, prepared.scored)
    if stretch is not None:
        # Hours would need too many digits on such a short axis.
        origin = np.floor(clock.time[stretch.start] * 100) / 100
        label = f"Time after {origin:g} {clock.unit} [s]"
        columns.append((prepared.time_s - origin * clock.seconds, label, stretch))
    whole, height_in = (1.0, 6.0)
    if len(rows.looks) == 1:
        whole, height_in = (1.3 if style.is_column() else 1.9, style.HEIGHT_IN)
    figure = style.make_figure(height_in)
    panels = figure.subplots(
        2,
        len(columns),
        sharex="col",
        squeeze=False,
        width_ratios=[whole, 1.0][: len(columns)],
        height_ratios=[2.0, 1.0],
    )
    for (voltage, current), (time, label, samples) in zip(panels.T, columns, strict=True):
        draw_rows(voltage, rows, time, samples, is_close=samples is stretch or stretch is None)
        _draw_current(current, prepared, time, samples)
        current.set_xlabel(label)
    for axes in panels[:, 0]:
        shade_unscored(axes, clock.time, prepared.scored)
    style.title(panels[0, 0], rows.title)
    if stretch is not None:
        style.title(panels[0, 1], "largest RMSE")
        edges = clock.time[[stretch.start, stretch.stop - 1]]
        for left, right in panels:
            right.set_ylabel("")
            left.axvspan(*edges, facecolor="none", edgecolor=FRAME, linewidth=0.9, zorder=3)
    return style.finish(figure, *panels.flat)


def draw_rows(axes: Axes, rows: Rows, time: Samples, samples: slice, *, is_close: bool) -> None:
    """The measured line and every row's; markers only where single samples can be seen."""
    look = {"color": rows.measured_color, "linewidth": 2.9 if is_close else 1.8}
    measured_v = rows.prepared.voltage_v[samples]
    style.draw_line(axes, time[samples], measured_v, label="measured", **look)
    for number, (label, row) in enumerate(rows.shown.items()):
        look = rows.looks[label]
        line = style.draw_line(axes, time[samples], row.simulated_v[samples], color=look.color)
        line.set(label=f"{label} (RMSE {1e3 * row.metrics.rmse_v:.3g} mV)")
        line.set(linewidth=1.0 if is_close else 0.6)
        if is_close:
            line.set(linestyle=look.line, marker=look.marker, markersize=3.6)
            line.set_markerfacecolor("white")
            # Offset from row to row, so that markers of equal answers stay visible.
            spacing = max(1, np.size(line.get_xdata()) // MARKERS_PER_LINE)
            line.set_markevery((spacing * number // len(rows.shown), spacing))
    axes.set_ylabel("Voltage [V]")


def _draw_current(axes: Axes, prepared: "PreparedRecord", time: Samples, samples: slice) -> None:
    """The current as it flowed between samples."""
    look = {"color": style.VERMILLION, "linewidth": 0.8}
    steps, _ = STEPS[prepared.record.hold.value]
    style.draw_line(axes, time[samples], prepared.current_a[samples], drawstyle=steps, **look)
    axes.axhline(0.0, color=style.BLACK, linewidth=0.6)
    axes.set_ylabel(CURRENT_LABEL)


def live_record(
    evaluations: "Mapping[str, Evaluation]", max_numbers: int = MAX_NUMBERS
) -> dict[str, Any]:
    """Measured and simulated voltage, errors and current of one record, on one time axis, ready for
    JSON, as used by a page's script.

    `evaluations` are those of circuits by their labels. Every sample is kept, as float32, unless
    that takes more than `max_numbers`; then only those that `decimate` keeps for any line. The
    first column is the time since the first sample in s, `origin` that sample's own.
    """
    rows = Rows(evaluations, MAX_VOLTAGES)
    prepared, clock = rows.prepared, Clock(rows.prepared.time_s)
    simulated_v = [row.simulated_v for row in rows.shown.values()]
    columns = [prepared.voltage_v, prepared.current_a, *simulated_v]
    lines = [*columns, *(row.error_v for row in rows.shown.values())]
    kept = enough_samples(prepared.time_s, lines, max_numbers // (len(columns) + 1))
    voltage = [_live_line("measured [V]", 1, rows.measured_color, width=2.5)]
    errors = []
    for column, label in enumerate(rows.shown, 3):
        color, of = rows.looks[label].color, f" of {label}"
        voltage.append(_live_line(f"{label} [V]", column, color))
        if rows.is_one:
            color, of = style.BLUE, ""
        errors.append(_live_line(f"error{of} [mV]", 1, color, minus=column))
    _, step = STEPS[prepared.record.hold.value]
    rmse_mv = 1e3 * rows.best.metrics.rmse_v
    levels = [-rmse_mv, rmse_mv] if rows.is_one else []
    current = _live_line("current [A]", 2, style.VERMILLION, step=step)
    return {
        "label": clock.label,
        "origin": float(prepared.time_s[0]),
        "seconds": clock.seconds,
        "columns": [
            base64.b64encode(np.asarray(column[kept], "<f4").tobytes()).decode()
            for column in (prepared.time_s - prepared.time_s[0], *columns)
        ],
        "shaded": unscored_spans(prepared.time_s, prepared.scored).tolist(),
        "panels": [
            {"label": "Voltage [V]", "height": 260, "lines": voltage},
            {"label": "Error [mV]", "height": 200, "lines": errors, "levels": levels},
            {"label": "Current [A]", "height": 170, "lines": [current]},
        ],
        "samples": len(prepared.time_s),
        "held": len(kept),
    }


def enough_samples(time_s: Samples, lines: Sequence[Samples], most: int) -> Int[np.ndarray, "kept"]:
    """Indices of all samples, or of at most about `most` including every peak of every line.

    >>> enough_samples(np.arange(5.0), [np.zeros(5)], 10)
    array([0, 1, 2, 3, 4])
    """
    if len(time_s) <= most:
        return np.arange(len(time_s))
    columns = max(most // (2 + 2 * len(lines)), 1)
    return np.unique(np.concatenate([style.decimate(time_s, line, columns) for line in lines]))


def _live_line(label: str, column: int, color: str, width: float = 1.0, **more: Any) -> dict:
    return {"label": label, "column": column, "color": color, "width": width, **more}


@style.figure_style()
def plot_design(design: "Design") -> Figure:
    """Current, voltage and state of charge over time, as predicted for a design.

    Args:
        design: A design.
    """
    predicted, limits = design.predicted, design.limits
    hours = predicted.time_s / 3600
    figure = style.make_figure(height_in=4.6)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(2, 2, 1))
    current, voltage, soc = panels
    current.plot(hours, predicted.current_a, color=style.BLACK, linewidth=0.6)
    current.set_ylabel(CURRENT_LABEL)
    low_v = np.minimum(predicted.low_v, predicted.voltage_v)
    high_v = np.maximum(predicted.high_v, predicted.voltage_v)
    band = {"color": style.SKY_BLUE, "alpha": 0.45, "linewidth": 0.0}
    voltage.fill_between(hours, low_v, high_v, **band, label="worst case")
    line = {"color": style.BLUE, "linewidth": 0.6}
    voltage.plot(hours, predicted.voltage_v, **line, label="predicted")
    limit = {"color": style.VERMILLION, "linewidth": 0.8, "linestyle": "--"}
    for limit_v in (limits.low_v, limits.high_v):
        voltage.axhline(limit_v, **limit, label="limits")
    voltage.set_ylabel("Voltage [V]")
    soc.plot(hours, predicted.soc, color=style.GREY)
    soc.set_ylim(0.0, 1.05)
    soc.set(xlabel="Time [h]", ylabel="SOC [-]")
    return style.finish(figure, *panels)
