"""What may be chosen of tables over SOC, with the defaults and where they come from."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..cell.circuits import RATE
from ..cell.tables import Table, require_nodes
from ..errors import InputError
from ..model.search_space import PAIRS, RESISTANCES, Range

# Closer below 20 % SOC, where resistances rise, and reaching below the lowest SOC of any record:
# tables that end at 0 bend all that lies above.
NODES: Table = (
    *(-0.05, -0.03, -0.015, 0.0, 0.025, 0.05, 0.1, 0.15, 0.2),
    *(0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
)
# Validation moves by 0.2 mV over four decades of this: it only ties nodes that no sample visits.
ROUGHNESS = 1e-4
RESISTANCE_RIDGE, VOLTAGE_RIDGE = 1e-9, 1e-7
FASTEST_TAU_S, SLOWEST_TAU_S = 2.0, 1000.0
# With an OCV correction a slower pair than this share of the record imitates a wrong capacity.
SLOWEST_SHARE = 0.1
# Blocks go to the folds in turn, so that no fold lacks a whole range of SOC.
FOLDS, BLOCK_S = 5, 400.0


@dataclass(frozen=True)
class TableSettings:
    """How tables over SOC are fitted.

    The objective is the mean squared error plus, for each table x, w^2 (`roughness` times the sum
    of its squared second differences plus a ridge times the sum of its squares). For resistances
    w is the capacity in Ah over 1 h, so in A, and the ridge is `resistance_ridge`; for voltages w
    is 1 and the ridge `voltage_ridge`. Second differences are taken over node numbers, not SOC.

    `ocv_correction` adds a table to the OCV; `half_hysteresis` fits the amplitude of a dynamic
    hysteresis instead of using half the hysteresis voltage. `bounds` and `fixed` are under PyBaMM's
    names: those of a resistance hold at every SOC, a time constant or gamma has one value for all.
    A fit is certified if its sqrt(J) is proved to be within `proved_share` of the lowest, using
    at most `most_cells` cells; 0 means no proof. Every `folds`-th block of `block_s` seconds
    is held out in turn for cross-validation; 0 `folds` means none.

    Raises `InputError` for nodes that do not rise, weights that are not positive, and bounds or
    fixed values that are unknown, reversed, negative or both given.
    """

    nodes: Table = NODES
    ocv_correction: bool = True
    half_hysteresis: bool = False
    roughness: float = ROUGHNESS
    resistance_ridge: float = RESISTANCE_RIDGE
    voltage_ridge: float = VOLTAGE_RIDGE
    bounds: Mapping[str, Range] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    proved_share: float = 0.01
    most_cells: int = 1000
    folds: int = FOLDS
    block_s: float = BLOCK_S

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        for name in ("roughness", "resistance_ridge", "voltage_ridge", "block_s"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"`{name}` {getattr(self, name):g} must be positive")
        if self.folds < 0 or self.folds == 1:
            raise InputError(f"`folds` {self.folds} must be 0 or at least 2")
        known = {*RESISTANCES, *(tau for tau, _ in PAIRS), RATE}
        for name in {*self.bounds, *self.fixed} - known:
            raise InputError(
                f"{name!r} cannot be bounded or fixed with tables over SOC; only resistances, time "
                "constants such as 'tau1 [s]' and gamma can"
            )
        for name in self.bounds.keys() & self.fixed.keys():
            raise InputError(f"{name!r} is both bounded and fixed; give one of them")
        for name, (low, high) in self.ranges.items():
            least = 0.0 if name in RESISTANCES else np.finfo(float).tiny
            if not least <= low <= high < np.inf:
                raise InputError(
                    f"the bounds of {name!r} are [{low:g}, {high:g}]; the lower one comes first, "
                    "and neither is negative"
                )

    @property
    def ranges(self) -> dict[str, Range]:
        """Bounds and fixed values alike, as ranges."""
        return {**self.bounds, **{name: (each, each) for name, each in self.fixed.items()}}
