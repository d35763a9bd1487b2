"""The part of a report that says how far the answer can be trusted."""

from typing import TYPE_CHECKING

from .document import Bullets, Column, Section, Table
from .words import NOTHING, fixed, joined, millivolt, percent, significant

if TYPE_CHECKING:
    from ..result import Result
    from ..trust_parts import EstimatePart, ExaminationPart, TrustPart

_ENDS = ("from", "to")


def trust_section(result: "Result") -> list[Section]:
    """Intervals, what the data leave open and where the errors are, where that was assessed."""
    trust = result.trust
    if trust is None:
        return []
    sentences = [trust.uncertainty.words, *(each.text for each in trust.identifiability.findings)]
    if not trust.identifiability.findings:
        sentences.append("The data determine every free parameter.")
    sentences.append(trust.diagnostics.words)
    blocks = [_uncertainty_table(trust)]
    if trust.examination is not None:
        sentences.append(trust.examination.words)
        blocks.append(_examination_table(trust.examination))
    told = Bullets(tuple(sentence for sentence in sentences if sentence))
    return [Section("How far to trust this", (told, *blocks, _bands_table(trust)))]


def _uncertainty_table(trust: "TrustPart") -> Table:
    share = percent(trust.uncertainty.confidence)
    return Table(
        caption=f"{share} intervals that reckon with correlated errors; the standard error beside "
        "the plain one, which takes every sample for independent.",
        columns=(
            Column("parameter", role="text"),
            *(Column(head) for head in ("refined", "from", "to", "error", "plain", "times")),
            Column("held", role="text"),
        ),
        rows=tuple(
            _estimate_cells(name, each) for name, each in trust.uncertainty.parameters.items()
        ),
    )


def _estimate_cells(name: str, estimate: "EstimatePart") -> tuple[str, ...]:
    shown, scale = _readable(name)
    if estimate.standard_error is None or estimate.plain_standard_error is None:
        return (shown, significant(scale * estimate.value), *[NOTHING] * 5, estimate.held or "")
    errors = (estimate.standard_error, estimate.plain_standard_error)
    return (
        shown,
        significant(scale * estimate.value),
        *(_end(end, scale) for end in (estimate.low, estimate.high)),
        *(percent(error / estimate.value) for error in errors),
        fixed(estimate.inflation, 1),
        "",
    )


def _examination_table(examination: "ExaminationPart") -> Table:
    again = examination.bootstrap
    cut = ", cut short by the record" if again.is_cut else ""
    rows = []
    for name, each in examination.profiles.items():
        shown, scale = _readable(name)
        resampled = again.parameters.get(name)
        ends = [each.low, each.high]
        ends += [None, None] if resampled is None else [resampled.low, resampled.high]
        rows.append((shown, *(_end(end, scale) for end in ends)))
    return Table(
        caption="The same intervals by fitting again: by profile likelihood, and by a block "
        f"bootstrap of {again.replicates} replicates in blocks of {again.block_s:.0f} s{cut}.",
        columns=(
            Column("parameter", role="text"),
            *(Column(f"{kind}, {end}") for kind in ("profile", "bootstrap") for end in _ENDS),
        ),
        rows=tuple(rows),
    )


def _bands_table(trust: "TrustPart") -> Table:
    found = trust.diagnostics
    kinds = [("SOC", found.by_soc), ("current", found.by_current)]
    if found.by_temperature is not None:
        kinds.append(("temperature", found.by_temperature))
    return Table(
        caption=f"Errors by {joined([kind for kind, _ in kinds])}; the mean is measured minus "
        "simulated.",
        columns=(
            Column("by", role="text"),
            Column("band", role="text"),
            Column("samples"),
            Column("RMSE"),
            Column("mean"),
            Column("share of the squared error"),
        ),
        rows=tuple(
            (
                kind,
                band.label,
                str(band.samples),
                millivolt(band.rmse_v),
                millivolt(band.mean_v),
                percent(band.share),
            )
            for kind, bands in kinds
            for band in bands
        ),
    )


def _end(end: float | None, scale: float) -> str:
    return "open" if end is None else significant(scale * end, 4)


def _readable(name: str) -> tuple[str, float]:
    """A parameter's name with the unit it is shown in, and the factor to that."""
    return (name.replace("[Ohm]", "[mOhm]"), 1e3) if name.endswith("[Ohm]") else (name, 1.0)
