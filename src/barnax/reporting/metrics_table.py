"""Metrics as cells of a table (Li et al., 2023, Eq. 22 to 26)."""

from typing import TYPE_CHECKING

from .document import Column

if TYPE_CHECKING:
    from ..result_parts import MetricsPart

METRICS = (
    Column("RMSE", "mV"),
    Column("R2"),
    Column("R2 (paper)"),
    Column("MAPE", "%"),
    Column("CE", "V"),
    Column("max", "mV"),
    Column("samples"),
)


def metrics_cells(metrics: "MetricsPart") -> tuple[str, ...]:
    """One record's metrics under the columns `METRICS`."""
    return (
        f"{1e3 * metrics.rmse_v:.3f}",
        f"{metrics.r2:.5f}",
        f"{metrics.r2_paper:.5f}",
        f"{metrics.mape_percent:.3f}",
        f"{metrics.ce_v:.2f}",
        f"{1e3 * metrics.max_v:.1f}",
        str(metrics.samples),
    )
