"""Problems whose circuit is known: voltages made by SciPy's filter on the bundled current."""

from collections.abc import Callable

import numpy as np
import pytest

from barnax import Problem, Window, make_problem
from barnax.model.prepared import prepare_record
from helpers.reference import drop_v, filtered_response, make_record

SAMPLES = 4000
WINDOW = Window(initial_soc=1.0)


@pytest.fixture(scope="session")
def filtered_problem(bundled_record, bundled_cell) -> Callable[..., Problem]:
    """A problem whose voltage is that of `circuit` = (r0, (r1, ...), (tau1, ...))."""

    def make(circuit, model="so-rc", *, hold="forward", noise_v=0.0, **settings) -> Problem:
        time_s = np.arange(SAMPLES, dtype=float)
        current_a = bundled_record.current_a[:SAMPLES]
        flat = make_record(time_s, current_a, hold=hold)
        source_v = prepare_record(flat, bundled_cell, model, WINDOW).source_v
        noise = np.random.default_rng(5).normal(0, noise_v, SAMPLES)
        drop = drop_v(filtered_response, 1.0, current_a, circuit, hold)
        record = make_record(time_s, current_a, source_v - drop + noise, hold=hold)
        return make_problem(record, bundled_cell, model, window=WINDOW, **settings)

    return make
