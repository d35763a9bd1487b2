"""`python -m benchmarks.planted` plants faults, each alone in a copy of the tree, and prints
which the tests of its room catch: all of them. `--only NAME` plants one, `--list` names them."""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.pages import as_markdown, provenance, publish

REPOSITORY = Path(__file__).parents[1]
PACKAGE = Path("src") / "barnax"
RESULTS = REPOSITORY / "benchmarks" / "results" / "planted.md"
COPIED, LINKED = ("src", "tests"), ("data", "benchmarks", "pyproject.toml")
# What pytest ends with where all tests passed, and where one failed.
PASSED, FAILED = 0, 1
# A test that takes longer hangs.
LIMIT_S = 1200


@dataclass(frozen=True)
class Fault:
    """One exact text of a module, what stands there instead, and the tests that are to notice."""

    name: str
    module: str
    text: str
    planted: str
    tests: tuple[str, ...]

    def count(self) -> int:
        """How often its text is in the module: once, or nothing is planted."""
        return (REPOSITORY / PACKAGE / self.module).read_text(encoding="utf-8").count(self.text)

    def plant(self, tree: Path) -> None:
        """Put the fault into a copy of the tree."""
        path = tree / PACKAGE / self.module
        text = path.read_text(encoding="utf-8")
        if text.count(self.text) != 1:
            raise SystemExit(f"{self.name}: {self.text!r} is not once in {self.module}")
        path.write_text(text.replace(self.text, self.planted), encoding="utf-8")


def fault(name: str, module: str, text: str, planted: str, *tests: str) -> Fault:
    return Fault(name, module, text, planted, tests)


BOX = "tests/global_optimum/test_box_bound.py"
TABLE_BOX = "tests/fit/test_bound_by_hand.py"
DENSE = "tests/fit/test_dense.py"
OFFSET = "tests/fit/test_current_offset.py"
PROGRAMS = "tests/test_programs.py"

