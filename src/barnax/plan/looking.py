"""What each file is: read once, checked, and told by what the checks found."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell import OcvTable, read_ocv_test
from ..checks import FileCheck, Role, check_file
from ..checks.roles import STEPS, Traits
from ..errors import InputError, printable
from ..gather import Reading, Watch, file_names, source_of
from ..model.window import Window
from ..records import Record, Source, read_record
from ..records.columns import is_ocv_table

# Kinds of tests that have a role.
SERVING = ("OCV test", "slow sweep", "pulse test", "drive cycle")
# What lies in a folder beside measured files, and is no candidate for one.
_BESIDE = (".toml", ".json")
_TEMPORARY = (".", "~$")
# Quantiles of the current by which two profiles are told apart, and by how much of the larger peak
# they differ on average.
_QUANTILES = np.linspace(0.05, 0.95, 19)
_ANOTHER = 0.05


@dataclass(frozen=True, eq=False)
class Seen:
    """One file that was looked at; `refusal` says why it cannot be read, empty where it can.

    `check` is None for a table of OCV and for what cannot be read. `starts_full` says that the file
    shows a charge to full right before this part of it.
    """

    path: Path
    name: str
    source: Source | None = None
    check: FileCheck | None = None
    refusal: str = ""
    is_table: bool = False
    starts_full: bool = False

    @property
    def traits(self) -> Traits | None:
        return None if self.check is None or self.refusal else self.check.traits

    @property
    def temperature_degc(self) -> float | None:
        return None if self.traits is None else self.traits.temperature_degc

    def role(self, name: str) -> Role | None:
        """A role that the checks found, usable or not."""
        roles = self.check.roles if self.check else ()
        return next((role for role in roles if role.name == name), None)

    def kind(self, capacity_ah: float | None) -> str:
        """What it is, of a cell of that capacity."""
        if self.refusal:
            return "unreadable"
        return "OCV table" if self.traits is None else self.traits.kind(capacity_ah)

    def lacks(self, capacity_ah: float | None, fewest: int = STEPS) -> str:
        """What it lacks to be simulated, in words."""
        return "" if self.traits is None else self.traits.lacks(capacity_ah, fewest)

    @property
    def warnings(self) -> int:
        """How many things are wrong with it."""
        findings = self.check.findings if self.check else ()
        return sum(finding.counts for finding in findings)

    @cached_property
    def record(self) -> Record:
        return read_record(self._source)

    @cached_property
    def ocv_test(self) -> Record | OcvTable:
        return read_ocv_test(self._source) if self.is_table else self.record

    @property
    def _source(self) -> Source:
        assert self.source is not None, "what cannot be read is asked for nothing"
        return self.source

    @property
    def window(self) -> Window:
        """The window that the checks suggest."""
        role = self.role("validation")
        suggested = role.window if role else None
        if suggested is None:
            return Window()
        window = Window(**suggested.options)
        if self.starts_full and window.start_after_step is None:
            return replace(window, start_time_s=None, initial_soc=1.0)
        return window

    @property
    def is_settled(self) -> bool:
        """Whether its profile begins with the cell at rest."""
        role = self.role("validation")
        return bool(role and role.window and role.window.is_settled)

    @cached_property
    def _quantiles_a(self) -> Float[np.ndarray, "quantiles"]:
        record, steps = self.record, self.window.score_steps
        is_scored = np.ones(record.samples, bool)
        if steps is not None and record.step is not None:
            is_scored = np.isin(record.step, steps)
        return np.quantile(record.current_a[is_scored], _QUANTILES)

    def is_like(self, other: "Seen") -> bool:
        """Whether both play the same profile, by how the current is distributed."""
        peak_a = max(np.abs(each._quantiles_a).max() for each in (self, other))
        apart_a = np.abs(self._quantiles_a - other._quantiles_a).mean()
        return bool(apart_a <= _ANOTHER * peak_a)


def files_of(sources: Sequence[Any]) -> list[Any]:
    """The files of what was given, folders replaced by what lies in them.

    Raises `InputError` for a folder without files.
    """
    found: list[Any] = []
    for each in sources:
        if not isinstance(each, str | Path) or not os.path.isdir(each):
            found.append(each)
            continue
        inside = [
            path
            for path in sorted(Path(each).iterdir())
            if path.is_file()
            and not path.name.startswith(_TEMPORARY)
            and path.suffix.lower() not in _BESIDE
        ]
        if not inside:
            raise InputError(
                f"{printable(str(each))}: has no files; give the folder with the records of a cell"
            )
        found += inside
    return found


def look(sources: Sequence[Any], reading: Reading, watch: Watch) -> Iterator[Seen]:
    """Every file once, in the order given. One that cannot be read is told as such."""
    names = file_names([each for each in sources if isinstance(each, str | Path)])
    for each in sources:
        name = each.name if isinstance(each, Source) else names[Path(each)]
        path = Path(name) if isinstance(each, Source) else Path(each)
        with watch(f"Looking at {name}", 0):
            yield _look_at(each, path, name, names, reading)


def _look_at(
    given: Any, path: Path, name: str, names: Mapping[Path, str], reading: Reading
) -> Seen:
    try:
        source = source_of(given, names, reading.columns)
    except InputError as problem:
        return Seen(path, name, refusal=str(problem))
    return look_at_source(path, source)


def look_at_source(path: Path, source: Source) -> Seen:
    """What was read of a file, checked."""
    name = source.name
    seen = Seen(path, name, source)
    try:
        if is_ocv_table(source.table.header):
            table = replace(seen, is_table=True)
            _ = table.ocv_test
            return table
        check = check_file(source)
    except InputError as problem:
        return replace(seen, refusal=str(problem))
    error = next((one for one in check.findings if one.severity == "error"), None)
    seen = replace(seen, check=check)
    if error is not None or check.traits is None:
        too_little = f"{name}: holds too few samples that can be read"
        return replace(seen, refusal=error.sentence(name) if error else too_little)
    return seen
