"""Kalman filters that identify a circuit online: with least squares, and dual."""

from functools import partial

import jax
import numpy as np

from ..cell import CircuitParameters
from ..execution import in_float64
from ..filters import Drive, ErrorModel, make_model, run_filter
from ..filters.model import GRID, NOISES_PER_REST
from ..model.problem import Problem
from . import regression
from .method import Answer, MethodFailure, deterministic
from .regression import FORGETTING, averaged

# Prior errors of a circuit in the middle of its box, before any data.
FIRST_ERROR_V = 0.02
# The start is known from rest; this is the accuracy assumed for a battery manager.
SOC_SD = 0.01
# Largest prior standard deviation of a parameter from the middle of its box, in logarithms.
LARGEST_SD = 1.0


def middle_of(problem: Problem) -> tuple[CircuitParameters, dict[str, float]]:
    """A circuit in the middle of the box, and each parameter's prior deviation, none if held.

    Time constants are at equal steps of their logarithm, because two equal pairs would stay equal.
    Deviations are of the logarithms: a quarter of the box, `LARGEST_SD` at most.
    """
    box, pairs = problem.bounds, problem.bounds.pairs
    shares = np.arange(1, pairs + 1) / (pairs + 1)
    tau_low, tau_high = np.array([box.tau_range_s(pair) for pair in range(pairs)]).T
    tau_s = tau_low * (tau_high / tau_low) ** shares
    low, high = box.resistance_box(tau_s)
    r0, *r = np.sqrt(low * high)
    gamma = None if box.gamma_range is None else float(np.sqrt(np.prod(box.gamma_range)))
    names = ["R0", *(f"R{pair}" for pair in range(1, pairs + 1))]
    names += [f"tau{pair}" for pair in range(1, pairs + 1)]
    spans = np.log(np.concatenate([high / low, tau_high / tau_low])) / 4
    sd = {name: min(float(span), LARGEST_SD) for name, span in zip(names, spans, strict=True)}
    circuit = CircuitParameters.of_tau(r0, r, tau_s, gamma)
    return circuit, {name: spread for name, spread in sd.items() if spread > 0}


@in_float64
def least_squares_and_filter(problem: Problem) -> Answer:
    """Recursive least squares for the circuit, an extended Kalman filter for its states, in turn.

    In the manner of Tan et al. (2021): at every sample the filter moves SOC and the voltages of the
    pairs with the circuit of the least squares, which use the open-circuit voltage at the filter's
    SOC, not at the counter's. The filter has the first circuit of `middle_of` until the regression
    gives one. Choices left open in the paper: the regression is that of `rls`; the current's noise
    is a fifth of that below which the cell counts as resting; the measurement noise is the mean
    square of the innovations so far, forgotten as in `rls`. The answer is that of `averaged`.
    Raises `MethodFailure` if a parameter is held or the filter diverges.
    """
    samples, columns, _ = regression.regression(problem)
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), np.finfo(float).tiny)
    prepared, (middle, _) = problem.prepared, middle_of(problem)
    model = make_model(problem.cell, prepared.circuit, middle, ErrorModel(FIRST_ERROR_V))
    ocv_v, half_v = np.asarray(model.table[:, 0]), np.asarray(model.table[:, 1])
    slope_v = np.gradient(ocv_v, GRID)
    drive = jax.tree.map(np.asarray, Drive.of(prepared))
    pairs, current_sd_a = middle.pairs, prepared.rest_current_a / NOISES_PER_REST
    r0, r, tau_s = middle.r0, np.array(middle.r), np.array(middle.tau_s)
    state = np.concatenate([[prepared.start.soc], np.zeros(pairs)])
    covariance = np.diag([SOC_SD**2, *(r * current_sd_a) ** 2])
    noise_v2 = FIRST_ERROR_V**2
    tracked = np.zeros(len(scale)), regression.VARIANCE * np.eye(len(scale))
    drops_v, rows = np.zeros(len(samples.time_s)), []
    for k, (interval_s, held_a) in enumerate(zip(drive.interval_s, drive.held_a, strict=True)):
        kept = np.exp(-interval_s / tau_s)
        per_ampere = np.concatenate([[-interval_s / (3600 * prepared.capacity_ah)], r * (1 - kept)])
        kept = np.concatenate([[1.0], kept])
        state = kept * state + per_ampere * held_a
        covariance = kept[:, None] * covariance * kept
        covariance += np.diag((per_ampere * current_sd_a) ** 2)
        by_state = np.concatenate([[np.interp(state[0], GRID, slope_v)], -np.ones(pairs)])
        turned_v = drive.direction[k] * np.interp(state[0], GRID, half_v)
        source_v = np.interp(state[0], GRID, ocv_v) + turned_v
        innovation_v = drive.voltage_v[k] - (source_v - r0 * drive.current_a[k] - state[1:].sum())
        noise_v2 += (1 - FORGETTING) * (innovation_v**2 - noise_v2)
        seen = covariance @ by_state
        gain = seen / (by_state @ seen + noise_v2)
        state = state + gain * innovation_v
        covariance = covariance - np.outer(gain, seen)
        if not np.all(np.isfinite(state)):
            raise MethodFailure(f"the filter of its states diverges after {drive_time(drive, k)}")
        source_v = np.interp(state[0], GRID, ocv_v) + turned_v
        drops_v[k] = source_v - drive.voltage_v[k]
        if not samples.is_row[k]:
            continue
        recent = slice(k - pairs, k + 1)
        here = drops_v[recent], drive.current_a[recent]
        columns, target = regression.difference_equation(*here, pairs)
        row = columns[0] / scale, target[0]
        tracked = regression.update(tracked, row, FORGETTING)
        rows.append(regression.circuit_values(tracked[0] / scale, samples, pairs))
        if all(np.all(np.isfinite(values) & (values > 0)) for values in rows[-1]):
            r0, r, tau_s = rows[-1]
    r0s, rs, taus_s = zip(*rows, strict=True)
    tracked_values = np.array(r0s), np.array(rs), np.array(taus_s)
    return averaged(problem, tracked_values, samples.notes)


