"""Records of the same samples in different files: converted, rounded, cut or thinned.

A fingerprint is a selection of a record's samples. Another record contains them if current and
voltage agree within their rounding once the clock is shifted. If a test was repeated, or run on
another cell, the current agrees and the voltage does not.
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from .counters import decimal_step
from .record import Record

# Time in s, current in A and voltage in V of neighboring samples, and how far the voltage may
# differ.
Run = Float[np.ndarray, "3 samples"]
Near = Float[np.ndarray, "2 1"]

# This many runs of samples, each around the largest voltage step in its part of the record.
_RUNS, _LENGTH = 8, 12
# This many samples are needed; nearly all have to agree, more for whole records, and at least half
# in each run.
_FEWEST, _ALIKE, _ALIKE_THROUGHOUT, _HALF = 12, 0.98, 0.995, 0.5
# Single precision, and the rounding of a current, as a share of the largest.
_SINGLE, _CURRENT_SHARE = 1e-6, 1e-3
# A voltage that occurs more often than this does not identify its time.
_MANY = 1000


class Content:
    """The samples of a record, to be compared with those of others."""

    def __init__(self, record: Record):
        self.record = record
        # A current moved to the times of the voltage is not that of the file, so no copy has it.
        current_a = record.current_a + (np.nan if record.voltage_lag_s else 0.0)
        self.run: Run = np.stack([record.time_s, current_a, record.voltage_v])
        # The rounding of current and voltage.
        self.rounded = np.array([*map(decimal_step, self.run[1:])])

    @cached_property
    def fingerprint(self) -> str:
        """The first and the last time, then, separated by semicolons, runs of samples: time in s,
        current in A (discharge positive, "nan" if it was moved) and voltage in V."""
        step_v = np.abs(np.diff(self.run[2]))
        length = min(_LENGTH, len(step_v))
        texts = [f"{self.run[0, 0]:.12g} {self.run[0, -1]:.12g}"]
        for part in np.array_split(np.arange(len(step_v)), min(_RUNS, len(step_v) // length)):
            first = int(part[np.argmax(step_v[part])]) + 1 - length // 2
            first = int(np.clip(first, 0, len(step_v) + 1 - length))
            samples = self.run[:, first : first + length].T
            texts.append(" ".join(f"{t:.12g} {i:.8g} {v:.8g}" for t, i, v in samples))
        return ";".join(texts)

    def is_like(self, other: "Content") -> bool:
        """True if two records share a good part of the samples of either."""
        return self.holds(other.fingerprint, other) or other.holds(self.fingerprint, self)

    def holds(self, fingerprint: str, whole: "Content | None" = None) -> bool:
        """True if the samples of a fingerprint are among these, as far as the two overlap; with the
        fingerprint's own record given, all its other samples too."""
        (first_s, last_s), runs = read_fingerprint(fingerprint)
        samples = np.concatenate(runs, axis=1)
        rounded = np.maximum(self.rounded, [*map(decimal_step, samples[1:])])
        least = np.array([_CURRENT_SHARE, _SINGLE]) * np.abs(samples[1:]).max(axis=1)
        near = (rounded / 2 + least)[:, None]
        clocks_s = 0.0, first_s - self.run[0, 0], last_s - self.run[0, -1]
        return any(
            self._agrees(runs, shift_s, near, _ALIKE)
            and (not whole or self._agrees([whole.run], shift_s, near, _ALIKE_THROUGHOUT))
            for shift_s in (*clocks_s, *self._likely_shifts(samples, near))
        )

    @cached_property
    def _by_voltage(self) -> Int[np.ndarray, "samples"]:
        return np.argsort(self.run[2])

    def _likely_shifts(self, samples: Run, near: Near) -> Iterator[float]:
        """The shifts of the clock at which most of some samples may agree."""
        time_s, current_a, voltage_v = self.run
        order, (near_a, near_v) = self._by_voltage, near.ravel()
        low = np.searchsorted(voltage_v, samples[2] - near_v, "left", order)
        high = np.searchsorted(voltage_v, samples[2] + near_v, "right", order)
        shifts_s = [np.zeros(0)]
        for sample_s, sample_a, first, last in zip(samples[0], samples[1], low, high, strict=True):
            if last - first <= _MANY:
                candidates = order[first:last]
                is_far = np.abs(current_a[candidates] - sample_a) > near_a
                shifts_s.append(sample_s - time_s[candidates[~is_far]])
        all_s, width_s = np.concatenate(shifts_s), np.median(np.diff(time_s))
        if len(all_s):
            bins, counts = np.unique(np.round(all_s / width_s), return_counts=True)
            middle_s = bins[np.argmax(counts)] * width_s
            yield float(np.median(all_s[np.abs(all_s - middle_s) <= width_s]))

    def _agrees(self, runs: list[Run], shift_s: float, near: Near, share: float) -> bool:
        """True if these samples are those of the runs, or one lies on the lines between the
        other's: a copy may be thinned or interpolated."""
        around = []
        for run in runs:
            # Samples around the run, on its clock.
            first, last = np.searchsorted(self.run[0], run[0, [0, -1]] - shift_s)
            around.append(self.run[:, max(first - 2, 0) : last + 2].copy())
            around[-1][0] += shift_s
        return _lie_on(runs, around, near, share) or _lie_on(around, runs, near, share)


def read_fingerprint(text: str) -> tuple[tuple[float, float], list[Run]]:
    """The ends and the runs of a fingerprint. Raises ValueError if the text is not one."""
    ends, *runs = (np.array(part.split(), float) for part in text.split(";"))
    first_s, last_s = ends
    if not runs:
        raise ValueError("a fingerprint holds samples")
    return (float(first_s), float(last_s)), [run.reshape(-1, 3).T for run in runs]


def _lie_on(lines: list[Run], points: list[Run], near: Near, share: float) -> bool:
    """True if this share of the points that overlap with the lines lies on them."""
    alike: list[np.bool_] = []
    for line, points_beside in zip(lines, points, strict=True):
        is_on = _is_on(line, points_beside, near)
        if len(is_on) and is_on.mean() < _HALF:
            return False
        alike.extend(is_on)
    return len(alike) >= _FEWEST and float(np.mean(alike)) >= share


def _is_on(line: Run, points: Run, near: Near) -> Bool[np.ndarray, "points"]:
    """True for points that overlap with a line and lie on it, or equal a neighboring sample."""
    if line.shape[1] < 2:
        return np.zeros(0, bool)
    inside = np.searchsorted(points[0], line[0, [0, -1]] + [-_SINGLE, _SINGLE])
    points = points[:, slice(*inside)]
    after = np.clip(np.searchsorted(line[0], points[0]), 1, line.shape[1] - 1)
    between = np.array([np.interp(points[0], line[0], row) for row in line[1:]])
    candidates = np.stack([line[1:, after - 1], line[1:, after], between])
    # NaN agrees with any current.
    return ~np.any(np.abs(points[1:] - candidates) > near, axis=1).all(axis=0)
