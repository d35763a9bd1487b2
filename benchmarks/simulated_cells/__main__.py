"""Is a simulated cell's R0 found, and where not, told? `python -m benchmarks.simulated_cells`.

120 cells of known truth (one to three RC pairs, three hystereses, slow sweeps and pulses, sampled
at 0.1 to 30 s, both holds, quantised and offset current), each with its dynamic record and its OCV
test, identified with defaults. Without counters no record proves its hold. Writes
benchmarks/results/simulated_cells.md. `python -m benchmarks.simulated_cells FIRST COUNT [MODELS]`
only prints it, for some cells, and for given circuits or `defaults`.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import barnax
from barnax.notices import Notice
from benchmarks.pages import as_markdown, provenance, save_page

from .cells import Cell, draw, dynamic, ocv_test

RESULTS = Path(__file__).parents[1] / "results" / "simulated_cells.md"
CELLS = 120
OFF = 0.05
# The codes of warnings that name a cause.
CAUSES = {
    "hold": {"hold.undecided", "counters.apart", "counters.net"},
    "sampling": {"role.unfit", "fast-load.rows", "late-voltage.step", "late-voltage.apart"},
}
# Of the codes of a hold, those that name it only where they have it as a value.
OF_COUNTERS = {"counters.apart", "counters.net"}


@dataclass(frozen=True)
class Outcome:
    """What one identification said of R0: relative to the truth, 0 being right."""

    cell: Cell
    model: str
    off: float | None
    low: float | None
    high: float | None
    warnings: tuple[Notice, ...]
    rmse_v: float = 0.0
    refusal: str = ""

    @property
    def holds(self) -> bool:
        """Whether the interval holds the truth; one that is open says nothing wrong."""
        return self.low is None or self.high is None or self.low <= 0 <= self.high

    @property
    def is_open(self) -> bool:
        return not self.refusal and self.low is None

    @property
    def causes(self) -> list[str]:
        """What the cell has that makes R0 wrong, of which a warning speaks."""
        cell = self.cell
        slow = cell.interval_s >= 10 or cell.load_s < cell.interval_s
        has = {
            "hold": cell.hold == "backward",
            "sampling": slow or cell.lag > 0,
        }
        naming = {
            warning.code
            for warning in self.warnings
            if warning.code not in OF_COUNTERS or "hold" in warning.values
        }
        return [cause for cause, codes in CAUSES.items() if has[cause] and codes & naming]

    @property
    def is_silently_wrong(self) -> bool:
        is_off = self.off is not None and abs(self.off) > OFF
        return is_off and not self.holds and not self.causes


def identified(cell: Cell, model: str) -> Outcome:
    """One cell with one circuit."""
    options = {} if model == "defaults" else {"model": model}
    try:
        result = barnax.identify(dynamic(cell), ocv=ocv_test(cell), seeds=0, **options)
    except barnax.InputError as problem:
        return Outcome(cell, model, None, None, None, (), refusal=str(problem))
    value, low, high = r0_of(result)
    off, below, above = (
        None if each is None else each / cell.r0 - 1 for each in (value, low, high)
    )
    rmse_v = result.metrics.identification.rmse_v
    return Outcome(cell, model, off, below, above, tuple(result.warnings), rmse_v)


def r0_of(result: barnax.Result) -> tuple[float, float | None, float | None]:
    """R0 in ohm and its interval, None where it is open; of a table, its mean over the visited SOC
    above 10 %, which is what a screen shows."""
    if result.tables is None:
        assert result.constant.assessment is not None
        estimate = result.constant.assessment.uncertainty["R0 [Ohm]"]
        return estimate.value, estimate.low, estimate.high
    mean = next(each for each in result.fit.means if each.name == "R0 [Ohm]")
    return mean.value, mean.low, mean.high


def share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.0f} %)" if whole else "-"


def summary(outcomes: Sequence[Outcome], traits: Sequence[tuple[str, str, object]]) -> list[str]:
    """The counts of every model, of all cells and by trait."""
    lines = [
        "| cells | model | R0 more than 5 % off | of these outside the interval "
        "| and no warning names a cause | interval holds R0 | open | refused |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, field, value in [("all", "", None), *traits]:
        for model in dict.fromkeys(each.model for each in outcomes):
            here = [
                each
                for each in outcomes
                if each.model == model and (not field or trait(each.cell, field) == value)
            ]
            found = [each for each in here if each.off is not None]
            off = [each for each in found if each.off is not None and abs(each.off) > OFF]
            outside = [each for each in off if not each.holds]
            silent = sum(each.is_silently_wrong for each in found)
            lines.append(
                f"| {name} | {model} | {share(len(off), len(found))} | {len(outside)} | {silent} "
                f"| {share(sum(each.holds for each in found), len(found))} "
                f"| {sum(each.is_open for each in found)} | {len(here) - len(found)} |"
            )
    return lines


TRAITS: list[tuple[str, str, object]] = [
    *((f"{count} pairs", "pairs", count) for count in (1, 2, 3)),
    *((f"{name} hysteresis", "hysteresis", name) for name in ("none", "moving", "switched")),
    *((name, "ocv_test", name) for name in ("slow sweep", "pulses")),
    *((f"{hold}", "hold", hold) for hold in ("forward", "backward")),
    *((name, "sampling", name) for name in ("up to 1 s", "2 to 5 s", "10 to 30 s")),
    ("load faster than the log", "is_fast", True),
    ("voltage lags", "is_late", True),
]


def trait(cell: Cell, field: str) -> object:
    """What a row of the summary asks of a cell."""
    slow = sum(cell.interval_s > limit_s for limit_s in (1, 5))
    derived = {
        "pairs": len(cell.r),
        "sampling": ("up to 1 s", "2 to 5 s", "10 to 30 s")[slow],
        "is_fast": cell.load_s < cell.interval_s,
        "is_late": cell.lag > 0,
    }
    return derived[field] if field in derived else getattr(cell, field)


def row(each: Outcome) -> str:
    """One wrong or refused outcome."""
    where = f"| {each.cell.number} | {each.cell.words()} | {each.model} |"
    if each.refusal:
        return f"{where} refused: {each.refusal.splitlines()[0]} | | | |"
    ends = "open" if each.low is None else f"{100 * each.low:+.1f} to {100 * (each.high or 0):+.1f}"
    told = ", ".join(each.causes) or "nothing"
    return f"{where} {100 * (each.off or 0):+.1f} | {ends} | {1e3 * each.rmse_v:.1f} | {told} |"


def page(outcomes: Sequence[Outcome], cells: int, minutes: float) -> str:
    """The whole page."""
    wrong = [
        each for each in outcomes if each.refusal or (abs(each.off or 0) > OFF and not each.holds)
    ]
    return "\n".join(
        [
            "# Simulated cells of known truth",
            "",
            f"{cells} cells, each identified from its dynamic record and its OCV test with seeds "
            f"0, in {minutes:.0f} min. R0 of a table is its mean over the visited SOC above 10 %. "
            "An open interval counts as one that holds R0.",
            "",
            as_markdown(provenance("python -m benchmarks.simulated_cells", 25)),
            "",
            *summary(outcomes, TRAITS),
            "",
            "Outside its interval and more than 5 % off, or refused: R0 and its interval in % "
            "off the truth, RMSE in mV, and the causes that warnings name.",
            "",
            "| cell | truth | model | R0 | interval | RMSE | told |",
            "|---|---|---|---|---|---|---|",
            *map(row, wrong),
            "",
        ]
    )


def main(arguments: Sequence[str]) -> None:
    """Identify every cell, print the page, and write it where all were asked for."""
    first, cells, *models = map(str, arguments) if arguments else ("0", str(CELLS))
    begun, outcomes = time.monotonic(), []
    for number in range(int(first), int(first) + int(cells)):
        for model in models or ["defaults"]:
            outcomes.append(identified(draw(number), model))
            print(row(outcomes[-1]), file=sys.stderr)
    text = page(outcomes, int(cells), (time.monotonic() - begun) / 60)
    print(text)
    if not arguments:
        save_page(RESULTS, text)


if __name__ == "__main__":
    main(sys.argv[1:])
