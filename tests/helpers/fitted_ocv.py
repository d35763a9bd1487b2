"""Tables of one circuit with an OCV of the records' own."""

from collections.abc import Mapping, Sequence

from barnax import Record, TableSettings, Window
from barnax.fit.fitted_ocv import FittedOcv, prove_with_ocv
from barnax.fit.starts import RecordsWithoutOcvTest
from barnax.fit.table_problem import find_best, reduced_objective


def fit_with_ocv(
    records: Sequence[Record], circuit: str, windows: Mapping[str, Window], settings: TableSettings
) -> FittedOcv:
    """The tables and the OCV that fit some records of one cell best, together, as a run has them
    for a circuit that is asked for."""
    own = RecordsWithoutOcvTest.of(records, windows, settings)
    starts = own.starts(circuit)
    prepared = own.prepared(circuit, starts.windows)
    objective = reduced_objective(prepared, own.settings_of(circuit))
    return prove_with_ocv(own, objective, find_best(objective), starts)
