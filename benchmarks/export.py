"""Does an exported circuit do elsewhere what it does here? `python -m benchmarks.export`.

Makes a virtual environment with barnax and both packages (the extra `verify`), identifies every
circuit on the bundled cell, exports it, and simulates the exports on two currents. Writes
benchmarks/results/export.md.
"""

import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results" / "export.md"
KEY, SEEDS, ITERATIONS = 0, 4, 100
CIRCUITS = ("1rc", "so-rc", "3rc", "4rc", "iso-rc", "esc")
PACKAGES = ("pybamm", "thevenin")
# The trips charge at times; from full, PyBaMM would end there, at its largest SOC.
TRIPS_FROM_SOC = 0.95
NOTES = """\
`apart from turns` leaves out the samples at which the current turns, `without hysteresis` compares
with barnax's circuit without its hysteresis voltage. What the figures come from:

- 50 µV everywhere: the OCV table, which its readers interpolate linearly. Tables of resistances add
  some: barnax holds a resistance over an interval (here cut in 16), and a solver does not.
- PyBaMM, `iso-rc` and `esc`: its model has no hysteresis voltage. Without ours, the same 50 µV.
- thevenin, `iso-rc`: the hysteresis is a state there, which turns once charge has passed, with
  gamma = 1e5; ours has turned at the sample at which the current turns, and does not turn below
  the rest current. On the trips, thevenin's follows the noise of 2 mA while the car stands.
- thevenin, `esc`: it relaxes the hysteresis voltage toward W(soc)/2, ours the share of W(soc)/2.
- That nothing else differs: a plain loop of thevenin's own equations agrees with it to
  {loop_v:.1e} V, `iso-rc` and `esc` on both currents.
- Currents are held from sample to sample on both sides. PyBaMM's own way, linear between samples,
  would differ on the trips by up to {ramp_v:.3f} V (`so-rc`): give PyBaMM a step profile."""


def run_in_environment() -> None:
    """This module again, in an environment that has barnax and both packages."""
    folder = Path(tempfile.gettempdir()) / "barnax-benchmark-export"
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, "-e", f"{REPOSITORY}[verify]"], check=True)
    subprocess.run(
        [python, "-m", "benchmarks.export", "--inside"],
        cwd=REPOSITORY,
        env=os.environ | {"PYBAMM_DISABLE_TELEMETRY": "true"},
        check=True,
    )


def results() -> Iterator:
    """Every circuit identified on the bundled cell, one of them with tables over SOC too."""
    import barnax
    from barnax.bundled import BUNDLED

    tests = [barnax.read_record(path) for path in BUNDLED.ocv]
    record = barnax.read_record(barnax.bundled_file("identification"))
    for circuit, over in (*((circuit, None) for circuit in CIRCUITS), ("so-rc", "soc")):
        yield barnax.identify(
            record,
            ocv=tests,
            ocv_fit="interpolated",
            model=circuit,
            over=over,
            method="ibmo-centered",
            iterations=ITERATIONS,
            seeds=SEEDS,
            key=KEY,
            coordinates="log",
            trust="none",
        )


def starting_at(result, soc: float):
    """The same result with another state of charge at the start."""
    first, *others = result.inputs
    start = replace(first.start, soc=soc)
    return result.model_copy(
        update={"inputs": (first.model_copy(update={"start": start}), *others)}
    )


def trips():
    """The current of the bundled validation record."""
    import barnax
    from barnax.export import HeldLoad

    record = barnax.read_record(barnax.bundled_file("validation"))
    return HeldLoad(record.time_s - record.time_s[0], record.current_a)


def cases(result) -> Iterator[tuple]:
    """Both currents: a name, the result with its start, and the profile."""
    from barnax.export import pulse_profile

    yield "pulses", result, pulse_profile(result)
    yield "trips", starting_at(result, TRIPS_FROM_SOC), trips()


def rows(result) -> Iterator[str]:
    """One line of the table for each current and package."""
    from barnax.export import get_exporter, verify

    for name, start, profile in cases(result):
        for package in PACKAGES:
            exporter = get_exporter(package)
            found = verify(start, exporter, exporter.write(start).content, profile)
            yield (
                f"| {name_of(result)} | {package} | {name} | {found.samples} | {found.rms_v:.2e} "
                f"| {found.largest_v:.2e} | {found.without_turns_v:.2e} "
                f"| {found.without_hysteresis_v:.2e} |"
            )


