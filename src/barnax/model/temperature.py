"""The temperature that a record or an OCV test is of."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

from ..cell import OcvTable
from ..cell.model import group_near
from ..errors import InputError
from ..records import Record
from ..records.record import degc_in_name
from ..settings import Window


def temperature_of(
    record: Record, window: Window, samples: slice | Int[np.ndarray, "_"] = slice(None)
) -> float | None:
    """The temperature given for a record in degC, else the median of those measured, else that in
    its name, if any."""
    if window.temperature_degc is not None:
        return window.temperature_degc
    measured = np.empty(0) if record.temperature_degc is None else record.temperature_degc[samples]
    known = measured[np.isfinite(measured)]
    return float(np.median(known)) if len(known) else degc_in_name(record.name)


def group_tests(
    tests: Sequence[Record | OcvTable], window: Window | Mapping[str, Window] | None
) -> dict[float, list[Record | OcvTable]]:
    """OCV tests by temperature in degC; nothing where they are of one or of none that is known.

    Raises `InputError` for one of unknown temperature beside others of several.
    """
    own = window if isinstance(window, Mapping) else {}
    degc = [
        temperature_of(test, own.get(test.name, Window()))
        if isinstance(test, Record)
        else own[test.name].temperature_degc
        if test.name in own
        else degc_in_name(test.name)
        for test in tests
    ]
    pairs = list(zip(degc, tests, strict=True))
    found = group_near((known, test) for known, test in pairs if known is not None)
    if len(found) < 2:
        return {}
    for known, test in pairs:
        if known is None:
            raise InputError(
                f"{test.name}: has no column of temperatures, and the other OCV tests are of "
                "several; say it with `temperature`"
            )
    return found
