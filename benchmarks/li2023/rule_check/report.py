"""The Markdown page."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.li2023.centre_bias.statistics import holm
from benchmarks.li2023.test_functions import DIMS, FUNCTIONS
from benchmarks.pages import as_markdown

from .agreement import Difference, difference, joint_difference
from .coco_report import RunningTimes, coco_section, coco_verdict
from .comparisons import COMPARISONS, NAMES, OTHER_RULES, Comparison
from .ours import Sample
from .sizes import ITERATIONS, OUR_RUNS, POINTS, POPULATION, SHIFTED

SIGNIFICANT = 0.05


class Outcome(NamedTuple):
    """What one comparison found: by problem, over all, and over all against the control."""

    comparison: Comparison
    ours: Sample
    theirs: Sample
    single: dict[str, Difference]
    joint: Difference
    control: Difference


def outcomes(
    ours: Mapping[str, tuple[Sample, Sample]], theirs: Mapping[str, Sample]
) -> list[Outcome]:
    """The comparisons that could be made."""
    found = []
    for comparison in COMPARISONS:
        if comparison.name not in theirs:
            continue
        (sample, control), other = ours[comparison.name], theirs[comparison.name]
        joint, against_control = (
            joint_difference([(mine.final[name], other.final[name]) for name in other.final])
            for mine in (sample, control)
        )
        single = {name: difference(sample.final[name], other.final[name]) for name in other.final}
        found.append(Outcome(comparison, sample, other, single, joint, against_control))
    return found


def markdown_page(
    found: list[Outcome],
    values: Mapping[str, NDArray],
    their_values: Mapping[str, Mapping[str, NDArray]],
    coco: list[RunningTimes],
    missing: Mapping[str, str],
    facts: Mapping[str, str],
) -> str:
    """The whole page; the verdict first."""
    lines = [
        "# The optimizers against implementations nobody here wrote",
        "",
        as_markdown(dict(facts)),
        "",
        "## Verdict",
        "",
        *(f"- {sentence}" for sentence in _verdict(found, values, their_values, coco)),
        *(f"- Not run: {name}: {reason}" for name, reason in missing.items()),
        "",
        *_searches(found),
        *_rules(found),
        *_values(values, their_values),
        *coco_section(coco),
    ]
    return "\n".join(lines)


def _verdict(
    found: list[Outcome],
    values: Mapping[str, NDArray],
    their_values: Mapping[str, Mapping[str, NDArray]],
    coco: list[RunningTimes],
) -> list[str]:
    sentences = _verdict_on_searches(found) if found else []
    if their_values:
        largest = max(
            _largest_difference(values[name], value)
            for theirs in their_values.values()
            for name, value in theirs.items()
        )
        sentences.append(
            f"F1 to F9 at {POINTS} random points each: the largest relative difference from "
            f"another library's value is {largest:.0e}."
        )
    return [*sentences, coco_verdict(coco)] if coco else sentences


def _verdict_on_searches(found: list[Outcome]) -> list[str]:
    joint = holm(np.array([outcome.joint.p for outcome in found]))
    by_problem = _single_p(found)
    checks = [place for place, outcome in enumerate(found) if not outcome.comparison.differs]
    singles = [p for place in checks for p in by_problem[place].values()]
    different = [found[i].comparison.name for i in checks if joint[i] < SIGNIFICANT]
    told_apart = [found[i].comparison.name for i in checks if found[i].control.p < SIGNIFICANT]
    sentences = []
    if checks:
        sentences = [
            f"Same rule, over all problems: {_count(different, len(checks))} comparisons differ "
            f"at 5 % (Holm; smallest p {joint[checks].min():.2g}).",
            f"Same rule, problem by problem: {sum(p < SIGNIFICANT for p in singles)} of "
            f"{len(singles)} tests differ at 5 % (Holm; smallest p {min(singles):.2g}).",
            "The tests can tell rules apart: with ours under another option, "
            f"{_count(told_apart, len(checks))} of these comparisons differ at 5 % over all "
            "problems.",
        ]
    for place, outcome in enumerate(found):
        if outcome.comparison.differs:
            verdict = "differ" if joint[place] < SIGNIFICANT else "are not told apart"
            sentences.append(
                f"{outcome.comparison.name} has not quite our rule, so it is no check; its losses "
                f"and ours {verdict} (p {joint[place]:.2g}, Holm)."
            )
    return sentences


def _searches(found: list[Outcome]) -> list[str]:
    if not found:
        return []
    joint = holm(np.array([outcome.joint.p for outcome in found]))
    by_problem = _single_p(found)
    lines = [
        "## Final losses",
        "",
        f"F1 to F9 in {DIMS} dimensions, F5 without noise, and {', '.join(SHIFTED)} with their "
        f"optimum moved, by the same offset for all; population {POPULATION}, {ITERATIONS} "
        f"generations, {OUR_RUNS} runs of ours, every problem with seeds of its own. Two-sided "
        "Mann-Whitney tests, which see the order of the losses only and so are those of their "
        "logarithms. The share says how often a loss of ours exceeds one of theirs; one half is "
        "no difference. Over all problems: van Elteren's test. The control is the same test with "
        "ours under another option, and should differ.",
        "",
        "| compared | rule | their runs | evaluations: ours | theirs | share | p | p (Holm) "
        "| smallest p of a problem (Holm) | control | share | p |",
        "|---" * 12 + "|",
    ]
    for place, (outcome, p) in enumerate(zip(found, joint, strict=True)):
        lines.append(
            f"| {outcome.comparison.name} | {'differs' if outcome.comparison.differs else 'same'} "
            f"| {outcome.comparison.runs} "
            f"| {_evaluations(outcome.ours)} | {_evaluations(outcome.theirs)} "
            f"| {outcome.joint.larger_share:.3f} | {outcome.joint.p:.2g} | {p:.2g} "
            f"| {min(by_problem[place].values()):.2g} "
            f"| `{outcome.comparison.control_option}` | {outcome.control.larger_share:.3f} "
            f"| {outcome.control.p:.1g} |"
        )
    names = [outcome.comparison.name for outcome in found]
    lines += [
        "",
        "Median of ours / of theirs, share and p before Holm:",
        "",
        "| | " + " | ".join(names) + " |",
        "|---" * (len(names) + 1) + "|",
    ]
    for problem in found[0].single:
        cells = []
        for outcome in found:
            test = outcome.single[problem]
            medians = (np.median(sample.final[problem]) for sample in outcome[1:3])
            shown = " / ".join(f"{median:.2e}" for median in medians)
            cells.append(f"{shown} ({test.larger_share:.2f}, {test.p:.2f})")
        lines.append(f"| {problem} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _rules(found: list[Outcome]) -> list[str]:
    lines = ["## The rules, as their sources read", ""]
    for comparison in (outcome.comparison for outcome in found):
        ours = type(comparison.ours).__name__
        lines.append(f"- **{comparison.name}** and `{ours}`. The same: {comparison.same}")
        if comparison.differs:
            lines[-1] += f" Different: {comparison.differs}"
    lines += [
        "",
        "Where a library evaluates a population, moves it and stops, its last move counts for "
        "nothing, and ours is read a generation earlier. EvoloPy's grey wolves take a wolf "
        "exactly as good as a leader for no leader, ours for the next one; only ties would tell.",
        "",
        "Read too, and no checks, because their rules are others than any option of ours:",
        "",
        *(f"- {rule}" for rule in OTHER_RULES),
        "",
        "So nothing here checks IGWO, SFO, BMO, IBMO, AEO, AGA, ESFO and the other particle "
        "swarms, nor SOA as its authors programmed it: no library was found that has their rules. "
        "They rest on their tests and on table2.md.",
        "",
    ]
    return lines


def _values(values, their_values) -> list[str]:
    libraries = list(their_values)
    lines = [
        "## Values of the test functions",
        "",
        f"The largest relative difference over {POINTS} points uniform in the box, {DIMS} "
        "dimensions, F5 without its noise. EvoloPy's F12, our F9, has a factor pi n / 10 where "
        "its source (Yao et al., 1999) has pi / n; it is compared with that mended. SciPy has "
        "none of the nine. mealpy stands for opfunu, whose functions it brings.",
        "",
        "| | " + " | ".join(NAMES[library] for library in libraries) + " |",
        "|---" * (len(libraries) + 1) + "|",
    ]
    for name in FUNCTIONS:
        cells = [
            f"{_largest_difference(values[name], their_values[library][name]):.0e}"
            if name in their_values[library]
            else ""
            for library in libraries
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _single_p(found: list[Outcome]) -> list[dict[str, float]]:
    """P of every problem of every comparison, Holm's correction over all of them."""
    adjusted = iter(
        holm(np.array([test.p for outcome in found for test in outcome.single.values()]))
    )
    return [{name: float(next(adjusted)) for name in outcome.single} for outcome in found]


def _largest_difference(ours: NDArray, theirs: NDArray) -> float:
    return float(np.max(np.abs(ours - theirs) / np.abs(ours)))


def _evaluations(sample: Sample) -> str:
    return " or ".join(f"{count:,}" for count in sample.evaluations)


def _count(names: list[str], total: int) -> str:
    return f"{len(names)} of {total}" + (f" ({', '.join(names)})" if names else "")
