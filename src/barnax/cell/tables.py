"""A circuit whose resistances are tables over state of charge."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .parameters import MOST_PAIRS, RATE

OCV_CORRECTION = "OCV correction [V]"
HALF_HYSTERESIS = "half hysteresis [V]"

Table = tuple[float, ...]


def hats(
    soc: Float[np.ndarray, "samples"], nodes: Sequence[float] | Float[np.ndarray, "nodes"]
) -> Float[np.ndarray, "samples nodes"]:
    """Each node's share of a table's value at every SOC: linear between nodes, constant beyond.

    >>> hats(np.array([-1.0, 0.25, 1.0]), (0.0, 0.5, 1.0)).tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.stack([np.interp(soc, nodes, each) for each in np.eye(len(nodes))], axis=1)


@dataclass(frozen=True)
class SocTables:
    """A circuit with tables over SOC: one value per node, linear between nodes, constant beyond.

    `r0_ohm` is the ohmic resistance, `r_ohm` has one table for each RC pair, and `tau_s` are their
    time constants, which are the same at every SOC. `ocv_correction_v` is added to the average
    OCV; None means no correction. `half_hysteresis_v` replaces half the hysteresis voltage as the
    amplitude of a dynamic hysteresis of rate `gamma`; None uses the measured one. `visited` says
    which nodes are the nearest of some scored sample: the values of the others follow from their
    neighbors and mean nothing by themselves.

    Raises `InputError` if nodes do not rise or a table has another length.

    >>> tables = SocTables((0.0, 1.0), (60.0,), (0.06, 0.04), ((0.02, 0.01),), visited=(True, True))
    >>> float(tables.at("R0 [Ohm]", np.array([0.5]))[0])
    0.05
    """

    nodes: Table
    tau_s: Table
    r0_ohm: Table
    r_ohm: tuple[Table, ...]
    ocv_correction_v: Table | None = None
    half_hysteresis_v: Table | None = None
    gamma: float | None = None
    visited: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        if len(self.r_ohm) != len(self.tau_s) or not 1 <= len(self.r_ohm) <= MOST_PAIRS:
            raise InputError(
                f"a circuit has one to {MOST_PAIRS} RC pairs; {len(self.r_ohm)} tables of R and "
                f"{len(self.tau_s)} time constants were given"
            )
        for name, table in self.tables.items():
            if len(table) != len(self.nodes):
                raise InputError(
                    f"the table of {name} has {len(table)} values for {len(self.nodes)} nodes"
                )

    @property
    def pairs(self) -> int:
        return len(self.tau_s)

    @property
    def tables(self) -> Mapping[str, Table]:
        """Every table under PyBaMM's name of what it tabulates."""
        named = {"R0 [Ohm]": self.r0_ohm}
        named |= {f"R{pair} [Ohm]": table for pair, table in enumerate(self.r_ohm, 1)}
        if self.ocv_correction_v is not None:
            named[OCV_CORRECTION] = self.ocv_correction_v
        if self.half_hysteresis_v is not None:
            named[HALF_HYSTERESIS] = self.half_hysteresis_v
        return named

    @property
    def constants(self) -> Mapping[str, float]:
        """What does not change with SOC, by name: the time constants and, if any, gamma."""
        named = {f"tau{pair} [s]": tau_s for pair, tau_s in enumerate(self.tau_s, 1)}
        return named if self.gamma is None else named | {RATE: self.gamma}

    def at(self, name: str, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The table of that name at some states of charge. Raises `KeyError` for an unknown one."""
        return np.interp(soc, self.nodes, self.tables[name])


def require_nodes(nodes: Sequence[float]) -> None:
    """Raise `InputError` unless there are nodes, finite and each above the one before."""
    if not len(nodes) or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0):
        raise InputError(
            f"the nodes {', '.join(f'{node:g}' for node in nodes)} must be states of charge, each "
            "above the previous one"
        )
