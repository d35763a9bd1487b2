"""How well a circuit tells the state of charge, in words: the screen of a replayed record."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.text import Text

from .terminal import bare_table, headed_line, indented
from .words import NOTHING, duration, joined

if TYPE_CHECKING:
    from ..replay import ScenarioPart, SocReplay

HEADS = (
    *("errors in % SOC", "within 3 %", "RMS", "above 10 %", "max", "in band"),
    *("counting", "max"),
)
FILTERS = {"ekf": "extended Kalman filter", "ukf": "unscented Kalman filter"}


# A band of 95 % that holds less often than this is said to be wrong.
TRUSTED_BAND = 0.9


def soc_screen(replay: "SocReplay") -> Iterator[RenderableType]:
    """What was replayed, the scenarios, what was estimated, and the innovations."""
    low, high = replay.soc_range
    tables = " with tables over SOC" if replay.with_tables else ""
    yield Text()
    facts = (
        f"{replay.record}   {duration(replay.duration_s)}   {replay.samples:,} samples   "
        f"SOC {100 * high:.0f} to {100 * low + 0.0:.0f} %"
    )
    yield indented(Text(facts))
    yield indented(
        Text(f"{replay.model}{tables}, {FILTERS[replay.settings.kind]}, {replay.states} states")
    )
    yield Text()
    yield indented(bare_table(HEADS, map(_scenario, replay.scenarios)))
    yield Text()
    for head, text in soc_lines(replay):
        yield indented(headed_line(head, text))


def soc_lines(replay: "SocReplay") -> Iterator[tuple[str, str]]:
    """Heads and sentences: what went wrong, what was estimated, whether innovations are white."""
    diverged = [each for each in replay.scenarios if each.diverged_s is not None]
    for each in diverged:
        yield (
            "Diverged",
            f"{each.name}: after {duration(each.diverged_s or 0.0)} the filter returns no numbers",
        )
    held = [each.in_band for each in replay.scenarios if each.in_band is not None]
    if held and min(held) < TRUSTED_BAND:
        low, high = (f"{100 * share:.0f}" for share in (min(held), max(held)))
        shares = f"{low} %" if low == high else f"{low} to {high} %"
        yield (
            "Overconfident",
            f"the filter's 95 % band contains the reference SOC {shares} of the time: its errors "
            "of SOC are larger than it assumes",
        )
    right = replay.scenarios[0]
    found = [_estimate(name, *right.estimates[name]) for name in right.estimates]
    if found:
        yield "Estimated", f"from the right start, {joined(found)}"
    tested = replay.innovations
    if tested is not None:
        white = "white" if tested.are_white else "not white"
        low, high = tested.mean_square_bounds
        size = tested.mean_square
        how = "as expected" if low <= size <= high else "smaller" if size < low else "larger"
        than = "" if how == "as expected" else " than the filter expects of a single sample"
        yield (
            "Innovations",
            f"measured minus predicted voltage is {white} (autocorrelation at lag one "
            f"{tested.first_lag:.2f}, below {tested.bound:.2f} for white noise), "
            f"{how}{than} (mean square {size:.2g}, ideally 1)",
        )


def _scenario(each: "ScenarioPart") -> list[str]:
    errors = each.rms, each.rms_above_10_soc, each.max
    counting = each.counter_rms, each.counter_max
    return [
        each.name,
        _converged(each),
        *(_percent(share) for share in errors),
        _percent(each.in_band, 0),
        *(_percent(share) for share in counting),
    ]


def _converged(part: "ScenarioPart") -> str:
    if part.diverged_s is not None:
        return "diverged"
    if part.converged_s is None:
        return "never"
    return duration(part.converged_s) if part.converged_s else "at once"


def _percent(share: float | None, decimals: int = 1) -> str:
    return NOTHING if share is None else f"{100 * share:.{decimals}f}"


def _estimate(name: str, value: float, sd: float) -> str:
    if name == "offset":
        return f"current offset {1e3 * value:.1f} +/- {1e3 * sd:.1f} mA"
    return f"{name} times {value:.3f} +/- {value * sd:.3f}"
