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
from ..pulses import STANDARD_S, Pulse, levels, pulse_samples
from .pictures import illustration
from .style import (
    BLACK,
    BLUE,
    SKY_BLUE,
    SOC_LABEL,
    VERMILLION,
    draw_points,
    finish,
    finish_bar,
    make_figure,
    make_panels,
    name_below,
    opened,
    row_looks,
    title,
)

if TYPE_CHECKING:
    from ..cell import AbstractCurve, OcvPoint
    from ..over_soc import NodeInterval
    from ..results import Result
    from ..search.evaluate import Evaluation


def cell_of(source: "CellModel | Result | str | Path") -> CellModel:
    """The cell itself, that of a result, or that of a `result.json`."""
    return source if isinstance(source, CellModel) else result_of(source).cell_model


def result_of(source: "Result | str | Path") -> "Result":
    """The result itself, or that of a `result.json`."""
    # It needs JAX, which a cell does not.
    from ..results import Result

    return opened(source, Result)


CURVE_SAMPLES = 1001
# More points than this (a slow sweep has them) would hide the curve under full-size markers.
FEW_POINTS = 50
# What curves through their points leave is rounding.
ROUNDING_MV = 1e-3


@illustration(
    "Open-circuit voltage: the measured points, the curve of each branch and their average. "
    "Below, unless the curves pass through their points, the error of each curve at its points.",
    "Open-circuit voltage over the state of charge, with residuals of the fit",
    is_dense=False,
)
def plot_ocv(cell: "CellModel | Result | str | Path") -> Figure:
    """OCV points and curves over SOC; below, what each curve leaves at its own points, in mV. One
    that was identified from records has no points: it is a line, of a result with its intervals.

    Curves through their points leave nothing, and have no panel for it. A branch that was not
    measured is not drawn, and then there is no average either.

    Args:
        cell: A cell from `characterize`, a result, or the path of a `result.json`.

    >>> from barnax import bundled_file, characterize, read_record
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> [axes.get_ylabel() for axes in plot_ocv(characterize(tests)).axes]
    ['Open-circuit voltage [V]']
    """
    source, cell = cell, cell_of(cell)
    if cell.is_of_records:
        nodes = () if isinstance(source, CellModel) else result_of(source).fit.of_table(OCV)
        return plot_own_ocv(cell, nodes)
    branches: list[tuple[str, AbstractCurve, tuple[OcvPoint, ...], str, str, str]] = [
        ("charge", cell.charge, cell.charge_points, VERMILLION, "^", "--"),
        ("discharge", cell.discharge, cell.discharge_points, BLUE, "v", "-"),
    ]
    measured = [branch for branch in branches if branch[2]]
    drawn = {
        name: np.array([(point.soc, point.voltage_v) for point in points]).T
        for name, _, points, *_ in measured
    }
    errors_mv = {
        name: 1e3 * (drawn[name][1] - curve(drawn[name][0])) for name, curve, *_ in measured
    }
    leaves = any(np.abs(own_mv).max() > ROUNDING_MV for own_mv in errors_mv.values())
    figure = make_figure()
    panels = figure.subplots(1 + leaves, 1, sharex=True, squeeze=False,
                             height_ratios=[2.2, 1.0][: 1 + leaves])[:, 0]  # fmt: skip
    ocv = panels[0]
    for residual in panels[1:]:
        residual.axhline(0.0, color=BLACK, linewidth=0.6)
    for name, curve, points, color, marker, line_style in measured:
        point_soc, point_v = drawn[name]
        soc = np.linspace(curve.soc[0], curve.soc[-1], CURVE_SAMPLES)
        size = 4.5 if len(points) <= FEW_POINTS else 1.8
        symbol = {"color": color, "markerfacecolor": "white", "markeredgewidth": 0.9}
        ocv.plot(soc, curve(soc), color=color, linestyle=line_style, label=f"{name} curve")
        draw_points(ocv, point_soc, point_v, marker, size, **symbol, label=f"{name} points")
        for residual in panels[1:]:
            draw_points(residual, point_soc, errors_mv[name], marker, size, **symbol)
    if len(measured) == 2:
        soc = np.linspace(*cell.soc_range, CURVE_SAMPLES)
        ocv.plot(soc, cell.average_ocv_v(soc), color=BLACK, linestyle="-.", label="average")
    ocv.set_ylabel("Open-circuit voltage [V]")
    for residual in panels[1:]:
        residual.set_ylabel("Residual [mV]\n(point − curve)")
    panels[-1].set_xlabel(SOC_LABEL)
    return finish(figure, *panels)


@illustration(
    "Open-circuit voltage identified from the record, no OCV test: lines between its nodes, and "
    "the 95 % interval of each node.",
    "Open-circuit voltage over the state of charge, identified from the record, with intervals",
    is_dense=False,
)
def plot_own_ocv(cell: CellModel, nodes: "Sequence[NodeInterval]" = ()) -> Figure:
    """An OCV of the records' own over SOC with the intervals of its nodes; where a hysteresis was
    identified with it, its branches too."""
    figure = make_figure()
    axes = figure.subplots()
    known = [(node.soc, node.low, node.high) for node in nodes if node.low is not None]
    if known:
        soc, low_v, high_v = np.array(known, float).T
        band = {"color": SKY_BLUE, "alpha": 0.35, "linewidth": 0.0, "label": "95 % interval"}
        axes.fill_between(soc, low_v, high_v, **band)
    soc = np.linspace(*cell.soc_range, CURVE_SAMPLES)
    axes.plot(soc, cell.average_ocv_v(soc), color=BLUE, label="identified from the record")
    if cell.charge_points and cell.discharge_points:
        for name, curve, style in (
            ("charge", cell.charge, "--"),
            ("discharge", cell.discharge, ":"),
        ):
            axes.plot(soc, curve(soc), color=VERMILLION, linestyle=style, label=f"after {name}")
    axes.set_ylabel("Open-circuit voltage [V]")
    axes.set_xlabel(SOC_LABEL)
    return finish(figure, axes)


