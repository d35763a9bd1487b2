"""Intervals and identifiability of parameters, and the distribution of the errors."""

from .assessment import Assessment as Assessment
from .assessment import Band as Band
from .assessment import Diagnostics as Diagnostics
from .assessment import Examination as Examination
from .assessment import assess as assess
from .assessment import examine as examine
from .covariance import Covariance as Covariance
from .covariance import Estimate as Estimate
from .covariance import Uncertainty as Uncertainty
from .covariance import compile_linearization as compile_linearization
from .identifiability import Identifiability as Identifiability
from .identifiability import Undetermined as Undetermined
from .profiles import ParameterProfile as ParameterProfile
from .profiles import profile as profile
