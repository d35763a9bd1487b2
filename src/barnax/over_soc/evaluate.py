"""Tables over SOC simulated on one record, with their errors."""

from ..cell import SocTables
from ..metrics import measure
from ..model.inputs import PreparedRecord, require_changing_voltage
from ..search.evaluate import Evaluation
from .simulate import simulate_tables


def evaluate_tables(prepared: PreparedRecord, tables: SocTables) -> Evaluation:
    """The errors of tables on a record made ready. Raises `InputError` for a flat voltage."""
    require_changing_voltage(prepared)
    simulated_v = simulate_tables(prepared, tables)
    scored = prepared.scored
    metrics = measure(prepared.voltage_v[scored], simulated_v[scored])
    return Evaluation(prepared, simulated_v, metrics)
