"""What is wrong with a file, what mends it, and what it can serve as."""

from ..records.findings import Finding, Severity
from .check_file import CHECKS, Facts, FileCheck, check_file
from .check_input import Check, CheckInput
from .roles import Role
from .windows import SuggestedWindow

__all__ = [
    "CHECKS",
    "Check",
    "CheckInput",
    "Facts",
    "FileCheck",
    "Finding",
    "Role",
    "Severity",
    "SuggestedWindow",
    "check_file",
]
