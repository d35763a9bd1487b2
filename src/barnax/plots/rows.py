"""How the rows of a comparison are told apart: color, line and marker together."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from .style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILLION

if TYPE_CHECKING:
    from ..evaluate import Evaluation

# Cycles of three coprime lengths: 315 rows differ in at least one of them. Neighbors differ in
# lightness too, so that grey print tells them apart.
COLORS: Final = (BLUE, ORANGE, BLACK, VERMILLION, SKY_BLUE, GREEN, PURPLE)
LINES: Final = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">")


@dataclass(frozen=True)
class RowLook:
    """The same row looks the same in every figure."""

    color: str
    line: str | tuple[int, tuple[float, ...]]
    marker: str


def row_looks(labels: Iterable[str]) -> dict[str, RowLook]:
    """A look for every label, by its place among the labels.

    >>> [look.marker for look in row_looks(["IBMO-ISO RC", "LS-SO RC"]).values()]
    ['o', 's']
    """
    return {
        label: RowLook(
            COLORS[place % len(COLORS)], LINES[place % len(LINES)], MARKERS[place % len(MARKERS)]
        )
        for place, label in enumerate(labels)
    }


def require_one_record(evaluations: Mapping[str, "Evaluation"]) -> None:
    """Raise `ValueError` where there is nothing to draw, or not the same samples in every row."""
    if not evaluations:
        raise ValueError("there is no row to draw; give at least one evaluation")
    simulated = {
        (each.course.record.name, each.course.first, len(each.simulated_v))
        for each in evaluations.values()
    }
    if len(simulated) > 1:
        names = ", ".join(sorted({name for name, _, _ in simulated}))
        raise ValueError(
            f"the rows are on different samples ({names}); draw one record and window at a time"
        )


def most_accurate(evaluations: Mapping[str, "Evaluation"], most: int) -> dict[str, "Evaluation"]:
    """At most `most` rows, those of the lowest RMSE, in their own order."""
    ranked = sorted(evaluations, key=lambda label: evaluations[label].metrics.rmse_v)
    kept = set(ranked[:most])
    return {label: each for label, each in evaluations.items() if label in kept}


def selection_note(kept: int, of: int) -> str:
    """What a title adds where not every row is drawn.

    >>> selection_note(8, 12)
    'the 8 of 12 rows with the lowest RMSE'
    """
    return "" if kept == of else f"the {kept} of {of} rows with the lowest RMSE"
