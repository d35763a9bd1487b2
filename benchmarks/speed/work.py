"""The rows of the table, all in the same turns."""

from importlib.util import find_spec

import numpy as np
from scipy.optimize import OptimizeResult

import barnax
from barnax.search.seeds import SEED_TOLERANCE, Descent

from .case import bundled_problem, points_in, points_of
from .filtered import Filtered
from .kernel import Kernel, lanes_of
from .row import Row
from .searches import generations, identify, one_search, reduce_record
from .sizes import POPULATION, Sizes
from .turns import Run, Taken, take_turns

LARGE = 900
# Two optima of one problem that are the same optimum.
SAME = 1e-3


def time_generations(name: str, kernel: Kernel, sizes: Sizes) -> list[Row]:
    """One generation by the scan against the kernel, two populations."""
    problem = bundled_problem()
    objective, inputs = problem.objective, problem.all_inputs[0]
    arrays = [np.asarray(each) for each in (inputs.current_a, inputs.base_error_v)]
    count = sizes.generations_a_turn
    runs: dict[str, Run] = {}
    for population in (POPULATION, LARGE):
        points = points_of(problem, population)
        lanes = lanes_of(problem, points)
        ours = generations(objective, points, 1)()[0] ** 2 * len(arrays[0])
        difference = max(abs(kernel(lanes, *arrays)[:population] / ours - 1))
        if not difference < 1e-9:
            raise SystemExit(f"the kernel and the scan disagree by {difference:.1e}")
        runs[f"scan {population}"] = Run(generations(objective, points, count), each=count)
        runs[f"kernel {population}"] = Run(lambda lanes=lanes: kernel(lanes, *arrays), calls=count)
    taken = take_turns(runs, 3 * sizes.turns)
    samples = f"{len(arrays[0]):,} samples"
    return [
        _at_most(
            f"one generation, scan, {population} candidates x {samples}, f64",
            taken, f"scan {population}", f"kernel {population}", name, aim,
        )
        for population, aim in ((POPULATION, 1.2), (LARGE, 1.2))
    ]  # fmt: skip


def time_searches(name: str, kernel: Kernel, sizes: Sizes) -> tuple[list[Row], list[str]]:
    """Everything that is compared with whole searches, and the answers of the runs."""
    scan, short = bundled_problem("scan"), bundled_problem("compressed")
    filtered = Filtered(scan)
    arrays = (filtered.current_a, filtered.base_v)
    lanes = lanes_of(scan, points_of(scan, POPULATION))
    nodes = len(short.compressed.in_tau.nodes)
    node_lanes = lanes_of(scan, points_of(scan, nodes))
    logs = scan.log_coordinates
    starts = np.asarray(points_in(logs, sizes.starts))
    circuits = short.parameters_at(starts, logs)
    descent = Descent(short)
    answers: dict[str, object] = {}

    def keep(key, call):
        def run():
            answers[key] = call()

        return run

    def generations_of_kernel():
        for _ in range(sizes.generations):
            kernel(lanes, *arrays)

    budget = sizes.generations, POPULATION
    runs = {
        "de": Run(keep("de", lambda: filtered.evolve(*budget))),
        "scan": Run(one_search(scan.objective, sizes)),
        "kernel": Run(generations_of_kernel),
        "compressed": Run(one_search(short.objective, sizes), calls=5),
        "trf": Run(keep("trf", lambda: filtered.descend(starts))),
        "lm": Run(keep("lm", lambda: descent(circuits, SEED_TOLERANCE)), calls=5),
        "optimum": Run(
            keep("optimum", lambda: barnax.find_global_optimum(bundled_problem(), prove=False))
        ),
        "certified": Run(keep("certified", lambda: barnax.find_global_optimum(bundled_problem()))),
        "cma": Run(keep("cma", filtered.adapt)),
        "mealpy": Run(keep("mealpy", lambda: filtered.mate(*budget))),
        "projection": Run(
            keep("projection", lambda: Filtered(bundled_problem()).project()), calls=5
        ),
        "seeds": Run(
            keep("seeds", lambda: identify(bundled_problem("compressed"), sizes, sizes.seeds))
        ),
        "nodes": Run(lambda: kernel(node_lanes, *arrays), calls=10),
        "reduction": Run(lambda: reduce_record(short), calls=3),
    }
    # Its pins conflict with ours: timed where it is installed without them.
    if find_spec("mealpy") is None:
        del runs["mealpy"]
    taken = take_turns(runs, sizes.turns)
    search = f"full search {POPULATION} x {sizes.generations}"
    evaluations = f"{POPULATION * sizes.generations:,} evaluations"
    de = f"NumPy + lfilter + SciPy DE, {evaluations}"
    alone = f"{name}, {sizes.generations} generations alone"
    after = "compressed, after the reduction"
    optimum = "global optimum, the reduction included"
    proved = "`make_problem` and `find_global_optimum(problem)`"
    single = "the program of one seed; a search by `identify` runs eight seeds at a time"
    projection = "lfilter + variable projection on a grid, the record prepared, unproved"
    trf = f"lfilter + least_squares TRF, {sizes.starts} starts"
    rows = [
        _faster(f"{search}, scan", taken, "scan", "de", de, 15.0, note=single),
        _at_most("the reduction of one record", taken, "reduction", "nodes",
                 f"one pass of the {name}, {node_lanes.shape[1]} lanes for {nodes} nodes", 5.0),
        _faster(f"{search}, {after}", taken, "compressed", "de", de, 100.0, note=single),
        _faster(f"{search}, {after}", taken, "compressed", "kernel", alone, 2.0, note=single),
        _faster(f"{sizes.seeds} seeds, compressed, the reduction included", taken, "seeds",
                "kernel", f"{sizes.seeds} x {alone}", 6.0, times=sizes.seeds,
                note="`make_problem` and `identify` as a user calls them"),
        _faster(f"multi-start LM from {sizes.starts} starts, {after}", taken, "lm", "trf", trf,
                20.0),
        *(_faster(f"{optimum}, with its certificate", taken, "certified", peer, baseline, aim,
                  note=proved)
          for peer, baseline, aim in (
              ("de", de, 30.0), ("trf", trf, 8.0),
              ("cma", "lfilter + CMA-ES, until it stops", None),
              ("mealpy", f"lfilter + mealpy's BMO, {evaluations}", None),
              ("projection", projection, None)) if peer in runs),
        _at_most(f"{optimum}, not proved", taken, "optimum", "projection", projection, 1.0),
    ]  # fmt: skip
    return rows, _answers(answers)


