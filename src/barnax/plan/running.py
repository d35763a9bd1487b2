"""A plan run: `identify` given a folder, a plan, or files without an OCV test."""

import functools
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..gather import Reading, listed, unwatched
from ..model.window import Window
from ..records import read_source
from ..results import Result
from .choosing import plan
from .parts import Part, Plan, Use
from .pulse_tests import prepare_pulse_tests
from .text import plan_from_toml

Run = Callable[..., Result]


def plan_of(records: Any, ocv: Any = (), validate: Any = (), **options: Any) -> Plan | None:
    """The plan of what `identify` was given, None where the files' roles are all given.

    There is one for a folder, a plan or its TOML file, and for files without an OCV test of a cell
    that is not known. Of
    `options` those matter that say how files are read.
    """
    given = listed(records)
    if options.get("cell") is not None:
        return None
    if len(given) == 1 and isinstance(given[0], Plan):
        return given[0]
    paths = [Path(each) for each in given if isinstance(each, str | Path)]
    if len(given) == len(paths) == 1 and paths[0].suffix.lower() == ".toml":
        return plan_from_toml(paths[0])
    if not any(map(os.path.isdir, paths)) and (not paths or listed(ocv)):
        return None
    if len(paths) < len(given):
        return None
    reading = options.get("reading") or Reading(columns=options.get("columns", ""))
    watch = options.get("watch", unwatched)
    over = options.get("over")
    return plan(given, ocv=ocv, validate=validate, over=over, reading=reading, watch=watch)


def plans_first(identify: Run) -> Run:
    """`identify`, which makes a plan first where it is given a folder or no OCV test."""

    @functools.wraps(identify)
    def planned(records: Any = (), *, ocv: Any = (), validate: Any = (), **options: Any) -> Result:
        found = plan_of(records, ocv, validate, **options)
        if found is None:
            return identify(records, ocv=ocv, validate=validate, **options)
        result = identify(**arguments(found, **options))
        return result.model_copy(update={"plan": found.stored})

    return planned


def arguments(
    found: Plan, *, window: Any = None, capacity: float | None = None, **options: Any
) -> dict[str, Any]:
    """What `identify` is given for a plan; options that are given replace the plan's.

    Raises `InputError` where a test is missing.
    """
    if found.missing:
        raise InputError("\n".join([found.missing, *found.lines]))
    found = found.changed(window, capacity=capacity)
    windows = {
        each.name: each.window
        for each in found.parts
        # Of an OCV test its temperature counts.
        if each.is_simulated or each.window.temperature_degc is not None
    }
    # Windows for names that are not simulated are refused further on.
    others = dict(window) if isinstance(window, Mapping) else {"": window or Window()}
    given = {
        **found.options,
        **options,
        "records": _sources(found, "identification"),
        "ocv": _sources(found, "OCV test"),
        "window": {**others, **windows},
    }
    validate = _sources(found, "validation")
    if found.command == "hppc":
        given = prepare_pulse_tests(**given)
    return {**given, "validate": validate}


def _sources(found: Plan, role: Use) -> list[Any]:
    return [_source(part) for part in found.of_role(role)]


def _source(part: Part) -> Any:
    if part.source is not None or part.span_s is None:
        return part.source or part.path
    return replace(read_source(part.path), name=part.name, span_s=part.span_s)
