"""The bound of a box of tables against its formulas, one unknown after another."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from barnax.execution import in_float64
from barnax.fit.certificate import _BoxAxis, _Relaxation
from barnax.fit.table_problem import find_best, reduced_objective
from helpers.dense import BOX, CAPACITY_AH, SETTINGS, made_record, prepared_of

THIRD, ERROR = 1 / (9 * math.sqrt(3)), 1.25


@pytest.fixture(scope="module")
def relaxation():
    settings = replace(SETTINGS, ocv_correction=True)
    prepared = prepared_of(made_record(200, interval_s=3.0))
    return _Relaxation(in_float64(reduced_objective)([prepared], settings, BOX))


def allowance(objective, remainders, number, node, half_width):
    """How far y.column can be below its parabola, for any unit y."""
    third, error = remainders[number][:, node]
    return THIRD * third * half_width**3 + ERROR * error


def lowest(three):
    """The least of the parabola through values at -1, 0 and 1, by NumPy's polynomials."""
    parabola = np.polynomial.Polynomial.fit([-1, 0, 1], three, 2, domain=[-1, 1])
    turns = [at for at in parabola.deriv().roots() if np.isreal(at) and abs(at) < 1]
    return min(parabola(np.real(at)) for at in [-1.0, 1.0, *turns])


def by_hand(relaxation, box, error, bent, objective_v2, taxes=None, signs=(0.0, 0.0)):
    """2 (y.base) - |y|^2 - |z|^2 with the least of every unknown times its coefficient; taxes are
    those of every node's own scale, at the end of the box that a sign says."""
    objective = relaxation.objective
    value = 2 * error @ objective.base - error @ error - bent @ bent
    low, high = limits_by_hand(objective, objective_v2)
    fixed = objective.fixed_columns
    lacking = np.zeros(len(low))
    for table in range(objective.tables):
        block = objective.block(table)
        for node in range(block.stop - block.start):
            unknown = block.start + node
            slope = 2 * bent @ objective.penalty[:, unknown]
            if table in fixed:
                slope += 2 * error @ fixed[table][:, node]
            for number, axis in enumerate(objective.axes):
                if axis.table == table:
                    ends = box[number]
                    at = [ends[0], sum(ends) / 2, ends[1]]
                    three = [2 * error @ axis.columns(np.array([u]))[0, :, node] for u in at]
                    if taxes is not None:
                        tax = taxes[number][node] * (ends[1] - ends[0]) / 2
                        three = [
                            lacked + tax * where
                            for lacked, where in zip(three, (-1, 0, 1), strict=True)
                        ]
                        slope -= signs[number] * tax
                    short = allowance(objective, relaxation.remainders, number, node,
                                      (ends[1] - ends[0]) / 2)  # fmt: skip
                    slope += lowest(three) - 2 * np.linalg.norm(error) * short
                    lacking[unknown] = max(-slope, 0.0)
            value += min(low[unknown] * slope, high[unknown] * slope)
    return value, lacking


def limits_by_hand(objective, objective_v2):
    """The furthest that an unknown goes where no ridge alone costs more, by linear programs."""
    widths = [len(nodes) for nodes in objective.nodes_of]
    ridges = [SETTINGS.resistance_ridge] * 3 + [SETTINGS.voltage_ridge]
    weights = [CAPACITY_AH] * 3 + [1.0]
    furthest = np.repeat(
        [math.sqrt(objective_v2 / ridge) / weight
         for ridge, weight in zip(ridges, weights, strict=True)],
        widths,
    )  # fmt: skip
    # The last table's unknowns are its first value and the steps from there.
    to_tables = np.eye(len(furthest))
    to_tables[-widths[-1] :, -widths[-1] :] = np.tri(widths[-1])
    rows, ends = np.vstack([to_tables, -to_tables]), np.append(furthest, furthest)
    reach = np.array(
        [-linprog(-unit, rows, ends, bounds=(None, None)).fun for unit in np.eye(len(furthest))]
    )
    low, high = objective.box
    return np.maximum(low, -reach), np.minimum(high, reach)


@in_float64
def test_the_limits_of_unknowns_are_those_of_the_tables_that_a_penalty_allows(relaxation):
    expected = limits_by_hand(relaxation.objective, 3e-6)
    np.testing.assert_allclose(relaxation._limits(3e-6), expected, rtol=1e-9)


@in_float64
def test_any_direction_gives_the_bound_of_its_formula_and_what_it_lacks(relaxation):
    objective, draw = relaxation.objective, np.random.default_rng(0)
    box = [(2.0, 2.2), (3.9, 4.3)]
    best = find_best(objective)
    middle = objective.solve((2.1, 4.1))
    given = zip(objective.axes, box, [middle] * 2, relaxation.remainders, (2.1, 4.1), strict=True)
    plain = [_BoxAxis.of(*lacked) for lacked in given]
    np.testing.assert_allclose(
        [box_axis.tax for box_axis in plain],
        [
            -2 * middle.error @ axis.slopes_at(at)
            for axis, at in zip(objective.axes, (2.1, 4.1), strict=True)
        ],
        rtol=1e-12,
    )
    limits = relaxation._limits(best.objective_v2)
    for _ in range(10):
        error = best.error * draw.uniform(0.5, 1.5) + 1e-4 * draw.standard_normal(len(best.error))
        bent = 1e-4 * draw.standard_normal(len(objective.penalty))
        taxes, signs = (
            1e-4 * draw.standard_normal((2, objective.nodes)),
            draw.choice([-1.0, 1.0], 2),
        )
        box_axes = [replace(box_axis, tax=tax) for box_axis, tax in zip(plain, taxes, strict=True)]
        value, lacking = relaxation._dual(error, bent, box_axes, signs, limits)
        expected, lacks = by_hand(relaxation, box, error, bent, best.objective_v2, taxes, signs)
        assert value == pytest.approx(expected, rel=1e-9)
        for number, lacked in lacking.items():
            np.testing.assert_allclose(lacked, lacks[objective.block(1 + number)], rtol=1e-9)
