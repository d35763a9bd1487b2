"""Estimates under several sizes of a change of shape, against the moments of their mixture."""

import numpy as np

from barnax.fit.ageing import SHAPE_ODDS, _averaged
from barnax.fit.nuisances import NuisanceEstimate


def estimated(draw, log_evidence):
    root, by_prior = draw.standard_normal((5, 5)), draw.standard_normal((5, 3))
    values, moved = draw.standard_normal(5), draw.standard_normal(2)
    return NuisanceEstimate(values, root @ root.T, moved, by_prior, log_evidence)


def test_an_average_over_shapes_has_the_mean_and_the_variance_of_the_mixture():
    draw = np.random.default_rng(0)
    evidence = np.array([-700.0, -699.0, -701.5])[: len(SHAPE_ODDS)]
    under = [estimated(draw, each) for each in evidence]
    weights = np.exp(evidence + 700.0) * np.array(SHAPE_ODDS[: len(under)])
    weights /= weights.sum()
    average = _averaged(under)

    def mean(of):
        return sum(weight * of(one) for weight, one in zip(weights, under, strict=True))

    np.testing.assert_allclose(average.values, mean(lambda one: one.values), rtol=1e-12)
    np.testing.assert_allclose(average.by_prior, mean(lambda one: one.by_prior), rtol=1e-12)
    np.testing.assert_allclose(average.moved_scales, mean(lambda one: one.moved_scales), rtol=1e-12)
    # The mean of squares less the square of the mean.
    squares = mean(lambda one: one.covariance + np.outer(one.values, one.values))
    np.testing.assert_allclose(
        average.covariance, squares - np.outer(average.values, average.values), rtol=1e-10
    )
    np.testing.assert_allclose(
        np.exp(average.log_evidence + 700.0),
        sum(np.exp(evidence + 700.0) * np.array(SHAPE_ODDS[: len(under)])),
    )
