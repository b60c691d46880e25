"""The library of compiled kernels: complete, equal to Python, refused where it does not fit."""

from __future__ import annotations

import ctypes
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import latin_fmu
from latin_fmu.aot import symbols
from latin_fmu.aot.build import declared
from latin_fmu.compiled import COMPILES, declare, entry, fields, library, with_numba
from latin_fmu.compiled.declare import Entry, Pointers
from latin_fmu.compiled.signature import MismatchError, Signature, address

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.skipif(not COMPILES, reason="compilation is off")
with_library = pytest.mark.skipif(
    library.loaded() is None, reason="no library here: an editable installation"
)


class Pair(NamedTuple):
    """An array and a number."""

    values: Any
    factor: float


PAIR = fields(Pair, "f8[:, ::1], f8")
RECORD = np.dtype([("n", np.int64), ("x", np.float64)])


# what a signature accepts, and how it is handed over


@pytest.mark.parametrize(
    ("text", "arguments", "slots"),
    [
        ("i8, f8, b1", (3, 0.5, True), [3, 0.5, 1]),
        ("i8", (np.int64(-2),), [-2]),
        ("f8[::1] -> i8", (np.arange(3.0),), ["address", 3]),
        ("i8[:, ::1], i8", (np.zeros((2, 5), dtype=np.int64), 1), ["address", 2, 5, 1]),
        ("u4[::1]", (np.zeros(0, dtype=np.uint32),), ["address", 0]),
        ("Pair, rows[::1]", (Pair(np.ones((1, 2)), 2.0), np.zeros(4, RECORD)), ["address", 1, 2, 2.0, "address", 4]),
    ],
)  # fmt: skip
def test_arguments_are_packed_without_copies(text, arguments, slots):
    signature = Signature(text, {"Pair": PAIR, "rows": RECORD})
    packed = signature.pack(arguments)
    assert len(packed) == 8 * len(slots)
    arrays = [a for a in flat(arguments) if isinstance(a, np.ndarray)]
    for i, slot in enumerate(slots):
        kind = np.float64 if isinstance(slot, float) else np.int64
        expected = arrays.pop(0).ctypes.data if slot == "address" else slot
        assert np.frombuffer(packed, kind)[i] == expected


def flat(arguments: Any) -> Iterator[Any]:
    """Arguments with tuples taken apart."""
    for argument in arguments:
        if isinstance(argument, tuple):
            yield from flat(argument)
        else:
            yield argument


@pytest.mark.parametrize(
    ("text", "argument"),
    [
        ("f8[::1]", np.zeros(3, dtype=np.float32)),
        ("f8[::1]", np.zeros((3, 3))),
        ("f8[:, ::1]", np.zeros((3, 4)).T),
        ("f8[::1]", np.zeros(6)[::2]),
        ("f8[::1]", [1.0, 2.0]),
        ("i8[::1]", np.zeros(3, dtype=np.int32)),
        ("i8", 0.5),
        ("f8", "a"),
        ("Pair", (np.zeros((1, 1)), 1.0)),
        ("Pair", Pair(np.zeros(3), 1.0)),
        ("rows[::1]", np.zeros(3, dtype=[("n", np.int64), ("y", np.float64)])),
    ],
)
def test_other_arguments_are_refused(text, argument):
    with pytest.raises(MismatchError):
        Signature(text, {"Pair": PAIR, "rows": RECORD}).pack((argument,))
    with pytest.raises(MismatchError, match="declared"):
        Signature("i8", {}).pack((1, 2))


def test_an_address_is_that_of_the_numbers():
    whole = np.arange(10.0)
    assert address(whole[3:]) == whole.ctypes.data + 24
    fixed = whole.copy()
    fixed.flags.writeable = False
    assert address(fixed) == fixed.ctypes.data


@pytest.mark.parametrize("text", ["f8[:, :]", "f16", "f8[::1] i8", "rows", "f8 -> f8[::1]", "Pair[::1]"])
def test_a_signature_that_cannot_be_read_is_refused(text):
    with pytest.raises(ValueError, match="signature"):
        Signature(text, {"Pair": PAIR, "rows": RECORD})
    with pytest.raises(ValueError, match="2 fields"):
        fields(Pair, "f8")


# the library


@with_library
def test_the_library_holds_every_entry():
    found = library.loaded()
    assert found is not None
    items = list(declared())
    assert len(items) > 20
    for item in items:
        names = [item.symbol]
        if isinstance(item, Entry):
            names = [f"{item.symbol}_{number}" for number in range(len(item.signatures))]
        for name in names:
            assert library.address_of(found, name) != 0, name
    assert len({item.symbol for item in items}) == len(items)


def test_signatures_have_the_arguments_of_their_functions():
    for item in declared():
        wanted = item.py_func.__code__.co_argcount
        given = (
            [item.n_integer + item.n_float]
            if isinstance(item, Pointers)
            else [len(s.arguments) for s in item.signatures]
        )
        assert set(given) == {wanted}, item.symbol


