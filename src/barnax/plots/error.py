"""Errors: of voltage over time, SOC and current, of one circuit or many, and of a filter's SOC."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from .pictures import illustration
from .style import (
    ALONE,
    BLACK,
    BLUE,
    COLUMNS,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SHADE,
    SKY_BLUE,
    SOC_LABEL,
    VERMILLION,
    decimate,
    draw_line,
    draw_points,
    finish,
    letters_pt,
    make_figure,
    mark_outside,
    row_looks,
    show_name,
    title,
)
from .voltage import (
    NOT_SCORED,
    choose_time_unit,
    heading,
    most_accurate,
    rows_of,
    shade_unscored,
)

if TYPE_CHECKING:
    from ..replay import ScenarioPart, SocReplay
    from ..search.evaluate import Evaluation


Samples = Float[np.ndarray, "samples"]

LABEL = "Error [mV]\n(measured − simulated)"
SOC_BINS = 20
FEWEST_IN_BIN = 5
# A few samples at the very end of a discharge can be ten times as far off as all the others.
FEW_PERCENT = 0.5
MARGIN = 0.3
NEARLY_INSIDE = 1.5
# Strips of a comparison's rows.
MAX_STRIPS: Final = 10
STRIP_IN: Final = 1.1
AROUND_STRIPS_IN: Final = 1.1
# Rows with more than this many times the lowest RMSE do not set the scale; a note counts what is
# outside.
FAR_OFF: Final = 3.0
# An outline, so that lines stand out from points of any color.
OUTLINE = (Stroke(linewidth=2.8, foreground="white"), Normal())


def broken_line(
    time: Samples, error_mv: Samples, chosen: Bool[np.ndarray, "samples"]
) -> tuple[Float[np.ndarray, "points"], Float[np.ndarray, "points"]]:
    """The chosen samples as a line, broken where others lie between, as wide as can be seen."""
    indices = np.flatnonzero(chosen)
    kept = indices[decimate(time[indices], error_mv[indices])]
    others = np.cumsum(~chosen)
    is_wide = np.diff(time[kept]) > (time[-1] - time[0]) / COLUMNS
    breaks = np.flatnonzero((np.diff(others[kept]) > 0) & is_wide) + 1
    return np.insert(time[kept], breaks, np.nan), np.insert(error_mv[kept], breaks, np.nan)


def draw_errors(
    over_time: Axes,
    over_soc: Axes,
    evaluation: "Evaluation",
    colors: tuple[str, str],
    labels: tuple[str, str, str],
    limits: tuple[float, float],
) -> None:
    """One evaluation's errors over time and over SOC, with its RMSE, in all and by SOC.

    `colors` are those of the scored errors and of the RMSE by SOC, `labels` those of what is
    scored, of what is not, and of the RMSE.
    """
    prepared, error_mv = evaluation.prepared, 1e3 * evaluation.error_v
    scored, soc, rmse_mv = prepared.scored, prepared.soc, 1e3 * evaluation.metrics.rmse_v
    time = prepared.time_s / choose_time_unit(prepared.time_s).seconds
    kinds = ((scored, colors[0], 2.0), (~scored, GREY, 1.9))
    for (chosen, color, layer), label in zip(kinds, labels[:2], strict=True):
        line = broken_line(time, error_mv, chosen)
        over_time.plot(*line, color=color, linewidth=0.8, label=label, zorder=layer)
        # Rasterized: as vectors, the points of a long record would make a huge file.
        style = {"color": color, "markeredgewidth": 0.0, "alpha": 0.6, "zorder": layer}
        draw_points(over_soc, soc[chosen], error_mv[chosen], ".", 2.0, **style, rasterized=True)
    draw_rmse_by_soc(over_soc, soc[scored], error_mv[scored], colors[1])
    for axes in (over_time, over_soc):
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        axes.axhline(rmse_mv, color=BLACK, linestyle="--", label=labels[2])
        axes.axhline(-rmse_mv, color=BLACK, linestyle="--", label="_lower")
    for axes, across in ((over_time, time), (over_soc, soc)):
        mark_outside(axes, across[scored], error_mv[scored], limits)
    shade_unscored(over_time, time, scored)


def draw_rmse_by_soc(axes: Axes, soc: Samples, error_mv: Samples, color: str) -> None:
    """Plus and minus the RMSE in each twentieth of SOC that holds enough samples."""
    edges = np.linspace(0.0, 1.0, SOC_BINS + 1)
    samples = np.histogram(soc, edges)[0]
    squares = np.histogram(soc, edges, weights=error_mv**2)[0]
    rmse_mv = np.where(samples >= FEWEST_IN_BIN, np.sqrt(squares / np.maximum(samples, 1)), np.nan)
    for side, label in ((1, f"± RMSE per {1 / SOC_BINS:g} of SOC"), (-1, "_lower")):
        style = {"color": color, "linewidth": 1.6, "zorder": 2.5, "path_effects": OUTLINE}
        axes.stairs(side * rmse_mv, edges, baseline=None, **style, label=label)


def scored_limits(scored_mv: Samples) -> tuple[float, float]:
    """Limits that all but a few scored samples need."""
    rmse_mv = np.sqrt(np.mean(scored_mv**2))
    few = [FEW_PERCENT, 100 - FEW_PERCENT]
    low, high = np.percentile(np.concatenate([scored_mv, [-rmse_mv, rmse_mv]]), few)
    margin = MARGIN * (high - low) or 1.0
    low, high = min(low - margin, -1.1 * rmse_mv), max(high + margin, 1.1 * rmse_mv)
    if NEARLY_INSIDE * low < scored_mv.min() and scored_mv.max() < NEARLY_INSIDE * high:
        low = min(low, scored_mv.min() - margin / 4)
        high = max(high, scored_mv.max() + margin / 4)
    return float(low), float(high)


def outside_note(scored_mv: Samples, low: float, high: float) -> str:
    """The number of scored samples outside the limits, and how far; empty where there are none.

    >>> outside_note(np.array([1.0, 2.0, -60.0]), -5.0, 5.0)
    'off scale: 1 of 3 samples, up to −60 mV'
    """
    outside = (scored_mv < low) | (scored_mv > high)
    if not outside.any():
        return ""
    farthest = scored_mv[np.argmax(np.abs(scored_mv))]
    return (
        f"off scale: {np.count_nonzero(outside)} of {len(scored_mv)} samples, "
        f"up to {farthest:.0f} mV".replace("-", "−")
    )


@illustration(
    "Measured minus simulated voltage on {}, over time and over the state of charge, all on one "
    "scale. Dashed: plus and minus the RMSE; steps: the RMSE in each 5 % of the state of charge.",
    "Error over time and over the state of charge",
    is_main=True,
)
def plot_error(evaluations: "Evaluation | Mapping[str, Evaluation]") -> Figure:
    """Measured minus simulated voltage in mV, over time and over SOC, of one circuit or of many.

    Samples that do not count are grey and shaded. Dashed: plus and minus the RMSE of all scored
    samples. Over SOC the steps are plus and minus the RMSE of the scored samples in each twentieth
    of SOC that holds at least five of them. The scale leaves out what few scored samples alone
    would need: an arrow at the edge for each, and a note of how many and how far.

    Many rows have a strip each, left over time, right over SOC, as in Fig. 11 and 13 of Li et al.
    (2023), on the scale of the rows within three times the lowest RMSE; of more than ten rows the
    ten with the lowest RMSE are drawn. Raises `ValueError` where they are on different samples.

    Args:
        evaluations: A record's evaluation, or those of rows on one record, by label.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record, cell = read_record(bundled_file("identification")), characterize(tests)
    >>> rows = {name: validate(record, cell, name, circuit) for name in ("so-rc", "iso-rc")}
    >>> [len(plot_error(drawn).axes) for drawn in (rows, rows["so-rc"])]
    [4, 2]
    """
    rows = rows_of(evaluations)
    looks, shown = row_looks(rows), most_accurate(rows, MAX_STRIPS)
    prepared, is_one = next(iter(shown.values())).prepared, ALONE in rows
    if is_one:
        figure = make_figure()
        panels = figure.subplots(2, 1, sharey=True)[None]
    else:
        figure = make_figure(height_in=AROUND_STRIPS_IN + STRIP_IN * len(shown))
        panels = figure.subplots(
            len(shown), 2, squeeze=False, sharey=True, sharex="col", width_ratios=[1.9, 1.0]
        )
        figure.supylabel(LABEL.replace("\n", " "), fontsize=letters_pt(9))
    limits = _common_limits(shown)
    for (over_time, over_soc), (label, row) in zip(panels, shown.items(), strict=True):
        rmse = f"{1e3 * row.metrics.rmse_v:.3g} mV"
        outside = outside_note(1e3 * row.error_v[prepared.scored], *limits)
        if is_one:
            not_scored = "_none" if prepared.scored.all() else NOT_SCORED
            colors, labels = (BLUE, ORANGE), ("scored error", not_scored, f"± RMSE, {rmse}")
            over_time.set_ylabel(LABEL)
            over_soc.set_ylabel(LABEL)
            over_soc.set_title(outside, loc="right")
        else:
            colors, labels = (looks[label].color, BLACK), ("_scored", "_not scored", "± RMSE")
            _name_strip(over_time, f"{label}: RMSE {rmse}")
            _name_strip(over_soc, outside)
        draw_errors(over_time, over_soc, row, colors, labels, limits)
    panels[-1, 0].set_xlabel(choose_time_unit(prepared.time_s).label)
    panels[-1, 1].set_xlabel(SOC_LABEL)
    title(panels[0, 0], heading(prepared.record.name, len(shown), len(rows)))
    return finish(figure, *panels.flat, columns=4, legend_of=panels[0])


def _common_limits(shown: Mapping[str, "Evaluation"]) -> tuple[float, float]:
    """One scale for all strips, from the rows that are not far off."""
    lowest_v = min(row.metrics.rmse_v for row in shown.values())
    near = [row for row in shown.values() if row.metrics.rmse_v <= FAR_OFF * lowest_v]
    limits = np.array([scored_limits(1e3 * row.error_v[row.prepared.scored]) for row in near])
    return float(limits[:, 0].min()), float(limits[:, 1].max())


def _name_strip(axes: Axes, text: str) -> None:
    """A line of text in the upper left corner, readable over data."""
    if text:
        box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0}
        place = {"transform": axes.transAxes, "verticalalignment": "top", "zorder": 4}
        show_name(axes.text(0.01, 0.97, text, fontsize=letters_pt(8), bbox=box, **place))


SCENARIO_COLORS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY_BLUE)
REPLAY_IN, SCENARIO_IN = 2.4, 0.85
# The least that errors of SOC are drawn over.
LEAST_PERCENT = 1.0
# Counts that are nearer to the counter are not drawn beside it.
SAME_SOC = 1e-3
# The least room for wrong counts beside the counter, in percent.
BESIDE = 25.0
BAND_SD = 2.0


@illustration(
    "State of charge of {}: the ampere-hour counter, and counting alone with what a scenario has "
    "wrong. Below, the error of the filter in each scenario.",
    "State of charge over time, counted right and wrong, and the errors of the filter",
    is_main=True,
)
def plot_soc_replay(replay: "SocReplay") -> Figure:
    """SOC by the counter and by counting with what each scenario has wrong, and a panel with the
    filter's errors in each.

    The shaded bands are two standard deviations of the filter about zero. The scale is that of
    errors from when they are within 3 %, and of the bands after ten minutes; a filter that is
    lost has its own. Raises `InputError` for a replay read from a file.

    Args:
        replay: A replay that was not read from a file.
    """
    traces = replay.traces
    unit = choose_time_unit(traces.time_s)
    time = traces.time_s / unit.seconds
    count = len(replay.scenarios)
    figure = make_figure(height_in=REPLAY_IN + SCENARIO_IN * count)
    counted, *errors = figure.subplots(1 + count, sharex=True, height_ratios=(2.2, *[1.0] * count))
    draw_line(counted, time, 100 * traces.truth, color=BLACK, label="ampere-hour counter")
    kind = "Gaussian sum" if replay.settings.kind == "sum" else replay.settings.kind.upper()
    title(counted, f"{replay.record}: {replay.model}, {kind}")
    widest = _widest_percent(replay)
    for place, (axes, part) in enumerate(zip(errors, replay.scenarios, strict=True)):
        color = SCENARIO_COLORS[place % len(SCENARIO_COLORS)]
        band = 100 * BAND_SD * np.nan_to_num(traces.estimate.soc_sd[place])
        axes.fill_between(
            time, -band, band, color=SHADE, linewidth=0, label="95 % band of the filter"
        )
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        off = 100 * (np.asarray(traces.estimate.soc[place]) - traces.truth)
        draw_line(axes, time, off, color=color)
        lost = np.max(np.abs(off), where=np.isfinite(off), initial=0.0) if part.is_lost else 0.0
        reach = max(widest, min(1.1 * float(lost), 100.0))
        axes.set_ylim(-reach, reach)
        beyond = float(np.max(np.abs(off), where=np.isfinite(off), initial=0.0))
        outside = f"; off scale: up to {beyond:.2g} %" if beyond > reach else ""
        title(axes, f"{part.name}: {_course(part)}{outside}")
        # Counting from the right start is the counter itself.
        if np.nanmax(np.abs(traces.counted[place] - traces.truth)) > SAME_SOC:
            style = {"color": color, "linestyle": "--", "label": f"counting, {part.name}"}
            draw_line(counted, time, 100 * traces.counted[place], **style)
    low, high = 100 * traces.truth.min(), 100 * traces.truth.max()
    starts = np.asarray(traces.counted)[:, 0]
    beside = max(BESIDE, 105 * float(np.nanmax(np.abs(starts - traces.truth[0]), initial=0.0)))
    # Above full, only a start that is drawn there needs room.
    full = max(105.0, 100 * float(np.nanmax(starts, initial=0.0)) + 5)
    counted.set_ylim(low - beside, min(high + beside, full))
    counted.set_ylabel("State of charge [%]")
    errors[count // 2].set_ylabel("Error of SOC [%]\n(filter − counter)")
    errors[-1].set_xlabel(unit.label)
    return finish(figure, counted, *errors, columns=2)


def _widest_percent(replay: "SocReplay") -> float:
    """The error of SOC up to which all scenarios are drawn in which the filter is not lost."""
    near = [part for part in replay.scenarios if not part.is_lost]
    reached = [share for part in near for share in (part.max, part.widest) if share]
    return min(max([LEAST_PERCENT, *(110 * share for share in reached)]), 100.0)


def _course(part: "ScenarioPart") -> str:
    """The errors of a scenario in words."""
    if part.diverged_s is not None:
        return "returns no numbers"
    if part.converged_s is None or part.max is None:
        return "never within 3 % for ten minutes"
    after = f"after {part.converged_s:.0f} s " if part.converged_s else ""
    return f"{after}off by at most {100 * part.max:.2g} %"
