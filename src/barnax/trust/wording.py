"""Parameters and figures in words."""

MILLI = {"Ohm": "mOhm"}


def symbol(name: str) -> str:
    """`R1` of `R1 [Ohm]`."""
    return name.split(" [")[0]


def with_unit(name: str, value: float) -> str:
    """A value to three figures, resistances in mOhm.

    >>> with_unit("R1 [Ohm]", 0.0149)
    '14.9 mOhm'
    """
    unit = name.partition(" [")[2].rstrip("]")
    if unit in MILLI:
        value, unit = 1e3 * value, MILLI[unit]
    return f"{figures(value)} {unit}".rstrip()


def figures(value: float) -> str:
    """Three figures, without an exponent where it can be helped.

    >>> figures(0.1), figures(212403.8), figures(7.0), figures(9.994e12)
    ('0.1', '212000', '7', '9.99e+12')
    """
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if 1000 <= abs(rounded) < 1e9 else f"{rounded:g}"


def joined(words: list[str], last: str = "and") -> str:
    """`a, b and c`."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
