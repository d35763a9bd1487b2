"""What each part of `ibmo-centered` is worth, on the development offsets and rotations."""

import dataclasses

import numpy as np

from barnax.optimizers import BarnacleMating, ibmo_centered
from benchmarks.li2023.test_functions import FUNCTIONS
from benchmarks.pages import as_markdown

from .runs import EVALUATIONS, POPULATION, RUNS, Losses
from .statistics import average_run_ranks, duels, losses_of

WHOLE = "ibmo-centered"


def variants() -> dict[str, BarnacleMating]:
    """The default and what becomes of it with one part changed."""
    whole = ibmo_centered(POPULATION, EVALUATIONS // POPULATION - 1)
    changes = {
        "uniform start instead of tent": {"tent_start": False},
        "without the cosine factor": {"cosine_factor": False},
        "Levy step of scale 1": {"cast_step": "levy", "cast_scale": 1.0},
        "Levy step of scale 0.7": {"cast_step": "levy", "cast_scale": 0.7},
        "one normal step an offspring": {"cast_per_dimension": False},
        "cast about the plain centroid": {"cast_center": "centroid"},
        "sperm of one mother": {"cast_mothers": "one"},
        "everyone competes throughout": {"brood_share": 0.0},
        "broods throughout": {"brood_share": 1.0},
        "broods for a third": {"brood_share": 1 / 3},
        "factor of mean 0 and spread 1": {"factor_mean": 0.0, "factor_spread": 1.0},
        "one factor vector a generation": {"shared_factor": True},
        "no mating": {"pl": -1},
        "pl 2": {"pl": 2},
        "pl 7": {"pl": 7},
        "pl 12": {"pl": 12},
        "cast scale 1.2": {"cast_scale": 1.2},
        "cast scale 1.6": {"cast_scale": 1.6},
    }
    start = BarnacleMating(
        POPULATION,
        whole.iterations,
        pl=7,
        tent_start=True,
        shared_factor=False,
        cast_step="levy",
        cast_per_dimension=True,
        cast_center="centroid",
    )
    return {
        WHOLE: whole,
        **{name: dataclasses.replace(whole, **change) for name, change in changes.items()},
        "the starting point": start,
    }


def ablation_page(results: Losses, seconds: float, facts: dict[str, str]) -> str:
    """Medians, average ranks among the variants, and how many functions get better or worse."""
    methods = list(variants())
    ranks = average_run_ranks(losses_of(results, "rotated", methods))
    found = duels(results, "rotated", WHOLE, methods[1:])
    lines = [
        "# What each part of `ibmo-centered` is worth",
        "",
        f"Shifted and rotated F1 to F9, {RUNS} runs, {EVALUATIONS:,} evaluations, on the offsets "
        "and rotations of the development set, with other search keys than those the default was "
        "chosen with. "
        "Medians of the final losses; the average rank among the variants below; on how many "
        "functions a variant is significantly better or worse than the default (Wilcoxon, Holm). "
        "The starting point casts one mother's sperm about the plain centroid with a Levy step "
        "for every dimension, and lets everyone compete.",
        "",
        as_markdown(facts),
        f"- time: {seconds:.0f} s",
        "",
        "| variant | rank | better | worse | " + " | ".join(FUNCTIONS) + " |",
        "|---" * (len(FUNCTIONS) + 4) + "|",
    ]
    for place in np.argsort(ranks):
        name = methods[place]
        verdicts = [duel.verdict for duel in found if duel.other == name]
        # A duel is told from the default's side.
        tally = ["", ""] if name == WHOLE else [verdicts.count("loss"), verdicts.count("win")]
        medians = [f"{np.median(results['rotated', f, name]):.1e}" for f in FUNCTIONS]
        label = f"**{name}**" if name == WHOLE else name
        cells = [label, f"{ranks[place]:.2f}", *map(str, tally), *medians]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])
