"""Which test to run next: what a current would tell, and the test that tells what is wanted."""

from .blocks import Block as Block
from .blocks import candidate_blocks as candidate_blocks
from .design import Design as Design
from .design import design as design
from .protocol import Limits as Limits
from .protocol import Step as Step
