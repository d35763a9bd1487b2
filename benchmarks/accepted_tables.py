"""Tables over SOC against the accepted ones of an independent program.

Run with `python -m benchmarks.accepted_tables [FOLDER OF MEASURED CELLS]`. Writes
benchmarks/results/accepted_tables.md. The other program took NumPy and SciPy's `lsq_linear` on
every sample's columns and a grid with descents over the time constants.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import barnax
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.over_soc import TableFit, errors_on
from barnax.settings import FOLDS
from benchmarks.pages import as_markdown, provenance, publish
from benchmarks.real_cells.cases import given_folder

RESULTS = Path(__file__).parent / "results" / "accepted_tables.md"
GIVEN_S = (10.0, 100.0)
PROFILE = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
# What a given row may differ by, and a searched one be above.
SHARE, ABOVE = 1e-3, 1e-5

Errors = tuple[float | None, float | None]


@dataclass(frozen=True)
class Accepted:
    """One row: what is fitted, and the other program's sqrt(J) and RMSE whole and above 10 % SOC in
    mV, of the records by name and of blocks held out; None where it has not told."""

    cell: str
    fitted: tuple[str, ...]
    ocv_correction: bool
    tau_s: tuple[float, float] | None
    root_mv: float | None
    errors_mv: dict[str, Errors]
    circuit: str = "so-rc"
    held_out_mv: Errors | None = None
    rising: bool = False


DST, DST_50, US06, US06_50 = (
    f"{cycle}_25degC_{soc}soc" for cycle in ("dst", "us06") for soc in (80, 50)
)


def _warm(degc: int) -> tuple[str, str]:
    return f"dst_{degc}degC_80soc", f"us06_{degc}degC_80soc"


def _four(*errors_mv: Errors) -> dict[str, Errors]:
    return dict(zip((DST, DST_50, US06, US06_50), errors_mv, strict=True))


SAMSUNG, A123 = "Samsung INR18650-20R", "A123 26650"
ROWS = (
    Accepted(SAMSUNG, (DST,), False, GIVEN_S, 17.2737,
             _four((16.913, 3.899), (25.292, 3.111), (34.111, 4.741), (39.066, 2.333))),
    Accepted(SAMSUNG, (DST,), True, GIVEN_S, 6.2154,
             _four((5.495, 1.252), (8.277, 2.908), (25.899, 5.154), (22.879, 2.186))),
    Accepted(SAMSUNG, (DST,), False, (9.134, 201.03), 17.0382,
             _four((16.681, 2.486), (25.174, 2.496), (33.896, 5.640), (38.738, 2.721))),
    Accepted(SAMSUNG, (DST,), True, (13.982, 53.32), 5.9566,
             _four((5.170, 1.255), (8.294, 3.152), (29.695, 4.945), (23.808, 2.305)),
             held_out_mv=(13.819, 1.583)),
    Accepted(SAMSUNG, (DST, US06), True, GIVEN_S, 9.3685,
             _four((8.994, 2.656), (9.542, 2.734), (8.598, 2.813), (13.536, 1.328))),
    Accepted(SAMSUNG, (DST,), True, GIVEN_S, 6.939,
             {DST: (6.46, 1.34), US06: (24.47, 5.17)}, rising=True),
    Accepted(SAMSUNG, (DST, US06), True, GIVEN_S, 10.263,
             {DST: (10.35, 2.71), US06: (9.60, 2.84)}, rising=True),
    Accepted(SAMSUNG, (DST, US06), True, (2.000, 27.28), 9.1463,
             _four((8.920, 2.695), (10.386, 3.207), (8.158, 2.890), (13.378, 1.607)),
             held_out_mv=(27.923, 2.938)),
    Accepted(SAMSUNG, _warm(0)[:1], True, (7.278, 76.74), 7.6276,
             {_warm(0)[0]: (7.542, None), _warm(0)[1]: (18.792, 12.191)}),
    Accepted(SAMSUNG, _warm(45)[:1], True, (9.025, 56.90), 3.9784,
             {_warm(45)[0]: (2.956, 1.003), _warm(45)[1]: (16.104, 2.588)}),
    Accepted(SAMSUNG, _warm(0), False, None, None,
             {_warm(0)[0]: (10.837, None), _warm(0)[1]: (11.972, 10.033)}),
    Accepted(SAMSUNG, _warm(45), True, None, None,
             {_warm(45)[0]: (7.747, 1.736), _warm(45)[1]: (9.696, 1.500)}),
    Accepted(A123, ("dyn-s1_25degC",), True, (17.402, 368.2), 5.8756,
             {"dyn-s1_25degC": (4.346, 2.449), "dyn-s3_25degC": (51.351, 24.283)}),
    Accepted(A123, ("dyn-s1_25degC",), True, (15.368, 304.9), 5.9677,
             {"dyn-s1_25degC": (4.475, 2.538), "dyn-s3_25degC": (46.822, 11.514)}, "esc"),
)  # fmt: skip


def main(arguments: Sequence[str]) -> None:
    """Fit all rows, print the page and write it."""
    lines = [
        "# Tables over SOC against accepted ones",
        "",
        as_markdown(provenance("python -m benchmarks.accepted_tables FOLDER", 0)),
        "",
        "RMSE whole (above 10 % SOC). The circuit `esc` has half the hysteresis voltage times h, "
        "whose gamma is 20. Blocks of 400 s are held out. Given time constants are 10 and 100 s; "
        "those rows "
        f"agree where sqrt(J) differs by no more than {100 * SHARE:g} %, searched ones where it "
        "is no higher. What was fitted stands first. OCV and hysteresis of the A123 cell are each "
        "program's own, from the same two tests, and differ a little.",
        "",
        "| cell | circuit | fitted | D | tau accepted [s] | tau [s] | sqrt(J) accepted [mV] "
        "| sqrt(J) [mV] | verdict | record | accepted [mV] | here [mV] |",
        "|---" * 12 + "|",
        *_lines(given_folder(arguments)),
        "",
    ]
    publish(RESULTS, "\n".join(lines))


def _lines(folder: Path) -> Iterator[str]:
    for row in ROWS:
        fixed = {}
        if row.tau_s == GIVEN_S:
            fixed = {f"tau{pair} [s]": tau_s for pair, tau_s in enumerate(GIVEN_S, 1)}
        settings = barnax.TableSettings(
            ocv_correction=row.ocv_correction,
            rising_ocv=row.rising,
            fixed=fixed,
            folds=FOLDS if row.held_out_mv else 0,
            max_boxes=0,
        )
        records = {name: _prepared(folder, row, name) for name in row.errors_mv}
        fit = barnax.fit_tables([records[name] for name in row.fitted], settings)
        head = [
            row.cell,
            row.circuit,
            " + ".join(row.fitted),
            ("rising" if row.rising else "free") if row.ocv_correction else "no",
            _pair(row.tau_s),
            _pair(fit.tables.tau_s),
            "-" if row.root_mv is None else f"{row.root_mv:.4f}",
            f"{1e3 * fit.objective_v:.4f}",
            _verdict(row, fit),
        ]
        errors = [
            (name, accepted_mv, errors_on(records[name], fit.tables))
            for name, accepted_mv in row.errors_mv.items()
        ]
        if row.held_out_mv is not None and fit.cross_validation is not None:
            errors.append(("held out", row.held_out_mv, fit.cross_validation.tables))
        for name, accepted_mv, found in errors:
            above_mv = None if found.above_v is None else 1e3 * found.above_v
            own_mv = 1e3 * found.rmse_v, above_mv
            yield f"| {' | '.join([*head, name, _errors(accepted_mv), _errors(own_mv)])} |"
            head = [""] * len(head)


def _verdict(row: Accepted, fit: TableFit) -> str:
    if row.root_mv is None:
        return "not told"
    apart = 1e3 * fit.objective_v / row.root_mv - 1
    if row.tau_s == GIVEN_S:
        return "agrees" if abs(apart) <= SHARE else f"{100 * apart:+.2g} %"
    return "no higher" if apart <= ABOVE else f"{100 * apart:.2g} % higher"


def _prepared(folder: Path, row: Accepted, name: str) -> PreparedRecord:
    if row.cell == SAMSUNG:
        place = folder / "calce-inr18650-20r"
        tests, window = ["ocv-incremental_25degC_SP20-3"], PROFILE
        path = place / f"{name}_SP20-2.parquet"
    else:
        place = folder / "plett-a123-26650"
        tests, window = ["ocv-s1_25degC", "ocv-s3_25degC"], Window(initial_soc=1.0)
        path = place / f"{name}.parquet"
        if name.startswith("dyn-s3"):
            window = Window(
                initial_soc=0.0, initial_direction=-1, score_steps=(11,), score_soc=(0.03, 0.95)
            )
    ocv = [barnax.read_record(place / f"{each}.parquet") for each in tests]
    capacity_ah = 2.0 if row.cell == SAMSUNG else None
    known = barnax.characterize(ocv, capacity_ah=capacity_ah, ocv_fit="interpolated")
    # As the other program took it.
    record = barnax.read_record(path, current_hold="backward")
    return prepare_record(record, known, row.circuit, window)


def _pair(values: Sequence[float] | None) -> str:
    return "-" if values is None else ", ".join(f"{each:.4g}" for each in values)


def _errors(errors_mv: Errors) -> str:
    whole, above = ("-" if each is None else f"{each:.3f}" for each in errors_mv)
    return f"{whole} ({above})"


if __name__ == "__main__":
    main(sys.argv[1:])
