"""From a cycler's file to a checked record, in one straight line."""

import hashlib
import os
from pathlib import Path
from typing import Literal

from ..errors import LARGEST_FILE, InputError
from .conventions import CHARGE, DISCHARGE, Sign, decide_hold, decide_sign
from .plausibility import check_samples
from .readers import read_table
from .record import Decision, Hold, Record
from .samples import Samples, take_samples


def read_record(
    path: str | Path,
    *,
    current_sign: Sign | Literal["auto"] = "auto",
    current_hold: Hold | Literal["auto"] = "auto",
) -> Record:
    """The record in a cycler's file, with discharge current positive.

    `current_sign` is the file's own ("charge-positive" or "discharge-positive"), `current_hold`
    says whether a sample's current flowed "forward" or "backward" in time; "auto" finds both.

    Raises InputError when the file cannot be read or its content cannot be one cell's record,
    and when the given sign contradicts strong evidence.

    >>> import pathlib, tempfile
    >>> rows = "".join(f"{k},{-(k % 2)},{3.7 - 0.05 * (k % 2)}\\n" for k in range(20))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "pulses.csv")
    ...     _ = file.write_text("Time [s],Current [mA],Voltage [V]\\n" + rows)
    ...     record = read_record(file)
    >>> record.sign.value, float(record.current_a.max())
    ('charge-positive', 0.001)
    """
    _check_option("--current-sign", current_sign, ("auto", CHARGE, DISCHARGE))
    _check_option("--current-hold", current_hold, ("auto", "forward", "backward"))
    path = Path(path)
    content = read_content(path)
    samples = check_samples(take_samples(read_table(content, path.name), path.name))
    sign, sign_warnings = decide_sign(samples, current_sign)
    hold = decide_hold(samples, current_hold)
    return make_record(samples.warn(*sign_warnings), sign, hold, content)


def make_record(samples: Samples, sign: Decision, hold: Decision, content: bytes) -> Record:
    """The record of checked samples, turned to discharge-positive; `content` is the file's."""
    return Record(
        name=samples.file,
        time_s=samples.time_s,
        # Adding zero makes the -0.0 of a resting tester a plain zero.
        current_a=samples.current_a * (-1.0 if sign.value == CHARGE else 1.0) + 0.0,
        voltage_v=samples.voltage_v,
        temperature_degc=samples.temperature_degc,
        step=samples.step,
        row=samples.row,
        sign=sign,
        hold=hold,
        sha256=hashlib.sha256(content).hexdigest(),
        warnings=samples.warnings,
    )


def _check_option(option: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"{option} is {value!r}; it must be one of {', '.join(allowed)}.")


def read_content(path: Path) -> bytes:
    """A file's bytes. Raises InputError where it is not there, too large, or cannot be read."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            # A pipe or a device has no size, and the latter no end.
            content = b"" if size > LARGEST_FILE else file.read(size or LARGEST_FILE + 1)
    except IsADirectoryError:
        raise InputError(
            f"{path.name}: is a directory; give one file of measured samples."
        ) from None
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}).") from error
    if max(size, len(content)) > LARGEST_FILE:
        raise InputError(
            f"{path.name}: is larger than the {LARGEST_FILE / 1e9:g} GB that are read; give a part "
            "of the record."
        )
    return content