def name_of(result) -> str:
    return f"{result.model}, tables" if result.tables else result.model


def thevenin_loop_difference_v(result, profile) -> float:
    """thevenin against a plain loop of its documented equations, exact for held current."""
    import numpy as np

    from barnax.export import get_exporter

    exporter = get_exporter("thevenin")
    content = exporter.write(result).content
    module: dict = {}
    exec(content, module)
    p = module["get_params"]()
    pairs = range(1, p["num_RC_pairs"] + 1)
    r = np.array([p[f"R{k}"](0.5, 298.15) for k in pairs])
    tau = r * [p[f"C{k}"](0.5, 298.15) for k in pairs]
    soc, hyst, eta, found = p["soc0"], module["INITIAL_HYSTERESIS_V"], 0 * r, []
    intervals = np.diff(profile.time_s, append=profile.time_s[-1])
    for i, dt in zip(profile.current_a.tolist(), intervals.tolist(), strict=True):
        found.append(p["ocv"](soc) + hyst - eta.sum() - i * p["R0"](soc, 298.15))
        eta = r * i + (eta - r * i) * np.exp(-dt / tau)
        # M_hyst moves with SOC: ten short steps an interval.
        passed = i * dt / (3600 * p["capacity"]) / 10
        for _ in range(10):
            level = -np.sign(i) * p["M_hyst"](soc - passed / 2)
            hyst = level + (hyst - level) * np.exp(-p["gamma"] * abs(passed))
            soc -= passed
    return float(np.abs(exporter.simulate(content, profile) - found).max())


def ramp_difference_v(result) -> float:
    """How far PyBaMM moves on the trips where it interpolates the current linearly."""
    import numpy as np
    import pybamm

    from barnax.export import get_exporter

    exporter, profile = get_exporter("pybamm"), trips()
    content = exporter.write(starting_at(result, TRIPS_FROM_SOC)).content
    module: dict = {}
    exec(content, module)
    values = module["get_parameter_values"]()
    time_s, current_a = profile.time_s, profile.current_a
    values["Current function [A]"] = lambda t: pybamm.Interpolant(time_s, current_a, t)
    solver = pybamm.IDAKLUSolver(rtol=1e-8, atol=1e-9)
    simulation = pybamm.Simulation(
        module["get_model"](), parameter_values=pybamm.ParameterValues(values), solver=solver
    )
    ramped_v = simulation.solve(t_eval=time_s, t_interp=time_s)["Voltage [V]"](time_s)
    return float(np.abs(ramped_v - exporter.simulate(content, profile)).max())


def write_page() -> None:
    """Simulate all, print the page and write it."""
    from benchmarks.pages import as_markdown, provenance, publish

    table, loop_v, ramp_v = [], 0.0, 0.0
    for result in results():
        table += rows(result)
        print(*table[-4:], sep="\n", file=sys.stderr, flush=True)
        if result.model in ("iso-rc", "esc"):
            for _, start, profile in cases(result):
                loop_v = max(loop_v, thevenin_loop_difference_v(start, profile))
        if name_of(result) == "so-rc":
            ramp_v = ramp_difference_v(result)
    page = "\n".join(
        [
            "# Exported circuits, simulated where they went",
            "",
            "Root mean square and largest difference of terminal voltage, in volts, between a "
            "package that reads what `barnax export` wrote and barnax itself. Circuits: "
            f"identified on the bundled cell ({SEEDS} seeds, {ITERATIONS} iterations of "
            "ibmo-centered, then refined). Currents: "
            "the pulse test of `--verify`, and the trips of the bundled validation record, "
            f"started at SOC {TRIPS_FROM_SOC}.",
            "",
            as_markdown(provenance("python -m benchmarks.export", KEY, *PACKAGES)),
            "",
            "| circuit | in | current | samples | rms [V] | largest [V] | apart from turns [V] "
            "| without hysteresis [V] |",
            "|---" * 8 + "|",
            *table,
            "",
            NOTES.format(loop_v=loop_v, ramp_v=ramp_v),
            "",
        ]
    )
    publish(RESULTS, page)


if __name__ == "__main__":
    if "--inside" in sys.argv:
        write_page()
    else:
        run_in_environment()
