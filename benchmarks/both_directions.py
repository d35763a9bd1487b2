"""What tables of a drive are worth on a charge: `python -m benchmarks.both_directions FOLDER`.

An LFP cell (A123 26650, in the folder of measured cells): a drive and a C/3 charge, as they are
told and with the drive registered on the OCV test. Writes benchmarks/results/both_directions.md.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import barnax
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.over_soc import SocErrors, errors_on, fit_tables, register_alone
from benchmarks.pages import as_markdown, provenance, publish
from benchmarks.real_cells.cases import given_folder

RESULTS = Path(__file__).parent / "results" / "both_directions.md"
CIRCUITS = ("so-rc", "esc", "esc+diffusion")
CHARGE = Window(initial_soc=0.0, initial_direction=-1, score_steps=(11,), score_soc=(0.03, 0.95))
SETTINGS = barnax.TableSettings(max_boxes=0)


def main(arguments: list[str]) -> None:
    """Fit all rows, print the page and write it."""
    lines = [
        "# Tables of a drive on a charge",
        "",
        as_markdown(provenance("python -m benchmarks.both_directions FOLDER", 0)),
        "",
        "A123 26650 at 25 degC, RMSE in mV whole (above 10 % SOC), on the drive and on a C/3 "
        "charge from 3 to 95 % SOC; left out are blocks of the drive. Half of the measured gap is "
        "the amplitude of the hysteresis. As told, the drive starts full and has the charge of "
        "the OCV test; registered, it has the start and capacity at which its tables fit best.",
        "",
        "| circuit | drive | start [%] | capacity [Ah] | fitted on the drive: drive | left out "
        "| charge | fitted on both: drive | charge |",
        "|---" * 9 + "|",
        *_lines(given_folder(arguments) / "plett-a123-26650"),
        "",
    ]
    publish(RESULTS, "\n".join(lines))


def _lines(place: Path) -> Iterator[str]:
    tests = [barnax.read_record(place / f"ocv-s{part}_25degC.parquet") for part in (1, 3)]
    cell = barnax.characterize(tests, ocv_fit="interpolated")

    def prepared(part: int, circuit: str, window: Window) -> PreparedRecord:
        path = place / f"dyn-s{part}_25degC.parquet"
        record = barnax.read_record(path, current_sign="discharge-positive")
        return prepare_record(record, cell, circuit, window)

    for circuit in CIRCUITS:
        charge = prepared(3, circuit, CHARGE)
        told = prepared(1, circuit, Window(initial_soc=1.0))
        for name, drive in (("as told", told), ("registered", register_alone(told, SETTINGS))):
            alone = fit_tables([drive], SETTINGS)
            both = fit_tables([drive, charge], SETTINGS).errors
            held = alone.cross_validation
            errors = [alone.errors[0], held and held.tables, errors_on(charge, alone.tables), *both]
            row = [circuit, name, f"{100 * drive.start.soc:.2f}", f"{drive.capacity_ah:.3f}"]
            yield f"| {' | '.join([*row, *map(_errors, errors)])} |"


def _errors(errors: SocErrors | None) -> str:
    if errors is None or errors.above_v is None:
        return "-"
    return f"{1e3 * errors.rmse_v:.2f} ({1e3 * errors.above_v:.2f})"


if __name__ == "__main__":
    main(sys.argv[1:])
