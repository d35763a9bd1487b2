"""Whether what a model adds pays: on the record it was fitted to, and on others."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from .comparison_view import SAME_RMSE, answered, contrast, records, rmse_on
from .words import joined, millivolt

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.parts import RowPart

Change = Literal["better", "worse", "same"]

# The plainest model, against which others must show that they pay, and one more question.
BASE = "so-rc"
SWITCHES = ("iso-rc", "esc")
ADDITIONS = {
    (BASE, "iso-rc"): "the hysteresis correction (iso-rc)",
    (BASE, "esc"): "the dynamic hysteresis (esc)",
    SWITCHES: "hysteresis that takes charge to turn (esc in place of iso-rc)",
}


@dataclass(frozen=True)
class Effect:
    """What a model changes on one record against another, in V; negative is better.

    `change` is "same" too where chance alone explains the difference.
    """

    record: str
    difference_v: float
    change: Change


def model_sentences(result: "ComparisonResult") -> Iterator[str]:
    """A sentence for each model against the plainest, by the best method that ran both."""
    present = list(dict.fromkeys(row.model for row in answered(result)))
    if not present:
        return
    base = BASE if BASE in present else present[0]
    pairs = [(base, model) for model in present if model != base]
    if base not in SWITCHES and set(SWITCHES) <= set(present):
        pairs.append(SWITCHES)
    for pair in pairs:
        rows = _same_method(result, *pair)
        addition = ADDITIONS.get(pair, f"{pair[1]} in place of {pair[0]}")
        if rows is None:
            yield (
                f"No method ran both {pair[0]} and {pair[1]}, so what {addition} is worth cannot "
                "be told from what the method is worth."
            )
            continue
        effects = [_effect(result, *rows, record) for record in range(len(records(result)))]
        yield (
            f"By {rows[0].method}, {addition} {joined(_changes(effects))}: "
            f"{conclusion(effects[0].change, [each.change for each in effects[1:]])}."
            f"{_at_the_optima(result, *pair)}"
        )


def conclusion(identified: Change, validated: Sequence[Change]) -> str:
    """What the changes on the identification record and on the others come to."""
    kinds = set(validated)
    if not kinds:
        return {
            "better": "whether that carries over is not known, for no record was given to "
            "validate on",
            "worse": "on this record it does not pay",
            "same": "on this record it makes no difference that counts",
        }[identified]
    if kinds >= {"better", "worse"}:
        return "on some of these records it pays, on others it does not"
    if "better" in kinds:
        if identified == "worse":
            return "it pays on what it has not seen, but not on what it was fitted to"
        return "on these data it pays"
    if "worse" in kinds or identified == "worse":
        return "on these data it does not pay"
    if identified == "better":
        return "the gain does not carry over, so on these data it does not pay"
    return "on these data it makes no difference that counts"


def _at_the_optima(result: "ComparisonResult", plain: str, rich: str) -> str:
    """What the model changes where no method's own error is in it, as far as that is known."""
    plain_v, rich_v = (result.models[name].optimum_rmse_v for name in (plain, rich))
    if not plain_v or not rich_v:
        return ""
    if abs(rich_v - plain_v) <= SAME_RMSE * plain_v:
        change = "leaves the identification error as it is"
    else:
        verb = "lowers" if rich_v < plain_v else "raises"
        change = f"{verb} the identification error by {millivolt(abs(rich_v - plain_v))}"
    return f" At the global optima of both models, which no method has a part in, it {change}."


def _same_method(
    result: "ComparisonResult", plain: str, rich: str
) -> "tuple[RowPart, RowPart] | None":
    """The rows of both models by one method: the one with the lowest errors on its own record."""
    rows = {(row.method, row.model): row for row in answered(result)}
    methods = [method for method, model in rows if model == plain and (method, rich) in rows]
    if not methods:
        return None
    best = min(
        methods,
        key=lambda method: rmse_on(rows[method, plain], 0) + rmse_on(rows[method, rich], 0),
    )
    return rows[best, plain], rows[best, rich]


def _effect(result: "ComparisonResult", plain: "RowPart", rich: "RowPart", record: int) -> Effect:
    plain_v, rich_v = rmse_on(plain, record), rmse_on(rich, record)
    compared = contrast(result, rich, plain, record)
    is_chance = compared is not None and not compared.is_real
    if is_chance or abs(rich_v - plain_v) <= SAME_RMSE * plain_v:
        change: Change = "same"
    else:
        change = "better" if rich_v < plain_v else "worse"
    name = records(result)[record]
    return Effect(name, rich_v - plain_v, change)


def _changes(effects: Sequence[Effect]) -> list[str]:
    """What is lowered and raised, the first on the identification record."""
    roles = ["the identification error"]
    if len(effects) == 2:
        roles.append("the validation error")
    else:
        roles += [f"the validation error on {each.record}" for each in effects[1:]]
    return [_change(role, each) for role, each in zip(roles, effects, strict=True)]


def _change(role: str, effect: Effect) -> str:
    size = millivolt(abs(effect.difference_v))
    if effect.difference_v == 0:
        return f"leaves {role} as it is"
    verb = "lowers" if effect.difference_v < 0 else "raises"
    chance = " (no more than chance)" if effect.change == "same" else ""
    return f"{verb} {role} by {size}{chance}"
