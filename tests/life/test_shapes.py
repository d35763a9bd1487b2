"""Sizes of changes of shape, pooled, on quantities that hidden parts of such changes move."""

import numpy as np
import polars as pl
import pytest

from barnax.fit.ageing import CAPACITY, SHAPE_ODDS, SHAPES_V, SHIFT
from barnax.fit.registration import REACH
from barnax.life.rows import ANOTHER, EVIDENCE, ROUNDS, pooled_shares, with_pooled_shapes

AGES, SEEN, SEEN_SD_V, BY_SHAPE = 10, 8, 2.5e-3, 0.6
ENDS = "", " low", " high"


def rows_of(sizes_v, seed=0):
    """Rows of cells whose OCVs change by one walk each, which grows from nothing to such a size:
    some steps are seen, with errors, and what is not moves a capacity of 2 A.h."""
    rng, rows = np.random.default_rng(seed), []
    for cell, size_v in enumerate(sizes_v):
        walk_v, hidden_v = (size_v * rng.standard_normal(count) for count in (SEEN, 1))
        for age in range(AGES):
            grown = age / (AGES - 1)
            steps_v = grown * walk_v / np.sqrt(20) + SEEN_SD_V * rng.standard_normal(SEEN)
            variances = SHAPES_V**2 / 20 + SEEN_SD_V**2
            evidence = -(np.sum(steps_v**2) / variances + SEEN * np.log(variances)) / 2
            value = 2.0 + BY_SHAPE * grown * float(hidden_v[0])
            by_shape = [[value, BY_SHAPE * size, 1e-3 / size] for size in SHAPES_V]
            own = {f"aged {CAPACITY}{end}": None for end in ENDS}
            rows.append({"cell": f"C{cell}", "age": age, EVIDENCE: evidence.tolist(), **own,
                         f"aged {CAPACITY} by OCV": [0.0],
                         f"aged {CAPACITY} by shape": np.ravel(by_shape).tolist()})  # fmt: skip
    return pl.DataFrame(rows, infer_schema_length=None)


def capacities(rows):
    """Values and ends of the capacity, NaN where it is not determined."""
    actual = with_pooled_shapes(rows, "cell", "age", (CAPACITY,))
    return np.array([actual[f"aged {CAPACITY}{end}"].fill_null(np.nan) for end in ENDS])


def test_cells_that_keep_their_shape_tell_together_what_one_record_does_not():
    for seed in range(6):
        rows, nothing = rows_of([0.0] * 8, seed), [float("nan")] * len(SHAPES_V)
        # Rows without evidence stay as they are.
        evidence = [nothing, None, *rows[EVIDENCE].to_list()[2:]]
        _, low, high = capacities(rows.with_columns(pl.Series(EVIDENCE, evidence)))
        assert np.isnan(low[:2]).all()
        low, high = low[2:], high[2:]
        _, alone_low, alone_high = capacities(rows_of([0.0], seed)[:1])
        assert np.median(high - low) / 2 < 0.005 * 2.0
        assert not alone_high[0] - alone_low[0] < 3 * np.median(high - low)


@pytest.mark.slow
def test_the_last_ages_of_one_growing_walk_a_cell_are_within_their_intervals():
    late = np.arange(AGES) >= AGES - 2
    for sizes_v in ([0.012] * 10, [0.02] * 10, [0.0] * 8 + [0.03, 0.04]):
        held = []
        for seed in range(30):
            _, low, high = capacities(rows_of(sizes_v, seed))
            own = np.repeat(np.array(sizes_v) > 0, AGES) & np.tile(late, len(sizes_v))
            own &= np.isfinite(low)
            held += [*((low[own] <= 2.0) & (high[own] >= 2.0))]
        # Of 60 cells, or 300.
        assert np.mean(held) >= 0.9


