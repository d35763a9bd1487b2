"""From files to a comparison: what `barnax compare` runs, and a notebook calls."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ..baselines import Budget
from ..cell.curves import HysteresisFit, OcvFit
from ..errors import InputError
from ..gather import (
    Given,
    Reading,
    Settings,
    Watch,
    ranges_of,
    read_inputs,
    unwatched,
    windows_of,
)
from ..model.search_space import Range
from ..model.window import Window
from .result import ComparisonResult, make_comparison_result
from .run import PAPER_ROWS, Comparison, compare
from .tabulated import tabulate


def compare_files(
    records: Given | Sequence[Given] = (),
    *,
    ocv: Given | Sequence[Given] = (),
    validate: Given | Sequence[Given] = (),
    rows: Sequence[tuple[str, str]] = PAPER_ROWS,
    tabulated: Sequence[str] = (),
    settings: Settings | None = None,
    window: Window | Mapping[str, Window] | None = None,
    capacity: float | None = None,
    ocv_capacity: float | None = None,
    bounds: Mapping[str, Range] | str | Path | None = None,
    fix: Mapping[str, float] | None = None,
    reading: Reading | None = None,
    ocv_fit: OcvFit = "polynomial",
    hysteresis_fit: HysteresisFit = "continuous",
    command: Sequence[str] = (),
    watch: Watch = unwatched,
) -> tuple[Comparison, ComparisonResult]:
    """Models and methods compared on one record, as objects and as a result that can be stored.

    `rows` are pairs of a circuit and a method of `METHODS`, by default those of the paper.
    Circuits in `tabulated`, which must also be in `rows`, are also fitted with tables over SOC.
    All other options are those of `identify`.

    Raises `InputError` if an input cannot be used, or more than one record is given.
    """
    if isinstance(records, list | tuple) and len(records) > 1:
        raise InputError(
            f"a comparison uses one record, but {len(records)} were given; give the others with "
            "`validate`"
        )
    settings = settings or Settings()
    inputs = read_inputs(
        records, ocv, validate, reading or Reading(),
        capacity=capacity, ocv_capacity=ocv_capacity,
        ocv_fit=ocv_fit, hysteresis_fit=hysteresis_fit,
        window=window, watch=watch,
    )  # fmt: skip
    windows = windows_of(inputs, window, capacity)
    source, ranges = ranges_of(bounds)
    comparison = compare(
        inputs.records[0],
        inputs.cell,
        rows,
        validation=inputs.validation,
        window=windows[inputs.records[0].name],
        validation_windows=[windows[record.name] for record in inputs.validation],
        bounds=ranges,
        fixed=fix,
        coordinates=settings.coordinates,
        objective="scan" if settings.objective == "auto" else settings.objective,
        budget=Budget(settings.population, settings.iterations, settings.seeds, settings.key),
        source=source,
        watch=watch,
    )
    with watch("Tables over SOC", 0):
        tables = tabulate(comparison, tabulated, bounds=ranges, fixed=fix)
    warnings = list(inputs.warnings)
    for each in tables:
        warnings += [f"{each.model}: {text}" for text in each.warnings]
    result = make_comparison_result(
        comparison, tables, ocv=inputs.ocv, command=command, warnings=warnings
    )
    return comparison, result
