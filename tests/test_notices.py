"""Every code that barnax tells is registered, made somewhere, and has its words."""

import ast
import tomllib

import pytest

from barnax.notices import CODES, kinds, notice
from test_house import MODULES, texts_in, tree_of

# Words of choices that any code may use.
SHARED = tomllib.loads(CODES.read_text(encoding="utf-8"))["words"].keys()
# What makes a notice, and which of its arguments is the code.
MAKERS = {"notice": 0, "at": 1, "found_at": 2, "_spike": 1, "mended": 0, "_attempt": 0}


def literals(node: ast.expr) -> list[str]:
    """The texts that an expression can be, where it is a literal or a choice of them."""
    if isinstance(node, ast.IfExp):
        return literals(node.body) + literals(node.orelse)
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []


def codes_made() -> set[str]:
    """The codes that calls name."""
    found: set[str] = set()
    for path in MODULES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
                name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
                place = MAKERS.get(name)
                if place is not None and len(node.args) > place:
                    found |= set(literals(node.args[place]))
    return found


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
    used = " ".join([kind.says, kind.remedy, *choices])
    assert all(f"{{{name}" in used for name in kind.words.keys() - SHARED)


def test_a_notice_without_what_its_words_need_is_refused():
    with pytest.raises(KeyError, match="held_ah"):
        notice("gaps.steady", "us06.csv", gaps=1, longest_s=120.0, longest_row=3, part="one")
