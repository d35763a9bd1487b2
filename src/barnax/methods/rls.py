"""Recursive least squares with a forgetting factor: the same regression, sample by sample."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..evaluate import evaluate_course
from ..precision import in_float64
from ..problem import Problem
from .answer import Answer, MethodFailure, Trajectory
from .even_samples import even_samples
from .method import Budget, Method, Progress
from .transfer_function import (
    circuit_of,
    impedances,
    outside_box,
    regression,
    require_all_free,
)

# Ljung's usual range is 0.98 to 0.995; at one sample a second those forget within the slower time
# constant of a cell. This remembers a thousand samples.
FORGETTING = 0.999
# Of the first guess, in units of each scaled coefficient: nothing is known of it.
VARIANCE = 1e6
# Samples after which the first guess is forgotten; the answer is averaged from there on.
MEMORY = round(1 / (1 - FORGETTING))


@in_float64
def recursive_least_squares(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The circuit that recursive least squares tracks, averaged, with its whole trajectory.

    Ljung, System Identification (1999), section 11.2, as Yang, Tang and Zhang, Energies 14 (2021)
    1054, use it for a second-order RC circuit; the forgetting factor is `FORGETTING`, the first
    guess zero. The averaged parameters are medians over time, from the sample on at which the
    first guess is forgotten (or half of a shorter record), where the equation belongs to a
    circuit; noise can make those few, and a note says how many. The bias of `ls` is its bias too.
    Raises `MethodFailure` where there are none, and where a parameter is held.
    """
    del budget
    require_all_free(problem)
    pairs = problem.bounds.pairs
    samples = even_samples(problem.course, pairs)
    columns, target = regression(samples, pairs)
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), np.finfo(float).tiny)
    coefficients = np.asarray(_track(jnp.asarray(columns / scale), jnp.asarray(target))) / scale
    r0, r, tau_s = impedances(coefficients, samples, pairs)
    is_circuit = np.isfinite(r0) & (r0 > 0) & np.all(np.isfinite(r) & (r > 0), axis=1)
    late = np.arange(len(r0)) >= min(MEMORY, len(r0) // 2)
    counted = late & is_circuit
    if not np.any(counted):
        raise MethodFailure(
            "the equation it tracks belongs to a circuit at no sample: its poles are complex, "
            "negative or unstable, or a resistance is negative"
        )
    parameters = circuit_of(
        np.median(r0[counted]),
        np.median(r[counted], axis=0),
        np.median(tau_s[counted], axis=0),
    ).ordered()
    progress(1)
    hidden = ~is_circuit[:, None]
    return [
        Answer(
            parameters=parameters,
            rmse_v=evaluate_course(problem.course, parameters).metrics.rmse_v,
            evaluations=0,
            trajectory=Trajectory(
                time_s=samples.time_s[samples.is_row],
                r0=np.where(is_circuit, r0, np.nan),
                r=np.where(hidden, np.nan, r),
                tau_s=np.where(hidden, np.nan, tau_s),
            ),
            notes=(
                f"averaged over the {np.count_nonzero(counted)} of {np.count_nonzero(late)} "
                "samples at which its equation belongs to a circuit",
                *samples.notes,
                *outside_box(parameters, problem),
            ),
        )
    ]


@jax.jit
def _track(columns, target):
    """Coefficients after every row."""
    size = columns.shape[1]

    def step(state, row):
        coefficients, variance = state
        regressor, value = row
        seen = variance @ regressor
        gain = seen / (FORGETTING + regressor @ seen)
        coefficients = coefficients + gain * (value - regressor @ coefficients)
        variance = (variance - jnp.outer(gain, seen)) / FORGETTING
        # Rounding would let it lose its symmetry, and then its sign.
        variance = (variance + variance.T) / 2
        return (coefficients, variance), coefficients

    start = (jnp.zeros(size), VARIANCE * jnp.eye(size))
    return lax.scan(step, start, (columns, target))[1]


RLS = Method(
    "rls",
    f"Recursive least squares, forgetting factor {FORGETTING} (Yang, Tang and Zhang, 2021)",
    is_deterministic=True,
    run=recursive_least_squares,
)
