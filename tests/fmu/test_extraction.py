"""A freshly extracted FMU does not compile what was compiled before on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

H = 0.6e-6
_CODE = """
    import json, sys
    from pathlib import Path
    sys.path[:0] = [{root!r}]
    from tests.fmu.host import Host
    host = Host(Path({fmu!r}), Path({folder!r}))
    host.start()
    assert host.step(0.0, {h!r})
    from numba.core.dispatcher import Dispatcher
    kernels = [
        value for name, module in list(sys.modules.items()) if name.startswith("latin_fmu_")
        for value in vars(module).values() if isinstance(value, Dispatcher)
    ]
    hits = sum(sum(k.stats.cache_hits.values()) for k in kernels)
    misses = sum(sum(k.stats.cache_misses.values()) for k in kernels)
    print(json.dumps({{"hits": hits, "misses": misses, "row": host.read().tolist()}}))
    host.close()
"""


def start(fmu: Path, folder: Path, **environment: str) -> subprocess.Popen[str]:
    """A host of its own, in a process of its own, on a fresh extraction."""
    root = str(Path(__file__).parents[2])
    code = textwrap.dedent(_CODE.format(root=root, fmu=str(fmu), folder=str(folder), h=H))
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, **environment},
    )  # fmt: skip


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, complaints = process.communicate(timeout=200)
    assert process.returncode == 0, complaints
    found: dict[str, Any] = json.loads(out.splitlines()[-1])
    return found


def test_the_second_extraction_compiles_nothing(fmus, opened, tmp_path):
    here = opened("2")  # compiles, where no test before this one did
    here.start()
    assert here.step(0.0, H)
    again = result(start(fmus["2"], tmp_path / "fresh"))
    assert again["misses"] == 0
    assert again["hits"] > 5
    assert again["row"] == here.read().tolist()


def test_without_a_store_it_compiles_and_gives_the_same_numbers(fmus, opened, tmp_path):
    here = opened("2")
    here.start()
    assert here.step(0.0, H)
    alone = result(start(fmus["2"], tmp_path / "fresh", LATIN_FMU_CACHE="0"))
    assert alone["misses"] > 5
    assert alone["row"] == here.read().tolist()


@pytest.mark.slow
def test_processes_that_compile_at_once(fmus, tmp_path):
    """Both write the same entries; a third finds every one of them sound."""
    store = {"LATIN_FMU_CACHE": str(tmp_path / "store")}
    both = [start(fmus["2"], tmp_path / name, **store) for name in ("one", "two")]
    rows = [result(process)["row"] for process in both]
    third = result(start(fmus["2"], tmp_path / "three", **store))
    assert third["misses"] == 0
    assert rows == [third["row"]] * 2
    assert not [f for f in (tmp_path / "store").rglob("*") if f.is_file() and f.suffix != ".kernel"]
