"""Tables and sentences about how far an answer can be trusted, for a terminal."""

from collections.abc import Iterator

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from .table_layout import LAYOUT
from .trust import Assessment, Estimate, Examination


def trust_report(
    assessment: Assessment, examination: Examination | None = None
) -> Iterator[RenderableType]:
    """Intervals beside the plain errors, and what the data leave open."""
    yield uncertainty_table(assessment)
    if examination is not None:
        yield examination_table(examination)
    yield Text(f"Trust: {assessment.words}")
    if examination is not None:
        yield Text(f"What would lower the error: {examination.words}")


def uncertainty_table(assessment: Assessment) -> Table:
    """Every parameter with its interval, its standard error and the plain one."""
    sure = assessment.uncertainty
    percent = f"{100 * sure.confidence:.0f} %"
    table = Table(
        title="How sure the parameters are",
        caption=f"from, to: {percent} interval; plain: as if all samples were independent",
        **LAYOUT,
    )
    table.add_column("parameter")
    table.add_column("unit")
    for head in ("refined", "from", "to", "error", "plain", "times"):
        table.add_column(head, justify="right", style="bold" if head == "refined" else "")
    for each in sure.estimates:
        symbol, unit, scale = _unit(each.name)
        table.add_row(symbol, unit, f"{scale * each.value:.5g}", *_errors(each, scale))
    return table


def examination_table(examination: Examination) -> Table:
    """The profile's and the bootstrap's intervals."""
    again = examination.bootstrap
    cut = ", cut short by the record" if again.is_cut else ""
    table = Table(
        title="The same by fitting again",
        caption=f"{again.replicates} replicates in blocks of {again.block_s:.0f} s{cut}; "
        f"{again.converged} refits converged",
        **LAYOUT,
    )
    table.add_column("parameter")
    table.add_column("unit")
    for head in ("profile\nfrom", "to", "bootstrap\nfrom", "to", "error"):
        table.add_column(head, justify="right")
    for each in examination.profiles:
        symbol, unit, scale = _unit(each.name)
        ends = ["open" if end is None else f"{scale * end:.4g}" for end in (each.low, each.high)]
        resampled = again.parameters.get(each.name)
        if resampled is not None:
            ends += [f"{scale * end:.4g}" for end in (resampled.low, resampled.high)]
            ends.append(_percent(resampled.relative_error))
        table.add_row(symbol, unit, *ends)
    return table


def _errors(estimate: Estimate, scale: float) -> list[str]:
    if estimate.relative_error is None or estimate.plain_relative_error is None:
        return [estimate.held or "", "", "", "", ""]
    ends = [
        "open" if end is None else f"{scale * end:.4g}" for end in (estimate.low, estimate.high)
    ]
    times = "" if estimate.inflation is None else f"{estimate.inflation:.1f}"
    shares = map(_percent, (estimate.relative_error, estimate.plain_relative_error))
    return [*ends, *shares, times]


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 10 else "open"


def _unit(name: str) -> tuple[str, str, float]:
    """A parameter's symbol, the unit it is shown in, and the factor to that."""
    symbol, _, unit = name.partition(" [")
    unit = unit.rstrip("]")
    return (symbol, "mOhm", 1e3) if unit == "Ohm" else (symbol, unit, 1.0)
