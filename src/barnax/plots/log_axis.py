"""Logarithmic axes that show plain numbers."""

import math

from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

SHORT = 10.0
MIDDLE = 300.0
LONG = 1e4
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def label_plainly(axis: Axis) -> None:
    """Ticks with plain numbers on a logarithmic axis, also where it spans less than a decade.

    Call it when the limits stand. An axis of more than four decades shows powers of ten, in plain
    characters: setting them as formulas takes as long as the rest of a figure's text.
    """
    low, high = sorted(axis.get_view_interval())
    within = (1, 3) if high / low < MIDDLE else (1,)
    is_short = high / low < SHORT
    label = _power_of_ten if high / low > LONG else _plain
    axis.set_major_locator(MaxNLocator(5) if is_short else LogLocator(subs=within))
    axis.set_major_formatter(FuncFormatter(label))
    axis.set_minor_locator(NullLocator())


def _plain(value: float, _: object) -> str:
    return f"{value:g}"


def _power_of_ten(value: float, _: object) -> str:
    return "10" + str(round(math.log10(value))).translate(RAISED)
