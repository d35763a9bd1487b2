"""Intervals and identifiability of parameters, and changes that would lower the error."""

from .assessment import Assessment as Assessment
from .assessment import Band as Band
from .assessment import Diagnostics as Diagnostics
from .assessment import Examination as Examination
from .assessment import assess as assess
from .assessment import examine as examine
from .batch_fit import Refit as Refit
from .bootstraps import Bootstrap as Bootstrap
from .bootstraps import bootstrap as bootstrap
from .covariance import Covariance as Covariance
from .covariance import Estimate as Estimate
from .covariance import Uncertainty as Uncertainty
from .covariance import compile_linearization as compile_linearization
from .identifiability import Identifiability as Identifiability
from .identifiability import Undetermined as Undetermined
from .profiles import Profile as Profile
from .profiles import profile as profile
from .suggestions import Suggestion as Suggestion
from .suggestions import suggestions as suggestions
