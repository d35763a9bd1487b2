"""A fleet in words: its progress, its last three lines, its report."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .words import counted, duration

if TYPE_CHECKING:
    from ..fleet import FleetCell, Progress


def missing_lines(cells: "Sequence[FleetCell]") -> list[str]:
    """What of a manifest is not there, a line each."""
    return [f"{cell.id}: {each} does not exist" for cell in cells for each in cell.missing]


def progress_remark(state: "Progress", elapsed_s: float) -> str:
    """Throughput and failures so far."""
    rate = state.finished / max(elapsed_s, 1e-9)
    failed = f", {state.failed} failed" if state.failed else ""
    return f"{rate:.1f} cells a second{failed}"


def closing_lines(
    state: "Progress", out: Path, elapsed_s: float, shard: str | None = None
) -> list[str]:
    """What was done, what failed, and where it is."""
    skipped = f"{state.skipped:,} already done" if state.skipped else ""
    where = f"{out}/report.html   cells.parquet"
    rest = ""
    if shard:
        rest = f"Shard {shard}: once all are done, the same command without it writes the report."
        where = str(out)
    if not state.finished:
        return [f"Nothing to do: {skipped}.", rest or "The dataset is unchanged.", where]
    done = f"{counted(state.finished - state.failed, 'cell')} identified, {state.failed:,} failed"
    rate = f"in {duration(elapsed_s)}, {state.finished / elapsed_s:.1f} a second"
    return [", ".join(filter(None, (done, skipped, rate))) + ".", rest, where]
