"""Circuits of one to four RC pairs around the average OCV: U = OCV - R0 I - U1 - U2 - ...

Two pairs are the second-order model of Li et al. (2023), Eq. 1.
"""

from ..model import CellModel
from .circuit import Circuit, Samples


def average_ocv(cell: CellModel, soc: Samples, direction: Samples) -> Samples:
    """The average of both OCV branches in V, whatever the direction."""
    del direction
    return cell.average_ocv_v(soc)


ONE_RC = Circuit("1rc", "one RC pair, OCV averaged over charge and discharge", average_ocv, pairs=1)
SO_RC = Circuit("so-rc", "two RC pairs, OCV averaged over charge and discharge", average_ocv)
THREE_RC = Circuit(
    "3rc", "three RC pairs, OCV averaged over charge and discharge", average_ocv, pairs=3
)
FOUR_RC = Circuit(
    "4rc", "four RC pairs, OCV averaged over charge and discharge", average_ocv, pairs=4
)
