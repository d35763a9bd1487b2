"""Circuits with tables over SOC: identified, proved, and checked on held-out blocks."""

from .cross_validation import CrossValidation as CrossValidation
from .cross_validation import SocErrors as SocErrors
from .cross_validation import is_loaded as is_loaded
from .fit import OcvCompared as OcvCompared
from .fit import TableFit as TableFit
from .fit import constant_held_out as constant_held_out
from .fit import errors_on as errors_on
from .fit import fit_tables as fit_tables
from .intervals import NodeInterval as NodeInterval
from .own_ocv import OwnOcv as OwnOcv
from .own_ocv import compare_with_own as compare_with_own
from .own_ocv import fit_with_ocv as fit_with_ocv
from .problem import HELD_GAMMA as HELD_GAMMA
from .registration import counted_alike as counted_alike
from .registration import register as register
from .registration import register_alone as register_alone
from .registration import rest_warnings as rest_warnings
from .settings import TableSettings as TableSettings
from .temperature import LeftOut as LeftOut
from .temperature import OverTemperature as OverTemperature
from .temperature import Reversal as Reversal
from .temperature import TableFits as TableFits
from .temperature import fit_temperatures as fit_temperatures
from .temperature import group_by_temperature as group_by_temperature
from .temperature import require_temperature as require_temperature
from .temperature import require_temperatures as require_temperatures
