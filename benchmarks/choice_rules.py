"""Where do the rules for "is it better?" differ? `python -m benchmarks.choice_rules`.

Calls every function that takes the errors of two circuits and says which to prefer, with one
grid of pairs, and writes results/choice_rules.md. `over_soc.further_terms.is_supported` and
`over_soc.low_end` decide by errors too, but also by the fits, so that pairs are not enough there.
"""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import NamedTuple

from barnax.candidates import is_better
from barnax.over_soc import SocErrors
from barnax.over_soc.dependence import is_worth
from barnax.reporting.candidates import tables_pay

from .pages import as_markdown, provenance, publish

RESULTS = Path(__file__).parent / "results" / "choice_rules.md"
Rule = Callable[[SocErrors, SocErrors], bool]
# Each takes the errors of a circuit and of a simpler one.
RULES: dict[str, Rule] = {
    "candidates.is_better": is_better,
    "over_soc.dependence.is_worth": is_worth,
    "not SocErrors.is_no_worse": lambda more, simpler: not simpler.is_no_worse(more),
    "reporting.candidates.tables_pay": lambda more, simpler: tables_pay((simpler, more), None),
}
SIMPLER_MV = ((10.0, 5.0), (0.5, 0.25))
SHARES, SHARES_ABOVE = (0.8, 0.88, 0.95, 0.985, 1.0, 1.05), (0.6, 0.88, 0.95, 1.0, 1.05)
# Of the difference of both errors, relative to the simpler one's.
STANDARD_ERRORS = (0.01, 0.05, 0.15)
# From so many standard errors on a gain is more than chance.
BEYOND_CHANCE = 1.5


class Pair(NamedTuple):
    """Errors of a circuit and of a simpler one, and the standard error of their difference (V)."""

    more: SocErrors
    simpler: SocErrors
    standard_error_v: float

    @property
    def is_beyond_chance(self) -> bool:
        """True where the error falls by more than chance, which no rule asks."""
        gain_v = self.simpler.rmse_v - self.more.rmse_v
        return gain_v > BEYOND_CHANCE * self.standard_error_v


def pairs() -> list[Pair]:
    """The grid."""
    grid = product(SIMPLER_MV, SHARES, SHARES_ABOVE, STANDARD_ERRORS)
    return [
        Pair(
            SocErrors(1e-3 * share * whole, 1e-3 * above * higher),
            SocErrors(1e-3 * whole, 1e-3 * higher),
            1e-3 * relative * whole,
        )
        for (whole, higher), share, above, relative in grid
    ]


def verdicts(pair: Pair) -> tuple[bool, ...]:
    """What every rule says of a pair, in the order of `RULES`."""
    return tuple(rule(pair.more, pair.simpler) for rule in RULES.values())


def page() -> str:
    """How often the rules agree, and every pair on which they do not."""
    grid = pairs()
    said = {pair: verdicts(pair) for pair in grid}
    differing = [pair for pair in grid if len(set(said[pair])) > 1]
    lines = [
        '# Where the rules for "is it better?" differ',
        "",
        as_markdown(provenance("python -m benchmarks.choice_rules", 0)),
        "",
        f"{len(grid)} pairs of errors of a circuit and of a simpler one, over all SOC and, in "
        "brackets, above 10 % SOC, with the standard error of their difference. The rules say "
        f"different things of {len(differing)}. None of them reads the standard error: a gain "
        f"beyond chance is one of more than {BEYOND_CHANCE} standard errors over all SOC.",
        "",
        "| rule | better in | of these within chance | beyond chance, but not called better |",
        "|---|---|---|---|",
    ]
    for place, rule in enumerate(RULES):
        better = [pair for pair in grid if said[pair][place]]
        lucky = sum(not pair.is_beyond_chance for pair in better)
        missed = sum(pair.is_beyond_chance for pair in grid if not said[pair][place])
        lines.append(f"| `{rule}` | {len(better)} | {lucky} | {missed} |")
    lines += ["", f"| simpler [mV] | other [mV] | {' | '.join(f'`{rule}`' for rule in RULES)} |"]
    lines.append("|---" * (len(RULES) + 2) + "|")
    shown = dict.fromkeys((pair.simpler, pair.more, said[pair]) for pair in differing)
    for simpler, more, answers in shown:
        words = ["yes" if answer else "no" for answer in answers]
        lines.append(f"| {_shown(simpler)} | {_shown(more)} | {' | '.join(words)} |")
    return "\n".join([*lines, ""])


def _shown(errors: SocErrors) -> str:
    return f"{1e3 * errors.rmse_v:.4g} ({1e3 * (errors.above_v or 0.0):.4g})"


def main() -> None:
    """Print the page and write it."""
    publish(RESULTS, page())


if __name__ == "__main__":
    main()
