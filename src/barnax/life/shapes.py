"""Sizes of the changes of OCVs' shapes in a fleet, and its quantities with them.

A row says what each of its quantities is, and how probable its records are, under every size s
that a change of the OCV's shape may have (`over_soc.ageing`). One record hardly tells a small s,
and what it does not tell may be another capacity; what it does not tell of a fleet's cells, these
tell together. A cell's change is one walk that grows as it ages, so that its rows repeat each
other, and its early ones say nothing of its late ones. Other cells at about that age are other
draws: a row r has the probabilities

    P_r(s) ~ pi(s) P(r | s),

pi those among the others, each of which has one vote, by its row nearest in age. They are from the
largest likelihood, with the usual odds as one cell more (Dempster, Laird and Rubin 1977). One cell
in five may be like none of the others, with the usual odds: a few that change among many that do
not are found late otherwise.
"""

from collections.abc import Sequence

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from scipy.special import softmax

from ..over_soc.ageing import SHAPE_ODDS, is_determined
from ..over_soc.registration import REACH

EVIDENCE = "aged log evidence by shape"
ANOTHER, ROUNDS = 0.2, 200
# Ages of a fleet are told apart in so many parts of its span, and a cell without a row within this
# share of the span has no vote.
PARTS, NEAR = 10, 0.25


def with_pooled_shapes(
    rows: pl.DataFrame, names: str, ages: str, quantities: Sequence[str]
) -> pl.DataFrame:
    """Rows with their quantities, intervals, and errors by the OCV of before, by what all of them
    tell of shapes; as they are where they do not say how that would be."""
    if EVIDENCE not in rows.columns:
        return rows
    evidence = np.full((len(rows), len(SHAPE_ODDS)), np.nan)
    is_told = rows[EVIDENCE].is_not_null().to_numpy()
    if is_told.any():
        evidence[is_told] = np.array(rows[EVIDENCE].drop_nulls().to_list(), float)
    is_known = np.all(np.isfinite(evidence), axis=1)
    if not is_known.any():
        return rows
    known = rows.filter(is_known)
    cells = np.unique(known[names].to_numpy(), return_inverse=True)[1]
    at = known[ages].cast(pl.Float64).to_numpy()
    shares, columns = pooled_shares(evidence[is_known], cells, at), {}
    for quantity in quantities:
        told = known[f"aged {quantity} by shape"]
        here = told.is_not_null().to_numpy()
        if not here.any():
            continue
        by_shape = np.array(told.drop_nulls().to_list()).reshape(here.sum(), len(SHAPE_ODDS), -1)
        mean, own = np.einsum("rs,rsn->rn", shares[here], by_shape), np.flatnonzero(is_known)[here]
        value, off = mean[:, 0].copy(), by_shape[..., 0] - mean[:, :1]
        error = np.sqrt(np.sum(shares[here] * (by_shape[..., 1] ** 2 + off**2), axis=1))
        value[~is_determined(quantity, value, error)] = np.nan
        for end, sign in (("", 0.0), (" low", -1.0), (" high", 1.0)):
            column = rows[f"aged {quantity}{end}"].cast(pl.Float64).to_numpy(writable=True)
            column[own] = value + sign * REACH * error
            columns[f"aged {quantity}{end}"] = pl.Series(column, nan_to_null=True)
        by_ocv = rows[f"aged {quantity} by OCV"].to_list()
        for place, moved in zip(own.tolist(), mean[:, 2:].tolist(), strict=True):
            by_ocv[place] = moved
        columns[f"aged {quantity} by OCV"] = pl.Series(by_ocv, dtype=pl.List(pl.Float64))
    return rows.with_columns(**columns)


def pooled_shares(
    log_evidence: Float[np.ndarray, "rows sizes"],
    cells: Int[np.ndarray, "rows"],
    ages: Float[np.ndarray, "rows"],
) -> Float[np.ndarray, "rows sizes"]:
    """The probabilities of every size in every row."""
    span = float(np.ptp(ages)) or 1.0
    middles = ages.min() + span * (np.arange(PARTS) + 0.5) / PARTS
    parts = np.argmin(np.abs(ages[:, None] - middles), axis=1)
    own, shares = softmax(log_evidence, axis=1), np.empty_like(log_evidence)
    for part in np.unique(parts):
        here, away = parts == part, np.abs(ages - middles[part])
        nearest = np.lexsort((away, cells))
        voters = nearest[np.unique(cells[nearest], return_index=True)[1]]
        voters = voters[away[voters] <= NEAR * span]
        odds, of_voters = np.ones_like(SHAPE_ODDS), own[voters]
        for _ in range(ROUNDS):
            of_voters = odds * own[voters]
            of_voters /= np.sum(of_voters, axis=1, keepdims=True)
            odds = np.sum(of_voters, axis=0) + SHAPE_ODDS
        of_cells = np.zeros((cells.max() + 1, len(SHAPE_ODDS)))
        of_cells[cells[voters]] = of_voters
        others = np.maximum(np.sum(of_voters, axis=0) - of_cells[cells[here]], 0.0)
        by_others = others + SHAPE_ODDS
        by_others /= np.sum(by_others, axis=1, keepdims=True)
        found = ((1 - ANOTHER) * by_others + ANOTHER * SHAPE_ODDS) * own[here]
        shares[here] = found / np.sum(found, axis=1, keepdims=True)
    return shares
