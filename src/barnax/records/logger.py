"""How a logger samples a changing current: decided once over all its records."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..errors import counted

Hold = Literal["forward", "backward", "centered"]
Strength = Literal["given", "strong", "weak", "assumed"]
Rows = Literal["instants", "means", "open"]

# Rows are instantaneous samples if the correlation is above the first value by the second one over
# the root of the number of rows, and innovations have at least the third share of the voltage's
# changes; they are means if the correlation is below the last value. That of noise alone is -1/2,
# that of means about -0.6.
_INSTANTS, _MORE, _MOVES, _MEANS = -0.455, 0.5, 0.02, -0.54
# From this interval on, if the current differs from both its neighbors in the first share of the
# samples under load, it also changed between them, unless the voltage contradicts that. Above the
# second share it may have; so does a load in time with its log.
ALONE, SOMETIMES = 0.35, 0.05


@dataclass(frozen=True)
class Decision:
    """A decision about a file, its strength, and the reason in words for the user."""

    value: str
    strength: Strength
    reason: str


@dataclass(frozen=True)
class SlowRows:
    """Sums over slow records that show whether their load changes between the rows.

    Attributes:
        loaded: Rows under load.
        alone: Those of them whose current differs from both neighbors'.
        through: Changes of the load through a row between both levels, where most are.
        rows: Rows whose voltage a regression on the current was fitted to.
        correlation: The sum over them of the correlation of its residuals with the next.
        innovation: So of the residual's random walk, as a share of what the voltage moves.
    """

    loaded: int = 0
    alone: int = 0
    through: int = 0
    rows: int = 0
    correlation: float = 0.0
    innovation: float = 0.0

    def __add__(self, other: "SlowRows") -> "SlowRows":
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return SlowRows(*(one + another for one, another in pairs))

    @property
    def kind(self) -> Rows:
        """What the rows are, if the load changes between them."""
        if self.through:
            return "means"
        if not self.rows:
            return "open"
        correlation = self.correlation / self.rows
        least = _INSTANTS + _MORE / self.rows**0.5
        if correlation > least and self.innovation / self.rows > _MOVES:
            return "instants"
        return "means" if correlation < _MEANS else "open"

    @property
    def changes_between(self) -> bool:
        """True if the load changes between rows."""
        if self.through or self.kind == "instants":
            return True
        # For a load in time with its log, the residuals of the voltage are only noise.
        is_noise = self.rows > 0 and _MEANS <= self.correlation / self.rows <= _INSTANTS
        return self.alone >= ALONE * max(self.loaded, 1) and not is_noise


@dataclass(frozen=True)
class SamplingEvidence:
    """The evidence of one record about its logger's sampling of the current.

    Attributes:
        header: The names of its columns: records with the same are of one logger.
        name: The record's.
        proof: What its counters, or else its columns or its make, say.
        slow: What a slow record shows; None where the load seldom changes from row to row.
    """

    header: tuple[str, ...]
    name: str
    proof: Decision | None = None
    slow: SlowRows | None = None


@dataclass(frozen=True)
class Logger:
    """The sampling of the current by one logger.

    Attributes:
        header: The names of its columns.
        proof: The sampling that its records, columns or make prove; None where they do not agree.
        slow: The sums over its slow records.
        slow_records: How many these are.
    """

    header: tuple[str, ...]
    proof: Decision | None
    slow: SlowRows
    slow_records: int

    @classmethod
    def of(cls, evidence: Sequence[SamplingEvidence]) -> "Logger":
        """The logger of records that have the same one."""
        proofs = [(one.proof, one.name) for one in evidence if one.proof is not None]
        strong = [pair for pair in proofs if pair[0].strength == "strong"]
        firm = strong or [pair for pair in proofs if pair[0].strength == "weak"]
        proof = None
        if firm and len({one.value for one, _ in firm}) == 1:
            first, name = firm[0]
            proof = replace(first, strength="weak", reason=f"in {name} {first.reason}")
        slow = [one.slow for one in evidence if one.slow is not None]
        return cls(evidence[0].header, proof, sum(slow, SlowRows()), len(slow))

    def sampling(self, evidence: SamplingEvidence) -> Decision:
        """The sampling of one of its records; proof by the record itself takes precedence."""
        proof = evidence.proof
        if proof is not None and (proof.strength == "strong" or self.proof is None):
            return proof
        if self.proof is not None:
            return proof if proof and proof.value == self.proof.value else self.proof
        pooled = "" if self.slow_records < 2 else f" in {counted(self.slow_records, 'record')}"
        if evidence.slow is not None and self.slow.changes_between:
            reason = (
                "the load changes from sample to sample, or passes through values between "
                f"two{pooled}"
            )
            return Decision("centered", "assumed", reason)
        reason = (
            "no counters prove otherwise; `current_hold='backward'` is for testers that log a "
            "sample at the end of its interval"
        )
        if evidence.slow is not None and self.slow.alone >= ALONE * self.slow.loaded:
            reason = f"the load changes with the samples, for the voltage leaves only noise{pooled}"
        return Decision("forward", "assumed", reason)


# By the names of the columns in their files.
Loggers = Mapping[tuple[str, ...], Logger]


def loggers_of(records: Iterable[Any]) -> dict[tuple[str, ...], Logger]:
    """The loggers of some records, by the names of their columns; none for anything that is not a
    record."""
    groups: dict[tuple[str, ...], list[SamplingEvidence]] = {}
    for record in records:
        evidence = getattr(record, "evidence", None)
        if evidence is not None:
            groups.setdefault(evidence.header, []).append(evidence)
    return {header: Logger.of(group) for header, group in groups.items()}
