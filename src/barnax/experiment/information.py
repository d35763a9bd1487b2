"""Information about a cell's tables in a current: the intervals that its fit would have, and the
error of that fit on a drive cycle.

Least squares with a covariance S of the error have the covariance H^-1 J' S J H^-1 of the tables,
with J the columns of `fit` and H = J'J + N P, P their smoothing. S is the error typically left
by an identification on measured cells: parts with exponentially decaying correlation. Against white
noise alone, a rest of an hour would look as valuable as a pulse.

On a drive cycle, most of the error is not noise. A cell is more than its circuit: it also relaxes
with other time constants, and its resistances fall with the current. The tables absorb the effect
of such columns F, wrongly if the drive differs from the test: of a deviation F w the fit leaves
(F - J H^-1 J_t' F_t) w on the drive. Its square, over w of independent unit size, distinguishes
tests (bias and variance of a response surface; Box and Draper, 1959). Products add up over pieces
with uncorrelated errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve

from ..cell import CellModel, CircuitParameters
from ..cell.elements import is_resistance
from ..cell.parameters import OCV_CORRECTION, OHMIC
from ..cell.tables import hats
from ..execution import in_float64
from ..fit.intervals import LIGHT, jacobian_blocks
from ..fit.objective import Solution, TableObjective
from ..fit.settings import TableSettings
from ..fit.table_curves import chord_offset
from ..fit.table_problem import reduced_objective
from ..metrics import NORMAL_95
from ..model.prepared import PreparedRecord, prepare_record
from ..model.window import Window
from ..records import Record
from ..records.lag import lagged
from ..search.answers import AtBound
from ..uncertainty.noise import Slots, summed

# SOC this near to an end counts as at it; and how far blocks may take a cell below their stretch.
NEARLY_SOC, OVERSHOT = 0.02, 0.03
# Effects outside the circuit: other pairs, as a share of R0 and as shares and multiples of its
# fastest and slowest time constants; resistances that change by a share at 1C. Nodes over SOC of
# both. With PyBaMM's SPMe, these distinguish tests that leave 7 to 20 mV on a drive.
OTHER_PAIR, FASTER, SLOWER = 0.3, (0.25,), (4.0, 16.0)
CHANGE_AT_1C = 0.45
LEFT_OUT_NODES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
# Prior deviation of a table where nothing is measured: a share, and in V.
UNSEEN_SHARE, UNSEEN_V = 0.3, 20e-3
# Slots per correlation time in which an error is taken as constant.
SLOTS_A_TIME = 10
# Smaller numbers count as zero in a product. No resistance is larger than the next.
NOTHING = 1e-100
MOST_OHM = 1e6
# The RMSE on a drive cycle due to uncertain values can be wanted too.
DRIVE = "drive"

Samples = Float[np.ndarray, "samples"]
Soc = Float[np.ndarray, "*any"]
Columns = Float[np.ndarray, "samples columns"]
Normal = Float[np.ndarray, "columns columns"]
# A table and its node; None for a constant.
Name = tuple[str, float | None]


@dataclass(frozen=True)
class ResidualModel:
    """The assumed error of a fit: its RMSE; its noise, in parts with a correlation time in s, 0 for
    white, and a standard deviation in V; the size of effects outside the circuit, 1 for usual; and
    the RMSE without them.
    """

    rmse_v: float
    noise: tuple[tuple[float, float], ...]
    left_out: float
    rest_v: float


@dataclass(frozen=True, eq=False)
class Prior:
    """The prior of a cell: the assumptions about it before a test.

    Attributes:
        cell: Its OCV, hysteresis and capacity.
        tables: Its resistances and time constants.
        worst: Worst-case resistances as multiples of their values, at every node of the tables.
        error: Error of a fit.
        settings: The tables that will be fitted; with a fitted OCV if it has `ocv_nodes`.
        circuit: Name of the circuit.
        earlier: Records that will be identified with the test's.
        half_widths: Half the 95 % intervals from these records, relative or in V, as in
            `halves_of`.
        printed: Half the intervals as printed, which may be wider.
        beyond: Causes of wider intervals: both samplings of the current ("hold"), a hidden "pair".
        follows: Quantities besides SOC on which the resistances depend, which a design ignores.
        ocv_reach_v: Largest deviation of the OCV from the cell's.
        ocv_soc: Range of SOC over which the OCV is measured.
        typical: Chemistry whose OCV continues it, with up to `typical_reach_v` more deviation.
        start_v: OCV that brings a cell to the highest SOC if full is not identified.
        start_reach_soc: Largest error of that SOC.
        rates_c: Largest usual discharge and charge, in 1/h of the capacity.
        untold: Reason why the earlier records do not count.
        at_bound: Time constants at a bound of their search.
    """

    cell: CellModel
    tables: CircuitParameters
    worst: Float[np.ndarray, "nodes"]
    error: ResidualModel
    settings: TableSettings
    circuit: str = "so-rc"
    earlier: Sequence[PreparedRecord] = ()
    half_widths: Mapping[Name, float] = field(default_factory=dict)
    printed: Mapping[Name, float] = field(default_factory=dict)
    beyond: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()
    ocv_reach_v: float = 0.0
    ocv_soc: tuple[float, float] = (0.0, 1.0)
    typical: str = ""
    typical_reach_v: float = 0.0
    start_v: float | None = None
    start_reach_soc: float = 0.0
    rates_c: tuple[float, float] = (1.0, 0.5)
    untold: str = ""
    at_bound: tuple[AtBound, ...] = ()

    @property
    def finds_ocv(self) -> bool:
        """True if the test's fit includes the OCV."""
        return self.settings.ocv_nodes is not None

    def loaded(self, current_a: Samples, soc: float, interval_s: float = 1.0) -> PreparedRecord:
        """The cell out of a rest, under a current that is held from sample to sample."""
        record = Record.of_load(
            "the test", interval_s * np.arange(len(current_a)), current_a, np.ones(len(current_a))
        )
        window = Window(start_time_s=0.0, initial_soc=soc, soc_source="registered")
        return prepare_record(record, self.cell, self.circuit, window, is_measured=False)

    @cached_property
    def objective(self) -> TableObjective:
        """The objective of the tables that will be fitted, without samples, and without bounds."""
        settings = replace(
            self.settings,
            ocv_correction=True,
            rising_ocv=False,
            half_hysteresis=False,
            bounds={OHMIC: (0.0, MOST_OHM)},
            fixed={},
            folds=0,
        )
        ranges = {name: (tau_s, tau_s) for name, tau_s in self.tables.named_tau_s.items()}
        return reduced_objective([self.loaded(np.zeros(2), 1.0)], settings, ranges)

    @cached_property
    def solution(self) -> Solution:
        """The prior values as its solution: zero for a correction of the OCV."""
        tables = self.tables.without(OCV_CORRECTION)
        rows = zip(self.objective.names, self.objective.nodes_of, strict=True)
        values = tuple(
            tables.at(name, nodes) if name in tables.tables else self.ocv_v(nodes) * self.finds_ocv
            for name, nodes in rows
        )
        best = self.objective.solve(tuple(np.log(self.tables.tau_s).tolist()))
        return replace(best, values=values)

    @cached_property
    def names(self) -> tuple[Name, ...]:
        """Every unknown: R0, the pairs' R, the OCV, and the time constants."""
        objective = self.objective
        tables = zip(objective.names, objective.nodes_of, strict=True)
        nodes = [(name, node) for name, row in tables for node in row.tolist()]
        return (*nodes, *((name, None) for name in objective.ranges))

    @cached_property
    def tables_of_names(self) -> dict[str, slice]:
        """The unknowns of every table's nodes."""
        objective = self.objective
        return {name: objective.block(table) for table, name in enumerate(objective.names)}

    @cached_property
    def are_resistances(self) -> Bool[np.ndarray, "unknowns"]:
        return np.array([is_resistance(name) for name, _ in self.names])

    @cached_property
    def values(self) -> Float[np.ndarray, "unknowns"]:
        """The prior value of each unknown."""
        return np.concatenate([*self.solution.values, self.tables.tau_s])

    @cached_property
    def units(self) -> Float[np.ndarray, "unknowns"]:
        """The unit of each width: its value for a resistance, else one."""
        return np.where(self.are_resistances, self.values, 1.0)

    @cached_property
    def unseen(self) -> Float[np.ndarray, "unknowns"]:
        """The prior width of each unknown where nothing is measured; time constants always are."""
        share = np.where(self.are_resistances, UNSEEN_SHARE, UNSEEN_V)
        return self.units * share * [soc is not None for _, soc in self.names]

    def ocv_v(self, soc: Soc) -> Soc:
        """The OCV between charge and discharge, with the tables' correction if there is one."""
        is_corrected = OCV_CORRECTION in self.tables.tables
        correction_v = self.tables.at(OCV_CORRECTION, soc) if is_corrected else 0.0
        return self.cell.average_ocv_v(soc) + correction_v

    def ocv_end_v(self, soc: Soc, sign: int) -> Soc:
        """The lowest (-1) or highest (+1) possible OCV."""
        low, high = self.ocv_soc
        reach_v = self.ocv_reach_v + np.where((soc < low) | (soc > high), self.typical_reach_v, 0.0)
        return self.ocv_v(soc + sign * self.start_reach_soc) + sign * reach_v

    @property
    def planned_soc(self) -> tuple[float, float]:
        """The lowest and the highest SOC at which an OCV is known or taken from other cells."""
        return (0.0, 1.0) if self.typical else self.ocv_soc

    @cached_property
    def penalty(self) -> Normal:
        """The smoothing of the tables, squared."""
        rows = np.pad(self.objective.table_penalty, ((0, 0), (0, self.tables.pairs)))
        return rows.T @ rows

    @cached_property
    def information_before(self) -> "Information | None":
        """The information in the earlier records."""
        whole = None
        for prepared in self.earlier:
            whole = information_of(self, prepared) + whole
        return whole


