"""A record replayed through a filter: state of charge and its errors over time."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SHADE,
    SKY_BLUE,
    VERMILLION,
    draw_line,
    figure_style,
    finish,
    make_figure,
    title,
)
from .voltage import choose_time_unit

if TYPE_CHECKING:
    from ..replay import SocReplay

COLORS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY_BLUE)
HEIGHT_IN = 5.6
# Errors beyond these are of a start that is still being found.
WIDEST_PERCENT = 8.0
BAND_SD = 2.0


def plot_soc_replay(replay: "SocReplay") -> Figure:
    """SOC by the counter and by the filter in every scenario, and the filter's errors.

    The shaded band is two standard deviations of the first scenario's filter about zero; dashed
    lines are the errors of plain counting. Raises `InputError` for a replay read from a file.
    """
    traces = replay.traces
    unit = choose_time_unit(traces.time_s)
    time = traces.time_s / unit.seconds
    with figure_style():
        figure = make_figure(height_in=HEIGHT_IN)
        over_time, errors = figure.subplots(2, sharex=True, height_ratios=(2, 3))
        draw_line(over_time, time, 100 * traces.truth, color=BLACK, label="ampere-hour counter")
        band = 100 * BAND_SD * np.nan_to_num(traces.estimate.soc_sd[0])
        errors.fill_between(time, -band, band, color=SHADE, linewidth=0, label="95 % band")
        errors.axhline(0.0, color=BLACK, linewidth=0.6)
        for place, (part, color) in enumerate(zip(replay.scenarios, COLORS, strict=False)):
            soc = 100 * np.asarray(traces.estimate.soc[place])
            # Where the others agree with the first, it shows on either side of them.
            style = {"color": color, "label": part.name, "linewidth": 2.6 if place == 0 else 1.0}
            draw_line(over_time, time, soc, **style)
            draw_line(errors, time, soc - 100 * traces.truth, **style)
            counted = 100 * (traces.counted[place] - traces.truth)
            errors.plot(time[::100], counted[::100], color=color, linestyle="--", linewidth=0.7)
        errors.plot([], [], color=GREY, linestyle="--", label="counting alone")
        errors.set_ylim(-WIDEST_PERCENT, WIDEST_PERCENT)
        errors.set_title(_beyond(replay), loc="right")
        over_time.set_ylabel("State of charge [%]")
        errors.set_ylabel("Error of SOC [%]\n(filter − counter)")
        errors.set_xlabel(unit.label)
        title(over_time, f"{replay.record}: {replay.model}, {replay.settings.kind.upper()}")
        return finish(figure, over_time, errors, columns=4)


def _beyond(replay: "SocReplay") -> str:
    """What leaves the scale of the errors, and how far; nothing where nothing does."""
    traces, far = replay.traces, []
    for way, soc in (("filter", traces.estimate.soc), ("counting", traces.counted)):
        most = 100 * np.abs(np.asarray(soc) - traces.truth).max(axis=1)
        far += [
            f"{part.name} ({way}, {error:.2g} %)"
            for part, error in zip(replay.scenarios, most, strict=True)
            if error > WIDEST_PERCENT
        ]
    return f"beyond the scale: {'; '.join(far)}" if far else ""
