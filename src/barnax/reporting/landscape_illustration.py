"""The figure of a landscape, with who ended where in it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from ..plots import plot_landscape
from ..plots.illustration import Illustration
from ..plots.landscape import has_landscape

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..optimum import GlobalOptimum


def landscape_illustration(
    model: str,
    found: "GlobalOptimum",
    answers: "Mapping[str, Sequence[CircuitParameters]]",
    refined: "Sequence[CircuitParameters]",
) -> Iterator[Illustration]:
    """The landscape of one model, where it has two time constants to be drawn over."""
    if not has_landscape(found.landscape):
        return
    yield Illustration(
        f"landscape-{model}",
        plot_landscape(
            found.landscape,
            answers=answers,
            refined=refined,
            optimum=found.parameters,
            others=[each.parameters for each in found.local_optima],
        ),
        f"The lowest RMSE that {model} can reach at every pair of time constants, with what every "
        f"seed ended with. {found.verdict}",
        "The error over both time constants, with every seed's answer and the optimum",
        is_dense=False,
    )
