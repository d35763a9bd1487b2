"""Checks of a file: what is wrong with it, how to repair it, and what it can be used for."""

from .check_file import CHECKS, FileCheck, check_file
from .roles import Role

__all__ = ["CHECKS", "FileCheck", "Role", "check_file"]
