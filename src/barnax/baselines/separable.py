"""Methods that solve for the resistances at given time constants: by a search, by subspaces."""

import numpy as np
from jaxtyping import Bool, Float

from ..global_optimum import find_global_optimum
from ..global_optimum.objective import ConstantObjective
from ..model.problem import Problem
from .method import Answer, MethodFailure, deterministic
from .regression import answer_of, even_samples


def variable_projection(problem: Problem) -> Answer:
    """The best circuit of a search over ln tau alone (Golub and Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413).

    At each set of time constants the resistances are the exact optimum of a bounded linear
    least-squares problem. The outer search is that of the global optimum without its proof: a grid
    over the ordered time constants, evenly spaced in ln tau, whose local minima are polished; a
    dynamic hysteresis adds ln gamma to the search. It draws nothing, and simulates nothing but its
    answer. Raises `InputError` where the box is too wide to compress.
    """
    best = find_global_optimum(problem, prove=False)
    return Answer(best.parameters, best.rmse_v, evaluations=0)


VARPRO = deterministic(
    "varpro",
    "Variable projection (Golub and Pereyra, 1973), bounded resistances, polished grid in tau",
    variable_projection,
)


# Rows of the past and of the future, for every pair: twice the order is the least that can work.
HORIZON = 15
# Time constants this close together, relative to them, are one pole to rounding.
APART = 1e-6


def subspace_method(problem: Problem) -> Answer:
    """The circuit whose poles span the future voltages that the past predicts.

    N4SID (Van Overschee and De Moor, Subspace Identification, 1996, section 4.3) with the weights
    of MOESP: current and drop (source minus terminal voltage) in block rows of the past and the
    future, the future drops projected along the future currents onto the past, and the poles from
    the shift of the leading singular vectors, as many as there are pairs. With the poles the
    resistances are those of least squares over the record, inside the box. As in Li et
    al. (2016), whose reference number 19 Li et al. (2023) give for it, the order is that of the
    circuit; `HORIZON` block rows a pair are ours. Poles that are complex, negative or unstable
    belong to no circuit: raises `MethodFailure`, also for an uneven clock, for a current that never
    changes, and for a record too short for the block rows.
    """
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
    shown = ", ".join(f"{tau:.4g} s" for tau in tau_s)
    objective = ConstantObjective.of(problem)
    low, high = np.transpose([(axis.low, axis.high) for axis in objective.axes])
    inside = np.clip(np.log(tau_s), low, high)
    if np.any(np.diff(inside) < APART):
        raise MethodFailure(f"its time constants, {shown}, are one inside the search box")
    notes = samples.notes
    if np.any(np.abs(inside - np.log(tau_s)) > APART):
        notes = (*notes, f"its time constants, {shown}, are moved into the search box")
    found = objective.circuit(objective.solve(tuple(inside.tolist()), exact=True))
    return answer_of(problem, found, notes)


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
        windows(signal / max(float(np.std(signal)), np.finfo(float).tiny), 2 * rows)[use]
        for signal in (current_a, drop_v)
    )
    past = np.hstack([current[:, :rows], drop[:, :rows]])
    whole = np.hstack([current[:, rows:], past, drop[:, rows:]])
    factor = np.asarray(np.linalg.qr(whole, mode="r")).T
    projected = factor[3 * rows :, rows : 3 * rows]
    observed = np.linalg.svd(projected)[0][:, :order]
    return np.linalg.lstsq(observed[:-1], observed[1:])[0]


N4SID = deterministic(
    "n4sid",
    "Subspace identification, N4SID (Van Overschee and De Moor, 1996; Li et al., 2016)",
    subspace_method,
)
