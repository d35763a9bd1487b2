"""A circuit's numbers in readable units."""

from collections.abc import Mapping

from ..cell import CircuitParameters


def readable(parameters: Mapping[str, float]) -> dict[str, float]:
    """Resistances in mOhm, capacitances in F and time constants in s, by a name with its unit.

    `parameters` are PyBaMM's names, as `result.json` holds them.

    >>> readable({"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.02, "C1 [F]": 500.0})
    {'R0 [mOhm]': 50.0, 'R1 [mOhm]': 20.0, 'C1 [F]': 500.0, 'tau1 [s]': 10.0}
    """
    circuit = CircuitParameters.from_dict(parameters)
    values = {"R0 [mOhm]": 1e3 * circuit.r0}
    pairs = zip(circuit.r, circuit.c, circuit.tau_s, strict=True)
    for pair, (r, c, tau_s) in enumerate(pairs, start=1):
        values |= {f"R{pair} [mOhm]": 1e3 * r, f"C{pair} [F]": c, f"tau{pair} [s]": tau_s}
    if circuit.gamma is not None:
        values["gamma [1/SOC]"] = circuit.gamma
    return values
