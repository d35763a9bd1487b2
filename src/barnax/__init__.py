"""Identify lithium-ion equivalent-circuit parameters, and know how good the answer is.

Names are imported on first use: importing barnax loads no JAX, sets nothing and touches no
device.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import export as export
    from . import plots as plots
    from . import uncertainty as trust
    from .baselines import METHODS as METHODS
    from .baselines import Budget as Budget
    from .bundled import bundled_file as bundled_file
    from .cell import CellModel as CellModel
    from .cell import CircuitParameters as CircuitParameters
    from .cell import characterize as characterize
    from .checks import Diagnosis as Diagnosis
    from .checks import diagnose as diagnose
    from .comparison import Comparison as Comparison
    from .comparison import ComparisonResult as ComparisonResult
    from .comparison import compare as compare
    from .comparison import make_comparison_result as make_comparison_result
    from .errors import InputError as InputError
    from .global_optimum import GlobalOptimum as GlobalOptimum
    from .global_optimum import global_optimum as global_optimum
    from .global_optimum import regret as regret
    from .model.inputs import Window as Window
    from .model.problem import Problem as Problem
    from .model.problem import make_problem as make_problem
    from .optimizers import OPTIMIZERS as OPTIMIZERS
    from .optimizers import make_optimizer as make_optimizer
    from .records import Record as Record
    from .records import read_record as read_record
    from .results import Result as Result
    from .results import make_result as make_result
    from .search.evaluate import Evaluation as Evaluation
    from .search.evaluate import evaluate_course as evaluate_course
    from .search.evaluate import validate as validate
    from .search.identify import Identification as Identification
    from .search.identify import identify as identify
    from .search.identify import identify_many as identify_many
    from .search.refine import CrossCheck as CrossCheck
    from .search.refine import refine as refine
    from .uncertainty import Assessment as Assessment
    from .uncertainty import Examination as Examination
    from .uncertainty import assess as assess
    from .uncertainty import examine as examine

__version__ = "0.1.0"

_HOME = {
    "Assessment": "trust",
    "Budget": "methods",
    "CellModel": "cell",
    "CircuitParameters": "cell",
    "Comparison": "comparison",
    "ComparisonResult": "comparison",
    "CrossCheck": "refinement",
    "Diagnosis": "doctor",
    "Evaluation": "evaluate",
    "Examination": "trust",
    "GlobalOptimum": "optimum",
    "Identification": "identification",
    "InputError": "errors",
    "METHODS": "methods",
    "OPTIMIZERS": "optimizers",
    "Problem": "problem",
    "Record": "records",
    "Result": "result",
    "Window": "window",
    "assess": "trust",
    "bundled_file": "bundled",
    "characterize": "cell",
    "compare": "comparison",
    "diagnose": "doctor",
    "evaluate_course": "evaluate",
    "examine": "trust",
    "global_optimum": "optimum",
    "identify": "identification",
    "identify_many": "identification",
    "make_comparison_result": "comparison",
    "make_optimizer": "optimizers",
    "make_problem": "problem",
    "make_result": "result_making",
    "read_record": "records",
    "refine": "refinement",
    "regret": "optimum",
    "validate": "evaluate",
}
_MODULES = {"export", "plots", "trust"}

__all__ = [
    "METHODS",
    "OPTIMIZERS",
    "Assessment",
    "Budget",
    "CellModel",
    "CircuitParameters",
    "Comparison",
    "ComparisonResult",
    "CrossCheck",
    "Diagnosis",
    "Evaluation",
    "Examination",
    "GlobalOptimum",
    "Identification",
    "InputError",
    "Problem",
    "Record",
    "Result",
    "Window",
    "__version__",
    "assess",
    "bundled_file",
    "characterize",
    "compare",
    "diagnose",
    "evaluate_course",
    "examine",
    "export",
    "global_optimum",
    "identify",
    "identify_many",
    "make_comparison_result",
    "make_optimizer",
    "make_problem",
    "make_result",
    "plots",
    "read_record",
    "refine",
    "regret",
    "trust",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    if name in _HOME:
        value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)

        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
