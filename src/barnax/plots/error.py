"""Errors: of voltage over time and SOC, for one circuit or many, and of a filter's SOC."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from . import style
from .voltage import ERROR_LABEL, NOT_SCORED, Clock, Rows, Samples, shade_unscored

if TYPE_CHECKING:
    from ..replay import ScenarioPart, SocReplay
    from ..search.evaluate import Evaluation

SOC_BINS: Final = 20
FEWEST_IN_BIN: Final = 5
# A few samples at the very end of a discharge can have ten times the error of all others.
FEW_PERCENT: Final = 0.5
MARGIN: Final = 0.3
NEARLY_INSIDE: Final = 1.5
# Strips of a comparison's rows.
MAX_STRIPS: Final = 10
STRIP_IN: Final = 1.1
AROUND_STRIPS_IN: Final = 1.1
# Rows with more than this many times the lowest RMSE do not set the scale; a note counts the
# samples outside.
FAR_OFF: Final = 3.0
# An outline, so that lines stand out from points of any color.
OUTLINE: Final = (Stroke(linewidth=2.8, foreground="white"), Normal())


@style.figure_style()
def plot_error(evaluations: "Evaluation | Mapping[str, Evaluation]") -> Figure:
    """Measured minus simulated voltage in mV, over time and over SOC, for one circuit or many.

    Samples that are not scored are grey and shaded. Dashed: plus and minus the RMSE of all scored
    samples. Over SOC the steps are plus and minus the RMSE of the scored samples in each twentieth
    of SOC that contains at least five of them. The scale leaves out the range needed only by a few
    scored samples: an arrow at the edge for each, and a note of how many and how far.

    Many rows have a strip each, left over time, right over SOC, as in Fig. 11 and 13 of Li et al.
    (2023), on the scale of the rows within three times the lowest RMSE; of more than ten rows the
    ten with the lowest RMSE are drawn. Raises `ValueError` if they are on different samples.

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
    rows = Rows(evaluations, MAX_STRIPS)
    scored, clock = rows.prepared.scored, Clock(rows.prepared.time_s)
    if rows.is_one:
        figure = style.make_figure()
        panels = figure.subplots(2, 1, sharey=True)[None]
    else:
        figure = style.make_figure(height_in=AROUND_STRIPS_IN + STRIP_IN * len(rows.shown))
        layout: dict[str, Any] = {"sharey": True, "sharex": "col", "width_ratios": [1.9, 1.0]}
        panels = figure.subplots(len(rows.shown), 2, squeeze=False, **layout)
        figure.supylabel(ERROR_LABEL.replace("\n", " "), fontsize=style.letters_pt(9))
    limits = _common_limits(rows)
    for (over_time, over_soc), (label, row) in zip(panels, rows.shown.items(), strict=True):
        rmse = f"{1e3 * row.metrics.rmse_v:.3g} mV"
        outside = outside_note(1e3 * row.error_v[scored], *limits)
        if rows.is_one:
            not_scored = "_none" if scored.all() else NOT_SCORED
            colors = style.BLUE, style.ORANGE
            labels = "scored error", not_scored, f"± RMSE, {rmse}"
            over_time.set_ylabel(ERROR_LABEL)
            over_soc.set_ylabel(ERROR_LABEL)
            over_soc.set_title(outside, loc="right")
        else:
            colors = rows.looks[label].color, style.BLACK
            labels = "_scored", "_not scored", "± RMSE"
            _name_strip(over_time, f"{label}: RMSE {rmse}")
            _name_strip(over_soc, outside)
        _draw_errors(over_time, over_soc, row, colors, labels)
        for axes, across in ((over_time, clock.time), (over_soc, rows.prepared.soc)):
            style.mark_outside(axes, across[scored], 1e3 * row.error_v[scored], limits)
        shade_unscored(over_time, clock.time, scored)
    panels[-1, 0].set_xlabel(clock.label)
    panels[-1, 1].set_xlabel(style.SOC_LABEL)
    style.title(panels[0, 0], rows.title)
    return style.finish(figure, *panels.flat, columns=4, legend_of=panels[0])


