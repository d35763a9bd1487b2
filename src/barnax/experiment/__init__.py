"""The next test to run: the information in a current, and the test that gives what is wanted."""

from .next_test import design as design
from .protocol import Block as Block
from .protocol import Limits as Limits
from .protocol import Step as Step
from .protocol import candidate_blocks as candidate_blocks
from .stored import Design as Design
