"""Programs are compiled once, and run in blocks whose rows come back in order."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import jax.numpy as jnp
import numpy as np
import pytest

from barnax.execution import compile_for, run_blocks, seed_blocks, wanted_rows


def counted():
    """A function that counts how often it is traced."""
    traces = []

    def doubled(values, is_negated):
        traces.append(values.shape)
        return -2 * values if is_negated else 2 * values

    return doubled, traces


def test_arguments_of_one_shape_are_traced_once():
    doubled, traces = counted()
    for start in (0.0, 1.0, 2.0):
        values = jnp.arange(3.0) + start
        program = compile_for(doubled, values, False)
        np.testing.assert_array_equal(program(values, False), 2 * values)
    assert traces == [(3,)]


def test_another_shape_type_or_setting_is_another_program():
    doubled, traces = counted()
    for values, is_negated in (
        (jnp.zeros(3), False),
        (jnp.zeros(4), False),
        (jnp.zeros(3, int), False),
        (jnp.zeros(3), True),
    ):
        compile_for(doubled, values, is_negated)
    assert len(traces) == 4


def test_threads_that_ask_at_once_compile_once():
    doubled, traces = counted()
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: compile_for(doubled, jnp.zeros(5), False), range(8)))
    assert len(traces) == 1


def test_blocks_have_one_size_and_hold_every_seed():
    assert seed_blocks(9) == [list(range(8)), list(range(8, 16))]
    assert wanted_rows(9) == [8, 1]


def test_rows_come_back_in_order_whatever_block_is_done_first():
    def run(block):
        return np.array(block), -np.array(block)

    steps = []
    rows = run_blocks(run, seed_blocks(30), wanted_rows(30), steps.append)
    assert rows == [(k, -k) for k in range(30)]
    assert sum(steps) == 30


def test_a_block_that_fails_is_not_passed_over():
    def run(block):
        raise RuntimeError(f"block {block[0]}")

    with pytest.raises(RuntimeError, match="block"):
        run_blocks(run, [[0], [1]], [1, 1], None)


def test_an_interruption_leaves_the_waiting_blocks_unstarted():
    started = []

    def run(block):
        started.append(block)
        time.sleep(0.05)
        return (np.zeros(1),)

    def interrupt(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_blocks(run, list(range(200)), [1] * 200, interrupt)
    assert len(started) < 100


def test_what_runs_at_an_interruption_is_kept():
    running = threading.Event()

    def run(block):
        if block:
            running.set()
            time.sleep(0.2)
        return (np.full(1, block),)

    def interrupt(_):
        assert running.wait(5)
        raise KeyboardInterrupt

    finished = {}
    with pytest.raises(KeyboardInterrupt):
        run_blocks(run, [0, 1], [1, 1], interrupt, finished)
    assert finished == {"0": (np.zeros(1),), "1": (np.ones(1),)}
    assert run_blocks(lambda _: 1 / 0, [0, 1], [1, 1], None, finished) == [(0.0,), (1.0,)]