def rmse_of(descended: OptimizeResult) -> float:
    """The root mean square of the errors where SciPy's least squares ended, in V."""
    return float((2 * descended.cost / len(descended.fun)) ** 0.5)


def _answers(answers: dict) -> list[str]:
    """The RMSE each method reached: a fast wrong answer is none."""
    optimum = answers["certified"]
    descents = [each.rmse_v for each in answers["lm"]]
    filtered = [rmse_of(each) for each in answers["trf"]]
    best = (1 + SAME) * optimum.rmse_v
    return [
        f"global optimum: {1e3 * optimum.rmse_v:.4f} mV, {optimum.status}; without proof "
        f"{1e3 * answers['optimum'].rmse_v:.4f} mV",
        f"LM: best {1e3 * min(descents):.4f} mV, "
        f"{sum(each < best for each in descents)} of {len(descents)} starts at the optimum",
        f"TRF from the same starts: best {1e3 * min(filtered):.4f} mV, "
        f"{sum(each < best for each in filtered)} of {len(filtered)} starts at the optimum, "
        f"{sum(each.nfev for each in answers['trf'])} evaluations without those of its Jacobians",
        f"SciPy DE: {1e3 * answers['de'].fun:.4f} mV",
        f"CMA-ES: {1e3 * answers['cma'].fun:.4f} mV, {answers['cma'].nfev:,} evaluations",
        f"mealpy's BMO: {1e3 * answers['mealpy'].fun:.4f} mV"
        if "mealpy" in answers
        else "mealpy is not installed, and not compared",
        f"variable projection: {1e3 * rmse_of(answers['projection']):.4f} mV, unproved",
        f"ibmo, best of all seeds: {1e3 * answers['seeds'].best.rmse_v:.4f} mV",
    ]


def _faster(
    work: str, taken: Taken, ours: str, other: str, baseline: str, aim: float | None, *,
    times: int = 1, note: str = "",
) -> Row:  # fmt: skip
    ratio = times * taken.ratio(other, ours)
    return Row(work, taken[ours], baseline, times * taken[other], ratio, "times faster", aim, note)


def _at_most(work: str, taken: Taken, ours: str, other: str, baseline: str, aim: float) -> Row:
    ratio = taken.ratio(ours, other)
    return Row(work, taken[ours], baseline, taken[other], ratio, "times as long", aim)
