"""An identified circuit as the state-space model of a Kalman filter.

The state is SOC, the voltage over every RC pair, the dynamic hysteresis if the circuit has one, and
the parts of the circuit's voltage error. A filter that took that error for white noise would trust
its voltage far too much. Parts that last for some time are first-order states; the bias b, which is
an error of the OCV at a SOC, changes with the charge passed and is constant at rest, however long:

    b' = exp(-|ds| / L) b + sqrt(1 - exp(-2 |ds| / L)) w,    v = U(s) + ... + sd_b(s) b,

with L the SOC over which it is correlated and w of variance one. Only the white part is measurement
noise.

Resistances and the sizes of errors are evaluated at one SOC for all hypotheses of a filter
(`near`): they are not accurate enough to determine the SOC, and a filter that uses them for it
becomes certain of a wrong one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Scalar

from ..cell import CellModel, CircuitParameters, get_circuit
from ..cell.parameters import HALF_HYSTERESIS, OCV_CORRECTION
from ..model.prepared import PreparedRecord

# The default nodes of tables over SOC are nodes of this grid too. Between its points curves are
# interpolated linearly, within 0.3 mV at the knee of an OCV and far closer elsewhere.
STEPS_PER_SOC = 400
GRID = np.arange(-STEPS_PER_SOC // 20, STEPS_PER_SOC * 21 // 20 + 1) / STEPS_PER_SOC
OFFSET, CAPACITY = "offset", "capacity"
# The current at which a cell counts as resting is five times the current's noise.
NOISES_PER_REST = 5.0
# Memory of a slow parameter: its random walk gains the prior variance in this time.
WALK_S = 100 * 3600.0
# Correlation length of the OCV's error in SOC.
BIAS_SOC = 0.05
# At rest a cell relaxes for hours, which circuits identified on a drive do not model: their lasting
# errors have this correlation time there, and are larger by this factor.
RESTING_S, RESTING = 3600.0, 3.0
# Columns of the table: OCV, half the hysteresis voltage, the scale of errors, the bias, R0, R1 ...
FIRST_RESISTANCE = 4
State = Float[Array, "states"]
Slow = Float[Array, "slow"]
Samples = Float[Array, "*samples"]
Some = Float[np.ndarray, "some"]


class Drive(NamedTuple):
    """The inputs of the model at every sample: the interval before it, and the measurements.

    `held_a` is the current since the sample before, discharge positive, `turning_a` the same if it
    turns a hysteresis, else zero. `direction` is that of the last current, or the position between
    the branches of a hysteresis that remembers its turns: it depends on the charge counted since,
    so it is known without a state. The first interval is zero seconds long. `gains` are those of
    `FilterModel.gains`, if they are computed for all samples at once.
    """

    interval_s: Samples
    held_a: Samples
    turning_a: Samples
    current_a: Samples
    direction: Samples
    voltage_v: Samples
    pairs_a: Samples | None = None
    gains: Float[Array, "*samples relaxing"] | None = None

    @classmethod
    def of(cls, prepared: PreparedRecord) -> "Drive":
        """The inputs from a prepared record. Call inside float64."""
        held_a = np.append(0.0, prepared.held_a[:-1])
        is_moving = np.abs(held_a) >= prepared.rest_current_a
        hysteresis = get_circuit(prepared.circuit).hysteresis
        ohmic_a, through_a = prepared.weighed_a
        pairs_a = None
        if prepared.dependence is not None:
            pairs_a = jnp.asarray(np.append(0.0, through_a[:-1]))
        return cls(
            interval_s=jnp.asarray(np.diff(prepared.time_s, prepend=prepared.time_s[0])),
            held_a=jnp.asarray(held_a),
            turning_a=jnp.asarray(np.where(is_moving, held_a, 0.0)),
            current_a=jnp.asarray(ohmic_a),
            direction=jnp.asarray(hysteresis.state(prepared.soc, prepared.direction)),
            voltage_v=jnp.asarray(prepared.voltage_v),
            pairs_a=pairs_a,
        )


class Filtered(NamedTuple):
    """After every sample: SOC and slow parameters with deviations, and the innovation.

    `innovation_v` is measured minus predicted voltage, `innovation_sd_v` its predicted standard
    deviation.
    """

    soc: Samples
    soc_sd: Samples
    slow: Float[Array, "*samples slow"]
    slow_sd: Float[Array, "*samples slow"]
    innovation_v: Samples
    innovation_sd_v: Samples


class FilterModel(eqx.Module):
    """The model of a cell for a filter; all of it may be batched, over cells or over tunings.

    `table` has a row for every SOC of `GRID` with the OCV, half the hysteresis voltage, the scale
    of the errors, the deviation of the bias in V, R0 and every pair's R. `slow` names the estimated
    parameters: "offset" is that of the current in A, all others are logarithms of the factor on
    "capacity", "R0", "R1", "tau1" and so on. The white part of the error lasts for `white_s`, and
    counts once in that time. `axis_sd` is the standard deviation between a record's SOC and that of
    the OCV, which no voltage determines.
    """

    table: Float[Array, "points rows"]
    capacity_ah: Scalar
    tau_s: Float[Array, "pairs"]
    gamma: Scalar
    error_s: Float[Array, "parts"]
    error_sd_v: Float[Array, "parts"]
    white_sd_v: Scalar
    white_s: Scalar
    axis_sd: Scalar
    current_sd_a: Scalar
    slow_sd: Slow
    slow: tuple[str, ...] = eqx.field(static=True)
    hysteresis: str = eqx.field(static=True)
    has_bias: bool = eqx.field(static=True)

    @property
    def pairs(self) -> int:
        return self.tau_s.shape[-1]

    @property
    def states(self) -> int:
        return self.first_error + self.error_s.shape[-1] + self.has_bias

    @property
    def first_error(self) -> int:
        return 1 + self.pairs + (self.hysteresis == "dynamic")

    def at(self, soc: Scalar) -> Float[Array, "rows"]:
        """The table's row at a SOC, extrapolated linearly beyond the grid."""
        along = (soc - GRID[0]) * STEPS_PER_SOC
        row_index = jnp.clip(lax.stop_gradient(along), 0, len(GRID) - 2).astype(jnp.int32)
        below, above = self.table[row_index], self.table[row_index + 1]
        return below + (along - row_index) * (above - below)

    def rise(self, soc: Scalar) -> Float[Array, "rows"]:
        """The slope of the table at a SOC: at a row that of the chord over both neighbors, linear
        between rows.

        If it jumped, like the slope of the table itself, rounding would decide which one counts: a
        full cell is at a row.
        """
        along = (soc - GRID[0]) * STEPS_PER_SOC
        row_index = jnp.clip(along, 1, len(GRID) - 3).astype(jnp.int32)
        below, above = (
            self.table[row + 1] - self.table[row - 1] for row in (row_index, row_index + 1)
        )
        return (below + jnp.clip(along - row_index, 0, 1) * (above - below)) * (STEPS_PER_SOC / 2)

    def factor(self, name: str, slow: Slow) -> Scalar | float:
        """The factor of a slow parameter; one if it is not estimated."""
        return jnp.exp(slow[self.slow.index(name)]) if name in self.slow else 1.0

    def factors(self, letter: str, slow: Slow) -> Float[Array, "pairs"]:
        """The factors of every pair's "R" or "tau"."""
        return jnp.stack(
            [jnp.asarray(self.factor(f"{letter}{pair + 1}", slow)) for pair in range(self.pairs)]
        )

    def offset_a(self, slow: Slow) -> Scalar | float:
        return slow[self.slow.index(OFFSET)] if OFFSET in self.slow else 0.0

    def gains(self, slow: Slow, drive: Drive) -> Float[Array, "relaxing"]:
        """The share of their way to rest that all states except SOC cover in an interval: pairs,
        hysteresis, errors, bias."""
        if drive.gains is not None:
            return drive.gains
        interval_s = drive.interval_s
        pairs_s = self.tau_s * self.factors("tau", slow)
        along = [interval_s / pairs_s]
        if self.hysteresis == "dynamic":
            along.append((self.gamma * self.passed(drive.turning_a, interval_s))[None])
        resting_s = jnp.maximum(self.error_s, RESTING_S)
        along.append(interval_s / jnp.where(drive.turning_a == 0, resting_s, self.error_s))
        if self.has_bias:
            along.append((self.passed(drive.held_a, interval_s) / BIAS_SOC)[None])
        # One call for all, and once: in a filter each costs as much as the rest of a product.
        return lax.optimization_barrier(-jnp.expm1(-jnp.concatenate(along)))

    def passed(self, current_a: Scalar, interval_s: Scalar) -> Scalar:
        """The SOC that a current moves in an interval, up or down, with the estimated capacity:
        accurate enough for hysteresis and bias."""
        return jnp.abs(current_a) * interval_s / (3600 * self.capacity_ah)

    def advance(self, state: State, slow: Slow, drive: Drive, near: Scalar | None = None) -> State:
        """The state one interval later, exact for current held over it.

        Resistances are those at the SOC `near`, by default the state's own.
        """
        held_a = drive.held_a - self.offset_a(slow)
        pairs_a = held_a if drive.pairs_a is None else drive.pairs_a - self.offset_a(slow)
        capacity_as = 3600 * self.capacity_ah * self.factor(CAPACITY, slow)
        ohm = self.at(state[0] if near is None else near)[FIRST_RESISTANCE + 1 :]
        toward = [ohm * self.factors("R", slow) * pairs_a]
        if self.hysteresis == "dynamic":
            toward.append(-jnp.sign(drive.turning_a)[None])
        toward.append(jnp.zeros(self.states - self.first_error))
        soc = state[0] - drive.interval_s * held_a / capacity_as
        rest = state[1:] + self.gains(slow, drive) * (jnp.concatenate(toward) - state[1:])
        return jnp.concatenate([soc[None], rest])

    def voltage(self, state: State, slow: Slow, drive: Drive, near: Scalar | None = None) -> Scalar:
        """The terminal voltage in V, the model's own error included; `near` as in `advance`."""
        row = self.at(state[0])
        there = row if near is None else self.at(near)
        current_a = drive.current_a - self.offset_a(slow)
        voltage_v = row[0] - there[FIRST_RESISTANCE] * self.factor("R0", slow) * current_a
        if self.hysteresis == "dynamic":
            voltage_v = voltage_v + state[1 + self.pairs] * row[1]
        elif self.hysteresis != "none":
            voltage_v = voltage_v + drive.direction * row[1]
        lasting = state[self.first_error : self.first_error + self.error_s.shape[-1]]
        voltage_v = voltage_v - jnp.sum(state[1 : 1 + self.pairs]) + there[2] * jnp.sum(lasting)
        return voltage_v + there[3] * state[-1] if self.has_bias else voltage_v

    def slopes(self, state: State, slow: Slow, drive: Drive, near: Scalar) -> Float[Array, "both"]:
        """The gradient of the voltage by every state and slow parameter, in closed form, because
        differentiating a table look-up takes as long as the rest of the filter, and jumps."""
        row, there = self.at(state[0]), self.at(near)
        by_soc, by_turn = self.rise(state[0])[:2]
        if self.hysteresis != "none":
            turned = state[1 + self.pairs] if self.hysteresis == "dynamic" else drive.direction
            by_soc = by_soc + turned * by_turn
        parts = [by_soc[None], -jnp.ones(self.pairs)]
        if self.hysteresis == "dynamic":
            parts.append(row[1:2])
        parts.append(jnp.full_like(self.error_s, there[2]))
        if self.has_bias:
            parts.append(there[3:4])
        current_a = drive.current_a - self.offset_a(slow)
        r0 = there[FIRST_RESISTANCE] * self.factor("R0", slow)
        by_slow = {OFFSET: r0, "R0": -r0 * current_a}
        parts += [jnp.reshape(by_slow.get(name, 0.0), 1) for name in self.slow]
        return jnp.concatenate(parts)

    def doubt_at(self, soc: Some) -> Some:
        """The standard deviation of the SOC from a voltage at rest, due to the bias alone."""
        table = np.asarray(self.table)
        # The slope is a mean over the distance between table nodes.
        below, above = (np.interp(soc + by, GRID, table[:, 0]) for by in (-0.05, 0.05))
        slope_v = np.maximum(above - below, 1e-9) / 0.1
        return np.interp(soc, GRID, table[:, 3]) / slope_v

    def noise_v2(self, soc: Scalar, interval_s: Scalar) -> Scalar:
        """The variance of the white part of the error at a SOC."""
        often = jnp.where(interval_s > 0, self.white_s / jnp.maximum(interval_s, 1e-9), 1.0)
        return (self.at(soc)[2] * self.white_sd_v) ** 2 * jnp.maximum(often, 1.0)

    def walk(self, drive: Drive) -> tuple[State, Slow]:
        """The variance that an interval adds to every state and to every slow parameter."""
        counted = self.current_sd_a * drive.interval_s / (3600 * self.capacity_ah)
        gain = self.gains(jnp.zeros_like(self.slow_sd), drive)[self.first_error - 1 :]
        still = jnp.zeros(self.first_error - 1)
        lasting_sd_v = jnp.where(drive.turning_a == 0, RESTING, 1.0) * self.error_sd_v
        sd = jnp.concatenate([lasting_sd_v, self.errors_sd[len(self.error_s) :]])
        errors = gain * (2 - gain) * sd**2
        state = jnp.concatenate([(counted**2)[None], still, errors])
        return state, self.slow_sd**2 * (drive.interval_s / WALK_S)

    @property
    def errors_sd(self) -> Float[Array, "errors"]:
        """The standard deviations of the error states: in V, and one for the bias."""
        return jnp.concatenate([self.error_sd_v, jnp.ones(int(self.has_bias))])

    def start(
        self, soc: Scalar | float, soc_sd: Scalar | float, direction: float, direction_sd: float
    ) -> tuple[State, State]:
        """State and variances of a cell that has rested. Call inside float64.

        Pairs may contain the effect of the current's noise; errors have their usual variance.
        """
        soc, soc_sd = jnp.asarray(soc, float), jnp.asarray(soc_sd, float)
        rest_v = self.at(soc)[FIRST_RESISTANCE + 1 :] * NOISES_PER_REST * self.current_sd_a
        count = int(self.hysteresis == "dynamic")
        turned, turned_sd = (jnp.full(count, one, float) for one in (direction, direction_sd))
        state = jnp.concatenate([soc[None], 0 * rest_v, turned, 0 * self.errors_sd])
        return state, jnp.concatenate([soc_sd[None], rest_v, turned_sd, self.errors_sd]) ** 2


