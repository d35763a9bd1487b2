"""Nuisances of the records of one cell, estimated together with its tables under priors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .intervals import UNSEEN, LinearizedFit, jacobian_blocks, lightly_smoothed, with_penalty
from .objective import Solution, TableObjective

# Columns of the voltage by the nuisances of all records, at the scored samples of one.
Nuisances = Callable[[TableObjective, Solution, int], Float[np.ndarray, "samples nuisances"]]


class PseudoMeasurements(NamedTuple):
    """Single voltages, combined so that their errors are independent with unit variance: the effect
    of each nuisance on them, and their difference from the voltages at the current nuisances."""

    columns: Float[np.ndarray, "voltages nuisances"]
    error: Float[np.ndarray, "voltages"]


@dataclass(frozen=True)
class NuisanceEstimate:
    """Nuisances relative to their given values, then the wanted sums of the tables' values, with
    their covariance, and the accompanying shifts of the searched scales' logarithms. `by_prior` is
    the change of each value per standard deviation of each nuisance's prior. `log_evidence` is the
    logarithm of the probability of the records with these standard deviations, up to a constant of
    the records.
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
    objective: TableObjective,
    best: Solution,
    index: int,
    slope: Float[np.ndarray, "samples"] | None = None,
) -> Float[np.ndarray, "samples nuisances"]:
    """The columns of a start and a capacity of every record, with a slope of the OCV by SOC, by
    default the cell's."""
    del best
    prepared = objective.prepared_records[index]
    soc = prepared.soc[prepared.scored]
    slope = prepared.cell.ocv_slope(soc) if slope is None else slope
    columns = np.zeros((len(soc), 2 * len(objective.prepared_records)))
    columns[:, 2 * index] = slope
    columns[:, 2 * index + 1] = slope * (prepared.start.soc - soc)
    return columns


def estimate(
    objective: TableObjective,
    best: Solution,
    nuisances: Nuisances,
    iterate: Float[np.ndarray, "nuisances"],
    priors: Sequence[Float[np.ndarray, "nuisances"]],
    combinations: Float[np.ndarray, "wanted values"] | None = None,
    pseudo_measurements: PseudoMeasurements | None = None,
) -> list[NuisanceEstimate]:
    """The nuisances of records prepared with the nuisances `iterate`, together with all tables,
    under each of `priors`, the standard deviations of the given values; `combinations` are weights
    of the tables' values in sums, and `pseudo_measurements` further information on the nuisances.

    The noise is correlated, so that H^-1 (J' G J + P S P) H^-1 is the covariance, with S the prior
    and P its weight in the least squares, the strength of the noise divided by S.
    """
    lighter, light = lightly_smoothed(objective, best)
    others = np.eye(len(objective.axes) + len(objective.numbers) + iterate.size)
    # The error falls where the simulated voltage rises.
    rows = jacobian_blocks(lighter, light, further=lambda index: -nuisances(lighter, light, index))
    fit = LinearizedFit.of(lighter, light, others, rows)
    normal, slopes = with_penalty(lighter, fit.products, fit.directions), fit.slopes[:, 0]
    noise, weight, values = fit.noises[0], fit.prior_weight, np.concatenate(light.values)
    combinations = np.empty((0, len(values))) if combinations is None else combinations
    of_nuisances = slice(len(normal) - iterate.size, len(normal))
    scales = len(normal) - len(others) + np.arange(len(objective.axes))
    units = np.eye(len(normal))[of_nuisances]
    picked = np.vstack([units, combinations @ fit.directions[: len(values)]])

    def under(prior: Float[np.ndarray, "nuisances"]) -> NuisanceEstimate:
        belief = np.diag(1 / prior), iterate / prior
        if pseudo_measurements is not None:
            belief = (
                np.vstack([belief[0], pseudo_measurements.columns]),
                np.append(belief[1], -pseudo_measurements.error),
            )
        pull, pushed, stiff = weight * belief[0].T, slopes.copy(), normal.copy()
        stiff[of_nuisances, of_nuisances] += pull @ belief[0]
        pushed[of_nuisances] += pull @ belief[1]
        moved = np.linalg.lstsq(stiff, np.column_stack([pushed, fit.to_noise.T]))[0]
        back = picked @ np.linalg.lstsq(stiff, units.T)[0]
        by_noise = picked @ moved[:, 1:]
        by_belief = back @ pull
        lengths = np.sqrt(np.maximum(np.diag(stiff), np.finfo(float).tiny))
        roots = np.linalg.eigvalsh(stiff / np.outer(lengths, lengths))
        volume = np.sum(np.log(np.maximum(roots, UNSEEN**2))) + 2 * np.sum(np.log(lengths))
        misfit = belief[1] @ belief[1] - pushed @ moved[:, 0] / weight
        return NuisanceEstimate(
            np.append(iterate, combinations @ values) - picked @ moved[:, 0],
            by_noise @ noise.spread_v2 @ by_noise.T + by_belief @ by_belief.T,
            -moved[scales, 0],
            by_belief[:, : iterate.size],
            float(-(misfit + volume) / 2 - np.sum(np.log(prior))),
        )

    return [under(prior) for prior in priors]