PANELS_ACROSS: Final = 2
PANEL_IN: Final = 2.1
# More rates than these are left out, the rarest first.
MAX_PANELS: Final = 6
PULSE_COLORS: Final = "viridis"


@illustration(
    "The pulses of {}, overlaid: the change of voltage divided by the change of current since "
    "the pulse began. Color: state of charge. Solid: measured; dashed: simulated.",
    "Resistance over the time into a pulse, one line per pulse",
    is_main=True,
)
def plot_pulses(evaluation: "Evaluation", pulses: Sequence[Pulse]) -> Figure:
    """The change of voltage over that of current since each pulse began, a panel a rate.

    Colored by SOC, measured; black and dashed, simulated. What remains of an earlier pulse's
    relaxation is in both.

    Args:
        evaluation: The pulse test's evaluation.
        pulses: The pulses found in it.
    """
    names = ("Time in the pulse [s]", "Resistance [mOhm]\n(change of V over I)")
    figure, panels = _rate_panels(pulses, evaluation.prepared.capacity_ah, *names)
    colors = matplotlib.colormaps[PULSE_COLORS]
    scale = ScalarMappable(Normalize(0.0, 1.0), colors)
    for axes, level in panels.items():
        for pulse in level:
            _draw_pulse(axes, evaluation, pulse, colors(pulse.soc))
    _from_zero(panels)
    bar = figure.colorbar(scale, ax=list(panels), pad=0.02, aspect=40)
    bar.set_label(SOC_LABEL)
    finish_bar(bar)
    return finish(figure, *panels)


def _draw_pulse(axes: Axes, evaluation: "Evaluation", pulse: Pulse, color: object) -> None:
    prepared = evaluation.prepared
    span = pulse_samples(prepared.record, pulse)
    inside = slice(span.start - prepared.first, span.stop - prepared.first)
    if inside.start < 0 or inside.stop > len(prepared.soc):
        return
    change_a = prepared.current_a[inside] - prepared.current_a[inside.start]
    is_on = np.abs(change_a) > abs(pulse.current_a) / 2
    since_s = (prepared.time_s[inside] - prepared.time_s[inside.start])[is_on]
    for voltage_v, style in (
        (prepared.voltage_v, {"color": color, "linewidth": 1.3, "zorder": 2}),
        (evaluation.simulated_v, {"color": BLACK, "linewidth": 0.7, "linestyle": (0, (3, 2))}),
    ):
        drop_v = voltage_v[inside.start] - voltage_v[inside]
        label = "simulated" if voltage_v is evaluation.simulated_v else "measured, colored by SOC"
        axes.plot(since_s, 1e3 * (drop_v[is_on] / change_a[is_on]), label=label, **style)


@illustration(
    "The standard pulse resistances of {} over the state of charge.",
    "Pulse resistances over the state of charge, by direction and rate",
    is_dense=False,
    is_main=True,
)
def plot_pulse_resistances(pulses: Sequence[Pulse], capacity_ah: float) -> Figure:
    """The standard pulse resistances over SOC, a panel a direction and rate.

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
    figure, panels = _rate_panels(pulses, capacity_ah, SOC_LABEL, "Resistance [mOhm]")
    labels = [f"after {time_s:g} s" if time_s else "at once" for time_s in STANDARD_S]
    looks = row_looks(labels)
    for axes, level in panels.items():
        # Room for the markers at the ends.
        axes.margins(x=0.04, y=0.08)
        soc = np.array([pulse.soc for pulse in level])
        values = np.array([pulse.resistance_ohm for pulse in level], float)
        for place, label in enumerate(labels):
            known = np.isfinite(values[:, place])
            if known.any():
                look = {"color": looks[label].color, "marker": looks[label].marker}
                style: dict[str, Any] = {"markersize": 3.6, "label": label} | look
                axes.plot(soc[known], 1e3 * values[known, place], **style)
    _from_zero(panels)
    return finish(figure, *panels, columns=5)


def _from_zero(panels: Iterable[Axes]) -> None:
    """Let the scale that panels share begin at zero and hold what is drawn in all of them."""
    for axes in panels:
        axes.set_ylim(bottom=0.0)


def rate_label(level: Sequence[Pulse], capacity_ah: float) -> str:
    """The direction and rate of pulses, such as "discharge at 1C (2 A)"."""
    current_a = float(np.median([pulse.current_a for pulse in level]))
    way = "discharge" if current_a > 0 else "charge"
    return f"{way} at {abs(current_a) / capacity_ah:.2g}C ({abs(current_a):.3g} A)"


def _rate_panels(
    pulses: Sequence[Pulse], capacity_ah: float, across: str, upward: str
) -> tuple[Figure, dict[Axes, tuple[Pulse, ...]]]:
    """A figure with a named panel for each of the rates with the most pulses, and its pulses."""
    found = levels(pulses)
    most_common = sorted(found, key=len, reverse=True)[:MAX_PANELS]
    shown = [level for level in found if level in most_common]
    figure, panels = make_panels(
        len(shown), min(PANELS_ACROSS, len(shown)), row_in=PANEL_IN, around_in=0.7,
        sharex=True, sharey=True,
    )  # fmt: skip
    for axes, level in zip(panels, shown, strict=True):
        title(axes, rate_label(level, capacity_ah))
    for axes in panels[::PANELS_ACROSS]:
        axes.set_ylabel(upward)
    name_below(panels, PANELS_ACROSS, across)
    return figure, dict(zip(panels, shown, strict=True))
