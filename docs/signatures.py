"""Types in the reference, as the source writes them, with the unit that a name ends in.

Names of types that the reference explains (`Given`, `Watch`) stay, instead of what they stand for;
choices are spelled out.
"""

import ast
import inspect
import re
import sys
import textwrap
from typing import Annotated, Any, Literal, get_args, get_origin

from barnax.schema import UNITS

FIELD = re.compile(r":(param|ivar) (\*{0,2}\w+):")
LONG_TUPLE = re.compile(r"(?<==)\((?:(?:[^()]+, ){4,}[^()]+|(?:\([^()]*\), )+\([^()]*\))\)")
TYPE_FIELDS = {"param": "type", "ivar": "vartype"}
SHOWN_UNITS = UNITS | {"ah": "Ah", "ohm": "ohm", "degc": "°C"}


class _Readable(ast.NodeTransformer):
    """An annotation without what only a type checker needs."""

    def __init__(self, names: dict[str, Any]) -> None:
        self.names = names

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """A forward reference is the expression in it."""
        is_text = isinstance(node.value, str)
        return self.visit(ast.parse(node.value, mode="eval").body) if is_text else node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        value = self.names.get(node.id)
        if value is Any:
            return ast.Name("object")
        if get_origin(value) is Literal:
            return ast.Name(" | ".join(map(repr, get_args(value))))
        if get_origin(value) is Annotated:
            return ast.Name(get_args(value)[0].__name__)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        return ast.Name(node.attr)

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        name = ast.unparse(node.value)
        if name == "Literal":
            choices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            return ast.Name(" | ".join(map(ast.unparse, choices)))
        if name == "Annotated":
            return self.visit(node.slice.elts[0])
        if get_origin(self.names.get(name)) is Annotated:
            return self.visit(node.slice)
        # An array's axes are text, and no reference.
        if "jaxtyping" in getattr(self.names.get(name), "__module__", ""):
            axes = node.slice.elts[1].value.replace(" ", ", ")
            return ast.Name("array" if "*" in axes else f"array[{axes}]")
        return self.generic_visit(node)


def types_of(thing: Any) -> dict[str, str]:
    """The type of every argument or field, and under "return" of what comes back."""
    if inspect.isclass(thing):
        bases = [base for base in reversed(thing.__mro__) if base.__module__.startswith("barnax")]
        nodes = [(_tree(base), base) for base in bases]
        fields = [
            (each.target.id, each.annotation, base)
            for tree, base in nodes
            for each in tree.body
            if isinstance(each, ast.AnnAssign)
        ]
        return {name: _written(node, base) for name, node, base in fields}
    thing = inspect.unwrap(thing)
    tree = _tree(thing)
    arguments = [*tree.args.posonlyargs, *tree.args.args, *tree.args.kwonlyargs]
    named = {each.arg: each.annotation for each in arguments} | {"return": tree.returns}
    return {name: _written(node, thing) for name, node in named.items() if node is not None}


def _tree(thing: Any) -> Any:
    return ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]


def _written(annotation: ast.expr, thing: Any) -> str:
    return ast.unparse(_Readable(vars(sys.modules[thing.__module__])).visit(annotation))


def add_types(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Add the type and unit of every argument and field, and of what is returned."""
    if what == "property":
        thing = thing.fget
    elif what not in ("function", "method", "class"):
        return
    types, described = types_of(thing), []
    for line in lines:
        field = FIELD.match(line)
        if field and field[2] in types:
            described.append(_type_field(TYPE_FIELDS[field[1]], field[2], types.pop(field[2])))
        described.append(line)
    returned, rest = types.pop("return", "None"), [] if what == "class" else types.items()
    added = [part for one in rest for part in (_type_field("type", *one), f":param {one[0]}:")]
    added += [f":rtype: {returned}"] * (returned != "None")
    # Behind the last field and what belongs to it, else at the end.
    fields = [index for index, line in enumerate(described) if FIELD.match(line)]
    end = described.index("", fields[-1]) if fields else len(described)
    described[end:end] = added if fields else ["", *added]
    lines[:] = described


def _type_field(kind: str, name: str, written: str) -> str:
    unit = SHOWN_UNITS.get(name.rpartition("_")[2]) if "_" in name else None
    return f":{kind} {name}: {written}" + (f", in {unit}" if unit else "")


def show_call(
    app: Any, what: str, name: str, thing: Any, options: Any, call: str | None, returned: Any
) -> tuple[str, None] | None:
    """How a thing is called, functions by name; nothing where users do not make it themselves."""
    if call is None:
        return None
    if what == "class" and "\nAttributes:\n" in (inspect.getdoc(thing) or ""):
        return "", None
    call = re.sub(r"<function ([\w.<>]+?)(?: at \w+)?>", r"\1", call)
    return LONG_TUPLE.sub("...", call), None
