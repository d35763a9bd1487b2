"""Which circuit is the answer: a family of circuits, one rule, and what was tried."""

from .choose import Choice as Choice
from .choose import Fitted as Fitted
from .choose import Tried as Tried
from .choose import choose as choose
from .family import Limits as Limits
from .family import Point as Point
from .family import limits_of as limits_of
from .policy import Gain as Gain
from .policy import Policy as Policy
