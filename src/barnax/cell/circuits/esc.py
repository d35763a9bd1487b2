"""Two RC pairs and a hysteresis that takes charge to turn: the enhanced self-correcting model.

Plett, J. Power Sources 134 (2004) 262, with one state h and without the instantaneous part:
U = OCV - R0 I - U1 - U2 + h W/2, and over an interval in which the SOC changes by dz,
h <- exp(-gamma |dz|) h + (1 - exp(-gamma |dz|)) Sig, Sig being +1 while charging. As gamma grows
it becomes `iso-rc`.
"""

from ..model import CellModel
from .circuit import Circuit, Samples
from .rc import average_ocv


def half_hysteresis(cell: CellModel, soc: Samples) -> Samples:
    """Half the hysteresis voltage in V: the way from the average OCV to either branch."""
    return cell.hysteresis_v(soc) / 2


ESC = Circuit(
    name="esc",
    description="two RC pairs, average OCV and dynamic hysteresis of rate gamma",
    source_voltage=average_ocv,
    hysteresis_amplitude=half_hysteresis,
)