def test_a_cell_whose_shape_changes_does_not_widen_the_others():
    sizes_v = [0.0] * 8 + [0.03, 0.04]
    fleets = np.stack([capacities(rows_of(sizes_v, seed)) for seed in range(6)])
    reach = ((fleets[:, 2] - fleets[:, 1]) / 2).reshape(-1, len(sizes_v), AGES)
    assert np.nanmedian(reach[:, :8]) < 0.005 * 2.0
    assert np.nanmedian(reach[:, 8:, -2:]) > 0.015 * 2.0


def test_rows_of_one_cell_do_not_vote_for_each_other():
    rows = rows_of([0.0])
    every = np.ptp(capacities(rows)[1:], axis=0)
    alone = [np.ptp(capacities(rows[[index]])[1:], axis=0)[0] for index in range(AGES)]
    np.testing.assert_allclose(every, alone)


def test_cells_far_from_an_age_have_no_vote_there():
    late = rows_of([0.0])[-1:]
    new = rows_of([0.0] * 8, seed=1).filter(pl.col("age") < 2)
    new = new.with_columns(cell=pl.concat_str(pl.lit("N"), "cell"))
    alone, beside = capacities(late), capacities(pl.concat([new, late]))
    np.testing.assert_allclose(beside[:, -1], alone[:, 0])


def test_shares_are_those_of_a_loop_over_cells_of_one_age():
    evidence = np.random.default_rng(1).normal(0.0, 2.0, (4, len(SHAPES_V)))
    odds = np.ones(len(SHAPES_V))
    for _ in range(ROUNDS):
        votes = [odds * np.exp(own) / np.sum(odds * np.exp(own)) for own in evidence]
        odds = sum(votes) + SHAPE_ODDS
    shares = pooled_shares(evidence, np.arange(4), np.zeros(4))
    for row, own in enumerate(evidence):
        others = sum(votes) - votes[row] + SHAPE_ODDS
        prior = (1 - ANOTHER) * others / np.sum(others) + ANOTHER * SHAPE_ODDS
        expected = prior * np.exp(own) / np.sum(prior * np.exp(own))
        np.testing.assert_allclose(shares[row], expected, rtol=1e-9)


def test_one_record_that_differs_from_its_cell_s_others_keeps_a_wide_interval():
    one = rows_of([0.0] * 8)
    other = rows_of([0.06], seed=3)[-1:].with_columns(cell=pl.lit("C7"))
    _, low, high = capacities(pl.concat([one[:-1], other]))
    assert not high[-1] - low[-1] < 5 * np.median(high[:-1] - low[:-1])


def test_an_interval_in_a_fleet_holds_the_spread_between_shapes():
    draw = np.random.default_rng(0)
    evidence = draw.normal(0.0, 2.0, (2, len(SHAPES_V)))
    # Value, standard error and what an error of the OCV adds, under every size of a change.
    by_shape = draw.uniform(0.5, 2.0, (2, len(SHAPES_V), 3))
    shift = {f"aged {SHIFT}{end}": [0.0, 0.0] for end in ENDS}
    rows = pl.DataFrame({
        "cell": ["a", "b"], "age": [0.0, 1.0], EVIDENCE: evidence.tolist(), **shift,
        f"aged {SHIFT} by shape": by_shape.reshape(2, -1).tolist(),
        f"aged {SHIFT} by OCV": [[0.0], [0.0]],
    })  # fmt: skip
    shaped = with_pooled_shapes(rows, "cell", "age", [SHIFT])
    shares = pooled_shares(evidence, np.array([0, 1]), np.array([0.0, 1.0]))
    for row, weights, (value, error, by_ocv) in zip(
        shaped.to_dicts(), shares, np.moveaxis(by_shape, 2, 1), strict=True
    ):
        mean = weights @ value
        reach = REACH * np.sqrt(weights @ (error**2 + value**2) - mean**2)
        expected = [mean, mean - reach, mean + reach, weights @ by_ocv]
        ends = [row[f"aged {SHIFT}{end}"] for end in ENDS]
        assert [*ends, *row[f"aged {SHIFT} by OCV"]] == pytest.approx(expected, rel=1e-9)
