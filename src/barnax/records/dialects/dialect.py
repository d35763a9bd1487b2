"""What a make of tester calls its columns: data, for the one reader of columns."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from ..columns import QUANTITIES, Quantity, normal

CHARGE, DISCHARGE = "charge-positive", "discharge-positive"
Sign = Literal["charge-positive", "discharge-positive"]


@dataclass(frozen=True)
class Dialect:
    """One make's way to write a table.

    `marks` are sets of names ("rec# & amps"): a header that has all of one is this make's. Names
    are in lower case, with blanks for underscores.

    `names` gives a quantity's own names, from the most to the least specific; for the others the
    usual ones hold. A unit, in any spelling, may stand behind a name in the file; where none does,
    "programmdauer=ms" says what it is. `sign` is what the make's currents mean as a rule, and
    `logs_at_end` that a sample's current flowed before it.
    """

    name: str
    marks: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    sign: Sign = CHARGE
    logs_at_end: bool = False

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What the columns of this make's tables may hold."""
        return tuple(
            replace(each, aliases=tuple(filter(None, self.names[each.name].split("|"))))
            if each.name in self.names
            else each
            for each in QUANTITIES
        )

    def is_marked(self, names: Iterable[str]) -> bool:
        """Whether the names, as `bare` gives them, are those of this make."""
        known = set(names)
        return any(known.issuperset(mark.split(" & ")) for mark in self.marks)


def bare(header: Sequence[str]) -> set[str]:
    """The names as marks give them, each with its unit and without."""
    names = {normal(name).replace(" (", "(") for name in header}
    return names | {re.split(r" *[(\[/#,]", name)[0] for name in names}
