"""Options about files and records: how they are read, what is known of them, what counts."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from ..errors import InputError
from .groups import INPUT, WINDOW, option

if TYPE_CHECKING:
    from ..model.window import Window

PerRecord = list[str] | None


def _of_a_record(metavar: str, text: str) -> Any:
    return option(WINDOW, f"[FILE=]{metavar}", text)


SignOf = Literal["auto", "charge-positive", "discharge-positive"]
Sign = Annotated[
    SignOf,
    option(
        INPUT,
        "SIGN",
        "Sign of current in the records: charge-positive, discharge-positive, or auto (decided "
        "from the data).",
    ),
]
Hold = Annotated[
    Literal["auto", "forward", "backward"],
    option(
        INPUT,
        "HOLD",
        "When a sample's current flows: until the next sample (forward), since the previous one "
        "(backward), or auto (decided from the data).",
    ),
]

Columns = Annotated[
    str,
    option(
        INPUT,
        "NAMES",
        "Columns that are not recognized: time=NAME:UNIT,current=NAME:UNIT,voltage=NAME, "
        "with a unit if the name has none.",
    ),
]


@dataclass(frozen=True)
class Files:
    """The files of a run, and how they are read."""

    ocv: Annotated[
        list[Path] | None,
        option(
            INPUT,
            "FILE",
            "OCV test of the same cell: pulses and rests, a slow sweep, or a table; repeatable.",
        ),
    ] = None
    validate: Annotated[
        list[Path] | None, option(INPUT, "FILE", "Record to validate on; repeatable.")
    ] = None
    ocv_capacity: Annotated[
        float | None,
        option(INPUT, "AH", "Capacity in the OCV test, if it does not span full to empty."),
    ] = None
    ocv_fit: Annotated[
        Literal["polynomial", "interpolated"] | None,
        option(
            INPUT,
            "FIT",
            "OCV curves: polynomial of degree 7, or interpolated (PCHIP) (default: polynomial; in "
            "a plan, interpolated).",
        ),
    ] = None
    hysteresis_fit: Annotated[
        Literal["continuous", "independent"],
        option(
            INPUT, "FIT", "Hysteresis segments: continuous (they meet at the knots) or independent."
        ),
    ] = "continuous"
    current_sign: Sign = "auto"
    ocv_current_sign: Annotated[
        SignOf, option(INPUT, "SIGN", "Sign of current in the OCV tests.")
    ] = "auto"
    validate_current_sign: Annotated[
        SignOf, option(INPUT, "SIGN", "Sign of current in the validation records.")
    ] = "auto"
    current_hold: Hold = "auto"
    columns: Columns = ""


@dataclass(frozen=True)
class RecordOptions:
    """What is known of the records, and what of them counts; for all, or for one by its name."""

    capacity: Annotated[
        PerRecord,
        _of_a_record(
            "AH",
            "Capacity of the cell when the record was measured (default: that of the OCV test).",
        ),
    ] = None
    temperature: Annotated[
        PerRecord,
        _of_a_record("DEGC", "Temperature in degC (default: the median of the record's column)."),
    ] = None
    start_time: Annotated[
        PerRecord, _of_a_record("S", "Time at which the simulation starts, on the file's clock.")
    ] = None
    start_after_step: Annotated[
        PerRecord, _of_a_record("N", "Start at the last sample of the last block of this step.")
    ] = None
    initial_soc: Annotated[
        PerRecord,
        _of_a_record("0..1", "State of charge at the start (default: from the rested voltage)."),
    ] = None
    initial_direction: Annotated[
        PerRecord,
        _of_a_record(
            "+1|-1",
            "Last direction before the start, if the record does not show it: +1 charge, "
            "-1 discharge (default: both are tried).",
        ),
    ] = None
    score_steps: Annotated[
        PerRecord, _of_a_record("N,N", "Score only these steps, such as 7,8.")
    ] = None
    score_from: Annotated[PerRecord, _of_a_record("S", "Score from this time on.")] = None
    score_to: Annotated[PerRecord, _of_a_record("S", "Score up to this time.")] = None
    score_soc: Annotated[
        PerRecord,
        _of_a_record("LOW,HIGH", "Score only between these states of charge, such as 0.1,1."),
    ] = None
    rest_current: Annotated[
        PerRecord, _of_a_record("A", "Current below which the cell is at rest (default: C/100).")
    ] = None

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Fields of a `Window` by the name of the record they are for, "" for all."""
        from ..model.window import OPTIONS

        found: dict[str, dict[str, Any]] = {}
        for asked, (name, parse, example) in OPTIONS.items():
            for text in getattr(self, asked) or []:
                record, _, value = text.rpartition("=")
                try:
                    found.setdefault(record, {})[name] = parse(value)
                except ValueError as problem:
                    raise InputError(
                        f"`{asked}` {text!r}: write it like {example}, or FILE={example} for one "
                        "of the records"
                    ) from problem
        return found

    def windows(self) -> "Window | dict[str, Window] | None":
        """One window for all records, or one for each that has its own; None where none is given.

        A record's own start replaces the common one. Raises `InputError` where options of one
        record contradict each other.
        """
        from ..model.window import Window

        chosen = self.chosen()
        if not chosen:
            return None
        common = chosen.get("", {})
        windows = {}
        for name, own in chosen.items():
            kept = common
            if own.keys() & {"start_time_s", "start_after_step"}:
                kept = {key: common[key] for key in common if not key.startswith("start")}
            try:
                windows[name] = Window(**(kept | own))
            except InputError as problem:
                raise InputError(f"{name}: {problem}" if name else str(problem)) from problem
        return windows
