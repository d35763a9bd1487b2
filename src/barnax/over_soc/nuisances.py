"""Nuisances of the records of one cell, estimated together with its tables under priors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from .intervals import UNSEEN, linearized, noises_behind, unsmoothed, with_penalty
from .objective import Solution, TableObjective

# Columns of the voltage by the nuisances of all records, at the scored samples of one.
Nuisances = Callable[[TableObjective, Solution, int], Float[np.ndarray, "samples nuisances"]]


class Measured(NamedTuple):
    """Single voltages, so combined that they have independent errors of one: what each nuisance
    adds to them, and how far they are above those of the nuisances now."""

    columns: Float[np.ndarray, "voltages nuisances"]
    error: Float[np.ndarray, "voltages"]


@dataclass(frozen=True)
class Estimated:
    """Nuisances relative to what was told, then the wanted sums of the tables' values, with their
    covariance, and the shifts of the searched scales' logarithms with them. `by_prior` is how far
    each moves with what was told of each nuisance, by one standard deviation. `log_evidence` is the
    logarithm of the probability of the records with these standard deviations, but for a constant
    of the records.
    """

    values: Float[np.ndarray, "estimates"]
    covariance: Float[np.ndarray, "estimates estimates"]
    moved_scales: Float[np.ndarray, "axes"]
    by_prior: Float[np.ndarray, "estimates nuisances"]
    log_evidence: float

    @property
    def errors(self) -> Float[np.ndarray, "estimates"]:
        """Standard errors."""
        return np.sqrt(np.diag(self.covariance))


def of_starts(
    objective: TableObjective, place: int, slope: Float[np.ndarray, "samples"]
) -> Float[np.ndarray, "samples nuisances"]:
    """The columns of a start and a capacity of every record, with the slope of the OCV by SOC."""
    prepared = objective.prepared_records[place]
    soc = prepared.soc[prepared.scored]
    columns = np.zeros((len(soc), 2 * len(objective.prepared_records)))
    columns[:, 2 * place] = slope
    columns[:, 2 * place + 1] = slope * (prepared.start.soc - soc)
    return columns


def estimate(
    objective: TableObjective,
    best: Solution,
    nuisances: Nuisances,
    now: Float[np.ndarray, "nuisances"],
    priors: Sequence[Float[np.ndarray, "nuisances"]],
    wanted: Float[np.ndarray, "wanted values"] | None = None,
    beside: Measured | None = None,
) -> list[Estimated]:
    """The nuisances of records that are prepared with those that are `now`, together with all
    tables, under every one of `priors`, standard deviations of what was told; `wanted` are weights
    of the tables' values in sums, and `beside` is what else tells of the nuisances.

    The noise is correlated, so that H^-1 (J' G J + P S P) H^-1 is the covariance, with S the prior
    and P its weight in the least squares, the noise's own strength over S.
    """
    lighter, light = unsmoothed(objective, best)
    of_tables, axes = lighter.ways(light), len(objective.axes)
    count, others = of_tables.shape[1], axes + len(objective.numbers) + now.size
    ways = np.asarray(block_diag(of_tables, np.eye(others)))
    # The error falls where the simulated voltage rises.
    rows = linearized(lighter, light, further=lambda place: -nuisances(lighter, light, place))
    values = np.concatenate(light.values)
    (noise,), to_noise, products, slopes = noises_behind(lighter, values[:, None], ways, rows)
    normal, slopes = with_penalty(lighter, products, of_tables), slopes[:, 0]
    weight = float(np.mean(np.diag(noise.spread_v2))) / objective.reduced.scored
    wanted = np.empty((0, len(values))) if wanted is None else wanted
    own = slice(len(normal) - now.size, len(normal))
    told = np.eye(len(normal))[own]
    picked = np.vstack([told, wanted @ ways[: len(values)]])

    def under(prior: Float[np.ndarray, "nuisances"]) -> Estimated:
        known = np.diag(1 / prior), now / prior
        if beside is not None:
            known = np.vstack([known[0], beside.columns]), np.append(known[1], -beside.error)
        pull, pushed, stiff = weight * known[0].T, slopes.copy(), normal.copy()
        stiff[own, own] += pull @ known[0]
        pushed[own] += pull @ known[1]
        moved = np.linalg.lstsq(stiff, np.column_stack([pushed, to_noise.T]))[0]
        back = picked @ np.linalg.lstsq(stiff, told.T)[0]
        by_noise = picked @ moved[:, 1:]
        by_known = back @ pull
        lengths = np.sqrt(np.maximum(np.diag(stiff), np.finfo(float).tiny))
        roots = np.linalg.eigvalsh(stiff / np.outer(lengths, lengths))
        volume = np.sum(np.log(np.maximum(roots, UNSEEN**2))) + 2 * np.sum(np.log(lengths))
        misfit = known[1] @ known[1] - pushed @ moved[:, 0] / weight
        return Estimated(
            np.append(now, wanted @ values) - picked @ moved[:, 0],
            by_noise @ noise.spread_v2 @ by_noise.T + by_known @ by_known.T,
            -moved[count : count + axes, 0],
            by_known[:, : now.size],
            float(-(misfit + volume) / 2 - np.sum(np.log(prior))),
        )

    return [under(prior) for prior in priors]
