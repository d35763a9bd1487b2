"""One cell: open-circuit voltage, hysteresis, capacity and circuit, without any search."""

from .characterize import characterize as characterize
from .characterize import characterize_over_temperature as characterize_over_temperature
from .circuits import CIRCUITS as CIRCUITS
from .circuits import Circuit as Circuit
from .circuits import get_circuit as get_circuit
from .circuits import make_circuit as make_circuit
from .curves import InterpolatedCurve as InterpolatedCurve
from .curves import SegmentedHysteresis as SegmentedHysteresis
from .dependence import Dependence as Dependence
from .elements import ELEMENTS as ELEMENTS
from .elements import Element as Element
from .model import CellModel as CellModel
from .ocv_points import OcvTable as OcvTable
from .ocv_points import read_ocv_table as read_ocv_table
from .ocv_points import read_ocv_test as read_ocv_test
from .parameters import CircuitParameters as CircuitParameters
from .soc_axis import OcvPoint as OcvPoint
from .tables import TemperatureTables as TemperatureTables
