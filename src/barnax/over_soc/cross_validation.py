"""What tables over SOC are worth on blocks of samples that were held out of their fit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from ..cell.soc_axis import is_above
from ..model.prepared import PreparedRecord
from .objective import Objective, Solution
from .reduced import Groups, Reduced
from .search import find_best, least_in_box
from .settings import TableSettings

# Blocks that a fold holds of a record at least, unless they would be shorter than what residuals
# are correlated over.
FEWEST_BLOCKS, SHORTEST_BLOCK_S = 5, 30.0
# An extra is worth its parameters where it lowers both held-out errors by more than this share.
WORTHWHILE = 0.1
# And by more than this: less than voltmeters tell is no reason for another circuit.
LEAST_GAIN_V = 1e-4


@dataclass(frozen=True)
class SocErrors:
    """RMSE over all samples that count, and over those above 10 % SOC; None without such."""

    rmse_v: float
    above_v: float | None

    @classmethod
    def of(cls, parts: Iterable[tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]]):
        """Those of errors at states of charge, part after part."""
        squares_v2, counts = np.zeros(2), np.zeros(2, int)
        for error_v, soc in parts:
            group = is_above(soc).astype(int)
            squares_v2 += np.bincount(group, error_v**2, minlength=2)
            counts += np.bincount(group, minlength=2)
        return cls.of_squares(squares_v2, counts)

    @classmethod
    def of_squares(cls, squares_v2: Float[np.ndarray, "2"], counts: Int[np.ndarray, "2"]):
        """Those of the sums of squares below 10 % SOC and above, of so many samples."""
        above_v = float(np.sqrt(squares_v2[1] / counts[1])) if counts[1] else None
        return cls(float(np.sqrt(squares_v2.sum() / counts.sum())), above_v)

    def is_worth(self, simpler: "SocErrors") -> bool:
        """Whether it is lower than a simpler circuit's by more than `WORTHWHILE` in both."""

        def falls(own_v: float | None, other_v: float | None) -> bool:
            if own_v is None or other_v is None:
                return True
            return own_v < min((1 - WORTHWHILE) * other_v, other_v - LEAST_GAIN_V)

        return falls(self.rmse_v, simpler.rmse_v) and falls(self.above_v, simpler.above_v)


@dataclass(frozen=True)
class CrossValidation:
    """Errors on blocks that were held out of the fit, of the tables and of the constant circuit.

    Each of the `folds` holds every `folds`-th block of every record, the longest of them of
    `block_s` seconds. Time constants are those of all samples; what is linear is fitted in each
    fold anew. The constant circuit is the same one with one value for every SOC and no OCV
    correction.
    """

    folds: int
    block_s: float
    tables: SocErrors
    constant: SocErrors


def blocks_of(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> tuple[list[Groups], int]:
    """For each record what gives the groups of some samples, -1 where one is not scored, and how
    many groups there are.

    Two groups a fold: the samples below and above 10 % SOC.
    """

    def group(here: slice, each: PreparedRecord, start_s: float) -> Int[np.ndarray, "samples"]:
        if not settings.folds:
            return np.where(each.scored[here], 0, -1)
        block_s = _block_s(each, settings)
        fold = np.floor((each.time_s[here] - start_s) / block_s).astype(int)
        groups = 2 * (fold % settings.folds) + is_above(each.soc[here])
        return np.where(each.scored[here], groups, -1)

    groups: list[Groups] = [
        partial(group, each=each, start_s=float(each.time_s[np.argmax(each.scored)]))
        for each in prepared_records
    ]
    return groups, 2 * settings.folds or 1


def _block_s(prepared: PreparedRecord, settings: TableSettings) -> float:
    """The length of a record's blocks: shorter ones where it has room for few in a fold, which
    would each hold out a range of SOC that no other sample visits."""
    room_s = prepared.scored_duration_s / (settings.folds * FEWEST_BLOCKS)
    return min(settings.block_s, max(room_s, SHORTEST_BLOCK_S))


def cross_validate(objective: Objective, best: Solution) -> CrossValidation | None:
    """The held-out errors of a circuit.

    None where nothing is held out, or where all samples lie in one fold.
    """
    settings, parts = objective.settings, objective.parts
    if not _has_folds(objective):
        return None
    plain = replace(settings, nodes=(0.5,), ocv_correction=False)
    whole = replace(objective, reduced=objective.reduced.constant(), settings=plain)
    flat = [part.constant() for part in parts]
    return CrossValidation(
        settings.folds,
        max(_block_s(each, settings) for each in objective.prepared_records),
        _held_out(objective, best, parts),
        _held_out(whole, find_best(whole), flat),
    )


def held_out_errors(objective: Objective, best: Solution) -> SocErrors | None:
    """The errors on held-out blocks alone; None as `cross_validate` has it."""
    return _held_out(objective, best, objective.parts) if _has_folds(objective) else None


def _has_folds(objective: Objective) -> bool:
    if not objective.settings.folds:
        return False
    scored = np.reshape([part.scored for part in objective.parts], (-1, 2)).sum(axis=1)
    return bool(np.count_nonzero(scored) > 1)


def _held_out(objective: Objective, best: Solution, parts: Sequence[Reduced]) -> SocErrors:
    folds = objective.settings.folds
    # Of every group's factor only the columns at one place are wanted.
    columns, bases = zip(
        *(replace(objective, reduced=part).columns(best.place) for part in parts), strict=True
    )
    scored = np.array([part.scored for part in parts])
    squares = np.zeros(len(parts))
    for fold in range(folds):
        is_rest = np.arange(len(parts)) // 2 != fold
        rest = np.flatnonzero(is_rest & (scored > 0))
        share = scored[rest] / scored[rest].sum()
        normal, gradient = objective.penalty_normal.copy(), np.zeros(len(objective.penalty_normal))
        for each, at in zip(share, rest, strict=True):
            normal += each * columns[at].T @ columns[at]
            gradient += each * columns[at].T @ bases[at]
        x, _ = least_in_box(normal, gradient, *objective.box, best.sides)
        for at in np.flatnonzero(~is_rest):
            squares[at] = scored[at] * np.sum((bases[at] + columns[at] @ x) ** 2)
    return SocErrors.of_squares(*(each.reshape(-1, 2).sum(axis=0) for each in (squares, scored)))
