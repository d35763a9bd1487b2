"""A pulse test (HPPC) identified: capacity and OCV from its own rests, tables over SOC."""

from collections.abc import Mapping, Sequence
from typing import Any

from .bundled import BUNDLED
from .inputs import Given, Reading, Watch, listed, unwatched
from .model.window import Window
from .pipeline import identify
from .plan.running import prepare_pulse_tests
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
    """Tables over SOC from one or several pulse tests, and the resistances of every pulse.

    Options are those of `identify`. Tests at several temperatures give tables for each
    temperature. Pulses and rests are found in the records. Without `ocv` the
    rests of the test are the OCV, interpolated; of several tests at one temperature, those of
    the first. The charge between its ends is the capacity, if none is given. A simulation starts
    at the end of the rest before the first pulse, unless `window` says otherwise.
    Without a record, the bundled cell's test at 25 degC is used, validated on its drive cycles.

    Raises `InputError` if a record has no pulses, and where `identify` does.
    """
    if not listed(records):
        records, validate = BUNDLED.hppc[1], validate or BUNDLED.validation
    prepared = prepare_pulse_tests(
        records, ocv=ocv, window=window, capacity=capacity, reading=reading, watch=watch, **options
    )
    return identify(validate=validate, **prepared)
