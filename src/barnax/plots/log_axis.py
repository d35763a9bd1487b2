"""Logarithmic axes that show plain numbers."""

from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

SHORT = 10.0
MIDDLE = 300.0
LONG = 1e4


def label_plainly(axis: Axis) -> None:
    """Ticks with plain numbers on a logarithmic axis, also where it spans less than a decade.

    Call it when the limits stand. An axis of more than four decades keeps its powers of ten.
    """
    low, high = sorted(axis.get_view_interval())
    if high / low > LONG:
        return
    within = (1, 3) if high / low < MIDDLE else (1,)
    is_short = high / low < SHORT
    axis.set_major_locator(MaxNLocator(5) if is_short else LogLocator(subs=within))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
