"""Compiled once for a shape, in blocks whose rows come back in order, on one thread of BLAS."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from barnax import execution
from barnax.blas import _take_control, one_blas_thread
from barnax.execution import compile_for, in_float64, in_one_function, run_blocks


@pytest.mark.parametrize("is_double", [False, True])
def test_double_precision_ends_with_the_function_or_its_error(is_double):
    @in_float64
    def third(value):
        return jnp.asarray(1.0) / value if value else 1 // value

    with jax.enable_x64(is_double):
        assert third(3).dtype == jnp.float64
        with pytest.raises(ZeroDivisionError):
            third(0)
        assert jax.config.jax_enable_x64 is is_double


def counted():
    """A function that counts how often it is traced."""
    traces = []

    def doubled(values, is_negated):
        traces.append(values.shape)
        return -2 * values if is_negated else 2 * values

    return doubled, traces


def test_arguments_of_one_shape_type_and_setting_are_traced_once_whoever_asks():
    doubled, traces = counted()
    for start in (0.0, 1.0, 2.0):
        values = jnp.arange(3.0) + start
        program = compile_for(doubled, values, False)
        np.testing.assert_array_equal(program(values, False), 2 * values)
    assert traces == [(3,)]
    others = [(jnp.zeros(4), False), (jnp.zeros(3, int), False), (jnp.zeros(3), True)]
    # Threads that ask at once compile once.
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda given: compile_for(doubled, *given), 4 * others))
    assert len(traces) == 1 + len(others)


def test_the_oldest_programs_are_let_go_and_made_again(monkeypatch):
    monkeypatch.setattr(execution, "PROGRAMS_KEPT", 2)
    monkeypatch.setattr(execution, "_programs", {})
    monkeypatch.setattr(execution, "_making", {})
    doubled, traces = counted()
    for size in (1, 2, 3, 1):
        compile_for(doubled, jnp.zeros(size), False)
    assert traces == [(1,), (2,), (3,), (1,)]
    assert len(execution._programs) == len(execution._making) == 2


def times(values, factor):
    return values * factor if factor is not True else -values


def test_values_of_other_types_that_are_equal_have_programs_of_their_own():
    results = [float(compile_for(times, np.ones(1), one)(np.ones(1), one)[0]) for one in (1, True)]
    assert results == [1, -1]


def summed(values):
    """A running sum of cosines, by a scan."""

    def step(total, value):
        total = total + jnp.cos(value) * jnp.cos(total)
        return total, total

    return in_one_function(lambda given: jax.lax.scan(step, 0.0, given)[1])(values)


@in_float64
def test_a_scan_in_one_function_gives_what_it_gives_turn_by_turn(monkeypatch):
    compile_, made = execution._compile, []
    monkeypatch.setattr(
        execution, "_compile", lambda *given: made.append(compile_(*given)) or made[0]
    )
    values, total, wanted = np.linspace(0, 3, 1000), 0.0, []
    for value in values:
        total += np.cos(value) * np.cos(total)
        wanted.append(total)
    program: Any = compile_for(summed, values)
    np.testing.assert_allclose(program(values), wanted, rtol=1e-14)
    plain: Any = jax.jit(summed).lower(values).compile()
    texts = made[0].as_text(), plain.as_text()
    assert ['inlineable="false"' in text for text in texts] == [True, False]


@in_float64
def test_what_the_compiler_takes_in_no_one_function_is_compiled_all_the_same():
    def factors(matrices):
        return in_one_function(lambda given: jax.lax.map(jnp.linalg.cholesky, given))(matrices)

    matrices = np.array([[[4.0, 2.0], [2.0, 5.0]]] * 3)
    actual = compile_for(factors, matrices)(matrices)
    np.testing.assert_allclose(actual, np.linalg.cholesky(matrices), rtol=1e-14)


@pytest.mark.parametrize("cores", ["1", "2"])
def test_a_block_that_fails_is_not_passed_over(cores, monkeypatch):
    monkeypatch.setenv("NPROC", cores)

    def run(block):
        raise RuntimeError(f"block {block[0]}")

    with pytest.raises(RuntimeError, match="block"):
        run_blocks(run, [[0], [1]], [1, 1], None)


def test_an_interruption_leaves_the_waiting_blocks_unstarted(monkeypatch):
    monkeypatch.setenv("NPROC", "2")
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


# Threads of linear algebra


def threads() -> set[int]:
    """What the libraries of linear algebra say themselves."""
    actual = ThreadpoolController().select(user_api="blas").info()
    return {library["num_threads"] for library in actual}


@pytest.fixture
def three_threads():
    _take_control()
    with ThreadpoolController().limit(limits=3, user_api="blas"):
        if threads() != {3}:
            pytest.skip("this library of linear algebra has one thread only")
        yield


@pytest.mark.usefixtures("three_threads")
def test_inside_there_is_one_thread_and_afterwards_as_many_as_before():
    with one_blas_thread():
        assert threads() == {1}
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == {1}
    assert threads() == {3}


@pytest.mark.usefixtures("three_threads")
def test_the_first_to_leave_does_not_give_the_second_more():
    first_is_in, second_is_in, first_is_out = (threading.Event() for _ in range(3))

    def first():
        with one_blas_thread():
            first_is_in.set()
            assert second_is_in.wait(10)
        first_is_out.set()

    def second():
        assert first_is_in.wait(10)
        with one_blas_thread():
            second_is_in.set()
            assert first_is_out.wait(10)
            return threads()

    with ThreadPoolExecutor(2) as pool:
        leaving, staying = pool.submit(first), pool.submit(second)
        assert staying.result() == {1}
        leaving.result()
    assert threads() == {3}
