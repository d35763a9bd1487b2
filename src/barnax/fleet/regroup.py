"""A fleet whose factors were kept, as cells of any grouping: no raw data are read again."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from ..errors import InputError, listed
from ..files import located
from .dataset import FACTORS, factors_path, rows_of_others
from .manifest import FleetCell


def regrouped(fleet: str | Path, group: Sequence[str]) -> list[FleetCell]:
    """A cell for all rows of a fleet that have the same values in some columns.

    Args:
        fleet: The folder of a fleet that was identified with `keep_factors`.
        group: Columns of its dataset, such as those copied from its manifest.

    Raises `InputError` where the dataset has no such column, or a row's factors are not there.
    """
    out = located(fleet)
    rows = rows_of_others(out)
    unknown = [name for name in group if name not in rows.columns]
    if unknown or not group:
        raise InputError(
            f"`group` {listed(unknown) or 'nothing'}: no column of {out}; there are "
            f"{listed(rows.columns)}"
        )
    good = rows.filter(pl.col("error").is_null())
    if "pack" in good.columns:
        # The mean cell of a pack is none of its cells.
        good = good.filter(~pl.col("id").is_in(good["pack"].drop_nulls().unique().to_list()))
    folder = out / FACTORS
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    cells: dict[str, FleetCell] = {}
    for values, members in good.group_by(group, maintain_order=True):
        outside = [name for name in members["id"] if Path(name).name != name]
        if outside:
            raise InputError(f"{out}: has a row {outside[0]!r}, which is no name of a file in it")
        paths = [factors_path(out, name) for name in members["id"]]
        gone = [path for path in paths if path.name not in there]
        if gone:
            raise InputError(
                f"{gone[0]}: is not there; identify the fleet with `keep_factors` again"
            )
        name = ", ".join(map(str, values)).replace("/", "-").replace("\\", "-")
        carried = dict(zip(group, values, strict=True))
        if name in cells:
            others = [cells[name].carried.get(column, name) for column in group]
            raise InputError(
                f"{out}: the groups {listed(map(str, others))} and {listed(map(str, values))} "
                f"would both be called {name!r}; change these values in a column of the "
                "manifest, and `group` by that"
            )
        # The name of a cell is its own column.
        carried.pop("id", None)
        cells[name] = FleetCell(name, tuple(map(str, paths)), carried=carried)
    if not cells:
        raise InputError(f"{out}: has no rows with factors; identify it with `keep_factors`")
    return [*cells.values()]
