"""Any pair's answer from a few: against the exponential itself."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

from barnax.model.compressed import Lagrange
from barnax.model.exponentials import can_span, interpolation_error, span_of

SPAN = span_of(0.5, 2000.0, 1e-12)
INTERVAL_S = 0.5
SAMPLES = 3000
# Both ends of the span, and 198 places all over it.
FRACTIONS = np.append(np.sort(np.random.default_rng(0).random(199)), 1.0)
FRACTIONS[0] = 0.0


def step_answer(tau):
    """An RC pair's answer to a current that is switched on, at every sample: the closed form."""
    return -np.expm1(-np.arange(SAMPLES) * INTERVAL_S / np.asarray(tau)[..., None])


def test_the_skeleton_gives_the_answer_of_any_time_constant_in_the_span():
    tau = 0.5 * 4000.0**FRACTIONS
    with jax.enable_x64(True):
        shares = np.asarray(jax.vmap(Lagrange.of(SPAN).at)(jnp.asarray(tau)))
    answer = shares @ SPAN.from_skeleton.T @ step_answer(SPAN.skeleton_tau)
    np.testing.assert_allclose(answer, step_answer(tau), rtol=0, atol=SPAN.error)


def test_the_promised_error_is_kept_with_room():
    assert SPAN.error <= 1e-12
    assert len(SPAN.skeleton) < len(SPAN.nodes)


def test_the_widest_span_that_is_taken_keeps_the_promise_too():
    uppers = 0.5 * 10 ** np.arange(12, 4, -0.25)
    widest = next(upper for upper in uppers if can_span(0.5, upper, 1e-12))
    assert span_of(0.5, widest, 1e-12).error <= 1e-12


@pytest.mark.parametrize("half_width", [2.0, 6.0])
def test_the_error_of_interpolation_stays_under_its_bound(half_width):
    count = 40
    angles = (2 * np.arange(count) + 1) * math.pi / (2 * count)
    nodes = half_width * np.cos(angles)
    log_s = np.arange(-20, 10, 0.1)
    kernel = lambda x: np.exp(log_s - x - np.exp(log_s - x))  # noqa: E731
    between = BarycentricInterpolator(nodes, np.stack([kernel(x) for x in nodes]))
    worst = max(
        0.1 * np.sum(np.abs(between(x) - kernel(x)))
        for x in np.linspace(-half_width, half_width, 301)
    )
    assert worst <= interpolation_error(count, half_width)


def test_a_node_itself_is_no_singularity():
    with jax.enable_x64(True):
        basis = Lagrange.of(SPAN)
        tau = jnp.exp(basis.center + basis.half_width * basis.nodes[7])
        shares, slopes = map(np.asarray, jax.jvp(basis.at, (tau,), (tau,)))
    assert np.argmax(shares) == 7
    assert np.sum(shares) == pytest.approx(1.0)
    assert np.all(np.isfinite(slopes))


def test_the_slope_in_log_tau_is_that_of_the_exponential():
    tau = 0.5 * 4000.0 ** FRACTIONS[1:-1]
    with jax.enable_x64(True):
        at = jax.vmap(Lagrange.of(SPAN).at)
        _, slopes = jax.jvp(at, (jnp.asarray(tau),), (jnp.asarray(tau),))
    answer = np.asarray(slopes) @ SPAN.from_skeleton.T @ step_answer(SPAN.skeleton_tau)
    x = np.arange(SAMPLES) * INTERVAL_S / tau[:, None]
    np.testing.assert_allclose(answer, -x * np.exp(-x), rtol=0, atol=1e-9)
