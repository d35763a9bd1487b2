"""Small changes of a module, each of which a test should notice."""

import ast
import copy
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

ARITHMETIC: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
COMPARISONS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
OPPOSITES = [
    ("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("any", "all"),
    ("floor", "ceil"), ("exp", "expm1"), ("sin", "cos"), ("zeros_like", "ones_like"),
    ("zeros", "ones"), ("sum", "max"), ("union1d", "intersect1d"),
]  # fmt: skip
CALLED = {one: other for pair in OPPOSITES for one, other in (pair, pair[::-1])}
CALLED["abs"] = "positive"

Change = Callable[[ast.AST], None]


@dataclass(frozen=True)
class Mutant:
    """A changed module, where the change is and what it is.

    `name` says so in the same words wherever else the file changes.
    """

    name: str
    line: int
    tree: ast.Module


def mutants_of(source: str) -> Iterator[Mutant]:
    """Every mutant of a module. Texts for people, annotations and imports are left alone."""
    tree = ast.parse(source)
    lines = source.splitlines()
    seen: Counter[str] = Counter()
    for place, (node, function) in enumerate(_changeable(tree)):
        for change in _changes(node):
            changed = copy.deepcopy(tree)
            target = next(each for at, (each, _) in enumerate(_changeable(changed)) if at == place)
            before = _shown(node)
            change(target)
            after = _shown(target)
            line = lines[node.lineno - 1].strip()
            name = f"{function}: `{line}`: {before} -> {after}"
            seen[name] += 1
            if seen[name] > 1:
                name = f"{name} ({seen[name]})"
            yield Mutant(name, node.lineno, ast.fix_missing_locations(changed))


def _changeable(tree: ast.Module) -> Iterator[tuple[Any, str]]:
    """The nodes that have a behavior, each with the function or class it stands in."""

    def walk(node: ast.AST, function: str) -> Iterator[tuple[Any, str]]:
        if isinstance(node, ast.Import | ast.ImportFrom | ast.JoinedStr | ast.Global):
            return
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return  # A docstring.
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            function = f"{function}.{node.name}".lstrip(".")
        if hasattr(node, "lineno"):
            yield node, function
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list", "bases", "type_params"):
                continue
            if isinstance(node, ast.Assign) and _is_type(node):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child, function)

    yield from walk(tree, "")


def _is_type(node: ast.Assign) -> bool:
    """Whether an assignment names a type, such as `Soc = Float[np.ndarray, "*any"]`."""
    return isinstance(node.value, ast.Subscript) and node.col_offset == 0


def _changes(node: ast.AST) -> Iterator[Change]:
    """What can be changed in a node, each as a function that does it to a copy."""
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in ARITHMETIC:
        yield _setting(op=ARITHMETIC[type(node.op)]())
    elif isinstance(node, ast.Compare):
        for at, operator in enumerate(node.ops):
            for other in COMPARISONS[type(operator)]:
                yield _replacing("ops", at, other())
    elif isinstance(node, ast.BoolOp):
        yield _setting(op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield _setting(operand=ast.UnaryOp(ast.Not(), node.operand))
    elif isinstance(node, ast.UnaryOp) and not isinstance(node.operand, ast.Constant):
        yield _setting(op=ast.UAdd())
    elif isinstance(node, ast.If | ast.IfExp | ast.While):
        # A comparison is turned round where it is met itself.
        if not isinstance(node.test, ast.Compare | ast.UnaryOp):
            yield _setting(test=ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Constant):
        for value in _other_values(node.value):
            yield _setting(value=value)
    elif isinstance(node, ast.Call) and (called := _other_function(node.func)) is not None:
        yield _setting(func=called)
    elif isinstance(node, ast.Raise | ast.Continue | ast.Break | ast.Expr):
        yield _removing
    elif isinstance(node, ast.Return) and isinstance(node.value, ast.Name | ast.Call):
        yield _setting(value=ast.Constant(None))


def _other_values(value: object) -> list[object]:
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1, -value] if value else [1]
    if isinstance(value, float):
        return [2 * value, -value] if value else [1.0]
    # A name or a key; what has blanks in it is for people.
    return [value + "_"] if isinstance(value, str) and value and " " not in value else []


def _other_function(called: ast.expr) -> ast.expr | None:
    if isinstance(called, ast.Name) and called.id in CALLED:
        # Python's own abs has no opposite of one argument but this.
        return ast.Name("float" if called.id == "abs" else CALLED[called.id], ast.Load())
    if isinstance(called, ast.Attribute) and called.attr in CALLED:
        return ast.Attribute(called.value, CALLED[called.attr], ast.Load())
    return None


def _setting(**fields: object) -> Change:
    def change(node: ast.AST) -> None:
        for name, value in fields.items():
            setattr(node, name, value)

    return change


def _replacing(field: str, at: int, value: ast.AST) -> Change:
    return lambda node: getattr(node, field).__setitem__(at, value)


def _removing(node: ast.AST) -> None:
    """Turn a statement into nothing: an expression that has no effect."""
    node.__class__ = ast.Expr
    node.__dict__.update(value=ast.Constant(None))


def _shown(node: ast.AST) -> str:
    if isinstance(node, ast.If | ast.While):
        return f"`if {ast.unparse(node.test)}`"
    text = " ".join(ast.unparse(node).split())
    return f"`{text if len(text) <= 90 else text[:86] + ' ...'}`"
