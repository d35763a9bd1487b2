"""Checks of a file: what is wrong with it, how to mend it, and what it can serve as."""

from .check_file import CHECKS, FileCheck, check_file
from .roles import Role

__all__ = ["CHECKS", "FileCheck", "Role", "check_file"]
