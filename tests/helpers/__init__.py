"""What several tests share."""

# The hook that checks shapes looks for it here.
from . import shape_checks as shape_checks
