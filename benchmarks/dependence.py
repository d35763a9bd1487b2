"""What it is worth that resistances follow temperature: `python -m benchmarks.dependence FOLDER`.

Identifies tables over SOC on measured cells that cannot be shipped, with resistances that follow
nothing but SOC and with those that `identify` chooses, and validates both on records that were not
used. Writes benchmarks/results/dependence.md.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import barnax
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "dependence.md"


class Case(NamedTuple):
    """One cell at one temperature: its OCV test, records to identify on, and others."""

    name: str
    ocv: Path
    records: tuple[Path, ...]
    others: tuple[Path, ...]
    options: dict[str, Any]


def cases(folder: Path) -> Iterator[Case]:
    lg, calce = folder / "lg-hg2-18650", folder / "calce-inr18650-20r"
    cycles = {"25degC": ("us06", "mixed1", "la92"), "0degC": ("us06", "mixed1", "la92")}
    for degc, names in {**cycles, "minus10degC": ("us06", "mixed1")}.items():
        paths = {name: lg / f"{name}_{degc}.parquet" for name in names}
        for count in range(1, len(names)):
            for first in range(len(names)):
                own = [names[(first + place) % len(names)] for place in range(count)]
                others = tuple(path for name, path in paths.items() if name not in own)
                yield Case(
                    f"LG 18650HG2, {degc}, {' + '.join(own)}",
                    lg / f"c20_{degc}.parquet",
                    tuple(paths[name] for name in own),
                    others,
                    {},
                )
    test = calce / "ocv-incremental_25degC_SP20-3.parquet"
    window = barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
    for degc in (0, 25, 45):
        both = [calce / f"{name}_{degc}degC_80soc_SP20-2.parquet" for name in ("dst", "us06")]
        half = [calce / f"{name}_25degC_50soc_SP20-2.parquet" for name in ("dst", "us06")]
        others = tuple(half) if degc == 25 else ()
        options = {"window": window, "capacity": 2.0}
        name = f"CALCE INR18650-20R, {degc} degC, DST + US06"
        yield Case(name, test, tuple(both), others, options)


def shown(case: Case, follow: str) -> list[str]:
    records, others = (
        [barnax.read_record(each) for each in of] for of in (case.records, case.others)
    )
    result = barnax.identify(
        records, ocv=case.ocv, validate=others, over="soc", seeds=0, trust="none",
        resistances_follow=follow, **case.options,
    )  # fmt: skip
    answer = next(each for each in result.candidates if each.is_answer)
    fit = result.fit
    known = fit.tables.dependence
    numbers = {} if known is None else known.numbers
    ends = {each.name: each for each in fit.intervals if each.name in numbers}
    told = [
        f"{name} {value:.3g} ({ends[name].low:.2g} to {ends[name].high:.2g})"
        for name, value in numbers.items()
    ]
    held = answer.held_out
    return [
        ", ".join(told) or "SOC alone",
        f"{1e3 * answer.identification.rmse_v:.2f}",
        f"{1e3 * held.rmse_v:.2f}" if held else "",
        ", ".join(f"{1e3 * each:.2f}" for each in answer.validation_v),
    ]


def main() -> None:
    lines = [
        "| identified on | resistances follow | RMSE there [mV] | held out [mV] | on others [mV] |",
        "|---|---|---|---|---|",
    ]
    for case in cases(Path(sys.argv[1])):
        without, chosen = (shown(case, follow) for follow in ("none", "auto"))
        for row in [without] if without == chosen else [without, chosen]:
            lines.append("| " + " | ".join([case.name, *row]) + " |")
            print(lines[-1], flush=True)
    text = (
        "# What it is worth that resistances follow temperature\n\n"
        "Tables over SOC with an OCV test, of two or three RC pairs as `identify` chooses in each\n"
        "row, identified on one or two drive cycles: with\n"
        "resistances of SOC alone, and, where `identify` chooses more by what is held out, with\n"
        "that too. *On others* are the records of the same temperature that were not used, in the\n"
        "order US06, Mixed1, LA92. The CALCE files have no temperatures.\n\n"
    )
    made = as_markdown(provenance("python -m benchmarks.dependence FOLDER", 0))
    save_page(RESULTS, text + "\n".join(lines) + f"\n\n{made}\n")


if __name__ == "__main__":
    main()
