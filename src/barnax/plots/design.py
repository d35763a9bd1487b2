"""A designed test as it is predicted: current, voltage with its worst case, and state of charge."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .pictures import illustration
from .style import BLACK, BLUE, GREY, SKY_BLUE, VERMILLION, finish, make_figure

if TYPE_CHECKING:
    from ..experiment import Design


@illustration(
    "The test for {} as predicted: current (discharge > 0), voltage with its range up "
    "to the largest resistances allowed for and an OCV that is off either way, state of charge.",
    "Current, voltage and state of charge over time",
    is_main=True,
)
def plot_design(design: "Design") -> Figure:
    """Current, voltage and state of charge over time, as a design predicts them.

    Args:
        design: A design.
    """
    found, limits = design.predicted, design.limits
    hours = found.time_s / 3600
    figure = make_figure(height_in=4.6)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(2, 2, 1))
    current, voltage, soc = panels
    current.plot(hours, found.current_a, color=BLACK, linewidth=0.6)
    current.set_ylabel("Current [A]\n(discharge > 0)")
    band = {"color": SKY_BLUE, "alpha": 0.45, "linewidth": 0.0}
    low_v = np.minimum(found.low_v, found.voltage_v)
    high_v = np.maximum(found.high_v, found.voltage_v)
    label = "worst case"
    voltage.fill_between(hours, low_v, high_v, **band, label=label)
    voltage.plot(hours, found.voltage_v, color=BLUE, linewidth=0.6, label="predicted")
    for limit_v in (limits.low_v, limits.high_v):
        voltage.axhline(limit_v, color=VERMILLION, linewidth=0.8, linestyle="--", label="limits")
    voltage.set_ylabel("Voltage [V]")
    soc.plot(hours, found.soc, color=GREY)
    soc.set_ylim(0.0, 1.05)
    soc.set_ylabel("SOC [-]")
    soc.set_xlabel("Time [h]")
    return finish(figure, *panels)
