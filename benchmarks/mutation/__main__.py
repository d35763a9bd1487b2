"""Which changes of the code do the tests not notice? `python -m benchmarks.mutation [MODULE...]`.

Every mutant of metrics, simulate and the code from an OCV test to a cell, each against the tests
of its module. Writes benchmarks/results/mutation.json and .md; with modules named, only theirs are
run again, and with `--again` before them only those that survived: after tests were added. What a
survivor means is in judged.toml.
"""

import hashlib
import json
import os
import sys
import time
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.pages import as_markdown, provenance, save_page

from .mutants import mutants_of
from .trial import Trial, load_libraries

RESULTS = Path(__file__).parents[1] / "results"
JUDGED = Path(__file__).with_name("judged.toml")
UNJUDGED = "not judged"
KINDS = {
    "equivalent": "Nothing a test could see: the behavior is the same.",
    "threshold": "A tolerance or a size chosen by judgment; another near it would do as well.",
    "missing": "A test is missing.",
    UNJUDGED: "Nobody has looked.",
}


def of_cell(module: str, *tests: str) -> Trial:
    own = tuple(f"tests/cell/test_{test}.py" for test in tests)
    return Trial(f"cell.{module}", (*own, "tests/cell"))


OF_SIMULATE = (
    "tests/model/test_simulate.py",
    "tests/model/test_dynamic_hysteresis.py",
    "tests/search/test_evaluate.py",
)
TRIALS = {
    trial.module: trial
    for trial in (
        Trial("metrics", ("tests/test_metrics.py",)),
        Trial("model.simulate", OF_SIMULATE),
        of_cell("curves", "curves", "model"),
        of_cell("ocv_points", "ocv_points", "slow_sweep", "characterize"),
        of_cell("soc_axis", "characterize", "ocv_points"),
        of_cell("characterize", "characterize"),
        of_cell("model", "model"),
        of_cell("circuits", "circuit_parameters", "model"),
    )
}


def main() -> None:
    """Run what is named, or all, print the page and write it."""
    os.chdir(Path(__file__).parents[2])
    store = RESULTS / "mutation.json"
    found = json.loads(store.read_text()) if store.exists() else {}
    words = sys.argv[1:]
    is_again = words[:1] == ["--again"]
    chosen = words[is_again:] or list(TRIALS)
    load_libraries()
    for module in chosen:
        found[module] = run(TRIALS[module], found[module] if is_again else None)
        save_page(store, json.dumps(found, indent=1) + "\n")
    found = {module: found[module] for module in TRIALS if module in found}
    page = render(found, judgments())
    print(page)
    save_page(RESULTS / "mutation.md", page)


def run(trial: Trial, before: dict[str, Any] | None) -> dict[str, Any]:
    """How a module's mutants fared; raises where its tests fail without any.

    Those that were killed `before` count as killed by tests that have only become more; of a
    module that has changed since they are not known, and it raises as well.
    """
    text = trial.source.read_text()
    digest = hashlib.sha256(text.encode()).hexdigest()
    if before is not None and before.get("source") != digest:
        raise RuntimeError(f"{trial.module} is not what was run before: run it without --again")
    start = time.monotonic()
    outcome, spent_s = trial.run(None, 600)
    if outcome != "survived":
        raise RuntimeError(f"the tests of {trial.module} fail as it is: {' '.join(trial.tests)}")
    limit_s = round(20 + 5 * spent_s)
    counts = {"killed": 0, "timed out": 0, "survived": 0}
    survivors = []
    for mutant in mutants_of(text):
        if before is not None and mutant.name not in before["survivors"]:
            counts["killed"] += 1
            continue
        outcome, _ = trial.run(mutant, limit_s)
        counts[outcome] += 1
        if outcome == "survived":
            survivors.append(mutant.name)
            print(f"{trial.module}:{mutant.line} {mutant.name}", file=sys.stderr, flush=True)
    minutes = round((time.monotonic() - start) / 60, 1)
    day = date.today().isoformat()
    if before is not None:
        minutes = round(minutes + before["minutes"], 1)
    facts = {"minutes": minutes, "date": day, "source": digest, "again": before is not None}
    return counts | {"survivors": survivors} | facts


def judgments() -> dict[tuple[str, str], tuple[str, str]]:
    """What was found out about survivors, by module and name: a kind and a reason."""
    if not JUDGED.exists():
        return {}
    stored = tomllib.loads(JUDGED.read_text())
    return {
        (module, name): (kind, group["why"])
        for group in stored["judged"]
        for kind, module in [(group["kind"], group["module"])]
        for name in group["mutants"]
    }


def render(found: dict[str, Any], judged: dict[tuple[str, str], tuple[str, str]]) -> str:
    """The page: counts by module, then every survivor with what it means."""
    kinds = {
        (module, name): judged.get((module, name), (UNJUDGED, ""))
        for module, each in found.items()
        for name in each["survivors"]
    }
    used = [kind for kind in KINDS if any(kind == of for of, _ in kinds.values())]
    totals = [sum(each[name] for each in found.values()) for name in ("killed", "timed out")]
    lines = [
        "# Changes of the code that the tests do not notice",
        "",
        f"{sum(totals) + len(kinds)} mutants: each is one small change of one module, run against "
        f"that module's own tests of the default suite. {totals[0]} made a test fail, {totals[1]} "
        f"did not end, {len(kinds)} were not noticed. These are listed below.",
        "",
        as_markdown(provenance("python -m benchmarks.mutation", 0, "pytest", "hypothesis")),
        "",
        "| module | mutants | killed | timed out | survived | " + " | ".join(used) + " | min |",
        "|---|" + "---|" * (5 + len(used)),
    ]
    for module, each in found.items():
        counts = [each[name] for name in ("killed", "timed out", "survived")]
        of = [sum(kinds[module, name][0] == kind for name in each["survivors"]) for kind in used]
        cells = [f"`{module}`", sum(counts), *counts, *of, each["minutes"]]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    again = [f"`{module}`" for module, each in found.items() if each.get("again")]
    if again:
        lines += [
            "",
            "After tests were added, only what had survived, or was new, was tried again of "
            f"{', '.join(again)}.",
        ]
    not_run = [f"`{module}`" for module in TRIALS if module not in found]
    if not_run:
        lines += ["", f"Not run: {', '.join(not_run)}."]
    lines += ["", *(f"- {kind}: {KINDS[kind]}" for kind in used)]
    for module, each in found.items():
        if each["survivors"]:
            lines += ["", f"## {module}", ""]
        groups: dict[tuple[str, str], list[str]] = {}
        for name in each["survivors"]:
            groups.setdefault(kinds[module, name], []).append(name)
        for (kind, why), names in groups.items():
            lines += [f"**{kind}**{': ' + why if why else ''}", ""]
            lines += [*(f"- {name}" for name in names), ""]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    main()
