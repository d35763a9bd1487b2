"""The data doctor: what is wrong with a file, what mends it, and what it can serve as."""

from .case import Case, Check
from .diagnose import Diagnosis, Facts, diagnose
from .finding import Finding, Severity
from .registry import CHECKS
from .roles import Role

__all__ = [
    "CHECKS",
    "Case",
    "Check",
    "Diagnosis",
    "Facts",
    "Finding",
    "Role",
    "Severity",
    "diagnose",
]
