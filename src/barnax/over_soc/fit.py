"""Tables identified from prepared records, and all that is said of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ..cell import SocTables
from ..model.inputs import PreparedRecord
from ..search.refine import AtBound
from .settings import TableSettings

# What a table's error is stated above, beside that over the whole window: below, resistances rise
# so steeply that an error in the capacity decides.
ABOVE_SOC = 0.1
# An extra is worth its parameters where it lowers both held-out errors by more than this share.
WORTHWHILE = 0.1


@dataclass(frozen=True)
class SocErrors:
    """RMSE over all samples that count, and over those above `ABOVE_SOC`; None without such."""

    rmse_v: float
    above_v: float | None

    def is_worth(self, simpler: "SocErrors") -> bool:
        """Whether it is lower than a simpler circuit's by more than `WORTHWHILE` in both."""

        def falls(own_v: float | None, other_v: float | None) -> bool:
            return own_v is None or other_v is None or own_v < (1 - WORTHWHILE) * other_v

        return falls(self.rmse_v, simpler.rmse_v) and falls(self.above_v, simpler.above_v)


@dataclass(frozen=True)
class CrossValidation:
    """Errors on blocks that were held out of the fit, of the tables and of the constant circuit.

    Each of the `folds` holds every `folds`-th of `blocks` equal blocks of every record. Time
    constants are searched in each fold anew.
    """

    folds: int
    blocks: int
    tables: SocErrors
    constant: SocErrors


@dataclass(frozen=True)
class NodeInterval:
    """One node's value of one table with its confidence interval; `soc` is None of a constant.

    `standard_error` allows for the residuals' autocorrelation, `bias` is what smoothing may have
    moved; the interval holds both. `is_biased` where the bias exceeds the standard error.
    `low` and `high` are None where the data leave the value open.
    """

    name: str
    soc: float | None
    value: float
    standard_error: float
    bias: float
    low: float | None
    high: float | None

    @property
    def is_biased(self) -> bool:
        return abs(self.bias) > self.standard_error


@dataclass(frozen=True)
class FitWarning:
    """What a user should know of a fit.

    "tau at bound": the time constant `name` ended there, at `value` seconds; "mostly unvisited":
    no sample is near the share `value` of the nodes.
    """

    kind: Literal["tau at bound", "mostly unvisited"]
    name: str
    value: float


@dataclass(frozen=True)
class TableFit:
    """Tables over SOC and what is known of them.

    `objective_v` is sqrt(J), the penalties included; `errors` are those of each record, by scan.
    No tables with time constants in `tau_ranges_s` have a smaller sqrt(J) than `lower_bound_v`,
    which `cells` were needed to show; the status is "certified" where that is within the share
    asked for. `parameters` counts the values that samples visit and the searched constants.
    `intervals` are those of visited nodes, then of time constants.
    """

    tables: SocTables
    objective_v: float
    errors: tuple[SocErrors, ...]
    tau_ranges_s: tuple[tuple[float, float], ...]
    lower_bound_v: float
    status: Literal["certified", "grid-verified"]
    cells: int
    at_bound: tuple[AtBound, ...]
    parameters: int
    intervals: tuple[NodeInterval, ...]
    cross_validation: CrossValidation | None
    warnings: tuple[FitWarning, ...]

    @property
    def proved_gap(self) -> float:
        """The largest share of sqrt(J) that other tables could save."""
        return max(0.0, 1 - self.lower_bound_v / self.objective_v) if self.objective_v else 0.0

    def of_table(self, name: str) -> tuple[NodeInterval, ...]:
        """The intervals of one table, by rising SOC."""
        return tuple(each for each in self.intervals if each.name == name and each.soc is not None)


def fit_tables(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings | None = None
) -> TableFit:
    """The tables that fit one or several records of one cell best, of the records' own circuit.

    Time constants are searched, and at every one of them all tables are the exact optimum of a
    bounded least-squares problem. The ordinary source voltage is the records': the average OCV for
    `so-rc`, with the switched hysteresis for `iso-rc`; `esc` has a dynamic one.

    Raises `InputError` where the box of time constants is empty or too wide, and where
    `half_hysteresis` is asked for without a dynamic hysteresis.
    """
    raise NotImplementedError
