"""A file's diagnosis: what was found in it, and what it can serve as."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .case import Case
from .finding import Finding
from .roles import Role


@dataclass(frozen=True)
class Facts:
    """What the record is, once mended so far as it could be."""

    samples: int
    first_s: float
    last_s: float
    interval_s: float
    voltage_v: tuple[float, float]
    charged_ah: float
    discharged_ah: float
    current_sign: str
    current_hold: str

    def to_dict(self) -> dict[str, Any]:
        """The facts as plain values, with units in the keys."""
        return {
            "samples": self.samples,
            "time [s]": [self.first_s, self.last_s],
            "median interval [s]": self.interval_s,
            "voltage [V]": list(self.voltage_v),
            "charged [A.h]": self.charged_ah,
            "discharged [A.h]": self.discharged_ah,
            "current sign": self.current_sign,
            "current hold": self.current_hold,
        }


@dataclass(frozen=True)
class Diagnosis:
    """What was found in one file. `facts` is None, and `roles` empty, where too little is left.

    `findings` are ordered by severity, then by row. The roles are those of the file once its
    errors are mended.
    """

    file: str
    findings: tuple[Finding, ...]
    facts: Facts | None
    roles: tuple[Role, ...]

    @property
    def is_clean(self) -> bool:
        """Whether nothing but notes was found."""
        return not any(finding.counts for finding in self.findings)

    def to_dict(self) -> dict[str, Any]:
        """The diagnosis as plain values."""
        return {
            "file": self.file,
            "clean": self.is_clean,
            "findings": [finding.to_dict() for finding in self.findings],
            "facts": self.facts.to_dict() if self.facts else None,
            "roles": {role.name: role.to_dict() for role in self.roles},
        }


def facts_of(case: Case) -> Facts:
    """The facts of a case."""
    record = case.record
    return Facts(
        samples=record.samples,
        first_s=float(record.time_s[0]),
        last_s=float(record.time_s[-1]),
        interval_s=float(np.median(record.interval_s)),
        voltage_v=(float(record.voltage_v.min()), float(record.voltage_v.max())),
        charged_ah=case.charged_ah,
        discharged_ah=case.discharged_ah,
        current_sign=record.sign.value,
        current_hold=record.hold.value,
    )
