"""What a current would tell of a cell's tables: the intervals that a fit of it would have.

Least squares with a covariance S of the error have the covariance H^-1 J' S J H^-1 of the tables,
with J the columns of `over_soc` and H = J'J + N P, P the light smoothing that intervals are taken
at. S is what an identification leaves on measured cells: parts with exponentially decaying
correlation. Against white noise alone, a rest of an hour would look worth as much as a pulse.
Products add up over pieces of a test, as far as the error of one is not correlated with the next.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.signal import lfilter

from ..cell import CellModel, CircuitParameters
from ..cell.parameters import OCV_CORRECTION
from ..cell.tables import hats
from ..over_soc.intervals import LIGHT, STEP
from ..over_soc.settings import OCV, TableSettings

# Half a 95 % interval in standard errors.
HALF_95 = 1.96

Columns = Float[np.ndarray, "samples unknowns"]
Normal = Float[np.ndarray, "unknowns unknowns"]
# A table and its node, None of a constant.
Name = tuple[str, float | None]


@dataclass(frozen=True, eq=False)
class Believed:
    """What is believed of a cell before a test.

    Attributes:
        cell: Its OCV, hysteresis and capacity.
        tables: Its resistances and time constants.
        worst: How many times their values the resistances may be, at every node of the tables.
        noise: Parts of the error of a fit: correlation time in s, 0 for white, and standard
            deviation in V.
        settings: The tables that will be fitted; an OCV of the test's own where it has `ocv_nodes`.
        known: Standard errors of what existing records tell, of a time constant that of its
            logarithm.
        ocv_reach_v: How far the OCV may be from the cell's.
    """

    cell: CellModel
    tables: CircuitParameters
    worst: Float[np.ndarray, "nodes"]
    noise: Sequence[tuple[float, float]]
    settings: TableSettings
    known: Mapping[Name, float]
    ocv_reach_v: float = 0.0

    @cached_property
    def names(self) -> tuple[Name, ...]:
        """Every unknown: R0, the pairs' R, the OCV, and the time constants."""
        nodes = self.settings.nodes
        found: list[Name] = [(row, node) for row in self.tables.resistances for node in nodes]
        name = OCV_CORRECTION if self.settings.ocv_nodes is None else OCV
        found += [(name, node) for node in self.settings.ocv_nodes or nodes]
        return (*found, *((name, None) for name in self.tables.named_tau_s))

    @cached_property
    def values(self) -> Float[np.ndarray, "unknowns"]:
        """What each is believed to be; nothing of an OCV's correction."""

        def value(name: str, soc: float | None) -> float:
            if soc is None:
                return self.tables.constants[name]
            if name == OCV:
                return float(self.ocv_v(np.array([soc]))[0])
            return (
                0.0 if name == OCV_CORRECTION else float(self.tables.at(name, np.array([soc]))[0])
            )

        return np.array([value(*name) for name in self.names])

    def ocv_v(self, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The OCV between charge and discharge, corrected where the tables correct it."""
        known_v = self.cell.average_ocv_v(soc)
        has_own = OCV_CORRECTION in self.tables.tables
        return known_v + self.tables.at(OCV_CORRECTION, soc) if has_own else known_v

    @cached_property
    def penalty(self) -> Normal:
        """The smoothing of the tables, as `TableObjective.table_penalty` has it, squared."""
        settings, blocks = self.settings, []
        for name in dict.fromkeys(name for name, soc in self.names if soc is not None):
            is_r = name.startswith("R")
            eye = np.eye(sum(each == name for each, _ in self.names))
            bent = np.diff(eye, 2, axis=0)
            weight = self.cell.capacity_ah if is_r else 1.0
            ridge = settings.resistance_ridge if is_r else settings.voltage_ridge
            blocks.append(weight**2 * (settings.roughness * bent.T @ bent + ridge * eye))
        return np.asarray(block_diag(*blocks, np.zeros((self.tables.pairs,) * 2)))

    @cached_property
    def known_information(self) -> Float[np.ndarray, "unknowns"]:
        return np.array([self.known.get(name, math.inf) for name in self.names]) ** -2.0


@dataclass(frozen=True, eq=False)
class Information:
    """J'J and J'SJ of some samples."""

    samples: int
    normal: Normal
    noise: Normal

    def __add__(self, other: "Information") -> "Information":
        return Information(
            self.samples + other.samples, self.normal + other.normal, self.noise + other.noise
        )

    def scaled(self, by: float) -> "Information":
        return Information(round(by * self.samples), by * self.normal, by * self.noise)

    def covariance(self, believed: Believed) -> tuple[Normal, Normal]:
        """The covariance of what a fit of these samples alone finds, and H^-1."""
        whole = self.normal + LIGHT * max(self.samples, 1) * believed.penalty
        # Of a time constant that nothing tells, the logarithm is known to about one.
        whole[np.diag_indices(len(whole))] += 1e-12 * np.diag(whole).max()
        inverse = cho_solve(cho_factor(whole), np.eye(len(whole)))
        return inverse @ self.noise @ inverse, inverse


def columns_along(
    believed: Believed, current_a: Float[np.ndarray, "samples"], soc: float, interval_s: float = 1.0
) -> tuple[Columns, Float[np.ndarray, "samples"]]:
    """The derivatives of the error by every unknown, for a current that is held from sample to
    sample out of a rest, and the state of charge at each."""
    passed = np.append(0.0, np.cumsum(current_a[:-1])) * interval_s / 3600
    along = soc - passed / believed.cell.capacity_ah
    spread = hats(along, believed.settings.nodes) * current_a[:, None]
    blocks, slopes = [spread], []
    _, *resistances = believed.tables.resistances
    for tau_s, resistance in zip(believed.tables.tau_s, resistances, strict=True):
        blocks.append(_low_passed(spread, tau_s, interval_s))
        drop_v = believed.tables.at(resistance, along) * current_a
        above, below = (
            _low_passed(drop_v, tau_s * math.exp(step), interval_s) for step in (STEP, -STEP)
        )
        slopes.append((above - below) / (2 * STEP))
    blocks.append(-hats(along, believed.settings.ocv_nodes or believed.settings.nodes))
    return np.concatenate([*blocks, np.stack(slopes, axis=1)], axis=1), along


def _low_passed(flow: np.ndarray, tau_s: float, interval_s: float) -> np.ndarray:
    kept = math.exp(-interval_s / tau_s)
    return np.asarray(lfilter([0.0, 1 - kept], [1.0, -kept], flow, axis=0))


def information_of(believed: Believed, columns: Columns, interval_s: float = 1.0) -> Information:
    """What samples with these columns tell."""
    used = np.flatnonzero(np.any(columns, axis=0))
    own = np.ascontiguousarray(columns[:, used])
    products = own.T @ own
    noise = np.zeros_like(products)
    for time_s, sd_v in believed.noise:
        if time_s == 0:
            noise += sd_v**2 * products
            continue
        # S = F + F' - 1 with F the sums over all earlier samples, weighted by exp(-lag / time).
        earlier = own.T @ lfilter([1.0], [1.0, -math.exp(-interval_s / time_s)], own, axis=0)
        noise += sd_v**2 * (earlier + earlier.T - products)
    whole = np.zeros((2, columns.shape[1], columns.shape[1]))
    for each, own_products in zip(whole, (products, noise), strict=True):
        each[np.ix_(used, used)] = own_products
    return Information(len(columns), whole[0], whole[1])


@dataclass(frozen=True)
class Width:
    """Half the 95 % interval of one value, as a test is predicted to leave it: relative for
    resistances and time constants, in V for an OCV.

    Args:
        name: What it is.
        soc: Its node, None of a time constant.
        value: What it is believed to be.
        alone: Half the interval of a fit of the test alone.
        after: The same with what existing records tell.
        before: What existing records leave, None for nothing.
    """

    name: str
    soc: float | None
    value: float
    alone: float
    after: float
    before: float | None


def widths_of(believed: Believed, found: Information) -> tuple[Width, ...]:
    """Half an interval of every value that some sample is near to."""
    covariance, inverse = found.covariance(believed)
    moved = found.normal @ np.append(
        believed.values[: -believed.tables.pairs], np.zeros(believed.tables.pairs)
    )
    full = found.normal + found.samples * believed.penalty
    full[np.diag_indices(len(full))] += 1e-12 * np.diag(full).max()
    smoothed = np.linalg.solve(full, moved) - inverse @ moved
    after = np.diag(joined(believed, covariance))
    widths = []
    for place, ((name, soc), value) in enumerate(zip(believed.names, believed.values, strict=True)):
        if found.normal[place, place] <= 0:
            continue
        scale = value if name.startswith("R") else 1.0
        extra = abs(smoothed[place]) / 2 if soc is not None and name.startswith("R") else 0.0
        known = believed.known.get((name, soc))
        widths.append(
            Width(
                name,
                soc,
                float(value),
                float(HALF_95 * math.sqrt(covariance[place, place]) + extra) / scale,
                float(HALF_95 * math.sqrt(after[place]) + extra) / scale,
                None if known is None else HALF_95 * known / scale,
            )
        )
    return tuple(widths)


def joined(believed: Believed, covariance: Normal) -> Normal:
    """The covariance with what existing records tell, which is independent of the test."""
    known = believed.known_information
    if not np.any(known):
        return covariance
    # C - C (C + D)^-1 C with D = 1 / known, for the known alone.
    told = np.flatnonzero(known)
    between = covariance[np.ix_(told, told)] + np.diag(1 / known[told])
    gained = covariance[:, told] @ np.linalg.solve(between, covariance[told])
    return covariance - gained
