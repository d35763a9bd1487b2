"""Options of tables over SOC, with bounds."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..cell.parameters import require_nodes
from ..errors import InputError, require_positive
from ..model.search_space import Range
from ..settings import NODES, TableOptions

SLOWEST_TAU_S = 1000.0
# With an OCV correction, a pair slower than this share of the record imitates a wrong capacity.
SLOWEST_SHARE = 0.1
# Parameters that can be bounded or fixed; which of these a circuit has is checked in the fit.
TABULATED = re.compile(r"R(\d|_\w+) \[Ohm\]|tau(\d|_\w+) \[s\]|gamma")


@dataclass(frozen=True, kw_only=True)
class TableSettings(TableOptions):
    """Tables over SOC: the options of `TableOptions`, with bounds and fixed values.

    Args:
        bounds: Lowest and highest value by PyBaMM's names; those of a resistance hold at every SOC.
        fixed: Values by the same names; a time constant or gamma has one for all SOC.

    Raises `InputError` for nodes that do not rise, weights that are not positive, and bounds or
    fixed values that are unknown, reversed, negative or both given.
    """

    bounds: Mapping[str, Range] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        require_nodes(self.ocv_nodes or self.nodes)
        for name in ("roughness", "resistance_ridge", "voltage_ridge", "block_s"):
            require_positive(name, getattr(self, name))
        if self.folds < 0 or self.folds == 1:
            raise InputError(f"`folds` {self.folds} must be 0 or at least 2")
        for name in [*self.bounds, *self.fixed]:
            if not TABULATED.fullmatch(name):
                raise InputError(
                    f"{name!r} cannot be bounded or fixed with tables over SOC; only resistances, "
                    "time constants such as 'tau1 [s]' and gamma can"
                )
        for name in self.bounds.keys() & self.fixed.keys():
            raise InputError(f"{name!r} is both bounded and fixed; give one of them")
        for name, (low, high) in self.ranges.items():
            least = 0.0 if name.endswith("[Ohm]") else np.finfo(float).tiny
            if not least <= low <= high < np.inf:
                raise InputError(
                    f"the bounds of {name!r} are [{low:g}, {high:g}]; the lower one comes first, "
                    "and neither is negative"
                )

    @property
    def nodes_of_ocv(self) -> tuple[float, ...]:
        """The nodes of a table of the OCV, or of its correction: all default nodes if resistances
        use a subset of them."""
        return self.ocv_nodes or (NODES if {*self.nodes} <= {*NODES} else self.nodes)

    @property
    def ranges(self) -> dict[str, Range]:
        """Bounds and fixed values alike, as ranges."""
        return {**self.bounds, **{name: (value, value) for name, value in self.fixed.items()}}


def circuit_name(model: str, over: str | None) -> str:
    """A circuit in a sentence, with its tabulated quantity: "ocv" for the OCV alone."""
    suffixes = {None: "", "ocv": " with a fitted OCV", "soc": " with tables over SOC"}
    return model + suffixes.get(over, " with tables over SOC and temperature")


def table_name(model: str, over: str | None) -> str:
    """The name of a circuit in a table of results; tables over SOC come first."""
    name = circuit_name(model, over)
    _, tables, over_what = name.partition(" with tables")
    return f"tables{over_what} ({model})" if tables else name
