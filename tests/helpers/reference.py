"""What tests compare against: the circuit and its fit in plain NumPy and SciPy.

Nothing here calls the code under test; `make_record` only fills in a record's fields.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import least_squares
from scipy.signal import lfilter

from barnax.records import Decision, Hold, Record

ROWS_BEFORE = 2


def make_record(
    time_s, current_a, voltage_v=None, *, step=None, hold: Hold = "forward", name: str = "made.csv"
) -> Record:
    """A record of these samples; discharge current is positive, the first one is row 2."""
    time_s = np.asarray(time_s, float)
    return Record(
        name=name,
        time_s=time_s,
        current_a=np.broadcast_to(np.asarray(current_a, float), time_s.shape),
        voltage_v=np.broadcast_to(
            np.asarray(3.7 if voltage_v is None else voltage_v, float), time_s.shape
        ),
        temperature_degc=None,
        step=None if step is None else np.asarray(step, int),
        row=np.arange(len(time_s)) + ROWS_BEFORE,
        sign=Decision("discharge-positive", "given", "made so"),
        hold=Decision(hold, "given", "made so"),
        sha256="",
    )


def looped_response(time_s, current_a, tau, hold: Hold = "forward"):
    """Voltage over an RC pair of 1 ohm, one plain step a sample; `tau` may be complex."""
    state = np.zeros_like(tau * 1.0)
    states = [state]
    for sample in range(len(time_s) - 1):
        share = -np.expm1(-(time_s[sample + 1] - time_s[sample]) / tau)
        flowing_a = current_a[sample if hold == "forward" else sample + 1]
        state = state + share * (flowing_a - state)
        states.append(state)
    return np.array(states)


def filtered_response(interval_s, current_a, tau, hold: Hold = "forward"):
    """The same for even intervals, as the digital filter of a zero-order hold."""
    share = -np.expm1(-interval_s / tau)
    feedback = [1.0, -np.exp(-interval_s / tau)]
    if hold == "forward":
        return lfilter([0.0, share], feedback, current_a)
    # The current of the first sample flowed before the record.
    return lfilter([share], feedback, np.append(0.0, current_a[1:]))


def banded_response(time_s, current_a, tau, hold: Hold = "forward"):
    """The same for any clock, as the solution of one bidiagonal system."""
    share = -np.expm1(-np.diff(time_s) / tau)
    flowing_a = current_a[:-1] if hold == "forward" else current_a[1:]
    bands = np.ones((2, len(time_s)))
    bands[1, :-1] = share - 1
    return solve_banded((1, 0), bands, np.append(0.0, share * flowing_a))


def drop_v(response, time_s, current_a, circuit, hold: Hold = "forward"):
    """Ohmic and polarization drop of `circuit` = (r0, (r1, ...), (tau1, ...)), in V."""
    r0, resistances, taus = circuit
    pairs = zip(resistances, taus, strict=True)
    return r0 * current_a + sum(r * response(time_s, current_a, tau, hold) for r, tau in pairs)


def fit_circuit(
    drop_of: Callable, base_v, is_scored, lower, upper, starts: int, seed: int = 0
) -> tuple[float, np.ndarray]:
    """The least RMSE in V that SciPy finds, and its (R0, R1, R2, tau1, tau2), faster pair first.

    `drop_of(r0, (r1, r2), (tau1, tau2))` is the drop at every sample, `base_v` the source minus
    the measured voltage. Trust-region least squares in logarithms, from random starts in the box.
    """

    def errors_mv(logarithms):
        r0, r1, r2, tau1, tau2 = np.exp(logarithms)
        return 1e3 * (base_v - drop_of(r0, (r1, r2), (tau1, tau2)))[is_scored]

    low, high = np.log(lower), np.log(upper)
    rng = np.random.default_rng(seed)
    options = {"bounds": (low, high), "xtol": 1e-13, "ftol": 1e-13, "gtol": 1e-13}
    fits = [
        least_squares(errors_mv, rng.uniform(low, high), max_nfev=200, **options)
        for _ in range(starts)
    ]
    best = min(fits, key=lambda fit: fit.cost)
    r0, r1, r2, tau1, tau2 = np.exp(best.x)
    if tau1 > tau2:
        r1, r2, tau1, tau2 = r2, r1, tau2, tau1
    rmse_v = 1e-3 * np.sqrt(2 * best.cost / np.count_nonzero(is_scored))
    return rmse_v, np.array([r0, r1, r2, tau1, tau2])