@dataclass(frozen=True, eq=False)
class Information:
    """Products of some samples' columns, and J'SJ of those of the unknowns."""

    samples: int
    normal: Normal
    noise: Normal

    def __add__(self, other: "Information | None") -> "Information":
        if other is None:
            return self
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Information(*(one + another for one, another in pairs))

    @property
    def of_unknowns(self) -> Normal:
        """J'J."""
        return self.normal[: len(self.noise), : len(self.noise)]

    def inverse(self, prior: Prior, smoothing: float = LIGHT) -> Normal:
        """H^-1."""
        whole = self.of_unknowns + smoothing * max(self.samples, 1) * prior.penalty
        # The logarithm of an undetermined time constant has a standard deviation of about one.
        whole[np.diag_indices(len(whole))] += 1e-12 * np.diag(whole).max()
        return np.asarray(cho_solve(cho_factor(whole), np.eye(len(whole))))

    def covariance(self, prior: Prior, inverse: Normal) -> Normal:
        """The covariance of a fit, with the noise scaled up as effects outside the circuit raise
        its error above the known RMSE."""
        error, mean = prior.error, self.normal / max(self.samples, 1)
        level = (error.rest_v**2 + self._left_out_on(inverse, mean)) / error.rmse_v**2
        return level * (inverse @ self.noise @ inverse)

    def left_on(self, prior: Prior, inverse: Normal, drive: Normal) -> float:
        """The RMSE in V of a fit of these samples, given the mean product of columns `drive`."""
        smoothed = LIGHT * self.samples * inverse @ (prior.penalty * prior.unseen)
        spread = self.covariance(prior, inverse) + smoothed @ smoothed.T
        count = len(inverse)
        squared = np.sum(drive[:count, :count] * spread) + self._left_out_on(inverse, drive)
        return math.sqrt(max(float(squared), 0.0))

    def _left_out_on(self, inverse: Normal, drive: Normal) -> float:
        """The mean square in V2 due to effects outside the circuit there."""
        count = len(inverse)
        followed = inverse @ self.normal[:count, count:]
        left = drive[:count, :count] @ followed - 2 * drive[:count, count:]
        return float(np.trace(drive[count:, count:]) + np.sum(followed * left))


