"""Whatever a file is called: generated text holds the name, and no more than its structure."""

import ast
import csv
import io
import json
import re
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from barnax.errors import InputError, printable
from barnax.export import EXPORTERS
from barnax.model.window import Window
from barnax.plan import FileRole, Plan, plan_to_toml
from barnax.pulses import Pulse
from barnax.reporting.pulses import pulses_csv
from export.conftest import COMPILER, needs_a_compiler
from helpers.hostile import EXAMPLES, names, repeated
from helpers.results import make_result


def export(target: str, name: str = "plain") -> bytes:
    result = make_result(record=name).model_copy(update={"versions": {"barnax": name}})
    return EXPORTERS[target].write(result).content


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("target", ["pybamm", "thevenin"])
def test_a_module_is_the_same_code_whatever_the_record_is_called(target, examples):
    plain = ast.dump(ast.parse(export(target)))

    def survive(name: str) -> None:
        content = export(target, name)
        assert content.startswith(b"# -*- coding: utf-8 -*-\n")
        # From bytes, so that a declared encoding counts.
        compile(content, "module", "exec")
        assert ast.dump(ast.parse(content)) == plain
        assert all(letter == "\n" or letter.isprintable() for letter in content.decode())

    repeated(examples // 5, survive, names())


@needs_a_compiler
@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("target", ["c-header", "c-filter"])
def test_a_header_is_the_same_code_whatever_the_record_is_called(target, examples):
    def tokens(content: bytes) -> bytes:
        words = (*("-E", "-P", "-trigraphs", "-Wall", "-Werror", "-x", "c"), "-")
        done = subprocess.run([COMPILER, *words], input=content, capture_output=True)
        assert not done.stderr
        return done.stdout

    plain = tokens(export(target))

    def survive(name: str) -> None:
        assert tokens(export(target, name)) == plain

    repeated(examples // 5, survive, names())


@pytest.mark.parametrize("examples", EXAMPLES)
def test_exported_data_are_the_same_whatever_the_record_is_called(examples):
    plain = json.loads(export("json"))
    tables = loadmat(io.BytesIO(export("simscape")))

    def survive(name: str) -> None:
        assert json.loads(export("json", name)) | {"notes": None} == plain | {"notes": None}
        actual = loadmat(io.BytesIO(export("simscape", name)))
        assert actual.keys() == tables.keys()
        same = [np.array_equal(actual[key], tables[key]) for key in tables if key.endswith("_vec")]
        assert same
        assert all(same)

    repeated(examples // 5, survive, names())


@pytest.mark.parametrize("examples", EXAMPLES)
def test_a_table_of_pulses_holds_no_formula(examples):
    def survive(name: str) -> None:
        pulse = Pulse(name, 7, 0.5, 1.0, 25.0, 10.0, 3600.0, False, 0.0, (None,) * 5)
        head, row = csv.reader(io.StringIO(pulses_csv([pulse]).decode()))
        assert len(row) == len(head)
        assert not re.match(r"[=+@\s-]", row[0])

    repeated(examples, survive, names())


@pytest.mark.parametrize("examples", EXAMPLES)
def test_a_plan_is_the_same_table_whatever_a_file_is_called(examples):
    def survive(name: str) -> None:
        shown = printable(name)
        window = Window(initial_soc=1.0)
        part = FileRole(
            path=Path(name), name=shown, role="validation", kind=name, reason=name, window=window,
            span_s=(0.0, 1.0),
        )  # fmt: skip
        plan = Plan("identify", (part,), {"columns": shown}, {"columns": name}, name)
        try:
            text = plan_to_toml(plan)
        except InputError:
            # TOML is UTF-8, and not all names are.
            with pytest.raises(UnicodeEncodeError):
                name.encode()
            return
        values = {"role": "validation", "name": shown, "span": [0.0, 1.0], "initial_soc": 1.0}
        told = {"kind": name, "reason": name} if name else {}
        file = values | {"file": str(Path(name)), **told}
        expected = {"command": "identify", "columns": shown, "files": [file]}
        expected["reasons"] = {"columns": name}
        assert tomllib.loads(text.encode().decode()) == expected
        assert all(letter == "\n" or letter.isprintable() for letter in text)

    repeated(examples, survive, names())
