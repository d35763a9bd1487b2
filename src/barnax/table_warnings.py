"""What a user should know of tables over SOC, in sentences: the same for a run and a comparison."""

from collections.abc import Iterator, Sequence

import numpy as np

from .model.inputs import PreparedRecord
from .over_soc import HELD_GAMMA, TableFit

# Validation may leave the SOC that tables were identified on by this much without a word.
OUTSIDE_SOC = 0.005


def table_warnings(
    fit: TableFit,
    identified: Sequence[PreparedRecord],
    validation: Sequence[PreparedRecord] = (),
) -> Iterator[str]:
    """A sentence for each thing that a user should know of tables fitted to some records."""
    for each in fit.warnings:
        if each.kind == "at bound":
            unit = " s" if each.name.startswith("tau") else ""
            advice = (
                "with an OCV correction a slow pair imitates a wrong capacity, so check "
                "`capacity`, or give `bounds` for it"
            )
            yield (
                f"tables over SOC: {each.name} ended at its bound of {each.value:.4g}{unit}; "
                + (advice if unit else "the bounds, not the data, set it")
            )
        elif each.kind == "one direction":
            yield (
                "tables over SOC: the amplitude of the hysteresis was fitted, but the records go "
                f"only {100 * each.value:.0f} % SOC in one of both directions; such a table spoils "
                "what was not fitted, so leave `half_hysteresis` out, or add a record of the other "
                "direction"
            )
        elif each.kind == "gamma held":
            yield (
                f"tables over SOC: the records go only {100 * each.value:.0f} % SOC in one of both "
                "directions, which tells nothing of how fast hysteresis turns, so gamma is held at "
                f"{HELD_GAMMA:g} and half the measured gap is its amplitude; add a record of the "
                "other direction, or give gamma with `fix` or `bounds`"
            )
        else:
            yield (
                f"tables over SOC: {100 * each.value:.0f} % of their nodes are near no sample; "
                "what stands there follows from their neighbors, and says nothing of the cell"
            )
    low, high = (
        bound([bound(each.soc[each.scored]) for each in identified]) for bound in (min, max)
    )
    for each in validation:
        soc = each.soc[each.scored]
        outside = int(np.count_nonzero((soc < low - OUTSIDE_SOC) | (soc > high + OUTSIDE_SOC)))
        if outside:
            yield (
                f"{each.record.name}: {outside} of {len(soc)} scored samples lie outside "
                f"the SOC that the tables were identified on ({100 * low:.0f} to "
                f"{100 * high:.0f} %), where they are held constant"
            )