@in_float64
def columns_of(prior: Prior, prepared: PreparedRecord) -> Columns:
    """The derivatives of the error at every sample, by every unknown and by the effects outside the
    circuit."""
    whole = replace(prepared.with_dependence(None), scored=np.ones_like(prepared.scored))
    objective = replace(prior.objective, prepared_records=[whole])
    left_out = _left_out(prior, prepared)
    blocks = jacobian_blocks(objective, prior.solution, further=lambda _: left_out)
    return np.concatenate([columns for columns, *_ in blocks])


def _left_out(prior: Prior, prepared: PreparedRecord) -> Columns:
    """The columns of the effects outside the circuit."""
    soc, tables = prepared.soc, prior.tables
    tau_s, interval_s = np.array(tables.tau_s), np.diff(prepared.time_s)
    shares = prior.error.left_out * hats(soc, LEFT_OUT_NODES).T
    # Pairs respond to the current that flows from each sample to the next.
    now_a, held_a = prepared.current_a, prepared.held_a
    other = OTHER_PAIR * shares * held_a * tables.at(OHMIC, soc)
    between_s = np.sqrt(tau_s[:-1] * tau_s[1:])
    others_s = (*(tau_s[0] * np.array(FASTER)), *between_s, *(tau_s[-1] * np.array(SLOWER)))
    rows = [lagged(other, other_s, interval_s) for other_s in others_s]
    shares *= CHANGE_AT_1C / prior.cell.capacity_ah
    ohm = [tables.at(name, soc) for name in tables.resistances[1:]]
    rows.append(shares * now_a * np.abs(now_a) * ohm[0])
    flows = shares * held_a * np.abs(held_a)
    rows += [lagged(flows * r, pair_s, interval_s) for r, pair_s in zip(ohm, tau_s, strict=True)]
    return np.concatenate(rows).T


