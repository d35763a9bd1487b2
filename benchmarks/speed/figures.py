"""Time against record length, seeds and cells."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .growth import Length

BLUE, ORANGE, BLACK = "#0072B2", "#D55E00", "#000000"


def growth_figure(
    lengths: Sequence[Length],
    seeds: Sequence[tuple[int, float]],
    cells: Sequence[tuple[int, float]],
    generations: int,
    seeds_a_cell: int,
) -> Figure:
    """Three panels, both axes logarithmic."""
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    of_length, of_seeds, of_cells = figure.subplots(1, 3)
    samples = [each.samples for each in lengths]
    _line(of_length, samples, [each.search_s for each in lengths], "compressed search", BLUE, "o")
    _line(of_length, samples, [each.reduction_s for each in lengths], "reduction", ORANGE, "s")
    scanned = [each for each in lengths if each.scan_s is not None]
    _line(
        of_length,
        [each.samples for each in scanned],
        [generations * each.scan_s for each in scanned if each.scan_s is not None],
        f"{generations} generations, scan",
        BLACK,
        "^",
    )
    of_length.set(xlabel="record length [samples]", ylabel="time [s]")
    of_length.legend(frameon=False, fontsize=8)
    x, y = zip(*seeds, strict=True)
    _line(of_seeds, x, y, "", BLUE, "o")
    of_seeds.set(xlabel="seeds, one cell", ylabel="time [s], after the reduction")
    x, y = zip(*cells, strict=True)
    _line(of_cells, x, y, "", BLUE, "o")
    of_cells.set(xlabel=f"cells, {seeds_a_cell} seeds each", ylabel="time [s], reductions included")
    return figure


def _line(axes: Axes, x, y, label: str, color: str, marker: str) -> None:
    axes.loglog(x, y, label=label, color=color, marker=marker, markersize=4, linewidth=1.2)
    axes.grid(True, which="major", linewidth=0.3)
