"""How a logger samples a current that changes: decided once, over all records of one logger."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..errors import counted

Hold = Literal["forward", "backward", "centered"]
Strength = Literal["given", "strong", "weak", "assumed"]
Rows = Literal["instants", "means", "open"]

# A correlation above this, by so much more over the root of the rows, and innovations of so much of
# what the voltage moves are of instants; a correlation below the last is of means. That of noise
# alone is -1/2, and that of means about -0.6.
_INSTANTS, _MORE, _MOVES, _MEANS = -0.455, 0.5, 0.02, -0.54
# From this interval on, a current that differs from both its neighbors in so many of the samples
# under load also changed between them, unless the voltage is against it. In a larger share than the
# second it may have; a load in time with its log does too.
ALONE, SOMETIMES = 0.35, 0.05


@dataclass(frozen=True)
class Decision:
    """A decision about a file, how firm it is, and why, in words for the user."""

    value: str
    strength: Strength
    reason: str


@dataclass(frozen=True)
class SlowRows:
    """Sums over slow records of what shows whether their load changes between the rows.

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
        """What the rows are, where the load changes between them."""
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
        # Of a load in time with its log the voltage leaves no more than noise.
        is_noise = self.rows > 0 and _MEANS <= self.correlation / self.rows <= _INSTANTS
        return self.alone >= ALONE * max(self.loaded, 1) and not is_noise


@dataclass(frozen=True)
class SamplingEvidence:
    """What one record shows of how its logger samples the current.

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
        """The logger of some records, which is one."""
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
        """The sampling of one of its records; what the record itself proves is its own."""
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
    """The loggers of some records, by the names of their columns; of what is no record, none."""
    groups: dict[tuple[str, ...], list[SamplingEvidence]] = {}
    for record in records:
        evidence = getattr(record, "evidence", None)
        if evidence is not None:
            groups.setdefault(evidence.header, []).append(evidence)
    return {header: Logger.of(group) for header, group in groups.items()}