@dataclass(frozen=True)
class ErrorModel:
    """The circuit's voltage error: white, in parts with a correlation time and a deviation, and the
    bias, which changes with the SOC.

    White and timed parts are multiplied by `scale` at `soc`; it and the bias are interpolated
    linearly over SOC and constant beyond. `white_s` and `axis_sd` are as in `FilterModel`.
    """

    white_sd_v: float
    correlation_s: tuple[float, ...] = ()
    sd_v: tuple[float, ...] = ()
    soc: tuple[float, ...] = (0.5,)
    scale: tuple[float, ...] = (1.0,)
    bias_v: tuple[float, ...] = ()
    white_s: float = 0.0
    axis_sd: float = 0.0


def make_model(
    cell: CellModel,
    circuit: str,
    parameters: CircuitParameters,
    errors: ErrorModel,
    *,
    rest_current_a: float | None = None,
    slow: Sequence[str] = (),
    slow_sd: Sequence[float] = (),
) -> FilterModel:
    """The model of a circuit on a cell, constant or with tables over SOC.

    Call inside float64. Beyond its end points the OCV is extrapolated linearly, where a simulation
    holds it constant: there too the voltage has to determine the SOC.
    """
    series, parameters = get_circuit(circuit), parameters.laddered()
    hysteresis = series.hysteresis_on(cell)
    ocv_v, half_v = _straight(cell, series.ocv_v(cell, GRID)), hysteresis.half_v(cell, GRID)
    if hysteresis.kind != "dynamic":
        half_v = _straight(cell, half_v)
    if OCV_CORRECTION in parameters.tables:
        ocv_v = ocv_v + parameters.at(OCV_CORRECTION, GRID)
    if HALF_HYSTERESIS in parameters.tables:
        half_v = parameters.at(HALF_HYSTERESIS, GRID)
    columns = [parameters.at(name, GRID) for name in parameters.resistances]
    scale = np.interp(GRID, errors.soc, errors.scale)
    bias_v = np.interp(GRID, errors.soc, errors.bias_v) if errors.bias_v else 0 * GRID
    rest_a = rest_current_a or cell.capacity_ah / 100
    return FilterModel(
        table=jnp.asarray(np.stack([ocv_v, half_v, scale, bias_v, *columns], axis=1)),
        capacity_ah=jnp.asarray(cell.capacity_ah, float),
        tau_s=jnp.asarray(parameters.tau_s, float),
        gamma=jnp.asarray(parameters.gamma or 0.0, float),
        error_s=jnp.asarray(errors.correlation_s, float),
        error_sd_v=jnp.asarray(errors.sd_v, float),
        white_sd_v=jnp.asarray(errors.white_sd_v, float),
        white_s=jnp.asarray(errors.white_s, float),
        axis_sd=jnp.asarray(errors.axis_sd, float),
        current_sd_a=jnp.asarray(rest_a / NOISES_PER_REST, float),
        slow_sd=jnp.asarray(slow_sd, float),
        slow=tuple(slow),
        hysteresis=hysteresis.kind,
        has_bias=bool(errors.bias_v),
    )


def _straight(cell: CellModel, source_v: np.ndarray) -> np.ndarray:
    """The curve on the grid, straight beyond the cell's OCV points."""
    low, high = cell.soc_range
    first, last = np.searchsorted(GRID, low), np.searchsorted(GRID, high, side="right") - 1
    steps = np.arange(len(GRID))
    inside_v = source_v[np.clip(steps, first, last)]
    before_v = (steps - first).clip(max=0) * (source_v[first + 1] - source_v[first])
    after_v = (steps - last).clip(min=0) * (source_v[last] - source_v[last - 1])
    return inside_v + before_v + after_v
