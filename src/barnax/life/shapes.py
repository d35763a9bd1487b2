"""Sizes of the changes of OCVs' shapes in a fleet, and its quantities with them.

A row says what each of its quantities is, and how probable its records are, under every size s
that a change of the OCV's shape may have (`over_soc.ageing`). One record hardly tells a small s,
and what it does not tell may be another capacity. So a cell c has one s with probabilities

    P_c(s) ~ pi(s) prod over its rows r of P(r | s),

pi those of all cells, from the largest likelihood with the usual odds as one cell more (Dempster,
Laird and Rubin 1977). One row in twenty may differ from its cell's others, with the usual odds.
"""

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from scipy.special import log_softmax, ndtri, softmax

from ..over_soc.ageing import SHAPE_ODDS, is_determined
from ..uncertainty.covariance import CONFIDENCE

EVIDENCE = "aged log evidence by shape"
ANOTHER, ROUNDS = 0.05, 200


def with_pooled_shapes(rows: pl.DataFrame, names: str, quantities: tuple[str, ...]) -> pl.DataFrame:
    """Rows with their quantities, and intervals, by what all of them tell of shapes; as they are
    where they do not say how that would be."""
    if EVIDENCE not in rows.columns:
        return rows
    is_known = rows[EVIDENCE].is_not_null().to_numpy()
    known = rows.filter(is_known)
    if not len(known):
        return rows
    cells = np.unique(known[names].to_numpy(), return_inverse=True)[1]
    shares = pooled_shares(np.array(known[EVIDENCE].to_list()), cells)
    reach, columns = float(ndtri((1 + CONFIDENCE) / 2)), {}
    for quantity in quantities:
        told = known[f"aged {quantity} by shape"]
        here = told.is_not_null().to_numpy()
        values, errors = np.moveaxis(
            np.array(told.drop_nulls().to_list()).reshape(-1, len(SHAPE_ODDS), 2), 2, 0
        )
        mean = np.sum(shares[here] * values, axis=1)
        off = values - mean[:, None]
        error = np.sqrt(np.sum(shares[here] * (errors**2 + off**2), axis=1))
        mean[~is_determined(quantity, mean, error)] = np.nan
        for end, sign in (("", 0.0), (" low", -1.0), (" high", 1.0)):
            column = rows[f"aged {quantity}{end}"].cast(pl.Float64).to_numpy(writable=True)
            column[np.flatnonzero(is_known)[here]] = mean + sign * reach * error
            columns[f"aged {quantity}{end}"] = pl.Series(column, nan_to_null=True)
    return rows.with_columns(**columns)


def pooled_shares(
    log_evidence: Float[np.ndarray, "rows sizes"], cells: Int[np.ndarray, "rows"]
) -> Float[np.ndarray, "rows sizes"]:
    """The probabilities of every size in every row."""
    usual = np.log(SHAPE_ODDS / np.sum(SHAPE_ODDS))
    own = log_softmax(log_evidence, axis=1)
    of_cell = np.zeros((cells.max() + 1, len(usual)))
    np.add.at(of_cell, cells, own)
    odds, of_cells = np.zeros(len(usual)), np.zeros_like(of_cell)
    for _ in range(ROUNDS):
        of_cells = softmax(odds + of_cell, axis=1)
        expected = np.sum(of_cells, axis=0) + np.exp(usual)
        odds = np.log(expected / np.sum(expected))
    # Those of a cell are from the others, and those of a row too.
    others = np.maximum(np.sum(of_cells, axis=0) - of_cells, 0.0) + np.exp(usual)
    by_others = log_softmax((np.log(others) + of_cell)[cells] - own, axis=1)
    mixed = np.logaddexp(np.log1p(-ANOTHER) + by_others, np.log(ANOTHER) + usual)
    return softmax(mixed + own, axis=1)
