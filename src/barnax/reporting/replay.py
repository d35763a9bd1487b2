"""A record replayed by a Kalman filter, in words, a table and a report."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from .document import Bullets, Document, Pictures, Section, Table, rows_table, warnings_section
from .wording import sentences, wording
from .words import NOTHING, duration, extent, joined, percent

if TYPE_CHECKING:
    from ..plots.pictures import Illustration
    from ..replay import ScenarioPart, SocReplay

# Columns of a replay's table.
HEADS = (
    *("errors in % SOC", "within 3 %", "RMS", "above 10 %", "max", "band", "in band"),
    "counting",
)
FILTERS = {
    "sum": "Gaussian sum of extended Kalman filters",
    "ekf": "extended Kalman filter",
    "ukf": "unscented Kalman filter",
}
# A 95 % band that holds less often than this is called overconfident.
TRUSTED_BAND = 0.9
# A start from one of these needs no line.
EXPECTED = ("given", "rested voltage")
# A flat OCV at a smaller share of samples is not worth a line.
FLAT_SHARE = 0.05


def replay_document(replay: "SocReplay", illustrations: "Iterable[Illustration]" = ()) -> Document:
    """The whole report of a replay."""
    told = tuple(f"{head}: {text}." for head, text in soc_lines(replay))
    sections = (
        Section("Errors", (*Pictures(illustrations).of("soc"), replay_table(replay))),
        Section("Verdict", (Bullets(told),)),
        *warnings_section(replay.warnings),
    )
    summary = f"{'; '.join(facts_of(replay)).replace('   ', ', ')}."
    return Document(f"State of charge of {replay.record}, tracked by a filter", summary, sections)


def facts_of(replay: "SocReplay") -> tuple[str, str]:
    """The record that was replayed, and the filter."""
    low, high = replay.soc_range
    at_first, joint = "between ", "and"
    if replay.start is not None:
        at_first, joint = f"{100 * replay.start.soc + 0.0:.0f} %, then ", "to"
    return (
        f"{replay.record}   {duration(replay.duration_s)}   {replay.samples:,} samples   "
        f"SOC {at_first}{100 * low + 0.0:.0f} {joint} {100 * high:.0f} %",
        f"{replay.circuit}, {FILTERS[replay.settings.kind]}, {replay.states} states",
    )


def replay_table(replay: "SocReplay") -> Table:
    """The filter's errors in every scenario, beside those of plain counting."""
    return rows_table(
        "Errors of the filter's SOC in percent, after it has come within 3 %, the mean half width "
        "of its 95 % band, and how often that holds; on the right the RMS error of plain counting "
        "over the same samples.",
        HEADS,
        map(_scenario_row, replay.scenarios),
        HEADS[:1],
    )


def soc_lines(replay: "SocReplay") -> Iterator[tuple[str, str]]:
    """Heads and sentences: what went wrong, what was estimated, whether innovations are white."""
    if replay.start is not None and (replay.before_s or replay.start.soc_source not in EXPECTED):
        yield "Start", _start(replay)
    extents = {replay.record: replay.soc_range}
    for told in sentences("starts.beyond", extents, "the identified OCV"):
        yield "SOC", told.removesuffix(".")
    diverged = [scenario for scenario in replay.scenarios if scenario.diverged_s is not None]
    for scenario in diverged:
        yield (
            "Diverged",
            f"{scenario.name}: after {duration(scenario.diverged_s or 0.0)} the filter returns no "
            "numbers",
        )
    right = replay.scenarios[0]
    whole = [own for own in replay.scenarios if own.whole_max is not None]
    if whole:
        rms, largest = map(_in_percent, (whole[0].whole_rms, whole[0].whole_max))
        worst = max(whole, key=lambda own: own.whole_max or 0.0)
        worst_rms, worst_max = map(_in_percent, (worst.whole_rms, worst.whole_max))
        others = "" if worst is whole[0] else f"; {worst.name}: {worst_rms} % and {worst_max} %"
        yield "Whole record", f"RMS {rms} %, max {largest} %{others}"
    if right.is_lost:
        size = "" if right.max is None else f" by up to {_in_percent(right.max)} %"
        advice = "" if replay.with_tables else "; tables over SOC may"
        yield (
            "Lost",
            f"even from the right start, the estimate of SOC goes wrong{size}: the circuit's "
            f"voltage does not tell it{advice}",
        )
    held = [scenario.in_band for scenario in replay.scenarios if scenario.in_band is not None]
    if held and min(held) < TRUSTED_BAND:
        shares = extent(held, 100, ".0f")
        yield (
            "Overconfident",
            f"the filter's 95 % band contains the reference SOC {shares} % of the time: its errors "
            "of SOC are larger than it assumes",
        )
    if replay.flat_soc is not None and replay.flat_share > FLAT_SHARE:
        low, high = (f"{100 * soc:.0f}" for soc in replay.flat_soc)
        widest = max(scenario.widest or 0.0 for scenario in replay.scenarios)
        yield (
            "Uncertain OCV",
            f"from {low} to {high} % SOC the circuit's voltage errors are over 5 % SOC; the filter "
            f"counts there, with a band of up to {100 * widest:.0f} %",
        )
    for name in replay.untried:
        yield "Not tried", f"{name}: the record's SOC leaves no room for it"
    found = [_estimate(name, *right.estimates[name]) for name in right.estimates]
    if found:
        yield "Estimated", f"from the right start, {joined(found)}"
    tested = replay.innovations
    if tested is not None:
        white = "white" if tested.are_white else "not white"
        low, high = tested.mean_square_bounds
        size = tested.mean_square
        above = (size > high) - (size < low)
        how = ("as large as", "larger than", "smaller than")[above]
        yield (
            "Innovations",
            f"{white} ({tested.first_lag:.2f} at lag one), {how} expected ({size:.2g})",
        )


def _start(replay: "SocReplay") -> str:
    start = replay.start
    assert start is not None, "asked by the caller"
    known = wording("starts.evidence", start, start.soc_source, "as given")
    part = f", {duration(replay.before_s)} into the record" if replay.before_s else ""
    return f"at {percent(start.soc)} SOC{part}, {known}"


def _scenario_row(scenario: "ScenarioPart") -> tuple[str, ...]:
    errors = scenario.rms, scenario.rms_above_10_soc, scenario.max, scenario.band
    return (
        scenario.name,
        _converged(scenario),
        *(_in_percent(share) for share in errors),
        _in_percent(scenario.in_band, 0),
        _in_percent(scenario.counter_rms),
    )


def _converged(part: "ScenarioPart") -> str:
    if part.diverged_s is not None:
        return "diverged"
    if part.converged_s is None:
        return "never"
    if part.is_lost:
        return "lost"
    return duration(part.converged_s) if part.converged_s else "at once"


def _in_percent(share: float | None, decimals: int = 1) -> str:
    return NOTHING if share is None else f"{100 * share:.{decimals}f}"


def _estimate(name: str, value: float, sd: float) -> str:
    if name == "offset":
        return f"current offset {1e3 * value:.1f} +/- {1e3 * sd:.1f} mA"
    return f"{name} times {value:.3f} +/- {value * sd:.3f}"
