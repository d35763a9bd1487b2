"""The errors of every circuit in a box from one small factor, whatever the record's length.

For given time constants the error is linear in the resistances, and an RC pair's response to the
current is a combination of a few responses (`exponentials`). With T the triangular factor of [those
responses, current, base error], a circuit's squared error is |T w|^2 with w from its few
parameters: the sum over all samples, without the samples.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Scalar

from ..cell.parameters import ANYWHERE
from ..execution import as_input
from .coordinates import Coordinates
from .exponentials import Span
from .layout import Layout, ends_of, spans_between
from .prepared import PreparedRecord
from .reduced import reduce_records
from .simulate import AbstractEvaluator, RCParameters
from .triangles import NEGLIGIBLE_V, shorten


class Lagrange(eqx.Module):
    """The Lagrange polynomials of a span, as the compiled search evaluates them."""

    center: Scalar
    half_width: Scalar
    nodes: Float[Array, "nodes"]
    weights: Float[Array, "nodes"]
    slope: Float[Array, "nodes nodes"]

    @classmethod
    def of(cls, span: Span) -> "Lagrange":
        return cls(*map(as_input, (span.center, span.half_width, *span[2:5])))

    def padded_to_multiple(self, step: int) -> "Lagrange":
        """A copy with a multiple of `step` nodes: added nodes lie outside and have no weight."""
        added = 0, -len(self.nodes) % step
        nodes = as_input(np.pad(self.nodes, added, constant_values=2.0))
        weights, slope = (as_input(np.pad(each, added)) for each in (self.weights, self.slope))
        return replace(self, nodes=nodes, weights=weights, slope=slope)

    def at(self, tau: Scalar, count: Scalar | float = 1.0) -> Float[Array, "nodes"]:
        """The weights of the nodes' responses in `count` times that of `tau`."""
        return _cardinal((jnp.log(tau) - self.center) / self.half_width, jnp.asarray(count), self)


@jax.custom_jvp
def _cardinal(x: Scalar, count: Scalar, basis: Lagrange) -> Float[Array, "nodes"]:
    """Barycentric formula (Berrut and Trefethen, 2004, Eq. 4.2).

    The count enters through a division because XLA does not repeat a division for every node; it
    would repeat everything else that a candidate's resistance is computed from.
    """
    gap = x - basis.nodes
    # At a node only the term of that node counts.
    terms = basis.weights / jnp.where(gap == 0, jnp.finfo(gap.dtype).tiny, gap)
    return terms * (count / jnp.sum(terms))


@_cardinal.defjvp
def _cardinal_jvp(primals, tangents):
    # Differentiating the quotient would lose all digits next to a node.
    x, count, basis = primals
    shares = _cardinal(x, jnp.ones_like(count), basis)
    slopes = shares @ basis.slope
    return count * shares, count * slopes * tangents[0] + shares * tangents[1]


class Compressed(AbstractEvaluator):
    """A record reduced to its triangular factor, for one box.

    Its errors agree with the scan's to 1e-9, or 1e-12 V; with the arrays in single precision, which
    the reduction itself never uses, to 2e-4, or 1e-5 V.

    The columns of `factor` are those of the nodes' responses, so that `pairs` @ Lagrange
    polynomials is the response of any RC pair of 1 ohm; likewise for a dynamic hysteresis if there
    is one; then those of the current, and of the base error.
    """

    scored: Scalar
    factor: Float[Array, "rows columns"]
    in_tau: Lagrange
    in_rate: Lagrange | None = None

    def errors(self, rc: RCParameters) -> Float[Array, "rows"]:
        # All pairs at once, and counts times the factor rather than the reverse: fewer steps, and
        # nothing to transpose, in a program that spends microseconds on each.
        r, tau = map(jnp.stack, zip(*rc.pairs, strict=True))
        if rc.elements:
            # A faster pair has settled within every interval, as one at the end of the span has.
            tau = jnp.maximum(tau, jnp.exp(self.in_tau.center - self.in_tau.half_width))
        answers = jax.vmap(self.in_tau.at)(tau, r)
        counts = [sum(answers[1:], answers[0])]
        if self.in_rate is not None and rc.gamma is not None:
            counts.append(self.in_rate.at(1 / rc.gamma))
        counts.append(jnp.stack([rc.r0, jnp.ones_like(rc.r0)]))
        return jnp.concatenate(counts) @ self.factor.T

    def squared_error(self, rc: RCParameters) -> Scalar:
        errors_v = self.errors(rc)
        return jnp.sum(errors_v * errors_v)

    def padded_to_multiple(self, step: int) -> "Compressed":
        """A copy with rows and nodes padded to a multiple of `step` without effect."""
        spans = [self.in_tau] if self.in_rate is None else [self.in_tau, self.in_rate]
        ends = np.cumsum([len(span.nodes) for span in spans])
        *answers, others = np.split(np.asarray(self.factor), ends, axis=1)
        filled = [np.pad(columns, ((0, 0), (0, -columns.shape[1] % step))) for columns in answers]
        factor = np.pad(np.hstack([*filled, others]), ((0, -len(others) % step), (0, 0)))
        spans = [span.padded_to_multiple(step) for span in spans]
        return Compressed(self.scored, as_input(factor), *spans)


def compress(records: Sequence[PreparedRecord], box: Coordinates) -> Compressed:
    """One or more records, reduced together. Call inside float64.

    Raises `InputError` if the box is too wide for the promised accuracy.
    """
    spans = in_tau, in_rate = spans_between(ends_of(records, *box.spans))
    layout = Layout(ANYWHERE, ANYWHERE, *spans, has_correction=False, has_amplitude=False)
    groups = [prepared.scored.astype(np.int32) - 1 for prepared in records]
    (reduced,) = reduce_records(records, layout, groups, 1)
    factor, count = reduced.factor, len(in_tau.skeleton)
    # The columns of all nodes from those of the skeletons; the last two stay.
    columns = [factor[:, :count] @ in_tau.from_skeleton]
    if in_rate is not None:
        columns.append(factor[:, count:-2] @ in_rate.from_skeleton)
    factor = np.concatenate([*columns, factor[:, -2:]], axis=1)
    factor = shorten(factor, NEGLIGIBLE_V * math.sqrt(reduced.scored))
    rate = None if in_rate is None else Lagrange.of(in_rate)
    scored = as_input(float(reduced.scored))
    return Compressed(scored, as_input(factor), Lagrange.of(in_tau), rate)
