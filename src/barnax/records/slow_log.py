"""Slow logs: rows that are means over their intervals, or samples of an instant.

The load changes between the rows. Of instants the charge between them is not known, so that the
voltage wanders from what the logged current tells, and keeps what it gained: the differences
between rows that a circuit leaves are innovations. Of means the charge is right, and what is left
is of each row alone, as noise is: its differences have a correlation of -1/2 with the next.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from .lag import lagged
from .logger import SOMETIMES, SlowRows
from .samples import SLOW_S, Samples, changes_through_values_between

# Time constants of pairs in rows, and SOC nodes of R0 and of the OCV.
_TAUS, _R0_NODES, _OCV_NODES = (1.0, 3.0, 10.0, 30.0), 5, 11
# No circuit follows near empty and full; between, each column needs this many rows.
_INSIDE, _FEWEST = (0.15, 0.98), 3
# Innovations are looked for in so many rows at a time, as shares of the noise.
_BLOCK, _SHARES = 64, np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 40)])


def slow_rows(samples: Samples) -> SlowRows | None:
    """What a slow record shows of its rows; None where its load seldom changes from row to row."""
    if samples.interval_s < SLOW_S:
        return None
    loaded, alone = samples.alone
    through = changes_through_values_between(samples.current_a)
    if not through and alone <= SOMETIMES * loaded:
        return None
    shown = SlowRows(loaded, alone, through)
    charge_ah = np.append(0.0, np.cumsum(samples.held_ah("centered")))
    # Charging raises the voltage, whichever sign it has in the file.
    charge_ah *= np.sign(np.cov(charge_ah, samples.voltage_v)[0, 1])
    left = _left_v(samples.current_a, samples.voltage_v, charge_ah)
    if left is None:
        return shown
    left_v, moved_v = left
    rows = len(left_v)
    correlation = float(np.mean(left_v[1:] * left_v[:-1]) / np.mean(left_v**2))
    return replace(
        shown,
        rows=rows,
        correlation=rows * correlation,
        innovation=rows * _innovation(left_v, moved_v),
    )


def _left_v(
    current_a: Float[np.ndarray, "rows"],
    voltage_v: Float[np.ndarray, "rows"],
    charge_ah: Float[np.ndarray, "rows"],
) -> tuple[Float[np.ndarray, "rows"], Float[np.ndarray, "rows"]] | None:
    """Residuals of the voltage's differences after R0 and OCV over SOC and pairs, and those."""
    moved_v = np.diff(voltage_v)
    if not np.ptp(charge_ah) > 0:
        return None
    soc = (charge_ah - charge_ah.min()) / np.ptp(charge_ah)
    between = (soc[1:] + soc[:-1]) / 2
    columns = [np.diff(current_a) * hat for hat in _hats(between, 0.0, _R0_NODES)]
    for rows in _TAUS:
        kept = np.exp(-1 / rows)
        answer = np.diff(lagged(current_a, kept))
        columns += [answer, answer * between] if rows < _TAUS[2] else [answer]
    columns += [np.diff(hat) for hat in _hats(soc, 0.1, _OCV_NODES)[1:]]
    columns += [current_a[1:], current_a[:-1], np.ones(len(between))]
    table = np.column_stack(columns)
    is_inside = (between > _INSIDE[0]) & (between < _INSIDE[1])
    if np.count_nonzero(is_inside) < _FEWEST * table.shape[1]:
        return None
    table, moved_v = table[is_inside], moved_v[is_inside]
    table = table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-12)
    left_v = moved_v - table @ np.linalg.lstsq(table, moved_v, rcond=1e-10)[0]
    return (left_v, moved_v) if np.any(left_v) else None


def _hats(at: Float[np.ndarray, "rows"], first: float, nodes: int) -> list[np.ndarray]:
    """Columns of a table over SOC that is linear between even nodes."""
    places = np.linspace(first, 1.0, nodes)
    return [np.maximum(1 - np.abs(at - place) / (places[1] - places[0]), 0.0) for place in places]


def _innovation(left_v: Float[np.ndarray, "rows"], moved_v: Float[np.ndarray, "rows"]) -> float:
    """The innovations of the voltage as a share of what it moves, by its median block.

    The most likely share of a random walk beside white noise, by Whittle's likelihood.
    """
    found = []
    blocks = max(len(left_v) // _BLOCK, 1)
    for left, moved in zip(
        np.array_split(left_v, blocks), np.array_split(moved_v, blocks), strict=True
    ):
        power = np.abs(np.fft.rfft(left)[1:]) ** 2 / len(left)
        place = 2 * np.pi * np.arange(1, len(power) + 1) / len(left)
        shape = _SHARES[:, None] + 2 * (1 - np.cos(place))
        noise = np.mean(power / shape, axis=1)
        likely = -np.sum(np.log(shape), axis=1) - len(power) * np.log(np.maximum(noise, 1e-300))
        best = int(np.argmax(likely))
        found.append(np.sqrt(_SHARES[best] * noise[best]) / max(float(np.std(moved)), 1e-12))
    return float(np.median(found))