def _draw_errors(
    over_time: Axes,
    over_soc: Axes,
    evaluation: "Evaluation",
    colors: tuple[str, str],
    labels: tuple[str, str, str],
) -> None:
    """One evaluation's errors over time and over SOC, with its RMSE, overall and by SOC.

    `colors` are those of the scored errors and of the RMSE by SOC, `labels` those of scored
    samples, of other samples, and of the RMSE.
    """
    prepared, error_mv = evaluation.prepared, 1e3 * evaluation.error_v
    scored, soc, rmse_mv = prepared.scored, prepared.soc, 1e3 * evaluation.metrics.rmse_v
    kinds = ((scored, colors[0], 2.0), (~scored, style.GREY, 1.9))
    for (chosen, color, layer), label in zip(kinds, labels[:2], strict=True):
        line = broken_line(Clock(prepared.time_s).time, error_mv, chosen)
        over_time.plot(*line, color=color, linewidth=0.8, label=label, zorder=layer)
        # Rasterized: as vectors, the points of a long record would make a huge file.
        look = {"color": color, "markeredgewidth": 0.0, "alpha": 0.6, "zorder": layer}
        points = soc[chosen], error_mv[chosen]
        style.draw_points(over_soc, *points, ".", 2.0, **look, rasterized=True)
    _draw_rmse_by_soc(over_soc, soc[scored], error_mv[scored], colors[1])
    for axes in (over_time, over_soc):
        axes.axhline(0.0, color=style.BLACK, linewidth=0.6)
        axes.axhline(rmse_mv, color=style.BLACK, linestyle="--", label=labels[2])
        axes.axhline(-rmse_mv, color=style.BLACK, linestyle="--", label="_lower")


def broken_line(
    time: Samples, error_mv: Samples, chosen: Bool[np.ndarray, "samples"]
) -> tuple[Float[np.ndarray, "points"], Float[np.ndarray, "points"]]:
    """The chosen samples as a line, with every visible break where others lie between."""
    indices = np.flatnonzero(chosen)
    kept = indices[style.decimate(time[indices], error_mv[indices])]
    others = np.cumsum(~chosen)
    is_wide = np.diff(time[kept]) > (time[-1] - time[0]) / style.COLUMNS
    breaks = np.flatnonzero((np.diff(others[kept]) > 0) & is_wide) + 1
    return np.insert(time[kept], breaks, np.nan), np.insert(error_mv[kept], breaks, np.nan)


def _draw_rmse_by_soc(axes: Axes, soc: Samples, error_mv: Samples, color: str) -> None:
    """Plus and minus the RMSE in each twentieth of SOC with enough samples."""
    edges = np.linspace(0.0, 1.0, SOC_BINS + 1)
    samples = np.histogram(soc, edges)[0]
    squares = np.histogram(soc, edges, weights=error_mv**2)[0]
    rmse_mv = np.where(samples >= FEWEST_IN_BIN, np.sqrt(squares / np.maximum(samples, 1)), np.nan)
    look = {"color": color, "linewidth": 1.6, "zorder": 2.5, "path_effects": OUTLINE}
    for side, label in ((1, f"± RMSE per {1 / SOC_BINS:g} of SOC"), (-1, "_lower")):
        axes.stairs(side * rmse_mv, edges, baseline=None, **look, label=label)


def scored_limits(scored_mv: Samples) -> tuple[float, float]:
    """Limits that include all but a few scored samples."""
    rmse_mv = np.sqrt(np.mean(scored_mv**2))
    few = [FEW_PERCENT, 100 - FEW_PERCENT]
    low, high = np.percentile(np.concatenate([scored_mv, [-rmse_mv, rmse_mv]]), few)
    margin = MARGIN * (high - low) or 1.0
    low, high = min(low - margin, -1.1 * rmse_mv), max(high + margin, 1.1 * rmse_mv)
    if NEARLY_INSIDE * low < scored_mv.min() and scored_mv.max() < NEARLY_INSIDE * high:
        low = min(low, scored_mv.min() - margin / 4)
        high = max(high, scored_mv.max() + margin / 4)
    return float(low), float(high)


def _common_limits(rows: Rows) -> tuple[float, float]:
    """One scale for all strips, from the rows with small enough errors."""
    limits = [
        scored_limits(1e3 * row.error_v[row.prepared.scored])
        for row in rows.shown.values()
        if row.metrics.rmse_v <= FAR_OFF * rows.best.metrics.rmse_v
    ]
    lows, highs = zip(*limits, strict=True)
    return min(lows), max(highs)


