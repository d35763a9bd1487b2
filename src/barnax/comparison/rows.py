"""Models and methods side by side on one cell: what each row of a comparison is."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..descent import RefinedSeed
from ..evaluate import Evaluation
from ..methods import Answer, Budget
from ..optimum import GlobalOptimum
from ..problem import Problem
from .statistics import BandError, Resampled, SeedPairs


@dataclass(frozen=True, eq=False)
class Row:
    """One method on one model. Everything but `refined` is of the method's own answers.

    `answers` holds one answer a seed, a single one where the method draws nothing, and none where
    it failed; then `failure` says why. `evaluations` are those of the median seed: on the
    identification record, then on each validation record. `bands` are its errors by SOC, a tuple
    for each of these records; `at_bound` names what is at an end of the box. `refined` is what
    Levenberg-Marquardt makes of the median seed; `regret` is the median seed's RMSE over the
    global optimum's, minus one.
    """

    model: str
    method: str
    problem: Problem
    is_deterministic: bool
    answers: tuple[Answer, ...] = ()
    failure: str | None = None
    notes: tuple[str, ...] = ()
    evaluations: tuple[Evaluation, ...] = ()
    bands: tuple[tuple[BandError, ...], ...] = ()
    at_bound: tuple[str, ...] = ()
    refined: RefinedSeed | None = None
    regret: float | None = None

    @property
    def name(self) -> str:
        return f"{self.method} {self.model}"

    @property
    def median(self) -> Answer:
        """The seed whose RMSE is the median; of an even number, the better of the middle two."""
        ranked = sorted(self.answers, key=lambda answer: answer.rmse_v)
        return ranked[(len(ranked) - 1) // 2]

    @property
    def best(self) -> Answer:
        return min(self.answers, key=lambda answer: answer.rmse_v)

    @property
    def errors_v(self) -> Float[np.ndarray, "seeds"]:
        """RMSE of every seed, in V, in the order of the seeds."""
        return np.array([answer.rmse_v for answer in self.answers])


@dataclass(frozen=True)
class Difference:
    """The error of one row minus another's, on one record, and whether it is more than chance.

    `first` and `second` are row names. `over_time` resamples blocks of samples; `over_seeds`
    pairs the seeds on the identification record, and is None elsewhere and where neither row
    draws anything.
    """

    first: str
    second: str
    record: str
    is_validation: bool
    over_time: Resampled
    over_seeds: SeedPairs | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """All rows of a comparison, in the order asked for, and the differences between them.

    `optima` are the models' global optima, where they can be known.
    """

    rows: tuple[Row, ...]
    budget: Budget
    differences: tuple[Difference, ...]
    optima: Mapping[str, GlobalOptimum]

    @property
    def answered(self) -> tuple[Row, ...]:
        """The rows that have an answer."""
        return tuple(row for row in self.rows if row.failure is None)
