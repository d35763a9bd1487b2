"""Numbers and lists as they appear in sentences and tables."""

import math
from collections.abc import Collection, Iterable, Sequence
from decimal import ROUND_CEILING, Context
from typing import TYPE_CHECKING, Literal, TypeVar

from ..cell.parameters import RATE
from ..errors import counted as counted

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..fit.cross_validation import SocErrors
    from ..fit.node_interval import NodeInterval
    from ..metrics import Metrics
    from ..uncertainty import Band, Estimate
    from ..uncertainty.profiles import ParameterProfile

NOTHING = "–"
NOT_DETERMINED = "not determined"
# The fewest and most digits used to distinguish the ends of an interval from the value in it.
FEWEST_DIGITS, MOST_DIGITS = 3, 5
# Errors within this share of each other are called the same, and circuits nearly as good.
SAME = 0.01
# From here on a resistance is shown in Ohm, as for coin cells.
LARGE_OHM = 1.0
# Rounded up, because a claim must not exceed what was proved.
ROUNDED_UP = Context(prec=1, rounding=ROUND_CEILING)
BandQuantity = Literal["SOC", "current", "temperature"]
Key = TypeVar("Key")
Item = TypeVar("Item")


def joined(items: Sequence[str], last: str = "and") -> str:
    """Items in a list, the last one after `last`.

    >>> joined([]), joined(["a"]), joined(["a", "b"]), joined(["a", "b", "c"])
    ('', 'a', 'a and b', 'a, b and c')
    """
    return (
        f" {last} ".join([", ".join(items[:-1]), items[-1]]) if len(items) > 1 else "".join(items)
    )


def numbered(role: str, count: int) -> list[str]:
    """Names of this many records of a role.

    >>> numbered("validation", 1), numbered("validation", 2)
    (['validation'], ['validation 1', 'validation 2'])
    """
    return [role] if count == 1 else [f"{role} {number}" for number in range(1, count + 1)]


def shortened(name: str, longest: int) -> str:
    """A name with at most this many letters, its middle left out.

    >>> shortened("identification.parquet", 16)
    'identi...parquet'
    """
    half = longest // 2
    return name if len(name) <= longest else f"{name[: half - 2]}...{name[1 - half :]}"


def gathered(pairs: Iterable[tuple[Key, Item]]) -> dict[Key, list[Item]]:
    """Items that share a key, by the key, in their order.

    >>> gathered([(1, "a"), (2, "b"), (1, "c")])
    {1: ['a', 'c'], 2: ['b']}
    """
    groups: dict[Key, list[Item]] = {}
    for key, item in pairs:
        groups.setdefault(key, []).append(item)
    return groups


def extent(values: Collection[float], scale: float = 1.0, form: str = ".4g") -> str:
    """The least and the largest value, once if both look the same.

    >>> extent([2.0, 1.0, 3.0]), extent([0.951, 0.949], scale=100, form=".0f")
    ('1 to 3', '95')
    """
    ends = (format(scale * end + 0.0, form) for end in (min(values), max(values)))
    return " to ".join(dict.fromkeys(ends))


def sentence(text: str) -> str:
    """The text with a full stop, added if it has none.

    >>> sentence("it failed"), sentence("It failed.")
    ('it failed.', 'It failed.')
    """
    return text if text.endswith((".", "!", "?")) else f"{text}."


def millivolt(value_v: float) -> str:
    """Two decimals, more where two would show nothing.

    >>> millivolt(0.0232118), millivolt(0.0000034), millivolt(0.0)
    ('23.21 mV', '0.0034 mV', '0.00 mV')
    """
    value_mv = 1e3 * value_v
    shown = f"{value_mv:.2f}" if abs(value_mv) >= 0.01 or value_mv == 0 else f"{value_mv:.2g}"
    return f"{shown} mV"


def aligned(value: float) -> str:
    """Three significant figures with zeros, so that a column lines up.

    >>> aligned(0.5), aligned(100.0)
    ('0.500', '100')
    """
    return f"{value:#.3g}".rstrip(".")