@in_float64
def information_of(prior: Prior, prepared: PreparedRecord) -> Information:
    """The information in the scored samples of a record."""
    columns, interval_s = columns_of(prior, prepared)[prepared.scored], prepared.median_interval_s
    times_s = prepared.time_s[prepared.scored] - prepared.time_s[0]
    of_unknowns = np.ascontiguousarray(columns[:, : len(prior.names)])
    noise = np.zeros((len(prior.names),) * 2)
    for time_s, sd_v in prior.error.noise:
        # For slowly varying errors, a few samples together count as one.
        slot_s = interval_s * max(1, int(time_s / SLOTS_A_TIME / interval_s))
        start_s, count = (slot_s - interval_s) / 2, 2 + int(times_s[-1] / slot_s)
        slots = Slots(start_s, slot_s, count, count).gathered(times_s, of_unknowns)
        together = summed(slots, np.full(len(slots) - 1, slot_s / time_s if time_s else np.inf))
        # Products of denormal numbers take six times as long.
        together[np.abs(together) < NOTHING] = 0.0
        noise += sd_v**2 * (slots.T @ together)
    return Information(len(columns), columns.T @ columns, noise)


@dataclass(frozen=True)
class Width:
    """Half the 95 % interval predicted for one value after a test: relative for resistances and
    time constants, in V for an OCV.

    Args:
        name: Name of the value.
        soc: Its node; None for a time constant.
        value: Assumed value.
        alone: Half the interval from the test alone.
        after: Half the interval from the test with the earlier records.
        before: Half the interval from the earlier records alone; None if they do not determine it.
    """

    name: str
    soc: float | None
    value: float
    alone: float
    after: float
    before: float | None = None


def widths_of(
    prior: Prior, test: Information | None = None, drive: Normal | None = None
) -> tuple[Width, ...]:
    """Half an interval for every value near a sample of a test, else of the earlier records; if
    `drive` is given, the mean product of columns on a drive cycle, the RMSE on that too."""
    earlier, before = prior.information_before, before_of(prior)
    alone, after, of_test, joint = before, before, earlier, earlier
    if test is not None:
        of_test, joint = test, test + earlier
        alone, after = _halves(prior, of_test), _halves(prior, joint)
    widths = [
        Width(*name, value, alone[name], after[name], before.get(name))
        for name, value in zip(prior.names, prior.values.tolist(), strict=True)
        if name in alone
    ]
    if drive is not None and of_test and joint:
        fits = (of_test, joint, earlier) if earlier else (of_test, joint)
        left_v = [each.left_on(prior, each.inverse(prior), drive) for each in fits]
        widths.append(Width(f"{DRIVE} [V]", None, 0.0, *left_v))
    return tuple(widths)


def before_of(prior: Prior) -> dict[Name, float]:
    """Half the intervals of a fit of the earlier records, or of their original fit if none
    count."""
    earlier = prior.information_before
    return _halves(prior, earlier) if earlier else dict(prior.half_widths)


def _halves(prior: Prior, fit: Information) -> dict[Name, float]:
    """Half the intervals of the values that samples are near, as in `fit.intervals`: due to
    noise, and half the effect of smoothing and of straight lines between nodes."""
    light, smooth = fit.inverse(prior), fit.inverse(prior, 1.0)
    errors = np.sqrt(np.maximum(np.diag(fit.covariance(prior, light)), 0.0))
    resistances = np.where(prior.are_resistances, prior.values, 0.0)
    smoothed = (smooth - light) @ (fit.of_unknowns @ resistances)
    moved, is_seen = np.zeros(len(errors)), np.diag(fit.of_unknowns) > 0
    for name, rows in prior.tables_of_names.items():
        seen = np.arange(rows.start, rows.stop)[is_seen[rows]]
        if is_resistance(name) and len(seen):
            nodes = np.array([soc for _, soc in prior.names])[seen].astype(float)
            sag = chord_offset(nodes, prior.values[seen])
            moved[seen] = np.maximum(np.abs(smoothed[seen]), np.abs(smoothed[seen] - sag))
    halves = (NORMAL_95 * errors + moved / 2) / prior.units
    return {prior.names[index]: float(halves[index]) for index in np.flatnonzero(is_seen)}