FAULTS = (
    # The reduction.
    fault("columns of pairs that have not settled", "model/layout.py",
          "SETTLED = 1e-16", "SETTLED = 1e-6", "tests/fit/test_reduced.py"),
    # The proof.
    fault("remainder of a proof", "global_optimum/certificate.py",
          "lowest_of_parabola(below, middle, above) - self.remainder",
          "lowest_of_parabola(below, middle, above)", BOX),
    fault("remainder of a table's proof", "fit/certificate.py",
          "return lowest - 2 * float(np.linalg.norm(error)) * self.remainder",
          "return lowest", TABLE_BOX),
    fault("limits not of the unknowns", "fit/objective.py",
          "return np.abs(np.linalg.inv(self.to_tables)) @ np.concatenate(values)",
          "return np.concatenate(values)", TABLE_BOX),
    fault("rounding of the parabola's ends", "global_optimum/proof.py",
          "LEBESGUE = 1.25", "LEBESGUE = 1.0", BOX, TABLE_BOX),
    fault("samples after an interval", "global_optimum/proof.py",
          "most[run_s] = _most_within(scored_s, run_s)", "most[run_s] = 1", BOX),
    fault("tax of a node's scale", "fit/certificate.py",
          "of_table += box_axis.least(error, tax) - sign * tax",
          "of_table += box_axis.least(error, tax)",
          TABLE_BOX),
    fault("highest bound for lowest", "global_optimum/proof.py",
          "float(bounds_v[0]) - slack_v", "float(bounds_v[-1]) - slack_v",
          "tests/global_optimum/test_certificate.py"),
    # Intervals.
    fault("quantile of intervals", "metrics.py",
          "stdtrit(freedom, (1 + CONFIDENCE) / 2)", "stdtrit(freedom, CONFIDENCE)",
          DENSE, "tests/uncertainty/test_covariance.py"),
    fault("one more record", "fit/cross_validation.py",
          "np.sqrt(1 + 1 / len(separate))", "np.sqrt(1 / len(separate))", DENSE),
    fault("smoothing in standard errors", "fit/intervals.py",
          "smoothing_scale=LIGHT * objective.smoothing_scale",
          "smoothing_scale=objective.smoothing_scale", DENSE),
    fault("lines for curves", "fit/intervals.py",
          "on_curve = near + sag - float(moves.by_lines[row])", "on_curve = near + sag", DENSE),
    fault("noise that a fit has followed", "uncertainty/noise.py",
          "np.transpose(of_parts) + taken]", "np.transpose(of_parts)]",
          "tests/uncertainty/test_noise.py"),
    # Nuisances, and what several shapes, cells or parts leave open.
    fault("least gain of an offset", "fit/current_offset.py",
          "is_shown = abs(offset_a) > least_a and leaves < LEAVES",
          "is_shown = abs(offset_a) > least_a", OFFSET),
    fault("pull of a start's prior", "fit/nuisances.py",
          "pushed[of_nuisances] += pull @ belief[1]",
          "pushed[of_nuisances] += 0 * pull @ belief[1]", DENSE),
    fault("spread between shapes", "fit/ageing.py",
          'mean["covariance"] += np.einsum("s,si,sj->ij", shares, off, off)',
          'mean["covariance"] += 0 * np.einsum("s,si,sj->ij", shares, off, off)',
          "tests/fit/test_ageing_shapes.py"),
    fault("spread between a fleet's shapes", "life/rows.py",
          "(by_shape[..., 1] ** 2 + off**2)", "by_shape[..., 1] ** 2",
          "tests/life/test_shapes.py"),
    fault("prior of a law's step", "fit/dependence.py",
          "range(len(scales)), pull_v2, pull_v2 * (scales - usual))", "range(len(scales)))",
          DENSE),
    fault("jackknife of a lag", "records/lag.py",
          "np.sqrt((_PARTS - 1) * np.var(_share(of_parts.T)))",
          "np.sqrt(np.var(_share(of_parts.T)))", "tests/records/test_lag.py"),
    # Packs.
    fault("error in common of a pack", "fit/pack.py",
          "reach = math.hypot(reach_of(number, direction), common)",
          "reach = reach_of(number, direction)", DENSE),
    fault("time constants of a pack's cell", "fit/pack.py",
          "by_scales = fit.slopes[:, :1] - fit.slopes",
          "by_scales = fit.slopes - fit.slopes[:, :1]", DENSE),
    # Sampling of the current.
    fault("R0 by the other sampling", "identification/answer.py",
          "shifts_ohm.append(other.most_ohm)", "shifts_ohm.append(0.0)",
          "tests/test_other_sampling.py"),
    fault("a pair that R0 hides", "fit/temperature_fits.py",
          "{R0: least_r0_share(records) - 1}", "{R0: 0.0}", "tests/test_other_sampling.py"),
    fault("pairs by the other sampling", "model/other_sampling.py",
          "= first / others - 1", "= others / first - 1",
          "tests/test_other_sampling.py"),
    # Choice.
    fault("gain in bands of SOC", "select/policy.py",
          "value = np.mean(by_block) / 2 + np.mean(np.log(sums_v2[0] / sums_v2[1])) / 2",
          "value = np.mean(by_block)", "tests/select/test_policy.py"),
    fault("standard error of a gain", "select/policy.py",
          "adds = by_block / 2 + len(by_block) * np.mean(shares, axis=1) / 2",
          "adds = by_block / 2", "tests/select/test_policy.py"),
    fault("held out and fitted", "fit/cross_validation.py",
          "x = self.fitted_to(labels != label)", "x = self.fitted_to(labels == labels)",
          DENSE),
    # Starts.
    fault("axis of several records", "fit/registration.py",
          "moved = (to_axis @ estimated.values).reshape", "moved = estimated.values.reshape",
          "tests/fit/test_registration.py"),
    fault("charge carried to a start", "model/start.py",
          "passed_ah = self.discharged_ah[determined.sample] - self.discharged_ah[self.first]",
          "passed_ah = self.discharged_ah[self.first] - self.discharged_ah[determined.sample]",
          "tests/model/test_start.py"),
    # Fit and filters.
    fault("weight of a bend", "fit/objective.py",
          "bent = math.sqrt(settings.roughness) *", "bent = settings.roughness *",
          DENSE),
    fault("spread of a Gaussian sum", "filters/kalman.py",
          "(variance + (mean - middle) ** 2)", "variance", "tests/filters/test_kalman.py"),
    # Programs that are kept.
    fault("source of a program", "programs.py",
          "made_from = _source, versions", "made_from = versions", PROGRAMS),
    fault("source edited while it ran", "programs.py",
          "if _hash_source() == _source:", "if True:", PROGRAMS),
    fault("values of a program", "programs.py",
          "pickler.dump((function, jax.tree.map(described, arguments)))",
          "pickler.dump((function, str(jax.tree.structure(arguments))))", PROGRAMS),
    fault("another user's program", "programs.py",
          "return status.st_uid == os.geteuid() and not", "return not", PROGRAMS),
)  # fmt: skip