def aligned_millivolt(value_v: float | None) -> str:
    """A voltage in mV with three figures, so that a column lines up; empty if there is none.

    >>> aligned_millivolt(0.0075), aligned_millivolt(1.25), aligned_millivolt(None)
    ('7.50', '1250', '')
    """
    if value_v is None:
        return ""
    return f"{1e3 * value_v:.0f}" if 1e3 * value_v >= 999.5 else aligned(1e3 * value_v)


def millivolts_cell(value_v: float | None) -> str:
    """A voltage under a head in mV; a dash if there is none."""
    return fixed(None if value_v is None else 1e3 * value_v, 3)


def percent(ratio: float | None) -> str:
    """A ratio in percent, with two digits or all before the point; a dash if there is none.

    >>> percent(0.0), percent(0.00123), percent(0.0213), percent(0.996), percent(1e-9)
    ('0 %', '0.12 %', '2.1 %', '100 %', '1e-07 %')
    """
    if ratio is None:
        return NOTHING
    value = 100 * ratio
    return f"{value:.0f} %" if abs(value) >= 10 else f"{value:.2g} %"


def soc_extent(soc: tuple[float, float] | None) -> str:
    """A range of SOC; empty if there is none.

    >>> soc_extent((0.1, 1.0)), soc_extent(None)
    ('10-100 %', '')
    """
    return "" if soc is None else f"{100 * soc[0]:.0f}-{100 * soc[1]:.0f} %"


def fixed(value: float | None, decimals: int) -> str:
    """A number with this many decimals; a dash if there is none."""
    return NOTHING if value is None else f"{value:.{decimals}f}"


def better_than(proved_gap: float) -> str:
    """The gain that no circuit exceeds, by the proof."""
    return f"more than {rounded_up(proved_gap)} better" if proved_gap > 0 else "better"


def rounded_up(proved_gap: float) -> str:
    """The proved gap in percent, without an exponent."""
    return f"{ROUNDED_UP.create_decimal(repr(100 * proved_gap)):f} %" if proved_gap else "0 %"


def minima_reach() -> str:
    """How far above the lowest one minima of the grid are kept."""
    from ..global_optimum.search import FACTOR

    return f"less than {percent(FACTOR - 1)} above the best one"


def optimality_gap(rmse_v: float, optimum_v: float) -> float:
    """The distance of an RMSE above that of the optimum, as a share."""
    from ..global_optimum import search

    return search.optimality_gap(rmse_v, optimum_v)


def errors_words(errors: "SocErrors | Metrics | None") -> str:
    """An RMSE in mV, followed in brackets by the one above 10 % SOC if it differs; a dash without
    errors.

    >>> from barnax.fit.cross_validation import SocErrors
    >>> errors_words(SocErrors(0.0232, 0.0102)), errors_words(SocErrors(0.0232, None))
    ('23.2 (10.2)', '23.2')
    """
    if errors is None:
        return NOTHING
    whole, above = aligned_millivolt(errors.rmse_v), aligned_millivolt(errors.above_v)
    return f"{whole} ({above})" if above not in ("", whole) else whole


def duration(value_s: float) -> str:
    """Seconds, minutes or hours, whichever is natural.

    >>> duration(46.8), duration(1500), duration(19679)
    ('46.8 s', '25 min', '5.47 h')
    """
    if value_s < 600:
        return f"{value_s:.3g} s"
    return f"{value_s / 60:.3g} min" if value_s < 7200 else f"{value_s / 3600:.3g} h"


def degrees(temperature_degc: float) -> str:
    """A temperature with its unit."""
    return f"{temperature_degc + 0.0:.3g} degC"


