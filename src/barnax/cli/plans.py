"""What `barnax identify` does with a folder: its plan, printed, changed by options, and stored."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .session import APPEARANCE, without_options

if TYPE_CHECKING:
    from ..model.window import Window
    from ..plan import Part, Plan

# Options of the run that a plan may hold; those of records go into its windows.
PLANNED = (
    "ocv_capacity", "ocv_fit", "hysteresis_fit", "model", "method", "trust", "over",
    "current_hold", "current_sign", "ocv_current_sign", "validate_current_sign", "columns",
)  # fmt: skip


def with_options(
    planned: "Plan", window: "Window | dict[str, Window] | None", *groups: object
) -> "Plan":
    """The plan with what the command line says otherwise, in its groups of options."""
    flags = {word.partition("=")[0] for word in sys.argv}
    given = {
        name: value
        for group in groups
        for name, value in vars(group).items()
        if name in PLANNED and f"--{name.replace('_', '-')}" in flags
    }
    return planned.changed(window, **given)


def arguments_of(
    planned: "Plan", options: Mapping[str, Any], records: list[Path]
) -> dict[str, Any]:
    """What `identify` is called with: the plan, and all that it does not settle."""
    left = {
        name: value
        for name, value in options.items()
        if name not in {*planned.options, "ocv", "validate", "window"}
    }
    return {**left, "records": planned, "command": _command(planned, records)}


def _command(planned: "Plan", records: list[Path]) -> list[str]:
    """The command that does the same without planning, of the same files where they are cut."""
    from ..model.window import OPTIONS as WINDOW_OPTIONS

    settled = {**APPEARANCE, "--report": 1, "--paper": 1, "--plan": 1}
    served = [part for part in planned.parts if part.role != "not used"]
    if any(part.span_s for part in served):
        names = dict.fromkeys(part.path.name for part in served)
        kept = without_options(sys.argv[2:], settled)
        return ["barnax", "identify", *names, *(w for w in kept if Path(w) not in records)]
    words = [part.name for part in planned.of_role("identification")]
    words += [word for part in planned.of_role("OCV test") for word in ("--ocv", part.name)]
    words += [word for part in planned.of_role("validation") for word in ("--validate", part.name)]
    for part in planned.parts:
        words += _window_words(part)
    for name, value in planned.options.items():
        if not (name == "over" and planned.command == "hppc"):
            words += [f"--{name.replace('_', '-')}", _written(value)]
    flags = [*WINDOW_OPTIONS, *PLANNED, "ocv", "validate"]
    settled |= {f"--{name.replace('_', '-')}": 2 for name in flags}
    kept = without_options(sys.argv[2:], settled)
    return ["barnax", planned.command, *words, *(w for w in kept if Path(w) not in records)]


def _window_words(part: "Part") -> list[str]:
    from ..model.window import OPTIONS as WINDOW_OPTIONS

    words = []
    for option, (name, *_) in WINDOW_OPTIONS.items():
        value = getattr(part.window, name)
        if value is not None:
            words += [f"--{option.replace('_', '-')}", f"{part.name}={_written(value)}"]
    return words


def _written(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
