"""The second-order RC circuit: U = OCV - R0 I - U1 - U2 (Li et al. 2023, Eq. 1)."""

from ..model import CellModel
from .circuit import Circuit, Samples


def average_ocv(cell: CellModel, soc: Samples, direction: Samples) -> Samples:
    """The average of both OCV branches in V, whatever the direction."""
    del direction
    return cell.average_ocv_v(soc)


SO_RC = Circuit(
    name="so-rc",
    description="two RC pairs, OCV averaged over charge and discharge",
    source_voltage=average_ocv,
)
