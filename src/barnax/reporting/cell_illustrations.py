"""The figures of the cell and of one record, with their captions."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..plots import plot_condition, plot_hysteresis, plot_ocv
from ..plots.illustration import Illustration

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..course import Course


def cell_illustrations(cell: "CellModel") -> Iterator[Illustration]:
    """Open-circuit and hysteresis voltage."""
    yield Illustration(
        "ocv",
        plot_ocv(cell),
        "Open-circuit voltage: the measured points, the curve of each branch and their average. "
        "Below, what each curve leaves at its own points.",
        "Open-circuit voltage over the state of charge, with residuals of the fit",
        is_dense=False,
    )
    yield Illustration(
        "hysteresis",
        plot_hysteresis(cell),
        "Hysteresis voltage, the charge branch minus the discharge branch, and the segments that "
        "stand for it.",
        "Hysteresis voltage over the state of charge, with its five segments",
        is_dense=False,
    )


def condition_illustrations(courses: "Mapping[str, Course]") -> Iterator[Illustration]:
    """Current, voltage and state of charge of every record, by its role."""
    for role, course in courses.items():
        yield Illustration(
            f"{role}-condition",
            plot_condition(course),
            f"The working condition of {course.record.name}: current, measured voltage and state "
            "of charge.",
            "Current, voltage and state of charge over time",
        )
