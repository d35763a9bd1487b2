"""The family of circuits: its points, and the rungs that lead from one to richer ones.

A circuit is four choices, each a short ladder: the nodes of its resistances over SOC, its RC pairs,
its hysteresis, and the quantities besides SOC on which resistances depend. Tables come with a
correction of the OCV.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from ..cell import CellModel, Dependence, get_circuit
from ..cell.parameters import ANYWHERE, RATE
from ..fit.flat_ocv import DISTINCT_RATES, with_fitted_ocv
from ..fit.settings import TableSettings
from ..settings import NODES

Ladder = Literal["nodes", "pairs", "hysteresis", "switched", "law", "starts", "without"]
# The kinds of hysteresis that have their own rungs; laws are proposed from records.
HYSTERESES: tuple[Ladder, ...] = ("hysteresis", "switched")
RUNGS: tuple[Ladder, ...] = ("nodes", "pairs", *HYSTERESES)
# Nodes of resistances, the finest last: each set has every second node of the next.
NODE_LADDER: tuple[tuple[float, ...], ...] = (ANYWHERE, NODES[::4], NODES[::2], NODES)
# By circuit, those with one more RC pair or a hysteresis. The ladder starts at the first; those
# with a hysteresis have two pairs.
RICHER: Mapping[str, Mapping[Ladder, str]] = {
    "1rc": {"pairs": "so-rc", "hysteresis": "esc", "switched": "iso-rc"},
    "so-rc": {"pairs": "3rc", "hysteresis": "esc", "switched": "iso-rc"},
    "3rc": {"hysteresis": "esc+rc"},
    "esc": {"pairs": "esc+rc"},
    "esc+rc": {},
    "iso-rc": {},
}


@dataclass(frozen=True)
class Point:
    """A circuit of the family: its name, the nodes of its resistances, and their law."""

    circuit: str
    nodes: tuple[float, ...] = ANYWHERE
    law: Dependence | None = None

    @property
    def has_rate(self) -> bool:
        """True for a circuit whose hysteresis follows the charge."""
        return get_circuit(self.circuit).has_rate

    @property
    def kind(self) -> str:
        """The kind of its hysteresis."""
        return get_circuit(self.circuit).hysteresis.kind

    @property
    def pairs(self) -> int:
        """Number of RC pairs."""
        return get_circuit(self.circuit).pairs

    @property
    def is_constant(self) -> bool:
        """True if resistances have one value at every SOC."""
        return len(self.nodes) == 1


@dataclass(frozen=True)
class Subfamily:
    """The part of the family to try.

    Args:
        start: The simplest circuit.
        nodes: Node ladder, from coarse to fine.
        richer: By circuit, the richer ones.
        laws: Permitted resistance laws; None leaves the choice to the records.
        has_ocv: Whether the OCV is a table fitted to the records.
        is_asked: Whether the circuit was requested: richer ones are tried, and none is kept.
    """

    start: str
    nodes: tuple[tuple[float, ...], ...] = NODE_LADDER
    richer: Mapping[str, Mapping[Ladder, str]] = field(default_factory=dict)
    laws: tuple[str, ...] | None = ()
    has_ocv: bool = False
    is_asked: bool = False

    def rungs(self, point: Point) -> Iterator[tuple[Ladder, Point]]:
        """The richer circuits one rung away, except for laws, which are proposed from records."""
        finer = self.nodes[self.nodes.index(point.nodes) + 1 :]
        if finer:
            yield "nodes", replace(point, nodes=finer[0])
        for ladder, circuit in self.richer.get(point.circuit, {}).items():
            yield ladder, replace(point, circuit=circuit)

    def simpler(self, point: Point) -> Iterator[Point]:
        """The circuits from which this one is one rung away, except for laws."""
        if index := self.nodes.index(point.nodes):
            yield replace(point, nodes=self.nodes[index - 1])
        for circuit, others in self.richer.items():
            if point.circuit in others.values() and circuit != point.circuit:
                yield replace(point, circuit=circuit)

    def without_rate(self, point: Point) -> Point:
        """The circuit with the same number of pairs without the hysteresis."""
        names = (name for name, to in self.richer.items() if to.get("hysteresis") == point.circuit)
        *_, circuit = names
        return replace(point, circuit=circuit)

    def settings_of(self, point: Point, settings: TableSettings) -> TableSettings:
        """The settings of the tables of a point."""
        if self.has_ocv:
            return with_fitted_ocv(replace(settings, nodes=point.nodes), point.circuit)
        is_corrected = settings.ocv_correction and not point.is_constant
        bounds = settings.bounds
        if point.has_rate and not Point(self.start).has_rate and RATE not in settings.ranges:
            # An optional hysteresis has a bounded rate.
            bounds = {**bounds, RATE: DISTINCT_RATES}
        return replace(settings, nodes=point.nodes, ocv_correction=is_corrected, bounds=bounds)


def limits_of(
    cell: CellModel,
    settings: TableSettings,
    model: str | None = None,
    over_soc: bool | None = None,
    has_ocv: bool = False,
) -> Subfamily:
    """The part of the family for a cell.

    Args:
        cell: The cell: if its OCV test shows a significant hysteresis, the family starts there.
        settings: Nodes other than the default are the only ones over SOC; with bounds or fixed
            values there are two pairs, or three if these apply to a third.
        model: The only circuit; None for all.
        over_soc: True for tables only, False for constants only.
        has_ocv: Whether the OCV is a table fitted to the records.
    """
    nodes = NODE_LADDER if settings.nodes == NODES else tuple({ANYWHERE: 0, settings.nodes: 0})
    if over_soc is not None and len(nodes) > 1:
        nodes = nodes[1:] if over_soc else nodes[:1]
    if not settings.folds:
        # With nothing held out there is no choice: the standard circuit, with the nodes as given.
        nodes = nodes[-1:]
    laws = {"auto": None, "none": ()}.get(
        settings.resistances_follow, tuple(settings.resistances_follow.split(","))
    )
    if model is not None:
        # With a fitted OCV, a hysteresis that is left out distorts resistances.
        others = RICHER.get(model, {}) if has_ocv else {}
        richer = {model: {ladder: others[ladder] for ladder in others if ladder == "hysteresis"}}
        return Subfamily(model, nodes, richer, laws, has_ocv, is_asked=True)
    is_bounded = bool(settings.ranges)
    start = "esc" if cell.has_flat_ocv else "1rc" if settings.folds and not is_bounded else "so-rc"
    if any(str(get_circuit(start).pairs + 1) in name for name in settings.ranges):
        # A third pair is requested by its bounds.
        start = RICHER[start].get("pairs", start)
    gaps = {"hysteresis": has_ocv or cell.has_gap, "switched": cell.has_gap and not has_ocv}
    richer: dict[str, Mapping[Ladder, str]] = {}
    reached = [start]
    for circuit in reached:
        richer[circuit] = {
            ladder: other
            for ladder, other in RICHER[circuit].items()
            if (ladder != "pairs" or not is_bounded) and gaps.get(ladder, True)
        }
        reached += richer[circuit].values()
    return Subfamily(start, nodes, richer, laws, has_ocv)
