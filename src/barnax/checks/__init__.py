"""What is wrong with a file, what mends it, and what it can serve as."""

from .check_file import Facts, FileCheck, check_file
from .check_input import Check, CheckInput
from .finding import Finding, Severity
from .registry import CHECKS
from .roles import Role

__all__ = [
    "CHECKS",
    "Check",
    "CheckInput",
    "Facts",
    "FileCheck",
    "Finding",
    "Role",
    "Severity",
    "check_file",
]
