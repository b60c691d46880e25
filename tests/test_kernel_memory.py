"""Memory of the arrays that compiled kernels make: freed once, and not before its last use."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Compiles kernels as a build does and runs them with memory that is watched: what is freed is filled with NaN.
SCRIPT = """
import ctypes

import llvmlite.binding as llvm
import numpy as np

from latin_fmu.aot import linking, lowering
from latin_fmu.compiled import entry, kernel


@kernel
def made(n):
    values = np.empty(n)
    for i in range(n):
        values[i] = 1.0
    return values


@kernel
def rear(values):
    return values[1:]


@kernel
def total(values):
    part, out = values[1:], values[0]
    for i in range(len(part)):
        out += part[i]
    return out


@entry("f8[::1], i8 -> f8")
def whole(given, n):
    out = 0.0
    for _ in range(n):
        own = made(5)
        back = rear(own)
        own = made(3)
        out += total(back) + total(rear(given)) + total(own)
    return out


modules, exported = lowering.lower(lowering.start(), [whole])
joined = lowering.joined(modules, exported)
for function in joined.functions:
    for name in ("made", "rear", "total", "whole"):
        if f"{len(name)}{name}B" in function.name and "@NRT_incref" in str(function):
            print("counts", name)

held, freed = {}, []
BLOCK = ctypes.c_int64 * 6  # count, destructor and its argument, data, size, allocator
WORD = ctypes.c_int64


def allocated(size, _align):
    data = (ctypes.c_double * (size // 8))()
    block = BLOCK(1, 0, 0, ctypes.addressof(data), size, 0)
    held[ctypes.addressof(block)] = block, data
    return ctypes.addressof(block)


def released(address):
    freed.append(address)
    held[address][1][:] = [float("nan")] * len(held[address][1])


known = {
    "NRT_MemInfo_alloc_aligned": ctypes.CFUNCTYPE(WORD, WORD, ctypes.c_int32)(allocated),
    "NRT_MemInfo_call_dtor": ctypes.CFUNCTYPE(None, WORD)(released),
}
nothing = ctypes.CFUNCTYPE(None)(lambda: None)
for function in joined.functions:
    if function.is_declaration and not function.name.startswith("llvm."):
        llvm.add_symbol(function.name, ctypes.cast(known.get(function.name, nothing), ctypes.c_void_p).value)
for item in joined.global_variables:
    if item.is_declaration:
        llvm.add_symbol(item.name, ctypes.addressof(BLOCK()))
target = linking.Target(llvm.get_default_triple(), llvm.get_host_cpu_name(), "")
lowering.optimise(joined, target)
engine = llvm.create_mcjit_compiler(joined, lowering.machine(target))
engine.finalize_object()
call = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)(engine.get_function_address(exported[0]))
given, out = np.ones(4), ctypes.c_double()
slots = (WORD * 3)(given.ctypes.data, 4, 10)
print("status", call(slots, ctypes.byref(out)), "result", out.value)
print("made", len(held), "freed", len(freed), "of them", len(set(freed)))
"""


def run(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A file, as numba reads the sources of kernels, in a process of its own, as a build replaces parts of numba."""
    pytest.importorskip("numba")
    file = folder / "kernels.py"
    file.write_text(script)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run([sys.executable, str(file)], capture_output=True, text=True, check=False, env=environment)


def test_memory_is_freed_once_after_its_last_use(tmp_path: Path) -> None:
    """Kernels that make arrays or return them count references; one that is given some alone does not."""
    done = run(SCRIPT, tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    counting = {line.removeprefix("counts ") for line in lines if line.startswith("counts")}
    assert counting == {"made", "rear", "whole"}
    # ten rounds of 4 + 3 + 3, two arrays each
    assert "status 0 result 100.0" in lines
    assert "made 20 freed 20 of them 20" in lines


YIELDS = """
@kernel
def parts(values):
    for i in range(len(values)):
        yield values[i:]

@entry("f8[::1] -> f8")
def whole(given):
    out = 0.0
    for part in parts(given):
        out += part[0]
    return out
"""
KEEPS = """
@entry("f8[::1] -> f8")
def whole(given):
    kept = [given[1:], given[2:]]
    kept[0] = given
    return kept[1][0]
"""
BUILD = """
from latin_fmu.aot import linking, lowering
from latin_fmu.compiled import entry, kernel
{}
target = linking.TARGETS["linux-x86_64"]
joined = lowering.joined(*lowering.lower(lowering.start(), [whole]))
lowering.optimise(joined, target)
linking.check(lowering.emit(joined, target))
"""


@pytest.mark.parametrize(
    ("kernels", "message"), [(YIELDS, "parts yields; a kernel returns"), (KEEPS, "the kernels need NRT_")]
)
def test_a_build_refuses_kernels_that_keep_arrays_elsewhere(kernels: str, message: str, tmp_path: Path) -> None:
    """Arrays in the state of a generator and in a list outlast a call, or are counted by what is in it."""
    done = run(BUILD.format(kernels), tmp_path)
    assert done.returncode == 1
    assert message in done.stderr
