"""Sizes of changes of shape, pooled, on quantities that hidden parts of such changes move."""

import numpy as np
import polars as pl

from barnax.life.shapes import EVIDENCE, with_pooled_shapes
from barnax.over_soc.ageing import CAPACITY, SHAPES_V

AGES, SEEN, SEEN_SD_V, BY_SHAPE = 10, 8, 2.5e-3, 0.6


def rows_of(sizes_v, seed=0):
    """Rows of cells whose OCVs change by walks of such sizes: some steps are seen, with errors, and
    what is not moves a capacity of 2 A.h."""
    rng, rows = np.random.default_rng(seed), []
    for cell, size_v in enumerate(sizes_v):
        for _ in range(AGES):
            steps_v = size_v / np.sqrt(20) * rng.standard_normal(SEEN)
            variances = SHAPES_V**2 / 20 + SEEN_SD_V**2
            seen_v2 = np.sum((steps_v + SEEN_SD_V * rng.standard_normal(SEEN)) ** 2)
            evidence = -(seen_v2 / variances + SEEN * np.log(variances)) / 2
            value = 2.0 + BY_SHAPE * size_v * rng.standard_normal()
            own = {f"aged {CAPACITY}{end}": None for end in ("", " low", " high")}
            by_shape = [float(part) for size in SHAPES_V for part in (value, BY_SHAPE * size)]
            rows.append({"cell": f"C{cell}", EVIDENCE: evidence.tolist(), **own,
                         f"aged {CAPACITY} by shape": by_shape})  # fmt: skip
    return pl.DataFrame(rows, infer_schema_length=None)


def told(rows):
    """Values and ends of the capacity, NaN where it is not determined."""
    found = with_pooled_shapes(rows, "cell", (CAPACITY,))
    columns = (f"aged {CAPACITY}{end}" for end in ("", " low", " high"))
    return np.array([found[column].fill_null(np.nan) for column in columns])


def test_cells_that_keep_their_shape_tell_together_what_one_record_does_not():
    _, low, high = told(rows_of([0.0] * 8))
    _, alone_low, alone_high = told(rows_of([0.0])[:1])
    assert np.median(high - low) / 2 < 0.005 * 2.0
    assert not alone_high[0] - alone_low[0] < 5 * np.median(high - low)


def test_a_cell_whose_shape_changes_is_not_taken_for_the_others():
    _, low, high = told(rows_of([0.0] * 8 + [0.03, 0.04]))
    assert np.nanmedian((high - low)[: 8 * AGES]) / 2 < 0.005 * 2.0
    changed = np.isfinite(low[8 * AGES :])
    held = (low[8 * AGES :] <= 2.0) & (high[8 * AGES :] >= 2.0)
    assert np.mean(held[changed]) >= 0.9
    assert np.median((high - low)[8 * AGES :][changed]) / 2 > 0.015 * 2.0


def test_one_record_that_differs_from_its_cell_s_others_keeps_a_wide_interval():
    one = rows_of([0.0] * 8)
    _, low, high = told(
        pl.concat([one[:-1], rows_of([0.06], seed=3)[:1].with_columns(cell=pl.lit("C7"))])
    )
    assert not high[-1] - low[-1] < 5 * np.median(high[:-1] - low[:-1])


def test_older_datasets_stay_as_they_are():
    rows = pl.DataFrame({"cell": ["C1"], f"aged {CAPACITY}": [2.0]})
    assert with_pooled_shapes(rows, "cell", (CAPACITY,)).equals(rows)
