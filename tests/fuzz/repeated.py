"""One test run on few examples by default, and on many behind the slow marker."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import SearchStrategy

EXAMPLES = [pytest.param(25, id="few"), pytest.param(500, id="many", marks=pytest.mark.slow)]


def repeated(examples: int, test: Callable[[Any], None], strategy: SearchStrategy) -> None:
    """Run `test` on that many examples, the slow ones of which hypothesis may not give up on."""

    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def test_one(example: Any) -> None:
        test(example)

    test_one()
