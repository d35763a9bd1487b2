"""A plan in the making: the decisions so far on every file, and the words for them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ..model.window import Window
from .document import ROLES, SIMULATED, Part, Use
from .looking import CandidateFile
from .ocv import SHOWN, OcvChoice, Started, ocv_reason

# What moves so many times the charge of a cell is of another.
_BEYOND = 1.2


@dataclass(eq=False)
class Draft:
    """The decisions so far: a role, a reason and a window for some of the files.

    `given_ah` is the capacity that was given, `is_over` whether all temperatures are asked for.
    """

    files: Sequence[CandidateFile]
    given_ah: float | None = None
    is_over: bool = False
    taken: dict[CandidateFile, tuple[Use, str, Window]] = field(default_factory=dict)
    capacity_ah: float | None = None
    tests: dict[CandidateFile, None] = field(default_factory=dict)
    starts: dict[CandidateFile, Started] = field(default_factory=dict)

    def window(self, file: CandidateFile) -> Window:
        """The window of a record: from its start on, where that was looked for."""
        return self.starts[file].window if file in self.starts else file.window

    def take(self, file: CandidateFile, role: Use, reason: str) -> None:
        """Settle a file's role, unless it is settled; what is simulated has its window then."""
        window = self.window(file) if role in SIMULATED else Window()
        self.taken.setdefault(file, (role, reason, window))

    def take_tests(self, choice: OcvChoice) -> None:
        """Settle the files of an OCV test."""
        self.tests |= dict.fromkeys(choice.tests)
        for test in choice.tests:
            self.take(test, "OCV test", ocv_reason([test]))

    def tell_temperatures(self) -> None:
        """Put the temperature that a name tells into the windows of records without a column."""
        for file, (role, reason, window) in self.taken.items():
            is_open = role != "not used" and window.temperature_degc is None
            if is_open and file.traits and file.record.temperature_degc is None:
                window = replace(window, temperature_degc=file.temperature_degc)
                self.taken[file] = role, reason, window

    def parts(self) -> tuple[Part, ...]:
        """Every file: those that serve first, by their role, the best to identify on first.

        Pulse tests have the OCV of their rests, but beside an OCV test they are named as one too.
        """
        parts = []
        best = [file for file, (role, *_) in self.taken.items() if role == "identification"]
        is_given = any(role == "OCV test" for role, *_ in self.taken.values())
        for file in dict.fromkeys((*best, *self.files)):
            role, reason, window = self.taken[file]
            part = Part(
                file.path,
                file.name,
                role,
                file.kind(self.capacity_ah),
                reason,
                window,
                span_s=file.source and file.source.span_s,
                temperature_degc=file.temperature_degc,
                plans_soc=window.initial_soc is not None and file.chosen.initial_soc is None,
                source=None if role == "not used" else file.source,
                sha256=file.source.sha256 if file.source else "",
            )
            parts.append(part)
            if is_given and role == "identification" and file in self.tests:
                why = ocv_reason([file])
                parts.append(replace(part, role="OCV test", reason=why, window=Window()))
        return tuple(sorted(parts, key=lambda part: ROLES.index(part.role)))


def reach_ah(file: CandidateFile) -> float:
    return file.traits.reach_ah if file.traits else 0.0


def why_useless(file: CandidateFile, capacity_ah: float | None) -> str:
    reason = file.missing_for(capacity_ah) or another_cell(file, capacity_ah)
    return reason or "no role is left for it"


def another_cell(file: CandidateFile, capacity_ah: float | None) -> str:
    """That a file moves more than the cell holds; empty where it does not."""
    if not capacity_ah or not file.traits or file.traits.span_ah <= _BEYOND * capacity_ah:
        return ""
    moved = f"it spans {file.traits.span_ah:.3g} Ah"
    return f"{moved}, and the cell of the OCV test holds {capacity_ah:.3g} Ah"


def words_of(draft: Draft, file: CandidateFile) -> str:
    """Why a record serves, as the checks say, and where its start is known from."""
    for name in ("identification", "validation"):
        role = file.role(name)
        if role is not None and role.is_usable:
            return role.reason + draft.starts.get(file, SHOWN).words
    return ""


def named_degc(degc: float | None) -> str:
    return "" if degc is None else f" at {degc:.3g} degC"
