"""Which files are the OCV test: the best set of them that characterizes a cell."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..cell import CellModel, characterize
from ..cell.soc_axis import CAPACITY_WARNING, CHARGE, DISCHARGE, WORD, Sweep
from ..errors import InputError
from .looking import Seen

OCV_KINDS = ("OCV test", "slow sweep", "pulse test", "OCV table")


@dataclass(frozen=True, eq=False)
class OcvChoice:
    """The files that are the OCV test, and the cell that they show.

    `capacity_ah` is what they need to be told; None where they tell it themselves.
    """

    tests: tuple[Seen, ...]
    cell: CellModel
    capacity_ah: float | None = None


def choose_ocv(
    candidates: Sequence[Seen], discharged_ah: float | None, is_given: bool = False
) -> OcvChoice | None:
    """The best OCV test of some files, None where none of them makes a cell; all where given.

    Both directions come before one, tests that close before others, rests before slow sweeps,
    tests of their own before pulse tests, and many points before few. `discharged_ah` is the most
    that a capacity test took out, for tests that do not tell the capacity.
    """
    sets = [tuple(candidates)] if is_given else sorted(_sets(candidates), key=_rank)
    for tests in sets:
        for capacity_ah in dict.fromkeys((None, discharged_ah)):
            try:
                cell = characterize(
                    [test.ocv_test for test in tests],
                    capacity_ah=capacity_ah,
                    ocv_fit="interpolated",
                )
            except InputError:
                continue
            return OcvChoice(tests, cell, capacity_ah)
    return None


def ocv_reason(tests: Sequence[Seen]) -> str:
    """What sweeps a set of tests holds, in words."""
    sweeps = _sweeps(tests)
    if not sweeps:
        return "a table of OCV over state of charge"
    kinds = {
        sweep.direction: f"{WORD[sweep.direction]} "
        + (f"by {len(sweep.points)} rests" if sweep.kind == "rests" else "by a slow sweep")
        for sweep in sweeps
    }
    return f"{' and '.join(kinds.values())}, {max(each.passed_ah for each in sweeps):.4g} Ah"


def _sets(candidates: Sequence[Seen]) -> Iterator[tuple[Seen, ...]]:
    """Every file by itself, every two of opposite directions, and all parts of one direction."""
    yield from ((each,) for each in candidates)
    lone = [(each, *_directions([each])) for each in candidates if len(_directions([each])) == 1]
    outward = [each for each, direction in lone if direction == DISCHARGE]
    inward = [each for each, direction in lone if direction == CHARGE]
    yield from ((one, other) for one in outward for other in inward)
    if max(len(outward), len(inward)) > 1:
        yield (*outward, *inward)


def _rank(tests: tuple[Seen, ...]) -> tuple:
    sweeps = _sweeps(tests)
    return (
        -len(_directions(tests)),
        not _closes(sweeps),
        # A table comes last: it has no charge.
        not sweeps,
        any(sweep.kind == "slow" for sweep in sweeps),
        any(test.kind(None) == "pulse test" for test in tests),
        sum(test.warnings for test in tests),
        -sum(len(sweep.points) for sweep in sweeps),
    )


def _closes(sweeps: Sequence[Sweep]) -> bool:
    """Whether both directions passed about the same charge."""
    passed_ah = [sweep.passed_ah for sweep in sweeps]
    return not passed_ah or min(passed_ah) >= (1 - CAPACITY_WARNING) * max(passed_ah)


def _sweeps(tests: Sequence[Seen]) -> list[Sweep]:
    return [sweep for test in tests if test.traits for sweep in test.traits.sweeps]


def _directions(tests: Sequence[Seen]) -> list[int]:
    return list(dict.fromkeys(sweep.direction for sweep in _sweeps(tests)))
