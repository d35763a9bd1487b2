"""One cell: open-circuit voltage, hysteresis, capacity and circuit; knows nothing of search."""

from .characterize import characterize, characterize_over_temperature, without_drop
from .circuits import CIRCUITS, Circuit, get_circuit, make_circuit
from .curves import (
    AbstractCurve,
    HysteresisFit,
    InterpolatedCurve,
    OcvFit,
    PolynomialCurve,
    SegmentedHysteresis,
)
from .dependence import Dependence
from .elements import ELEMENTS, Element
from .model import CellModel, FitError
from .ocv_table import OcvTable, read_ocv_table, read_ocv_test
from .parameters import CircuitParameters, parameter_names
from .soc_axis import OcvPoint
from .tables import TemperatureTables

__all__ = [
    "CIRCUITS",
    "ELEMENTS",
    "AbstractCurve",
    "CellModel",
    "Circuit",
    "CircuitParameters",
    "Dependence",
    "Element",
    "FitError",
    "HysteresisFit",
    "InterpolatedCurve",
    "OcvFit",
    "OcvPoint",
    "OcvTable",
    "PolynomialCurve",
    "SegmentedHysteresis",
    "TemperatureTables",
    "characterize",
    "characterize_over_temperature",
    "get_circuit",
    "make_circuit",
    "parameter_names",
    "read_ocv_table",
    "read_ocv_test",
    "without_drop",
]
