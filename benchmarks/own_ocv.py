"""What an OCV test is worth: `python -m benchmarks.own_ocv [FOLDER OF MEASURED CELLS]`.

Identifies tables over SOC with the OCV test and without it, on the bundled cell and, where the
folder is given, on measured cells that cannot be shipped, and validates both on records that were
not used. Writes benchmarks/results/own_ocv.md.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import numpy as np

import barnax
from barnax.cell import CellModel, characterize
from barnax.cell.parameters import OCV
from barnax.over_soc import SocErrors
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "own_ocv.md"
LOWEST, HIGHEST, NEAR_MV = 0.1, 0.9, 10.0


@dataclass(frozen=True)
class Case:
    """One cell: OCV tests, records to identify on together, and records that are not used."""

    name: str
    ocv: tuple[Path, ...]
    records: tuple[Path, ...]
    others: tuple[Path, ...]
    options: dict = field(default_factory=dict)


def cases(folder: Path | None) -> Iterator[Case]:
    yield Case(
        "bundled cell",
        (barnax.bundled_file("ocv_discharge"), barnax.bundled_file("ocv_charge")),
        (barnax.bundled_file("identification"),),
        (barnax.bundled_file("validation"),),
        {"capacity": 2.0},
    )
    if folder is None:
        return
    calce = folder / "calce-inr18650-20r"
    dst, us06 = (
        {charge: calce / f"{name}_25degC_{charge}soc_SP20-2.parquet" for charge in (80, 50)}
        for name in ("dst", "us06")
    )
    profile = barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
    test = (calce / "ocv-incremental_25degC_SP20-3.parquet",)
    known = {"window": profile, "capacity": 2.0}
    others = (dst[50], us06[50])
    yield Case("CALCE INR18650-20R, DST", test, (dst[80],), (us06[80], *others), known)
    yield Case("CALCE INR18650-20R, DST and US06", test, (dst[80], us06[80]), others, known)
    lg = folder / "lg-hg2-18650"
    for degc in (25, 0):
        names = (f"us06_{degc}degC", f"mixed1_{degc}degC", f"la92_{degc}degC")
        first, second, other = (lg / f"{name}.parquet" for name in names)
        test = (lg / f"c20_{degc}degC.parquet",)
        yield Case(f"LG 18650HG2, {degc} degC, US06", test, (first,), (other,))
        yield Case(f"LG 18650HG2, {degc} degC, US06 and Mixed1", test, (first, second), (other,))


def identified(case: Case, ocv: tuple[Path, ...]) -> tuple[barnax.Result, float]:
    # Read first: files without a test would be planned, not taken as they are.
    records, others = (
        [barnax.read_record(path) for path in of] for of in (case.records, case.others)
    )
    started = perf_counter()
    result = barnax.identify(
        records, ocv=ocv, validate=others, over="soc", seeds=0, trust="none", **case.options
    )
    return result, perf_counter() - started


def shown(result: barnax.Result, seconds: float) -> list[str]:
    answer = next(circuit for circuit in result.candidates if circuit.is_answer)

    def millivolts(errors: SocErrors) -> str:
        return f"{1e3 * errors.rmse_v:.2f} ({1e3 * (errors.above_v or 0.0):.2f})"

    parts = result.metrics.validation
    own, above, moved = (
        ", ".join("-" if error_v is None else f"{1e3 * error_v:.1f}" for error_v in errors_v)
        for errors_v in (
            [part.rmse_v for part in parts],
            [part.rmse_above_10_soc_v for part in parts],
            [part.registered_v for part in parts],
        )
    )
    return [millivolts(answer.identification), own, above, moved, f"{seconds:.1f}"]


def beside_test(result: barnax.Result, test: CellModel) -> str:
    """The OCV of the records' own beside that of a test, at the same charge below full.

    A cell that mostly discharges shows its discharge branch, so that an OCV from there to the mean
    of both branches is the test's.
    """
    share = result.cell_model.capacity_ah / test.capacity_ah
    mean_mv, beyond_mv, is_held = [], [], []
    for node in result.fit.of_table(OCV):
        soc = 1 - (1 - np.array([node.soc], float)) * share
        if node.low is None or node.high is None or not LOWEST <= soc[0] <= HIGHEST:
            continue
        mean_v = float(test.average_ocv_v(soc)[0])
        branch_v = mean_v - float(test.hysteresis_v(soc)[0])
        mean_mv.append(1e3 * abs(node.value - mean_v))
        beyond_mv.append(1e3 * max(node.value - mean_v, branch_v - node.value, 0.0))
        is_held.append(node.low <= mean_v and node.high >= branch_v)
    shares = [np.mean(np.array(beyond_mv) <= NEAR_MV), np.mean(is_held)]
    words = [f"{np.median(far_mv):.1f}, {np.max(far_mv):.1f}" for far_mv in (mean_mv, beyond_mv)]
    return " | ".join([*words, *(f"{100 * share:.0f} %" for share in shares)])


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    lines = [
        "| identified on | OCV test | RMSE there (above 10 % SOC) [mV] | on others [mV] | "
        "above 10 % SOC [mV] | with their start moved [mV] | [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    curves = [
        "| identified on | from the mean: median, largest [mV] | "
        "beyond branch and mean: median, largest [mV] | within 10 mV | interval reaches it |",
        "|---|---|---|---|---|",
    ]
    for case in cases(folder):
        with_test, without = identified(case, case.ocv), identified(case, ())
        for name, ran in (("with", with_test), ("without", without)):
            lines.append(f"| {' | '.join([case.name, name, *shown(*ran)])} |")
        test = characterize([barnax.read_record(path) for path in case.ocv])
        curves.append(f"| {case.name} | {beside_test(without[0], test)} |")
    text = (
        "# What an OCV test is worth\n\n"
        "Tables over SOC, of two RC pairs or three, identified with an OCV test and\n"
        "its correction, and with an OCV of the records' own. With their start moved, the other\n"
        "records start where their error is least.\n\n"
    )
    made = as_markdown(provenance("python -m benchmarks.own_ocv FOLDER", 0))
    beside = (
        "The OCV of the records' own beside the test's at the same charge below full, at the\n"
        "visited nodes from 10 to 90 % SOC. These cells mostly discharge, so that they show\n"
        "something from the test's discharge branch to the mean of its branches; beyond is what\n"
        "lies outside of both. The Samsung's test is of another specimen, the LG's a sweep.\n\n"
    )
    parts = ["\n".join(lines), beside + "\n".join(curves), made]
    save_page(RESULTS, text + "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
