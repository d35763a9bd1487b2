"""Plans for a folder of a cycler's files: roles, windows and options, chosen with reasons."""

from .choosing import plan
from .document import ROLES, Part, Plan, plan_from_toml, plan_to_toml
from .running import found_anywhere, plan_given, plan_of, planned, with_choices

__all__ = [
    "ROLES",
    "Part",
    "Plan",
    "found_anywhere",
    "plan",
    "plan_from_toml",
    "plan_given",
    "plan_of",
    "plan_to_toml",
    "planned",
    "with_choices",
]