def drive_time(drive: Drive, index: int) -> str:
    """The time of a sample since the first."""
    return f"{float(np.sum(drive.interval_s[: index + 1])):.0f} s"


@in_float64
def dual_filter(problem: Problem) -> Answer:
    """Two unscented Kalman filters, of the states and of the circuit, whose noise adapts.

    In the manner of Peng et al. (2021), with `barnax.filters`: two unscented filters side by side,
    the measurement noise following the residuals with the memory of `rls`. Choices left open in the
    paper: it starts in the middle of the box (`middle_of`) at the counter's SOC, and parameters are
    logarithms, so that each sample has a circuit. The filter of the parameters looks one interval
    ahead, so time constants and slow pairs have only a faint effect on it. The answer is that of
    `averaged`; a dynamic hysteresis keeps the middle rate. Raises `MethodFailure` if a filter
    diverges.
    """
    prepared, (middle, slow_sd) = problem.prepared, middle_of(problem)
    model = make_model(
        problem.cell, problem.circuit, middle, ErrorModel(FIRST_ERROR_V),
        rest_current_a=prepared.rest_current_a,
        slow=tuple(slow_sd), slow_sd=tuple(slow_sd.values()),
    )  # fmt: skip
    start = model.start(prepared.start.soc, SOC_SD, float(prepared.start.direction), 0.0)
    drive = Drive.of(prepared)
    slow = np.asarray(_dual(model, start, drive).slow)
    if not np.all(np.isfinite(slow)):
        first = int(np.argmin(np.all(np.isfinite(slow), axis=1)))
        raise MethodFailure(f"its filters diverge after {drive_time(drive, first)}")
    factor = dict(zip(slow_sd, np.exp(slow).T, strict=True))
    pairs = range(1, middle.pairs + 1)
    held = np.ones(len(slow))
    r = np.stack([middle.r[pair - 1] * factor.get(f"R{pair}", held) for pair in pairs], axis=1)
    tau_s = [middle.tau_s[pair - 1] * factor.get(f"tau{pair}", held) for pair in pairs]
    tau_s = np.stack(tau_s, axis=1)
    if problem.bounds.interchangeable_pairs:
        # Pairs may change order on their way.
        order = np.argsort(tau_s, axis=1)
        r, tau_s = (np.take_along_axis(values, order, axis=1) for values in (r, tau_s))
    r0, scored = middle.r0 * factor.get("R0", held), prepared.scored
    return averaged(problem, (r0[scored], r[scored], tau_s[scored]), gamma=middle.gamma)


_dual = jax.jit(partial(run_filter, kind="dual", adapting=1 - FORGETTING))

RLS_EKF = deterministic(
    "rls-ekf",
    "Recursive least squares and an extended Kalman filter for the states (Tan et al., 2021)",
    least_squares_and_filter,
)
DUAL_UKF = deterministic(
    "dual-ukf",
    "Adaptive dual unscented Kalman filter (Peng et al., 2021)",
    dual_filter,
)
