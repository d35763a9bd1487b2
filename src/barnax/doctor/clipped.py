"""A current that stops at the end of its range."""

from collections.abc import Iterator

import numpy as np

from .case import Case
from .finding import Finding, counted
from .stuck import equal_runs

# Readings alike for so many samples, in so many places, at the largest or the smallest value.
_ALIKE, _FEWEST_PLACES = 4, 3
# Elsewhere under load hardly any are: a tester without noise repeats every value.
_ELSEWHERE, _FEWEST_ELSEWHERE = 0.02, 100
_LOADED = 0.05


def find_clipped_current(case: Case) -> Iterator[Finding]:
    """Currents that read exactly the largest value again and again, while others vary."""
    current_a = case.samples.current_a
    first, last = equal_runs(current_a)
    is_alike = last - first + 1 >= _ALIKE
    in_run = np.repeat(is_alike, last - first + 1)
    is_loaded = np.abs(current_a) > _LOADED * case.peak_a
    for limit_a in (current_a.max(), current_a.min()):
        at_limit = is_alike & (current_a[first] == limit_a)
        elsewhere = is_loaded & (current_a != limit_a)
        # Both ends of the range may be clipped.
        elsewhere &= current_a != -limit_a
        if abs(limit_a) <= _LOADED * case.peak_a or at_limit.sum() < _FEWEST_PLACES:
            continue
        if elsewhere.sum() < _FEWEST_ELSEWHERE or in_run[elsewhere].mean() > _ELSEWHERE:
            continue
        samples = int(np.sum((last - first + 1)[at_limit]))
        yield case.at(
            int(first[at_limit][0]),
            "error",
            f"the current stops at {limit_a:.6g} A: {samples} samples in "
            f"{counted(int(at_limit.sum()), 'place')} read exactly that, while other readings "
            "vary",
            "measure again with a wider range; --score-from, --score-to or --score-steps leave "
            "such rows out",
        )
