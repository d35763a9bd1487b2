"""Every code that barnax tells is registered, made somewhere, and has its words."""

import ast
import tomllib
from collections.abc import Iterable

import pytest

from barnax.notices import CODES, Notice, kinds
from test_house import MODULES, label, nodes_of, texts_in

# Words of choices that any code may use.
SHARED = tomllib.loads(CODES.read_text(encoding="utf-8"))["words"].keys()
# What makes a notice, and which of its arguments is the code.
MAKERS = {"notice": 0, "at": 1, "notice_at": 2, "telling": 1, "_spike": 1, "mended": 0}


def literals(node: ast.expr) -> list[str]:
    """The texts that an expression can be, where it is a literal or a choice of them."""
    if isinstance(node, ast.IfExp):
        return literals(node.body) + literals(node.orelse)
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []


def codes_made() -> set[str]:
    """The codes that calls name."""
    collected: set[str] = set()
    for path in MODULES:
        for node in nodes_of(path):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
                name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
                place = MAKERS.get(name)
                if place is not None and len(node.args) > place:
                    collected |= set(literals(node.args[place]))
    return collected


def test_every_code_that_is_made_is_registered_and_every_registered_one_is_made():
    named = {text for path in MODULES for text in texts_in(path)}
    assert codes_made() <= set(kinds())
    assert set(kinds()) <= named


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.code)
def test_a_code_has_a_meaning_and_words_for_all_its_choices(kind):
    assert kind.means.endswith(".")
    choices = [text for own in kind.words.values() for text in own.values()]
    assert not any(text.endswith(".") for text in (kind.says, kind.remedy, *choices))
    # Whoever sets up words for a value also uses it, the shared ones aside.
    used = " ".join([kind.says, kind.remedy, kind.severity, *choices])
    assert all(f"{{{name}" in used for name in kind.words.keys() - SHARED)


def test_a_notice_without_what_its_words_need_is_refused():
    with pytest.raises(KeyError, match="held_ah"):
        Notice(
            "gaps.missing",
            {"gaps": 1, "longest_s": 120.0, "longest_row": 3, "charge": "steady"},
            "us06.csv",
        )


@pytest.mark.parametrize(
    ("code", "values", "said"),
    [
        (
            "columns.not-there",
            {"unit": "none", "column": "I", "symbols": "A, mA", "needed": "true"},
            "unknown unit 'none' of 'I'",
        ),
        ("columns.repeated", {"name": "none", "columns": 2}, "2 columns are called 'none'"),
        ("file.not-found", {"folders": "none"}, "not found in none"),
    ],
)
def test_a_users_word_none_is_a_value_as_others_are(code, values, said):
    assert said in Notice(code, values).what


# What looks for something in a text.
LOOKING = {"startswith", "endswith", "find", "index", "count", "match", "search", "fullmatch"}
TEMPLATES = "\n".join(
    text
    for kind in kinds().values()
    for text in (
        kind.says,
        kind.remedy,
        *(each for own in kind.words.values() for each in own.values()),
    )
)


def is_worded(node: ast.expr) -> bool:
    """Whether an expression is the sentence of a notice or of a refusal, or a phrase of one."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, str) and " " in node.value.strip() and node.value in TEMPLATES
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "str":
        return getattr(node.args[0], "id", "") in ("problem", "told", "each")
    return isinstance(node, ast.Attribute) and node.attr in ("what", "remedy")


def decisions_by_words(nodes: Iterable[ast.AST]) -> list[int]:
    """The lines of a module that look for something in a notice's words."""
    collected = []
    for node in nodes:
        sides: list[ast.expr] = []
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            sides = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            sides = [node.func.value, *node.args] if node.func.attr in LOOKING else []
        collected += [side.lineno for side in sides if is_worded(side)]
    return collected


@pytest.mark.parametrize(
    "code",
    [
        "if 'gap' in told.what: ...",
        "str(problem).startswith(SHORT)",
        "[text for text in texts if 'do not show whether' in text]",
    ],
)
def test_a_decision_by_a_phrase_is_detected(code):
    assert decisions_by_words(ast.walk(ast.parse(code)))


def test_nothing_decides_by_what_a_notice_says():
    actual = {label(path): decisions_by_words(nodes_of(path)) for path in MODULES}
    assert {path: lines for path, lines in actual.items() if lines} == {}
