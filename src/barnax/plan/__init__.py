"""What a folder of a cycler's files is for: roles, windows and options, chosen with reasons."""

from .choosing import plan
from .parts import ROLES, Part, Plan
from .running import arguments, plan_of, plans_first
from .text import plan_from_toml, plan_to_toml

__all__ = [
    "ROLES",
    "Part",
    "Plan",
    "arguments",
    "plan",
    "plan_from_toml",
    "plan_of",
    "plan_to_toml",
    "plans_first",
]