def outside_note(scored_mv: Samples, low: float, high: float) -> str:
    """The number of scored samples outside the limits, and how far; empty if there are none.

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


def _name_strip(axes: Axes, text: str) -> None:
    """A line of text in the upper left corner, readable over data."""
    if text:
        box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0}
        corner = {"transform": axes.transAxes, "verticalalignment": "top", "zorder": 4}
        shown = axes.text(0.01, 0.97, text, fontsize=style.letters_pt(8), bbox=box, **corner)
        style.show_name(shown)


SCENARIO_COLORS: Final = (
    *(style.BLUE, style.VERMILLION, style.GREEN),
    *(style.PURPLE, style.ORANGE, style.SKY_BLUE),
)
REPLAY_IN, SCENARIO_IN = 2.4, 0.85
# The smallest range for errors of SOC.
LEAST_PERCENT: Final = 1.0
# Counts closer than this to the counter are not drawn separately.
SAME_SOC: Final = 1e-3
# The least room for wrong counts around the counter, in percent.
BESIDE: Final = 25.0
BAND_SD: Final = 2.0


@style.figure_style()
def plot_soc_replay(replay: "SocReplay") -> Figure:
    """SOC by the counter and by counting with the faults of each scenario, and a panel with the
    filter's errors in each.

    The shaded bands are two standard deviations of the filter about zero. The scale covers errors
    from when they are within 3 %, and the bands after ten minutes; a filter that diverges has its
    own. Raises `InputError` for a replay read from a file.

    Args:
        replay: A replay that was not read from a file.
    """
    traces, count = replay.traces, len(replay.scenarios)
    clock = Clock(traces.time_s)
    figure = style.make_figure(height_in=REPLAY_IN + SCENARIO_IN * count)
    counted, *errors = figure.subplots(1 + count, sharex=True, height_ratios=(2.2, *[1.0] * count))
    truth = 100 * traces.truth
    style.draw_line(counted, clock.time, truth, color=style.BLACK, label="ampere-hour counter")
    kind = "Gaussian sum" if replay.settings.kind == "sum" else replay.settings.kind.upper()
    style.title(counted, f"{replay.record}: {replay.model}, {kind}")
    widest = _widest_percent(replay)
    for row, (axes, part) in enumerate(zip(errors, replay.scenarios, strict=True)):
        color = SCENARIO_COLORS[row % len(SCENARIO_COLORS)]
        band = 100 * BAND_SD * np.nan_to_num(traces.estimate.soc_sd[row])
        shade = {"color": style.SHADE, "linewidth": 0, "label": "95 % band of the filter"}
        axes.fill_between(clock.time, -band, band, **shade)
        axes.axhline(0.0, color=style.BLACK, linewidth=0.6)
        off = 100 * (np.asarray(traces.estimate.soc[row]) - traces.truth)
        style.draw_line(axes, clock.time, off, color=color)
        beyond = float(np.max(np.abs(off), where=np.isfinite(off), initial=0.0))
        reach = max(widest, min(1.1 * beyond, 100.0)) if part.is_lost else widest
        axes.set_ylim(-reach, reach)
        outside = f"; off scale: up to {beyond:.2g} %" if beyond > reach else ""
        style.title(axes, f"{part.name}: {_course(part)}{outside}")
        # Counting from the right start is the counter itself.
        if np.nanmax(np.abs(traces.counted[row] - traces.truth)) > SAME_SOC:
            look = {"color": color, "linestyle": "--", "label": f"counting, {part.name}"}
            style.draw_line(counted, clock.time, 100 * traces.counted[row], **look)
    starts = np.asarray(traces.counted)[:, 0]
    beside = max(BESIDE, 105 * float(np.nanmax(np.abs(starts - traces.truth[0]), initial=0.0)))
    # Only a start drawn above full needs room there.
    full = max(105.0, 100 * float(np.nanmax(starts, initial=0.0)) + 5)
    counted.set_ylim(truth.min() - beside, min(truth.max() + beside, full))
    counted.set_ylabel("State of charge [%]")
    errors[count // 2].set_ylabel("Error of SOC [%]\n(filter − counter)")
    errors[-1].set_xlabel(clock.label)
    return style.finish(figure, counted, *errors, columns=2)


def _widest_percent(replay: "SocReplay") -> float:
    """The error of SOC up to which all scenarios are drawn in which the filter does not diverge."""
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
