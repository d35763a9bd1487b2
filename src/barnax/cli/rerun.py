"""`barnax rerun`: repeat a result from its own record of the command."""

import hashlib
import itertools
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from ..errors import InputError
from . import options
from .session import Session

if TYPE_CHECKING:
    from ..model.search_space import Range
    from ..results import Result

# Across machines and versions the refined error agrees this closely, relative.
SAME_RMSE = 1e-9
FINDINGS = 1


def rerun(
    result: Annotated[
        Path,
        typer.Argument(metavar="RESULT.json", help="What identify wrote.", show_default=False),
    ],
    data: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Where the measured files are (default here and beside the result); repeatable.",
        ),
    ] = None,
    quiet: options.Quiet = False,
) -> None:
    """Repeat a result by the command it stores, and say whether the same comes out.

    Exit status 0 where it does, bit for bit or to 1e-9 of the refined error; 1 where it does not.
    """
    session = Session(is_quiet=quiet)
    from ..results import Result

    stored = Result.from_json(result)
    command = _with_files(result, stored, [*(data or []), Path(), result.parent])
    with session.stage("Repeating"), tempfile.TemporaryDirectory() as folder:
        repeated = _run(command, Path(folder, "repeated"))
    if repeated.to_json() == stored.to_json():
        session.show(["The same bytes came out."])
        return
    change = repeated.refined.rmse_v / stored.refined.rmse_v - 1
    session.show(_differences(stored, repeated))
    if abs(change) <= SAME_RMSE:
        session.show([f"The refined error agrees to {abs(change):.1e}."])
        return
    session.show([f"[bold]The refined error differs by {100 * change:+.2g} %.[/bold]"])
    raise typer.Exit(FINDINGS)


def _with_files(result: Path, stored: "Result", folders: list[Path]) -> list[str]:
    """The stored command with every file's name replaced by where it lies."""
    if len(stored.command) < 2 or stored.command[1] != "identify":
        raise InputError(
            f"{result}: stores no command to repeat (it was made from Python); run it again there"
        )
    hashes = {each.name: each.sha256 for each in stored.inputs}
    words = []
    for before, word in itertools.pairwise(stored.command):
        option, equals, name = word.partition("=") if word.startswith("--") else ("", "", word)
        if (option if equals else before) == "--bounds":
            name = _find_bounds(result, name, stored, folders)
        elif name in hashes:
            name = _find(result, name, hashes[name], folders)
        words.append(f"{option}{equals}{name}")
    return words


def _find_bounds(result: Path, name: str, stored: "Result", folders: list[Path]) -> Path:
    """The file of that name, in one of the folders, that sets the bounds the result has.

    Its hash is not stored, but what it sets is. Where it leaves out a parameter that the former one
    bounded shows in the bounds of the repeated result alone.
    """
    from ..model.search_space import read_bounds

    places = _places(name, folders)
    for place in places:
        if all(_agrees(stored, *each) for each in read_bounds(place).items()):
            return place
    raise InputError(
        f"{places[0]}: is not the file that {result} was made with (it sets other bounds); give "
        "the folder of the right one with --data"
    )


def _agrees(stored: "Result", name: str, wanted: "Range") -> bool:
    """Whether a result's bounds can come from a range in a file."""
    if name not in stored.bounds:
        return False
    (low, high), (stored_low, stored_high) = wanted, stored.bounds[name]
    # Where a pair is bounded or fixed in C, the search narrows the bounds of its resistance.
    searched = {*stored.bounds, *stored.fixed}
    is_narrowed = name.startswith("R") and f"C{name[1:].replace('[Ohm]', '[F]')}" in searched
    if is_narrowed:
        return low <= stored_low <= stored_high <= high
    return (low, high) == (stored_low, stored_high)


def _places(name: str, folders: list[Path]) -> list[Path]:
    """Where in the folders there is a file of that name, at least one."""
    places = [folder / name for folder in folders if (folder / name).is_file()]
    if not places:
        raise InputError(
            f"{name}: is in none of {', '.join(str(folder) for folder in folders)}; give its "
            "folder with --data"
        )
    return places


def _find(result: Path, name: str, sha256: str, folders: list[Path]) -> Path:
    """The file of that name and content in one of the folders."""
    places = _places(name, folders)
    for place in places:
        if sha256 == hashlib.sha256(place.read_bytes()).hexdigest():
            return place
    raise InputError(
        f"{places[0]}: is not the file that {result} was made from (its SHA-256 differs); give "
        "the folder of the right one with --data"
    )


def _run(command: list[str], folder: Path) -> "Result":
    from ..results import Result

    done = subprocess.run(
        # Without -P a file in the working folder could pass for one of our libraries.
        [sys.executable, "-P", "-m", "barnax", *command, "--out", str(folder), "--quiet"],
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode:
        raise InputError(f"the stored command fails now: {done.stderr.strip()}")
    return Result.from_json(folder / "result.json")


def _differences(stored: "Result", repeated: "Result") -> list[str]:
    """What is not the same, in words."""
    lines = [
        f"{name} was {old}, is {repeated.versions.get(name)}."
        for name, old in stored.versions.items()
        if repeated.versions.get(name) != old
    ]
    lines += [
        f"{escape(name)} was {old:.6g}, is {repeated.parameters[name]:.6g}."
        for name, old in stored.parameters.items()
        if repeated.parameters.get(name, old) != old
    ]
    lines += [
        f"The bounds of {escape(name)} were {old[0]:.6g} to {old[1]:.6g}, are "
        + (f"{new[0]:.6g} to {new[1]:.6g}." if (new := repeated.bounds.get(name)) else "none.")
        for name, old in stored.bounds.items()
        if repeated.bounds.get(name) != old
    ]
    moved = sum(
        old.rmse_v != new.rmse_v
        for old, new in zip(stored.search.seeds, repeated.search.seeds, strict=False)
    )
    lines.append(f"{moved} of {len(stored.search.seeds)} seeds ended elsewhere before refinement.")
    places = sorted(
        set(_entries(json.loads(stored.to_json()))) ^ set(_entries(json.loads(repeated.to_json())))
    )
    names = list(dict.fromkeys(place for place, _ in places))
    return [
        *lines,
        f"The bytes differ: {len(names)} entries are not what is stored, such as "
        f"{escape(', '.join(names[:3]))}.",
    ]


def _entries(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Every number and text of a file with the path that leads to it."""
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    for name, part in parts:
        path = f"{place}.{name}" if place else str(name)
        if isinstance(part, dict | list):
            yield from _entries(part, path)
        else:
            yield path, repr(part)
