"""`result.json`: what an identification found, and all that is needed to use or repeat it."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from .cell import CellModel, CircuitParameters, get_circuit
from .result_parts import (
    GlobalPart,
    InputPart,
    JointPart,
    MetricsBlock,
    Parameters,
    Part,
    RefinedPart,
    SearchPart,
    Soc,
    read_stored,
)
from .trust_parts import TrustPart
from .window import Window

SCHEMA_VERSION = 1
REMEDY = "give the result.json that barnax identify wrote"


class Result(Part):
    """The whole of `result.json`. Equal runs give equal bytes: no times, dates or folders.

    `global_optimum` is None where it was not looked for, or the box is too wide for that; `trust`
    where the answer was not assessed. `jointly`
    holds every record where several were identified together; `initial_soc` is then
    that of the first, like `initial_direction`, the hysteresis' direction at the first simulated
    sample (+1 after charging), and `rest_current_a`, below which nothing turns it. Results of
    versions that did not store these two have None: `start_direction` is then the window's.

    >>> Result.from_json("missing.json")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    barnax.errors.InputError: missing.json: cannot be read (No such file or directory); ...
    """

    schema_version: Literal[1] = SCHEMA_VERSION
    model: str
    parameters: Parameters
    search: SearchPart
    refined: RefinedPart
    global_optimum: GlobalPart | None = None
    trust: TrustPart | None = None
    metrics: MetricsBlock
    cell: dict[str, Any]
    bounds: dict[str, tuple[float, float]]
    fixed: Parameters
    window: Window
    initial_soc: Soc
    initial_soc_reason: str
    initial_direction: Literal[-1, 1] | None = None
    rest_current_a: Annotated[float, Field(ge=0)] | None = None
    jointly: tuple[JointPart, ...] = ()
    inputs: tuple[InputPart, ...]
    warnings: tuple[str, ...]
    command: tuple[str, ...]
    versions: dict[str, str]

    @field_validator("model")
    @classmethod
    def _name_a_known_circuit(cls, name: str) -> str:
        return get_circuit(name).name

    @field_validator("parameters")
    @classmethod
    def _name_a_circuit(cls, values: Parameters) -> Parameters:
        return CircuitParameters.from_dict(values).to_dict()

    @model_validator(mode="after")
    def _hold_what_the_circuit_has(self) -> Self:
        wanted = get_circuit(self.model).parameter_names
        if set(self.parameters) != set(wanted):
            raise ValueError(
                f"the circuit {self.model} has the parameters {', '.join(wanted)}, not "
                f"{', '.join(self.parameters)}"
            )
        return self

    @field_validator("cell")
    @classmethod
    def _hold_a_cell(cls, cell: dict[str, Any]) -> dict[str, Any]:
        CellModel.from_dict(cell)
        return cell

    @property
    def circuit_parameters(self) -> CircuitParameters:
        return CircuitParameters.from_dict(self.parameters)

    @property
    def cell_model(self) -> CellModel:
        return CellModel.from_dict(self.cell)

    @property
    def start_direction(self) -> int:
        """+1 where the simulation starts with a charging cell's hysteresis, else -1.

        Of a result that does not store it, the window's, which is the direction before the record:
        wrong where the simulation starts later and the current has turned until then.
        """
        if self.initial_direction is None:
            return self.window.initial_direction
        return self.initial_direction

    @property
    def start_rest_current_a(self) -> float:
        """The current in A below which a hysteresis keeps its direction.

        Of a result that does not store it, the given one or C/100, its least.
        """
        if self.rest_current_a is not None:
            return self.rest_current_a
        return self.window.rest_current_a or self.cell_model.capacity_ah / 100

    def to_dict(self) -> dict[str, Any]:
        """The file's content as plain Python values, units in the keys."""
        return self.model_dump(mode="json", by_alias=True)

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=1) + "\n"

    @classmethod
    def from_json(cls, path: str | Path) -> "Result":
        """The result in a file. Raises `InputError` that names what is wrong with it."""
        return read_stored(cls, Path(path), REMEDY)
