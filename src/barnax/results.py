"""`result.json`: the results of an identification, and all that is needed to use or repeat it.

The stored content is the dataclasses of the numerics (see `schema`), collected here with the files,
the settings and the versions behind them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from pydantic import Field, PrivateAttr, model_validator

from .cell import CellModel, CircuitParameters
from .display import hook
from .errors import InputError
from .fit.settings import table_name
from .fit.table_fit import TableFit
from .fit.temperature_fits import TableFits
from .job import FileRole
from .model.start import Start
from .model.window import Window
from .pulses import Pulse
from .result_parts import Candidate, CircuitName, ConstantPart, InputPart, MetricsBlock
from .schema import Document, NoticeField
from .search.answers import AtBound
from .search.evaluate import Evaluation, Evaluations
from .select.choose import Tried
from .settings import AutoHold, AutoSign, Reading

if TYPE_CHECKING:
    import numpy as np
    import polars
    from matplotlib.figure import Figure

    from .records import Given
    from .records.read import Frame


class Result(Document):
    """The contents of `result.json`. Equal runs give equal bytes: no times, dates or folders.

    A computed or loaded result has its simulated records in `evaluations`.

    Attributes:
        schema_version: Version of the schema.
        model: Name of the answer's circuit.
        metrics: The answer's errors.
        candidates: The constant circuit and the answer, with their errors.
        tried: The circuits of the family that were tried, rung by rung, with the gain of each.
        tables: The tables over SOC that are the answer; None for a constant circuit.
        constant: The best constant circuit: the answer, or in addition to the tables.
        pulses: The pulses of pulse tests.
        cell: OCV, hysteresis voltage and capacity.
        inputs: Every file, with its digest and the decisions about it.
        plan: Every file of a folder with its role.
        notes: Changes and assumptions about the inputs; they need no action.
        warnings: Doubtful results, each with a remedy; printed as sentences.
        versions: Versions of barnax and of its numerical packages.

    >>> Result.from_json("missing.json")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    barnax.errors.InputError: missing.json: cannot be read (No such file or directory); ...
    """

    schema_version: Literal[10]
    model: CircuitName
    metrics: MetricsBlock
    candidates: tuple[Candidate, ...] = ()
    tried: tuple[Tried, ...] = ()
    tables: TableFits | None = None
    constant: ConstantPart
    pulses: tuple[Pulse, ...] = ()
    cell: CellModel
    inputs: tuple[InputPart, ...] = Field(min_length=1)
    plan: tuple[FileRole, ...] = ()
    notes: tuple[NoticeField, ...] = ()
    warnings: tuple[NoticeField, ...]
    versions: dict[str, str]

    _evaluations: tuple[Evaluations, ...] | None = PrivateAttr(None)
    _inputs: Any = PrivateAttr(None)
    remedy: ClassVar[str] = "give the folder that barnax identify wrote, or its result.json"

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        """The circuit and its error: the whole result would be pages."""
        yield "model", self.model
        if self.over is not None:
            yield "over", self.over
        yield "rmse_v", self.metrics.identification.rmse_v
        if self.over is None:
            yield "parameters", self.parameters

    @model_validator(mode="after")
    def _hold_a_record(self) -> Self:
        if not any(part.role == "identification" and part.start for part in self.inputs):
            raise ValueError("no record that was identified on is among the inputs")
        return self

    @property
    def evaluations(self) -> Evaluations:
        """The answer, simulated on its records; for the constant circuit in addition to tables use
        `without_tables()`.

        A loaded result reads its records on first access. Raises `InputError` if they are not
        found, and for one that was read by `from_json`.
        """
        if self._evaluations is None and self._inputs is not None:
            self._evaluations = hook("Result.evaluations")(self, self._inputs)
        if self._evaluations is None:
            raise InputError(
                "this result was read from a file without its records; `Result.load` finds them "
                "for the evaluations and the figures over time"
            )
        return self._evaluations[0 if self.over is None else -1]

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        data: "str | Path | Sequence[str | Path] | Mapping[str, Given]" = (),
        columns: Mapping[str, str] | str = "",
        series: int = 1,
    ) -> Self:
        """A stored result that can draw every figure again, from its records.

        They are read on first access, from `data`, the working folder, the result's, the one above
        it, or the locations in its `plan.toml`; they are matched by name, and must have the same
        content.

        Args:
            path: The folder that identify wrote, or its `result.json`.
            data: Folders of the measured files, or a mapping from the names of inputs to files or
                data frames.
            columns: Names of columns, as for `read_record`, if they were given then.
            series: Number of cells in series, if it was given then.

        Raises `InputError` if it is not a result; figures do so if a record is not found.

        >>> import tempfile, barnax
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     result = barnax.identify(setup="li2023", seeds=0, trust="none")
        ...     _ = Path(folder, "result.json").write_text(result.to_json())
        ...     again = Result.load(folder)
        >>> len(again.figure("voltage").axes)
        4
        """
        return hook("Result.load")(cls, path, data, Reading(columns=columns, series=series))

    def simulate(
        self,
        current: "Frame | Mapping[str, Sequence[float]] | Sequence[float]",
        time: "Sequence[float] | np.ndarray | None" = None,
        *,
        initial_soc: float | None = None,
        temperature: float | None = None,
        initial_direction: Literal[-1, 1] | None = None,
    ) -> "Frame":
        """The voltage of the answer, circuit or tables, for a current of your own.

        Discharge current is positive, and each sample's current flows until the next one. The
        columns `Time [s]`, `Current [A]`, `Voltage [V]` and `SOC` are returned in a data frame of
        the same library, or in a mapping to NumPy arrays. Currents far beyond those of the
        identification (1.5 times), and an SOC outside its range, give warnings.

        Args:
            current: A data frame or a mapping with a column of time and one of current, such as
                `"Time [s]"` and `"Current [A]"`; or an array of currents in A, with `time`:
                `result.simulate([0.0, 2.0], [0.0, 1.0])`.
            time: Times in s, as many as there are currents, if `current` is an array.
            initial_soc: State of charge at the first sample, from 0 (empty) to 1 (full); by default
                that at the start of the first record identified on, `result.start.soc`.
            temperature: Constant temperature of the cell in degC, which tables over temperature
                need. A column of temperatures only affects resistances that depend on it.
            initial_direction: Direction of the load before the start, for hysteresis: +1 charged,
                -1 discharged; by default that of the identification.

        Raises `InputError` for unequal columns, for values that are not numbers, times that do not
        rise, a temperature not covered by the result, and a current that takes the SOC more than 5
        % too far.

        >>> import barnax, numpy as np
        >>> result = barnax.identify(setup="li2023", seeds=0, trust="none")
        >>> time_s = np.arange(3.0)
        >>> found = result.simulate({"Time [s]": time_s, "Current [A]": [0.0, 2.0, 2.0]})
        >>> found["Voltage [V]"].round(2)
        array([4.18, 4.07, 4.07])
        """
        given = {"initial_soc": initial_soc, "initial_direction": initial_direction}
        return hook("Result.simulate")(self, current, time, temperature_degc=temperature, **given)

    def validate(  # pyrefly: ignore
        self,
        record: "Given",
        window: Window | None = None,
        *,
        current_sign: AutoSign = "auto",
        current_hold: AutoHold = "auto",
        voltage_lag: float | None = None,
        columns: Mapping[str, str] | str = "",
        series: int = 1,
    ) -> Evaluation:
        """The answer, circuit or tables, simulated on another record, with its errors.

        Args:
            record: A file, `Record` or data frame.
            window: The simulated part of the record; by default its own if it belongs to the
                result, else the one in a plan.
            current_sign: The sign of the file's current; "auto" decides from the data.
            current_hold, voltage_lag, columns, series: As for `read_record`.

        Raises `InputError` if the record or its window cannot be used.

        >>> import barnax
        >>> result = barnax.identify(setup="li2023", seeds=0, trust="none")
        >>> found = result.validate(barnax.bundled_file("validation"))
        >>> round(1e3 * found.metrics.rmse_v, 1), found.warnings
        (16.8, ())
        """
        reading = Reading(
            validate_current_sign=current_sign, current_hold=current_hold,
            voltage_lag=voltage_lag, columns=columns, series=series,
        )  # fmt: skip
        return hook("Result.validate")(self, record, window, reading)

    def to_frame(self) -> "polars.DataFrame":
        """The parameters of the answer with their 95 % intervals, units in the names.

        For a constant circuit each row is a parameter, with `value`, `low` and `high`. For tables
        each row is a node, at each temperature: its SOC, and the value of every table with its
        interval, such as `R0 [Ohm]`, `R0 low [Ohm]` and `R0 high [Ohm]`. The nodes of a fitted OCV
        are rows too, at which resistances have no interval. Missing values are null.
        """
        return hook("Result.to_frame")(self)

    def report(
        self, path: str | Path | None = None, *, format: Literal["html", "md"] | None = None
    ) -> str:
        """The report with every figure, as text; it is written to `path` if that is given.

        HTML is one file. Markdown has its figures in a folder `figures` beside it, which are
        written with it.

        Args:
            path: The file to write.
            format: "html" or "md"; by default by the suffix of `path`, else "html".

        Raises `InputError` for another format, and if a loaded result's records are not found.
        """
        return hook("Result.report")(self, path, format)

    @property
    def parameters(self) -> dict[str, float | tuple[float, ...]]:
        """The answer's parameters under PyBaMM's names in SI units.

        A table over SOC is a tuple of values at the states of charge under "SOC"; for tables at
        several temperatures, those nearest to 25 degC.
        """
        circuit = self.circuit_parameters
        if self.over is None:
            return {**circuit.to_dict()}
        return {"SOC": circuit.nodes, **circuit.tables, **circuit.constants}

    @property
    def circuit_parameters(self) -> CircuitParameters:
        """The parameters as a circuit."""
        return self.fit.tables

    @property
    def at_bound(self) -> tuple[AtBound, ...]:
        """The constants of the answer at a bound of their search."""
        return tuple(dict.fromkeys(bound for fit in self.fits for bound in fit.at_bound))

    @property
    def fits(self) -> TableFits:
        """The fitted answer, at each temperature; constants as tables of one node."""
        return self.tables or self.constant.fits

    @property
    def fit(self) -> TableFit:
        """The fit at the temperature nearest to 25 degC, or the only one: intervals and proof."""
        return self.fits.reference

    @property
    def over(self) -> Literal["ocv", "soc", "soc,temperature"] | None:
        """The coordinates of the tables, "ocv" if only the OCV is tabulated; None for a constant
        circuit.
        """
        return self.fits.over

    @property
    def answer(self) -> str:
        """The answer's circuit as named in tables and screens."""
        return table_name(self.model, self.over)

    def without_tables(self) -> Self:
        """A copy with its constant circuit as the answer."""
        constant = {"tables": None, "model": self.constant.model, "metrics": self.constant.metrics}
        return self.model_copy(update=constant)

    def at_temperature(self, temperature_degc: float) -> Self:
        """A copy with the tables over SOC, the OCV and the capacity at a single temperature."""
        # The capacity now belongs to the cell, not to a record.
        alone: dict[str, Any] = {
            "cell": self.cell_at(temperature_degc),
            "inputs": tuple(part.model_copy(update={"capacity_ah": None}) for part in self.inputs),
        }
        if self.fits.over_temperature is not None:
            fit = replace(self.fit, tables=self.fits.at(temperature_degc))
            alone["tables"] = replace(self.fits, fits=(fit,), over_temperature=None)
        return self.model_copy(update=alone)

    def cell_at(self, temperature_degc: float | None = None) -> CellModel:
        """The cell as simulated in the identification at a temperature, by default that of the
        first record: with the capacity of the first record there, which may differ from the
        cell's."""
        records = self.of_role("identification")
        if temperature_degc is None:
            temperature_degc, near = self._first.temperature_degc, records[:1]
        else:
            near = [part for part in records if part.is_at(temperature_degc)]
        cell = self.cell.at(temperature_degc)
        capacity_ah = (near[0].initial_capacity_ah if near else None) or cell.capacity_ah
        return replace(cell, capacity_ah=capacity_ah, elsewhere=())

    def of_role(self, role: str) -> tuple[InputPart, ...]:
        """The inputs with the given role."""
        return tuple(part for part in self.inputs if part.role == role)

    @property
    def name(self) -> str:
        """The names of the records identified on."""
        return " + ".join(part.name for part in self.of_role("identification"))

    @property
    def _first(self) -> InputPart:
        return self.of_role("identification")[0]

    @property
    def measured_at(self) -> list[tuple[str, float | None]]:
        """The records identified on and their temperatures, if the circuit is for a single one."""
        if self.fits.over_temperature is not None:
            return []
        planned = {part.name: part.temperature_degc for part in self.plan}
        records = [(part.name, part.temperature_degc) for part in self.of_role("identification")]
        return [(name, planned.get(name) if degc is None else degc) for name, degc in records]

    @property
    def start(self) -> Start:
        """The start of the simulation of the first record."""
        start = self._first.start
        assert start is not None, "validated above"
        return start

    @property
    def common_window(self) -> Window:
        """The window for a record outside the result: the cell's capacity and rest current, if they
        were given for all records. A start and scored samples belong to one file."""
        first, *others = [p.window.unregistered for p in self.inputs if p.window] or [Window()]
        agreed = {
            name: getattr(first, name)
            for name in ("capacity_ah", "rest_current_a")
            if all(getattr(window, name) == getattr(first, name) for window in others)
        }
        return Window(**agreed)

    @property
    def initial_soc(self) -> float:
        return self.start.soc

    @property
    def start_rest_current_a(self) -> float:
        """The current in A below which a hysteresis keeps its direction."""
        return self._first.rest_current_a or self.cell.capacity_ah / 100

    def figure(self, name: str) -> "Figure":
        """A figure by its name, such as "voltage", "error", "tables" or "ocv".

        Raises `InputError` for a figure that this result does not have.
        """
        return hook("Result.figure")(self, name)

    def _repr_html_(self) -> str:
        return hook("Result._repr_html_")(self)
