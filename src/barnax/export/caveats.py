"""Sentences that several exporters say in the same way."""

from .tables import Tables


def hysteresis_is_left_out(tool: str, tables: Tables) -> tuple[str, ...]:
    """What a tool with a single OCV curve loses; nothing for a circuit without hysteresis."""
    if tables.kind == "none":
        return ()
    rate = ""
    if tables.kind == "dynamic":
        rate = f", and its rate gamma of {tables.parameters.gamma:.6g} per unit of SOC"
    largest_mv = 1e3 * tables.largest_hysteresis_v
    return (
        f"{tool} has no hysteresis voltage: W(soc), up to {largest_mv:.3g} mV, of which the "
        f"circuit {tables.model} adds half after charging and takes half away after "
        f"discharging{rate}, is left out. What remains is the OCV averaged over charge and "
        "discharge.",
    )