def capitalized(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def symbol(name: str) -> str:
    """A parameter's name without its unit.

    >>> symbol("R1 [Ohm]")
    'R1'
    """
    return name.partition(" [")[0]


def quantity_name(quantity: str) -> str:
    """A quantity's name in a sentence; "total R" for R, the sum of all resistances."""
    return {"R": "total R"}.get(symbol(quantity), symbol(quantity))


def figures(value: float | None, digits: int = 3) -> str:
    """This many digits, without an exponent if possible; a dash if there is none.

    >>> figures(0.1), figures(212403.8), figures(7.0), figures(9.994e12), figures(307212.0, 4)
    ('0.1', '212000', '7', '9.99e+12', '307200')
    """
    if value is None:
        return NOTHING
    rounded = float(f"{value:.{digits}g}")
    if 10**digits <= abs(rounded) < 1e9:
        return f"{rounded:.0f}"
    return f"{rounded:.{digits}g}"


def shown(name: str, value: float, digits: int = 3) -> tuple[str, str]:
    """A parameter's value with this many figures and its unit: resistances in mOhm, those of coin
    cells in Ohm, many seconds in hours, voltages in mV with two figures.

    >>> shown("R1 [Ohm]", 0.0149), shown("R1 [Ohm]", 57.2), shown("tau2 [s]", 19680.0)
    (('14.9', 'mOhm'), ('57.2', 'Ohm'), ('5.47', 'h'))
    """
    unit = "/SOC" if name == RATE else name.partition(" [")[2].rstrip("]")
    if unit == "V":
        return figures(1e3 * value, digits - 1), "mV"
    if unit == "Ohm" and value < LARGE_OHM:
        value, unit = 1e3 * value, "mOhm"
    if unit == "s" and value >= 10_000:
        value, unit = value / 3600, "h"
    return figures(value, digits), unit


def in_milliohm(name: str) -> tuple[str, float]:
    """A parameter's name with the unit of a column, and the factor to that.

    >>> in_milliohm("R1 [Ohm]"), in_milliohm("C1 [F]")
    (('R1 [mOhm]', 1000.0), ('C1 [F]', 1.0))
    """
    head = "gamma [1/SOC]" if name == RATE else name.replace("[Ohm]", "[mOhm]")
    return head, 1e3 if name.endswith("[Ohm]") else 1.0


def readable(circuit: "CircuitParameters") -> dict[str, float]:
    """The numbers of a constant circuit, resistances in mOhm, by names with their units.

    >>> from barnax import CircuitParameters
    >>> readable(CircuitParameters.constant(r0=0.05, r=(0.02,), c=(500.0,)))
    {'R0 [mOhm]': 50.0, 'R1 [mOhm]': 20.0, 'C1 [F]': 500.0, 'tau1 [s]': 10.0}
    """
    # Loads JAX, which a check of files does not need.
    from ..uncertainty.covariance import named_values

    scaled = ((in_milliohm(name), value) for name, value in named_values(circuit).items())
    return {head: factor * value for (head, factor), value in scaled}


def with_unit(name: str, value: float) -> str:
    """A parameter's value with its unit, for sentences.

    >>> with_unit("R1 [Ohm]", 0.0149), with_unit("gamma", 48.0)
    ('14.9 mOhm', '48 /SOC')
    """
    return " ".join(shown(name, value)).rstrip()


def seconds(time_s: float) -> str:
    """A time constant or another duration, for sentences."""
    return with_unit("time [s]", time_s)


def times(log_step: float) -> str:
    """A factor; beyond `WIDEST_FACTOR` its size is unknown."""
    # Loads JAX, which a check of files does not need.
    from ..uncertainty.covariance import WIDEST_FACTOR

    if abs(log_step) > math.log(WIDEST_FACTOR):
        less = f"less than {1 / WIDEST_FACTOR:g}"
        return f"times {less if log_step < 0 else f'more than {WIDEST_FACTOR:g}'}"
    return f"times {math.exp(log_step):.2g}"


def between(name: str, low: float, high: float, value: float | None = None) -> str:
    """An interval of a parameter, with enough digits to distinguish its ends from the value.

    >>> between("R1 [Ohm]", 0.0136, 0.0687), between("tau1 [s]", 4000, 40000)
    ('13.6 to 68.7 mOhm', '4000 s to 11.1 h')
    >>> between("R0 [Ohm]", 0.019, 0.02004, 0.02), between("R1 [Ohm]", 0.685, 1.05)
    ('19.00 to 20.04 mOhm', '0.685 to 1.05 Ohm')
    """
    digits = max(_digits_apart(name, end, value) for end in (low, high))
    (least, unit), (most, other) = (shown(name, end, digits) for end in (low, high))
    if (unit, other) == ("mOhm", "Ohm"):
        least, unit = figures(low, digits), other
    elif unit != other:
        return f"{least} {unit} to {most} {other}"
    if digits > FEWEST_DIGITS and "e" not in least + most:
        decimals = max(len(text.partition(".")[2]) for text in (least, most))
        least, most = (f"{float(text):.{decimals}f}" for text in (least, most))
    return f"{least} to {most} {unit}".rstrip()


def interval(name: str, low: float | None, high: float | None, value: float | None = None) -> str:
    """An interval of a parameter for sentences, whichever of its ends is known.

    >>> interval("R1 [Ohm]", 0.0136, 0.0687), interval("R1 [Ohm]", 0.0, 0.0687)
    ('13.6 to 68.7 mOhm', 'at most 68.7 mOhm')
    >>> interval("R1 [Ohm]", None, None)
    'not determined'
    """
    if high is None:
        return NOT_DETERMINED if low is None else f"at least {with_unit(name, low)}"
    return between(name, low, high, value) if low else f"at most {with_unit(name, high)}"


def interval_beside(value: str, of: "NodeInterval") -> str:
    """The interval of a number, without the unit of the value next to it."""
    return without_unit(interval(of.name, of.low, of.high, of.value), value)


def interval_under(head: str, of: "NodeInterval | Estimate | ParameterProfile") -> str:
    """The interval under the head of a column, without its unit."""
    text = interval(of.name, of.low, of.high, getattr(of, "value", None))
    return without_unit(text, head.replace("[", "").rstrip("]"))


def without_unit(text: str, value: str) -> str:
    """A text without the unit of the value next to it; two different units remain.

    >>> without_unit("1 to 2 s", "1.5 s"), without_unit("9 s to 3 h", "2 h")
    ('1 to 2', '9 s to 3 h')
    """
    first, _, last = text.partition(" to ")
    return text if last and " " in first else text.removesuffix(f" {value.rpartition(' ')[2]}")


def _digits_apart(name: str, end: float, value: float | None) -> int:
    """The digits that distinguish an end from the value; the fewest if none do."""
    for digits in range(FEWEST_DIGITS, MOST_DIGITS + 1):
        if value is None or shown(name, end, digits) != shown(name, value, digits):
            return digits
    return FEWEST_DIGITS


def band_label(quantity: BandQuantity, band: "Band") -> str:
    """A band of SOC, current or temperature in a table.

    >>> from barnax.uncertainty import Band
    >>> band_label("SOC", Band(0.1, 0.2, 1, 0.0, 0.0, 0.0))
    '10 to 20 %'
    >>> band_label("current", Band(-0.2, -0.05, 1, 0.0, 0.0, 0.0))
    'charge 0.05 to 0.2 C'
    >>> band_label("current", Band(-0.05, 0.05, 1, 0.0, 0.0, 0.0))
    'rest'
    """
    if quantity == "SOC":
        return f"{100 * (band.low or 0.0):.0f} to {100 * (band.high or 0.0):.0f} %"
    if quantity == "temperature":
        return f"{band.low:g} to {band.high:g} degC"
    if band.low is not None and band.high is not None and band.low < 0 < band.high:
        return "rest"
    ends = sorted(abs(end) for end in (band.low, band.high) if end is not None)
    way = "charge" if (band.high or 0.0) < 0 else "discharge"
    size = f"above {ends[0]:.2g}" if len(ends) == 1 else f"{ends[0]:.2g} to {ends[1]:.2g}"
    return f"{way} {size} C"
