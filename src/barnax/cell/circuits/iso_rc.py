"""The same circuit with hysteresis as a controlled source (Li et al. 2023, Eq. 4 and 5).

U = OCV - R0 I - U1 - U2 + Sig W/2 with discharge current positive. The paper prints Eq. 5 for
discharge-positive and the rule for Sig for charge-positive current; Sig is +1 while charging.
"""

from ..model import CellModel
from .circuit import Circuit, Samples


def average_ocv_with_hysteresis(cell: CellModel, soc: Samples, direction: Samples) -> Samples:
    """The average OCV in V, raised by W/2 after charging and lowered by it after discharging."""
    return cell.average_ocv_v(soc) + direction * cell.hysteresis_v(soc) / 2


ISO_RC = Circuit(
    name="iso-rc",
    description="two RC pairs, average OCV and segmented hysteresis voltage",
    source_voltage=average_ocv_with_hysteresis,
)
