"""Tests of a cell: open-circuit and hysteresis voltage, pulses and their resistances."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..cell import CellModel
from ..cell.parameters import OCV
from ..pulses import STANDARD_S, Pulse, levels, pulse_samples, rate_label
from . import style

if TYPE_CHECKING:
    from ..fit.node_interval import Fact
    from ..results import Result
    from ..search.evaluate import Evaluation

OCV_LABEL: Final = "Open-circuit voltage [V]"
CHARGE: Final = style.RowLook(style.VERMILLION, "--", "^")
DISCHARGE: Final = style.RowLook(style.BLUE, "-", "v")
CURVE_SAMPLES: Final = 1001
# More points than this (a slow sweep has them) would hide the curve under full-size markers.
FEW_POINTS: Final = 50
# Residuals of curves through their points are rounding.
ROUNDING_MV: Final = 1e-3


@style.figure_style()
def plot_ocv(cell: "CellModel | Result | str | Path") -> Figure:
    """OCV points and curves over SOC; below, the residuals of each curve at its own points, in mV.
    An OCV fitted to records has no points: it is a line, for a result with its intervals.

    Curves through their points have no residuals, and no panel for them. A branch that was not
    measured is not drawn, and then there is no average either.

    Args:
        cell: A cell from `characterize`, a result, or the path of a `result.json`.

    >>> from barnax import bundled_file, characterize, read_record
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> [axes.get_ylabel() for axes in plot_ocv(characterize(tests)).axes]
    ['Open-circuit voltage [V]']
    """
    nodes: Sequence[Fact] = ()
    if not isinstance(cell, CellModel):
        result = style.load_result(cell)
        cell, nodes = result.cell, [fact for fact in result.fit.facts if fact.name == OCV]
    if cell.ocv_is_fitted:
        return plot_fitted_ocv(cell, nodes)
    branches = [
        (name, curve, np.array([(point.soc, point.voltage_v) for point in points]).T, look)
        for name, curve, points, look in (
            ("charge", cell.charge, cell.charge_points, CHARGE),
            ("discharge", cell.discharge, cell.discharge_points, DISCHARGE),
        )
        if points
    ]
    errors_mv = [1e3 * (point_v - curve(soc)) for _, curve, (soc, point_v), _ in branches]
    rows = 1 + any(np.abs(error_mv).max() > ROUNDING_MV for error_mv in errors_mv)
    figure, heights = style.make_figure(), [2.2, 1.0]
    panels = figure.subplots(rows, sharex=True, squeeze=False, height_ratios=heights[:rows])
    ocv, *residuals = panels[:, 0]
    for residual in residuals:
        residual.axhline(0.0, color=style.BLACK, linewidth=0.6)
        residual.set_ylabel("Residual [mV]\n(point − curve)")
    for (name, curve, (point_soc, point_v), look), error_mv in zip(
        branches, errors_mv, strict=True
    ):
        soc = np.linspace(curve.soc[0], curve.soc[-1], CURVE_SAMPLES)
        ocv.plot(soc, curve(soc), color=look.color, linestyle=look.line, label=f"{name} curve")
        size = 4.5 if len(point_soc) <= FEW_POINTS else 1.8
        hollow = {"color": look.color, "markerfacecolor": "white", "markeredgewidth": 0.9}
        points = {**hollow, "label": f"{name} points"}
        style.draw_points(ocv, point_soc, point_v, look.marker, size, **points)
        for residual in residuals:
            style.draw_points(residual, point_soc, error_mv, look.marker, size, **hollow)
    if len(branches) == 2:
        soc = np.linspace(*cell.soc_range, CURVE_SAMPLES)
        ocv.plot(soc, cell.average_ocv_v(soc), color=style.BLACK, linestyle="-.", label="average")
    ocv.set_ylabel(OCV_LABEL)
    figure.axes[-1].set_xlabel(style.SOC_LABEL)
    return style.finish(figure, *figure.axes)


def plot_fitted_ocv(cell: CellModel, nodes: "Sequence[Fact]") -> Figure:
    """A fitted OCV over SOC with the intervals of its nodes; if a hysteresis was identified with
    it, its branches too."""
    figure = style.make_figure()
    axes = figure.subplots()
    bounded = [(node.soc, node.low, node.high) for node in nodes if node.low is not None]
    if bounded:
        axes.fill_between(*np.array(bounded, float).T, **style.BAND, label="95 % interval")
    soc = np.linspace(*cell.soc_range, CURVE_SAMPLES)
    label = "identified from the record"
    axes.plot(soc, cell.average_ocv_v(soc), color=style.BLUE, label=label)
    if cell.charge_points and cell.discharge_points:
        red = style.VERMILLION
        axes.plot(soc, cell.charge(soc), color=red, linestyle="--", label="after charge")
        axes.plot(soc, cell.discharge(soc), color=red, linestyle=":", label="after discharge")
    axes.set(xlabel=style.SOC_LABEL, ylabel=OCV_LABEL)
    return style.finish(figure, axes)


PANELS_ACROSS: Final = 2
# Height of a row of panels, and of the space around all of them.
HEIGHTS_IN: Final = (2.1, 0.7)
# With more rates than these the rarest are left out.
MAX_PANELS: Final = 6
PULSE_COLORS: Final = "viridis"


@style.figure_style()
def plot_pulses(evaluation: "Evaluation", pulses: Sequence[Pulse]) -> Figure:
    """The change of voltage over that of current since the start of each pulse, one panel per rate.

    Measured curves are colored by SOC, simulated ones black and dashed. Relaxation left from an
    earlier pulse is in both.

    Args:
        evaluation: The pulse test's evaluation.
        pulses: The pulses in it.
    """
    names = ("Time in the pulse [s]", "Resistance [mOhm]\n(change of V over I)")
    figure, panels = _rate_panels(pulses, evaluation.prepared.capacity_ah, *names)
    colors = matplotlib.colormaps[PULSE_COLORS]
    for axes, level in panels.items():
        for pulse in level:
            _draw_pulse(axes, evaluation, pulse, colors(pulse.soc))
    _from_zero(panels)
    scale = ScalarMappable(Normalize(0.0, 1.0), colors)
    bar = figure.colorbar(scale, ax=list(panels), pad=0.02, aspect=40)
    bar.set_label(style.SOC_LABEL)
    bar.ax.tick_params(which="both", **style.scaled(style.TICKS))
    return style.finish(figure, *panels)


def _draw_pulse(axes: Axes, evaluation: "Evaluation", pulse: Pulse, color: object) -> None:
    prepared = evaluation.prepared
    samples = pulse_samples(prepared.record, pulse)
    inside = slice(samples.start - prepared.first, samples.stop - prepared.first)
    if inside.start < 0 or inside.stop > len(prepared.soc):
        return
    change_a = prepared.current_a[inside] - prepared.current_a[inside.start]
    is_on = np.abs(change_a) > abs(pulse.current_a) / 2
    since_s = (prepared.time_s[inside] - prepared.time_s[inside.start])[is_on]
    measured: dict[str, Any] = {"color": color, "linewidth": 1.3, "zorder": 2}
    simulated: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.7, "linestyle": (0, (3, 2))}
    for label, voltage_v, look in (
        ("measured, colored by SOC", prepared.voltage_v, measured),
        ("simulated", evaluation.simulated_v, simulated),
    ):
        drop_v = voltage_v[inside.start] - voltage_v[inside]
        axes.plot(since_s, 1e3 * (drop_v[is_on] / change_a[is_on]), **look, label=label)


@style.figure_style()
def plot_pulse_resistances(pulses: Sequence[Pulse], capacity_ah: float) -> Figure:
    """The standard pulse resistances over SOC, one panel per direction and rate.

    Args:
        pulses: The pulses of a test.
        capacity_ah: Capacity, for the C-rates.

    >>> from barnax import bundled_file, read_record
    >>> from barnax.pulses import find_pulses
    >>> record = read_record(bundled_file("hppc_25degC"))
    >>> pulses = find_pulses(record, 1 - record.discharged_ah / 2.0, threshold_a=0.02)
    >>> plot_pulse_resistances(pulses, 2.0).axes[0].get_title(loc="left")
    'discharge at 1C (2 A)'
    """
    figure, panels = _rate_panels(pulses, capacity_ah, style.SOC_LABEL, "Resistance [mOhm]")
    looks = style.row_looks(
        [f"after {time_s:g} s" if time_s else "at once" for time_s in STANDARD_S]
    )
    for axes, level in panels.items():
        # Room for the markers at the ends.
        axes.margins(x=0.04, y=0.08)
        soc = np.array([pulse.soc for pulse in level])
        columns = np.array([pulse.resistance_ohm for pulse in level], float).T
        for (label, look), ohm in zip(looks.items(), columns, strict=True):
            is_drawn = np.isfinite(ohm)
            if is_drawn.any():
                mark = {"color": look.color, "marker": look.marker, "markersize": 3.6}
                axes.plot(soc[is_drawn], 1e3 * ohm[is_drawn], **mark, label=label)
    _from_zero(panels)
    return style.finish(figure, *panels, columns=5)


def _from_zero(panels: Iterable[Axes]) -> None:
    """Start the scale shared by the panels at zero, and extend it to the data of all of them."""
    for axes in panels:
        axes.set_ylim(bottom=0.0)


def _rate_panels(
    pulses: Sequence[Pulse], capacity_ah: float, across: str, upward: str
) -> tuple[Figure, dict[Axes, tuple[Pulse, ...]]]:
    """A figure with a named panel for each of the rates with the most pulses, and its pulses."""
    rates = levels(pulses)
    most_common = sorted(rates, key=len, reverse=True)[:MAX_PANELS]
    shown = [level for level in rates if level in most_common]
    columns = min(PANELS_ACROSS, len(shown))
    figure, panels = style.make_panels(
        len(shown), columns, HEIGHTS_IN, across, sharex=True, sharey=True
    )
    for axes, level in zip(panels, shown, strict=True):
        style.title(axes, rate_label(level, capacity_ah))
    for axes in panels[::PANELS_ACROSS]:
        axes.set_ylabel(upward)
    return figure, dict(zip(panels, shown, strict=True))
