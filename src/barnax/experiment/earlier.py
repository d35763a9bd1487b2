"""Earlier records as a design counts them, and what their errors show: how much of these is noise,
and how much comes of a cell that is more than its circuit.

The columns F of what a circuit leaves out (`information`) are followed by the tables as far as they
can; what is left of them explains some of the errors of a fit. Noise would leave errors that look
so too, of an expected size; what is more tells how large that is which the circuit leaves out.
"""

import math
from collections.abc import Sequence

import numpy as np

from ..model.prepared import PreparedRecord
from ..over_soc.intervals import MAX_SLOTS, UNSEEN
from ..search.evaluate import Evaluation
from ..uncertainty.noise import fit_noise
from .information import Believed, Columns, Error, Seconds, columns_along


def by_second(prepared: PreparedRecord) -> Seconds:
    """A record by the second."""
    time_s = prepared.time_s - prepared.time_s[0]
    soc = np.interp(np.arange(0.0, time_s[-1] + 1.0), time_s, prepared.soc)
    counted = np.isin(np.arange(len(soc) - 1), _second(prepared)[prepared.scored])
    current_a = -np.diff(soc) * prepared.capacity_ah * 3600
    return Seconds(prepared.record.name, current_a, float(soc[0]), counted)


def _second(prepared: PreparedRecord) -> np.ndarray:
    return np.floor(prepared.time_s - prepared.time_s[0] + 1e-6).astype(int)


def error_of(believed: Believed, earlier: Sequence[Evaluation]) -> Error:
    """The error of a fit with these tables as its residuals on its records show it."""
    errors, stacked, times, clock_s = [], [], [], 0.0
    longest_s = max(evaluated.prepared.scored_duration_s for evaluated in earlier)
    for evaluated in earlier:
        seconds, scored = by_second(evaluated.prepared), evaluated.prepared.scored
        second, count = _second(evaluated.prepared)[scored], len(seconds.counted)
        sums_v, samples = (
            np.bincount(second, weights, count)[:count][seconds.counted]
            for weights in (evaluated.error_v[scored], np.ones(len(second)))
        )
        errors.append(sums_v / samples)
        columns, _ = columns_along(believed.usual, seconds.current_a, seconds.soc)
        stacked.append(columns[seconds.counted])
        # No lag within a record is one between records.
        at = np.flatnonzero(seconds.counted)
        times.append(clock_s + at - at[0])
        clock_s = times[-1][-1] + longest_s + 2
    columns, time_s = np.concatenate(stacked), np.concatenate(times)
    clock = time_s, longest_s, MAX_SLOTS
    followed, left_out = np.split(columns, [len(believed.names)], axis=1)
    basis = _basis(followed)
    # What bounds and smoothing kept a fit from following is left too.
    error_v, left_out = np.concatenate(errors), _without(left_out, basis)
    explaining = _basis(left_out)
    noise = fit_noise(error_v, basis, *clock)
    both = np.concatenate([basis, explaining], axis=1)
    of_rest = fit_noise(_without(error_v, explaining), both, *clock).spread_v2
    expected_v2 = float(np.trace(of_rest[basis.shape[1] :, basis.shape[1] :]))
    explained_v2 = max(float(np.sum((explaining.T @ error_v) ** 2)) - expected_v2, 0.0)
    rmse_v = math.sqrt(float(np.mean(error_v**2)))
    parts = zip(noise.correlation_s.tolist(), np.sqrt(noise.variance_v2).tolist(), strict=True)
    return Error(
        rmse_v=rmse_v,
        noise=tuple((correlation_s, sd_v) for correlation_s, sd_v in parts if sd_v > 0),
        left_out=math.sqrt(explained_v2 / float(np.sum(left_out**2))),
        rest_v=math.sqrt(max(rmse_v**2 - explained_v2 / len(error_v), 0.0)),
    )


def _basis(columns: Columns) -> Columns:
    """Orthonormal columns that span the same, as far as these can be told from rounding."""
    lengths = np.linalg.norm(columns, axis=0)
    seen = lengths > UNSEEN * lengths.max()
    basis, sizes, _ = np.linalg.svd(columns[:, seen] / lengths[seen], full_matrices=False)
    return basis[:, sizes > UNSEEN * sizes[0]]


def _without(values: np.ndarray, basis: Columns) -> np.ndarray:
    return values - basis @ (basis.T @ values)
