"""A pulse test (HPPC) identified: capacity and OCV from its own rests, tables over SOC."""

from collections.abc import Mapping, Sequence
from typing import Any

from .bundled import BUNDLED
from .gather import Given, Reading, Watch, listed, unwatched
from .model.window import Window
from .pipeline import identify
from .plan.pulse_tests import prepare_pulse_tests
from .results import Result


def hppc(
    records: Given | Sequence[Given] = (),
    *,
    ocv: Given | Sequence[Given] = (),
    validate: Given | Sequence[Given] = (),
    window: Window | Mapping[str, Window] | None = None,
    capacity: float | None = None,
    reading: Reading | None = None,
    watch: Watch = unwatched,
    **options: Any,
) -> Result:
    """The tables over SOC that one or several pulse tests show, and every pulse's resistances.

    As `identify` with tables over SOC, which see for all other options; tests at several
    temperatures give tables for each. Pulses and rests are found in the records. Without `ocv` the
    rests of the test are the OCV, interpolated, and of several tests of one temperature those of
    the first; the charge between its ends is the capacity, where none is given. A simulation starts
    at the end of the rest before the first pulse, unless `window` says otherwise. Without any
    record the bundled cell's test at 25 degC is identified and validated on its trips.

    Raises `InputError` where a record has no pulses, and where `identify` does.
    """
    if not listed(records):
        records, validate = BUNDLED.hppc[1], validate or BUNDLED.validation
    prepared = prepare_pulse_tests(
        records, ocv=ocv, window=window, capacity=capacity, reading=reading, watch=watch, **options
    )
    return identify(validate=validate, **prepared)
