"""Plans for a folder of a cycler's files: roles, windows and options, chosen with reasons."""

from ..job import FileRole as FileRole
from .choosing import plan as plan
from .document import Plan as Plan
from .document import plan_from_toml as plan_from_toml
from .document import plan_to_toml as plan_to_toml
from .running import plan_given as plan_given
from .running import plan_of as plan_of
from .running import planned as planned
from .running import planned_window as planned_window
from .running import with_choices as with_choices
from .running import with_whole_paths as with_whole_paths
