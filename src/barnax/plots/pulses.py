"""Pulses of an HPPC test: laid over each other, and their resistances over SOC."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..pulses import STANDARD_S, Pulse, levels, pulse_samples
from .compared_records import row_looks
from .style import BLACK, figure_style, finish, finish_bar, make_panels, name_below, title

if TYPE_CHECKING:
    from ..search.evaluate import Evaluation

ACROSS: Final = 2
PANEL_IN: Final = 2.1
# More rates than these are left out, the rarest first.
MOST_PANELS: Final = 6
COLORS: Final = "viridis"


@figure_style()
def plot_pulses(evaluation: "Evaluation", pulses: Sequence[Pulse]) -> Figure:
    """The change of voltage over that of current since each pulse began, a panel a rate.

    Colored by SOC, measured; black and dashed, simulated. What remains of an earlier pulse's
    relaxation is in both.
    """
    shown = _most_common(pulses)
    figure, panels = _panels(len(shown))
    colors = matplotlib.colormaps[COLORS]
    scale = ScalarMappable(Normalize(0.0, 1.0), colors)
    for axes, level in zip(panels, shown, strict=True):
        for number, pulse in enumerate(level):
            _draw_pulse(axes, evaluation, pulse, colors(pulse.soc), number == 0)
        axes.set_ylim(bottom=0.0)
        title(axes, rate_label(level, evaluation.prepared.capacity_ah))
    _name(panels, "Time in the pulse [s]", "Resistance [mOhm]\n(change of V over I)")
    bar = figure.colorbar(scale, ax=panels, pad=0.02, aspect=40)
    bar.set_label("State of charge [-]")
    finish_bar(bar)
    return finish(figure, *panels)


def _draw_pulse(
    axes: Axes, evaluation: "Evaluation", pulse: Pulse, color: object, is_first: bool
) -> None:
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
        name = "simulated" if voltage_v is evaluation.simulated_v else "measured, colored by SOC"
        label = name if is_first else "_"
        axes.plot(since_s, 1e3 * (drop_v[is_on] / change_a[is_on]), label=label, **style)


@figure_style()
def plot_pulse_resistances(pulses: Sequence[Pulse], capacity_ah: float) -> Figure:
    """The standard pulse resistances over SOC, a panel a direction and rate.

    >>> from barnax import bundled_file, read_record
    >>> from barnax.pulses import find_pulses
    >>> record = read_record(bundled_file("hppc_25degC"))
    >>> pulses = find_pulses(record, 1 - record.discharged_ah / 2.0, threshold_a=0.02)
    >>> plot_pulse_resistances(pulses, 2.0).axes[0].get_title(loc="left")
    'discharge at 1C (2 A)'
    """
    shown = _most_common(pulses)
    figure, panels = _panels(len(shown))
    labels = [f"after {time_s:g} s" if time_s else "at once" for time_s in STANDARD_S]
    looks = row_looks(labels)
    for axes, level in zip(panels, shown, strict=True):
        soc = np.array([pulse.soc for pulse in level])
        values = np.array([pulse.resistance_ohm for pulse in level], float)
        for place, label in enumerate(labels):
            known = np.isfinite(values[:, place])
            if known.any():
                look = {"color": looks[label].color, "marker": looks[label].marker}
                style: dict[str, Any] = {"markersize": 3.6, "label": label} | look
                axes.plot(soc[known], 1e3 * values[known, place], **style)
        axes.set_ylim(bottom=0.0)
        title(axes, rate_label(level, capacity_ah))
    _name(panels, "State of charge [-]", "Resistance [mOhm]")
    return finish(figure, *panels, columns=5)


def rate_label(level: Sequence[Pulse], capacity_ah: float) -> str:
    """The direction and rate of pulses, such as "discharge at 1C (2 A)"."""
    current_a = float(np.median([pulse.current_a for pulse in level]))
    way = "discharge" if current_a > 0 else "charge"
    return f"{way} at {abs(current_a) / capacity_ah:.2g}C ({abs(current_a):.3g} A)"


def _most_common(pulses: Sequence[Pulse]) -> list[tuple[Pulse, ...]]:
    """The rates with the most pulses, in their own order."""
    found = levels(pulses)
    kept = sorted(found, key=len, reverse=True)[:MOST_PANELS]
    return [level for level in found if level in kept]


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    shared = {"sharex": True, "sharey": True}
    return make_panels(count, min(ACROSS, count), row_in=PANEL_IN, around_in=0.7, **shared)


def _name(panels: Sequence[Axes], across: str, upward: str) -> None:
    """Names below the lowest panel of each column and beside the first of each row."""
    name_below(panels, ACROSS, across)
    for axes in panels[::ACROSS]:
        axes.set_ylabel(upward)