def copied(folder: Path) -> Path:
    """A copy of the tree in a new folder, as far as tests need it."""
    tree = Path(tempfile.mkdtemp(dir=folder))
    for name in COPIED:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(REPOSITORY / name, tree / name, ignore=ignored)
    for name in LINKED:
        (tree / name).symlink_to(REPOSITORY / name)
    return tree


def run_tests(tree: Path, tests: Iterable[str]) -> int:
    """What pytest ends with; the first failure ends it."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider"]
    return subprocess.run(
        [*command, *tests],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree / "src")},
        capture_output=True,
        timeout=LIMIT_S,
        check=False,
    ).returncode


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planted", description=__doc__)
    parser.add_argument("--only", metavar="NAME", choices=[each.name for each in FAULTS])
    parser.add_argument("--list", action="store_true", help="name the faults and plant none")
    options = parser.parse_args(arguments)
    if options.list:
        print("\n".join(f"{each.name}: {each.module}" for each in FAULTS))
        return
    faults = [each for each in FAULTS if options.only in (None, each.name)]
    rows, survivors = ["| fault | module | tests | | s |", "|---|---|---|---|---|"], []
    with tempfile.TemporaryDirectory() as folder:
        tests = sorted({path for each in faults for path in each.tests})
        if run_tests(copied(Path(folder)), tests) != PASSED:
            raise SystemExit(f"these do not pass without a fault: {' '.join(tests)}")
        for each in faults:
            tree, started = copied(Path(folder)), time.perf_counter()
            each.plant(tree)
            status = run_tests(tree, each.tests)
            shutil.rmtree(tree)
            if status not in (PASSED, FAILED):
                raise SystemExit(f"{each.name}: pytest ends with {status}, and tells nothing")
            seconds, verdict = time.perf_counter() - started, "caught"
            if status == PASSED:
                verdict = "**survived**"
                survivors.append(each.name)
            names = ", ".join(f"`{path}`" for path in each.tests)
            row = f"| {each.name} | `{each.module}` | {names} | {verdict} | {seconds:.0f} |"
            rows.append(row)
            print(row, flush=True)
    if options.only is None:
        publish(RESULTS, _page(rows, len(faults), survivors))
    if survivors:
        raise SystemExit(f"survived: {', '.join(survivors)}")


def _page(rows: Sequence[str], count: int, survivors: Sequence[str]) -> str:
    facts = provenance("python -m benchmarks.planted", 0, "pytest")
    verdict = f"{len(survivors)} survived" if survivors else "none survived"
    return "\n".join([
        "# Planted faults", "",
        "Each fault replaces one line of the program, alone, in a copy of it. The default tests "
        "named beside it pass without the fault, and one of them has to fail with it.", "",
        f"Of {count} faults {verdict}.", "",
        as_markdown({name: facts[name] for name in ("command", "versions", "machine", "date")}), "",
        *rows, "",
    ])  # fmt: skip


if __name__ == "__main__":
    main()
