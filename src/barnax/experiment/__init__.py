"""The next test to run: what a current would tell, and the test that tells what is wanted."""

from .blocks import Block as Block
from .blocks import candidate_blocks as candidate_blocks
from .next_test import design as design
from .protocol import Limits as Limits
from .protocol import Step as Step
from .stored import Design as Design
