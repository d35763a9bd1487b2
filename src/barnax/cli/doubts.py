"""What `barnax check` would say of the files of a run, where that puts the run in doubt."""

from collections.abc import Iterator
from pathlib import Path

from ..bundled import BUNDLED
from ..errors import InputError
from .inputs import Files
from .session import Session


def warn_of_doubts(
    session: Session, files: Files, capacity_ah: float | None, *, has_window: bool
) -> None:
    """Warn of errors in the files, roles they cannot serve in, and a window that is missing.

    `has_window` says that the user has chosen where the simulation starts or what is scored. The
    bundled cell is in no doubt.
    """
    if files.records == [BUNDLED.record]:
        return
    roles = [(path, "identification") for path in files.records]
    roles += [(path, "validation") for path in files.validation]
    with session.stage("Checking records"):
        texts = [
            text
            for path, role in roles
            for text in _doubts_of(path, files.names[path], role, capacity_ah, has_window)
        ]
    session.warn(texts)


def _doubts_of(
    path: Path, name: str, wanted: str, capacity_ah: float | None, has_window: bool
) -> Iterator[str]:
    from ..checks import check_file
    from .check_report import finding_line

    try:
        diagnosis = check_file(path, capacity_ah=capacity_ah)
    except InputError:
        # It was read, so what stands in the way of a diagnosis is no fault of the record.
        return
    for finding in diagnosis.findings:
        if finding.severity == "error":
            yield f"barnax check: {finding_line(name, finding)}"
    for role in diagnosis.roles:
        if role.name != wanted:
            continue
        if not role.is_usable:
            yield f"barnax check: {name} is not fit for {wanted}: {role.reason}"
        elif role.options and not has_window:
            yield f"barnax check proposes for {name}: {' '.join(role.options)}"
