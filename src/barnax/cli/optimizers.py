"""`barnax optimizers`: what can search, where it comes from, what an iteration costs."""

from rich.console import Console
from rich.table import Table


def optimizers() -> None:
    """List the optimizers that --method takes."""
    from ..optimizers import summarize_optimizers
    from ..reporting.terminal import LAYOUT

    table = Table(title="Optimizers, with a population of 30", **LAYOUT)
    table.add_column("name", no_wrap=True)
    table.add_column("evaluations\nan iteration", justify="right")
    table.add_column("what it is")
    for summary in summarize_optimizers():
        cost = str(summary.evaluations_per_iteration)
        table.add_row(summary.name, cost, summary.source)
    Console(highlight=False).print(table)
