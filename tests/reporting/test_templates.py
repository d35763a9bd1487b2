"""Every name that a template reads exists: a renamed field fails only where it is rendered."""

import ast
import re
from collections.abc import Iterator
from functools import cache

import pytest
from jinja2 import nodes

from barnax.reporting.view import View
from barnax.reporting.wording import _templates
from test_house import MODULES, PACKAGE, nodes_of

NAMES = sorted(file.stem for file in (PACKAGE / "reporting/templates/words").glob("*.txt"))
OF_LOOPS = {"index0", "first", "last", "revindex"}


@cache
def parsed(name: str) -> nodes.Template:
    templates = _templates()
    assert templates.loader is not None
    return templates.parse(templates.loader.get_source(templates, f"{name}.txt")[0])


@cache
def macros(name: str) -> dict[str, nodes.Macro]:
    """The macros that a template has and imports, by name."""
    there = {macro.name: macro for macro in parsed(name).find_all(nodes.Macro)}
    for node in parsed(name).find_all(nodes.FromImport):
        of = macros(node.template.as_const().removesuffix(".txt"))
        there |= {macro: of[macro] for macro in map(str, node.names)}
    return there


@cache
def members() -> set[str]:
    """The members of the package's classes, and the keys of facts that reporting makes."""
    names = {*OF_LOOPS, *dir(str), *dir(dict), *dir(list)}
    for file in MODULES:
        walked = nodes_of(file)
        for member in (own for one in walked if isinstance(one, ast.ClassDef) for own in one.body):
            if isinstance(member, ast.FunctionDef):
                names.add(member.name)
            elif isinstance(member, ast.AnnAssign) and isinstance(member.target, ast.Name):
                names.add(member.target.id)
        if file.parent.name == "reporting":
            constants = (node for node in walked if isinstance(node, ast.Constant))
            names |= {node.value for node in constants if isinstance(node.value, str)}
    return names


def attributes(name: str) -> Iterator[tuple[str, int, bool]]:
    """Each attribute that a template reads, its line, and whether it is one of the view."""
    for node in parsed(name).find_all(nodes.Getattr):
        is_of_view = isinstance(node.node, nodes.Name) and node.node.name == "view"
        yield node.attr, node.lineno, is_of_view
    for node in parsed(name).find_all(nodes.Filter):
        by = [pair.value for pair in node.kwargs if pair.key == "attribute"]
        by += node.args[:1] if node.name in ("selectattr", "rejectattr") else []
        # Names that differ in case are different.
        assert node.name != "unique" or node.args, f"{name}.txt:{node.lineno}"
        for value in by:
            for attribute in str(value.as_const()).split("."):
                yield attribute, node.lineno, False


@pytest.mark.parametrize("name", NAMES)
def test_every_attribute_and_macro_that_a_template_reads_exists(name):
    for attribute, line, is_of_view in attributes(name):
        known = {*dir(View), *View.__dataclass_fields__} if is_of_view else members()
        assert attribute in known, f"{name}.txt:{line}"
    for call in parsed(name).find_all(nodes.Call):
        macro = macros(name).get(getattr(call.node, "name", ""))
        if macro is not None:
            given, most = len(call.args) + len(call.kwargs), len(macro.args)
            assert most - len(macro.defaults) <= given <= most, f"{name}.txt:{call.lineno}"


def test_every_macro_is_used():
    source = "".join(file.read_text(encoding="utf-8") for file in MODULES)
    calls = {
        (name, getattr(call.node, "name", ""))
        for name in NAMES
        for call in parsed(name).find_all(nodes.Call)
    }
    called = {id(macros(name)[macro]) for name, macro in calls if macro in macros(name)}
    quoted = {*re.findall(r"""["']([\w-]+\.\w+)["']""", source)}
    for name in NAMES:
        for macro in parsed(name).find_all(nodes.Macro):
            is_said = f"{name}.{macro.name}" in quoted or (
                name == "figures" and f"def {macro.name}(" in source
            )
            assert id(macro) in called or is_said, f"{name}.{macro.name}"


@pytest.mark.parametrize("name", NAMES)
def test_no_line_begins_with_what_may_be_nothing_and_a_space(name):
    """It would go on with the line above."""
    templates = _templates()
    assert templates.loader is not None
    inline = r"\{%-? if [^%]*%\}(?:(?!\{%).)*\{%-? endif -?%\} "
    value = r"\{\{(?:(?!\}\}| else ).)* if (?:(?!\}\}| else ).)*\}\} "
    source = templates.loader.get_source(templates, f"{name}.txt")[0]
    for number, line in enumerate(source.split("\n"), 1):
        assert not re.match(f"{inline}|{value}", line), f"{name}.txt:{number}"
