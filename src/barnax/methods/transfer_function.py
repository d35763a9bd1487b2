"""The circuit as a difference equation: linear in its coefficients, and back to R and C.

With z_i = exp(-dt / tau_i) and current held between samples, the drop E over R0 and n RC pairs
obeys E = [R0 + sum_i R_i (1 - z_i) / (z - z_i)] I exactly; where the current is held backward,
the fraction gains a factor z. It is written in the difference operator d = z - 1,

    d^n E + a_(n-1) d^(n-1) E + ... + a_0 E = b_n d^n I + ... + b_0 I,

whose residual, and so whose least-squares solution, is that of the usual form in E_(k-1),
E_(k-2), ..., but whose columns are not almost equal (Middleton and Goodwin, IEEE Trans. Autom.
Control 31 (1986) 1015).
"""

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..problem import Problem
from .answer import MethodFailure
from .even_samples import EvenSamples

# R C is a product, and may miss a bound of tau by its rounding.
ROUNDING = 1e-9

Coefficients = Float[np.ndarray, "... coefficients"]


def regression(
    samples: EvenSamples, pairs: int
) -> tuple[Float[np.ndarray, "rows coefficients"], Float[np.ndarray, "rows"]]:
    """Columns and target of the difference equation at every sample that is a row.

    The columns belong to a_(n-1), ..., a_0, b_n, ..., b_0.
    """
    is_row = samples.is_row[pairs:]

    def differences(values: np.ndarray, order: int) -> np.ndarray:
        return np.diff(values, order)[: len(is_row)][is_row]

    columns = [-differences(samples.drop_v, order) for order in range(pairs - 1, -1, -1)]
    columns += [differences(samples.current_a, order) for order in range(pairs, -1, -1)]
    return np.stack(columns, axis=1), differences(samples.drop_v, pairs)


def impedances(
    coefficients: Coefficients, samples: EvenSamples, pairs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R0, every pair's R and every pair's tau in s, from fast to slow, at any number of rows.

    NaN where a pole is complex, negative or unstable and so belongs to no time constant.
    """
    a, b = coefficients[..., :pairs], coefficients[..., pairs:]
    companion = np.zeros((*a.shape[:-1], pairs, pairs))
    companion[..., 0, :] = -a
    companion[..., np.arange(1, pairs), np.arange(pairs - 1)] = 1.0
    root = np.linalg.eigvals(companion)
    is_real = np.all(np.abs(root.imag) == 0, axis=-1, keepdims=True)
    pole = np.sort(root.real, axis=-1)
    is_decay = is_real & np.all((pole > -1) & (pole < 0), axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        pole = np.where(is_decay, pole, np.nan)
        numerator = sum(b[..., order, None] * pole ** (pairs - order) for order in range(pairs + 1))
        gap = pole[..., :, None] - pole[..., None, :] + np.eye(pairs)
        step = 1.0 if samples.is_forward else 1 + pole
        r = numerator / (-pole * step * np.prod(gap, axis=-1))
        r0 = b[..., 0] - (0.0 if samples.is_forward else np.sum(-pole * r, axis=-1))
        tau_s = -samples.interval_s / np.log1p(pole)
    return r0, r, tau_s


def circuit_of(r0: float | np.ndarray, r: np.ndarray, tau_s: np.ndarray) -> CircuitParameters:
    """The circuit of these values. Raises `MethodFailure` where they are no circuit's."""
    if not np.all(np.isfinite(np.hstack([r0, r, tau_s]))):
        raise MethodFailure(
            "the difference equation it finds has complex, negative or unstable poles, which no "
            "time constants have; noise and what the circuit cannot follow do that"
        )
    resistances = [float(r0), *(float(each) for each in r)]
    if min(resistances) <= 0:
        values = ", ".join(
            f"R{index} {1e3 * value:.4g} mohm" for index, value in enumerate(resistances)
        )
        raise MethodFailure(f"the difference equation it finds has a negative resistance: {values}")
    r0, *pairs = resistances
    c = tuple(float(tau) / each for each, tau in zip(pairs, tau_s, strict=True))
    return CircuitParameters(r0, tuple(pairs), c)


def require_all_free(problem: Problem) -> None:
    """Raise `MethodFailure` where a parameter is held: a difference equation cannot hold one."""
    if problem.bounds.fixed:
        held = ", ".join(f"{name} = {value:g}" for name, value in problem.bounds.fixed.items())
        raise MethodFailure(
            f"a regression of the difference equation cannot hold {held}; use another method, such "
            "as varpro, or leave out --fix"
        )


def outside_box(parameters: CircuitParameters, problem: Problem) -> tuple[str, ...]:
    """A note where parameters lie outside the search box, which a linear method does not know."""
    values = parameters.to_dict()
    values |= {f"tau{pair} [s]": tau for pair, tau in enumerate(parameters.tau_s, 1)}
    outside = [
        f"{name} = {values[name]:.4g} ({low:.4g} to {high:.4g})"
        for name, (low, high) in problem.bounds.ranges.items()
        if not low * (1 - ROUNDING) <= values[name] <= high * (1 + ROUNDING)
    ]
    return (f"outside the search box, which it does not know: {', '.join(outside)}",) * bool(
        outside
    )
