"""Subspace identification (N4SID): poles from the record's column space, then resistances."""

import numpy as np
from jaxtyping import Bool, Float

from ..model.problem import Problem
from .method import Answer, Budget, Method, MethodFailure, Progress
from .regression import answer_of, even_samples
from .varpro import OuterSearch, triangular_factor

# Rows of the past and of the future, for every pair: twice the order is the least that can work.
HORIZON = 15
# Time constants this close together, relative to them, are one pole to rounding.
APART = 1e-6


def subspace_method(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The circuit whose poles span the future voltages that the past predicts.

    N4SID (Van Overschee and De Moor, Subspace Identification, 1996, section 4.3) with the weights
    of MOESP: current and drop (source minus terminal voltage) in block rows of the past and the
    future, the future drops projected along the future currents onto the past, and the poles from
    the shift of the leading singular vectors, as many as there are pairs. With the poles the
    resistances are those of least squares over the simulated record, inside the box. As in Li et
    al. (2016), whose reference number 19 Li et al. (2023) give for it, the order is that of the
    circuit; `HORIZON` block rows a pair are ours. Poles that are complex, negative or unstable
    belong to no circuit: raises `MethodFailure`, also for an uneven clock, for a current that never
    changes, and for a record too short for the block rows.
    """
    del budget
    pairs = problem.bounds.pairs
    rows = HORIZON * pairs
    samples = even_samples(problem.prepared, 2 * rows - 1)
    if not np.ptp(samples.current_a):
        raise MethodFailure("the current never changes, and without a change it shows no pole")
    if (found := np.count_nonzero(samples.is_row)) < 4 * rows:
        raise MethodFailure(
            f"it needs {4 * rows} samples with {2 * rows - 1} evenly before each; there are {found}"
        )
    poles = np.linalg.eigvals(
        state_matrix(samples.current_a, samples.drop_v, samples.is_row, rows, pairs)
    )
    if np.any(poles.imag != 0) or np.any((poles.real <= 0) | (poles.real >= 1)):
        shown = ", ".join(f"{pole:.4g}" for pole in poles)
        raise MethodFailure(
            f"the poles it finds ({shown}) are not decays, so they are not time constants; noise "
            "and model error cause this"
        )
    tau_s = np.sort(-samples.interval_s / np.log(poles.real))
    search = OuterSearch(problem)
    inside = np.clip(np.log(tau_s), search.low, search.high)
    if np.any(np.diff(inside) < APART):
        raise MethodFailure(
            "its time constants, " + ", ".join(f"{tau:.4g} s" for tau in tau_s) + ", are one "
            "inside the search box"
        )
    notes = samples.notes
    if np.any(np.abs(inside - np.log(tau_s)) > APART):
        found = ", ".join(f"{tau:.4g} s" for tau in tau_s)
        notes = (*notes, f"its time constants, {found}, are moved into the search box")
    progress(1)
    return answer_of(problem, search.circuit(inside), notes)


def state_matrix(
    current_a: Float[np.ndarray, "samples"],
    drop_v: Float[np.ndarray, "samples"],
    is_row: Bool[np.ndarray, "samples"],
    rows: int,
    order: int,
) -> Float[np.ndarray, "order order"]:
    """The state matrix, up to a change of basis, of a system of one input and one output.

    `is_row` says of every sample whether it and the 2 `rows` - 1 before it can be used.
    """
    windows = np.lib.stride_tricks.sliding_window_view
    use = np.flatnonzero(is_row) - (2 * rows - 1)
    current, drop = (
        windows(each / max(float(np.std(each)), np.finfo(float).tiny), 2 * rows)[use]
        for each in (current_a, drop_v)
    )
    past = np.hstack([current[:, :rows], drop[:, :rows]])
    factor = triangular_factor(np.hstack([current[:, rows:], past, drop[:, rows:]])).T
    projected = factor[3 * rows :, rows : 3 * rows]
    observed = np.linalg.svd(projected)[0][:, :order]
    return np.linalg.lstsq(observed[:-1], observed[1:])[0]


N4SID = Method(
    "n4sid",
    "Subspace identification, N4SID (Van Overschee and De Moor, 1996; Li et al., 2016)",
    is_deterministic=True,
    run=subspace_method,
)
