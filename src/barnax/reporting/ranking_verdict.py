"""Which row is the most accurate on each record, and whether its lead is more than chance."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from .comparison_view import answered, contrast, leaders, ranked, records, rmse_on
from .words import joined, millivolt

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.parts import RowPart

NARROW = "errors stay alike for longer than the blocks, so the interval is too narrow"


def ranking_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The leader on each record, its lead over the next, and who else cannot be told from it."""
    rows = answered(result)
    if not rows:
        yield "No row has an answer."
        return
    for record in range(len(records(result))):
        best = leaders(rows, record)
        yield " ".join([_leader(result, record, best), *_lead(result, record, best)])
    if len(records(result)) == 1:
        yield "No record was given for validation, so nothing tells how the rows do on others."


def _leader(result: "ComparisonResult", record: int, best: "list[RowPart]") -> str:
    name, names = records(result)[record], joined([row.name for row in best])
    lowest = millivolt(rmse_on(best[0], record))
    rows = answered(result)
    if len(rows) == 1:
        return f"On {name} the error of {names} is {lowest}; there is no other row to compare with."
    if record == 0:
        role = f"On {name}, the record identified on,"
    else:
        role = f"On {name}, which no row has seen,"
    shared = "is shared by" if len(best) > 1 else "is that of"
    sentence = f"{role} the lowest error, {lowest}, {shared} {names}."
    first = leaders(rows, 0)
    if record == 0 or any(row in first for row in best):
        return sentence
    place = ranked(rows, record).index(first[0]) + 1
    return (
        f"{sentence} {first[0].name}, which led in identification, comes in at place {place} of "
        f"{len(rows)} with {millivolt(rmse_on(first[0], record))}."
    )


def _lead(result: "ComparisonResult", record: int, best: "list[RowPart]") -> Iterator[str]:
    """The lead over the next row, and the rows that are worse by more than chance."""
    others = [row for row in ranked(answered(result), record) if row not in best]
    if not others:
        return
    found = {row.name: contrast(result, best[0], row, record) for row in others}
    following = found[others[0].name]
    lead_v = rmse_on(others[0], record) - rmse_on(best[0], record)
    if following is None:
        yield f"The next is {others[0].name}, {millivolt(lead_v)} behind."
    else:
        low_v, high_v = following.interval_v
        interval = f"{1e3 * -high_v:.2f} to {millivolt(-low_v)}"
        judgment = (
            f"more than chance: its 95 % interval over time, {interval}, leaves out zero"
            if following.is_real
            else f"no more than chance: its 95 % interval over time, {interval}, holds zero"
        )
        doubt = f" ({NARROW})" if following.is_narrow else ""
        yield (
            f"The lead of {millivolt(lead_v)} over the next, {others[0].name}, is "
            f"{judgment}{doubt}."
        )
        if following.seeds is not None:
            wins, losses, p_value = following.seeds
            yield (
                f"Seed by seed it wins {wins} and loses {losses} (Wilcoxon signed-rank "
                f"p = {p_value:.2g})."
            )
    known = {row.name: found[row.name] for row in others[1:] if found[row.name] is not None}
    like = [name for name, each in known.items() if each is not None and not each.is_real]
    worse = [name for name, each in known.items() if each is not None and each.is_real]
    if like:
        verb = "is" if len(like) == 1 else "are"
        yield f"{joined(like)} {verb} not told from it by more than chance either."
    if worse:
        verb = "is" if len(worse) == 1 else "are"
        yield f"{joined(worse)} {verb} worse by more than chance."