@pytest.fixture
def misses(monkeypatch) -> list[str]:
    """Kernels that numba is asked for."""
    found: list[str] = []

    def refuse(function: Callable[..., Any]) -> Any:
        found.append(f"{function.__module__}.{function.__name__}")
        raise AssertionError(f"{found[-1]} is not in the library")

    monkeypatch.setattr(with_numba, "dispatcher", refuse)
    monkeypatch.setattr(with_numba, "c_function", lambda function, *_: refuse(function))
    return found


@with_library
@pytest.mark.parametrize(
    ("name", "end"),
    [("two_specimen_crushing/scene", "6e-6"), ("impact_bar/scene", "2.0"), ("stacked_blocks/n02", "1e-5")],
)
def test_a_run_needs_no_numba(name, end, tmp_path):
    """In a process of its own: numba is not even imported, and nothing is written but the result."""
    code = (
        "import sys, latin_fmu\n"
        "from latin_fmu.cli import main\n"
        "main(['run', sys.argv[1], '-o', sys.argv[2], '--set', sys.argv[3]])\n"
        "assert 'numba' not in sys.modules and 'llvmlite' not in sys.modules\n"
    )
    home = tmp_path / "home"
    home.mkdir()
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": str(home), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-B", "-c", code, str(ROOT / "models" / f"{name}.toml"), str(tmp_path / "out.nc"),
         f"time.end={end}"],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not list(home.rglob("*"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["home", "out.nc"]


# every entry against its Python function


class Recorder:
    """Runs the library and, on copies of the first arguments, the Python function of every entry that is called."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, each: int = 2) -> None:
        self.checked: dict[str, int] = {}
        self._call, self._each, self._inside = Entry.__call__, each, False
        monkeypatch.setattr(Entry, "__call__", self._checked(self))
        monkeypatch.setattr(declare.Kernel, "__call__", lambda kernel, *arguments: kernel.py_func(*arguments))

    @staticmethod
    def _checked(recorder: Recorder) -> Callable[..., Any]:
        def call(kernel: Entry, *arguments: Any) -> Any:
            return recorder.call(kernel, arguments)

        return call

    def call(self, kernel: Entry, arguments: tuple[Any, ...]) -> Any:
        """Both, and compare all that they return and leave in their arguments."""
        if self._inside:  # called by another kernel in Python
            return kernel.py_func(*arguments)
        seen = self.checked.get(kernel.symbol, 0)
        if seen >= self._each or not in_python(kernel):
            return self._call(kernel, *arguments)
        copies = copied(arguments)
        found = self._call(kernel, *arguments)
        self._inside = True
        with np.errstate(all="ignore"):
            expected = kernel.py_func(*copies)
        self._inside = False
        assert found == (expected if expected is None else pytest.approx(expected, rel=1e-12)), kernel.symbol
        for one, other in zip(flat(arguments), flat(copies), strict=True):
            if isinstance(one, np.ndarray) and one.dtype.fields is None:
                size = np.abs(other).max(initial=0.0) if one.dtype.kind == "f" else 0.0
                eps = 1e-5 if one.dtype == np.float32 else 1e-11
                np.testing.assert_allclose(one, other, rtol=0.0, atol=eps * size, err_msg=kernel.symbol)
        self.checked[kernel.symbol] = seen + 1
        return found


def copied(arguments: Any) -> Any:
    """Arguments of their own for another call."""
    if isinstance(arguments, np.ndarray):
        return arguments.copy()
    if isinstance(arguments, tuple):
        made = [copied(a) for a in arguments]
        return type(arguments)(*made) if hasattr(arguments, "_fields") else tuple(made)
    return arguments


def in_python(kernel: Any, above: tuple[Any, ...] = ()) -> bool:
    """Whether a kernel and those that it calls can run uncompiled."""
    for name in kernel.py_func.__code__.co_names:
        used = kernel.py_func.__globals__.get(name)
        if isinstance(used, declare.Later) and used.in_python is None:
            return False
        if isinstance(used, declare.Kernel) and used not in above and not in_python(used, (*above, kernel)):
            return False
    return True


CRUSHING = {"time.end": "1.5e-6"}
RUNS = (
    ("two_specimen_crushing/scene", CRUSHING),
    ("two_specimen_crushing/soft", CRUSHING),
    ("stacked_blocks/n02", {"time.end": "1e-5"}),
    ("two_specimen_crushing/scene", {**CRUSHING, "solver.window": "whole"}),
    ("two_specimen_crushing/scene", {**CRUSHING, "solver.precision": "float32"}),
    (
        "stacked_blocks/n02",
        {"time.end": "4e-6", "time.scheme.type": "central_difference", "time.step": "2e-8"},
    ),
)


def settings(changes: dict[str, str]) -> list[str]:
    """Changes as they are given on the command line."""
    return [f"{name}={value}" for name, value in changes.items()]


@with_library
def test_every_entry_equals_its_python_function(monkeypatch):
    recorder = Recorder(monkeypatch)
    for name, changes in RUNS:
        scene = latin_fmu.load_scene(ROOT / "models" / f"{name}.toml", settings(changes))
        latin_fmu.solve(scene)
    runnable = {item.symbol for item in declared() if isinstance(item, Entry) and in_python(item)}
    assert len(runnable) > 15
    assert runnable <= recorder.checked.keys(), runnable - recorder.checked.keys()
