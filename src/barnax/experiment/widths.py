"""Half the 95 % intervals that fits are predicted to have, and had, in one measure."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..over_soc.intervals import NodeInterval
from ..over_soc.node_interval import sag_of
from .information import HALF_95, Believed, Information, Name


@dataclass(frozen=True)
class Width:
    """Half the 95 % interval of one value, as a test is predicted to leave it: relative for
    resistances and time constants, in V for an OCV.

    Args:
        name: What it is.
        soc: Its node, None of a time constant.
        value: What it is believed to be.
        alone: Half the interval of a fit of the test alone.
        after: The same of a fit of the test with the earlier records.
        before: The same of a fit of the earlier records alone, None where they tell nothing.
    """

    name: str
    soc: float | None
    value: float
    alone: float
    after: float
    before: float | None


def widths_of(believed: Believed, found: Information) -> tuple[Width, ...]:
    """Half an interval of every value that some sample is near to."""
    alone = after = _halves(believed, found)
    if believed.told_before is not None:
        after = _halves(believed, found + believed.told_before)
    before = before_of(believed)
    return tuple(
        Width(*name, value, own, own_after, before.get(name))
        for name, value, own, own_after, square in zip(
            believed.names,
            believed.values.tolist(),
            alone.tolist(),
            after.tolist(),
            np.diag(found.of_unknowns),
            strict=True,
        )
        if square > 0
    )


def before_of(believed: Believed) -> dict[Name, float]:
    """Half the intervals of a fit of the earlier records, in the measure of those of a test; what
    their own fit told where they do not count."""
    found = believed.told_before
    if found is None:
        return dict(believed.known)
    seen = np.diag(found.of_unknowns) > 0
    halves = zip(believed.names, _halves(believed, found).tolist(), seen, strict=True)
    return {name: half for name, half, is_seen in halves if is_seen}


def told_half(interval: NodeInterval) -> float | None:
    """Half an interval of a fit in the measure of a design: what more samples would narrow. None
    where nothing tells it."""
    scale = interval.value if interval.name.startswith(("R", "tau")) else 1.0
    if interval.low is None or interval.high is None or not scale > 0:
        return None
    return (HALF_95 * interval.standard_error + abs(interval.bias) / 2) / scale


def _halves(believed: Believed, found: Information) -> Float[np.ndarray, "unknowns"]:
    """Half the intervals as `over_soc.intervals` has them: by the noise, and half of what smoothing
    and the straight lines between nodes move."""
    light, smooth = found.inverse(believed), found.inverse(believed, 1.0)
    errors = np.sqrt(np.maximum(np.diag(found.covariance(believed, light)), 0.0))
    is_r = np.array([name.startswith("R") for name, _ in believed.names])
    smoothed = (smooth - light) @ (found.of_unknowns @ np.where(is_r, believed.values, 0.0))
    moved, is_seen = np.zeros(len(errors)), np.diag(found.of_unknowns) > 0
    for name, places in believed.tables_of_names.items():
        seen = np.arange(places.start, places.stop)[is_seen[places]]
        if name.startswith("R") and len(seen):
            nodes = np.array([soc for _, soc in believed.names])[seen].astype(float)
            sag = sag_of(nodes, believed.values[seen])
            moved[seen] = np.maximum(np.abs(smoothed[seen]), np.abs(smoothed[seen] - sag))
    return (HALF_95 * errors + moved / 2) / believed.units
