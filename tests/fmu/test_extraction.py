"""A freshly extracted FMU compiles nothing: it holds the library, or finds what numba compiled before."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
import zipfile
from pathlib import Path
from typing import Any

import pytest

from latin_fmu.compiled import library

H = 0.6e-6
_CODE = """
    import json, sys
    from pathlib import Path
    sys.path[:0] = [{root!r}]
    from tests.fmu.host import Host
    host = Host(Path({fmu!r}), Path({folder!r}))
    host.start()
    assert host.step(0.0, {h!r})
    hits = misses = 0
    if "numba" in sys.modules:
        from numba.core.dispatcher import Dispatcher
        from numba.core import registry
        import gc
        kernels = [value for value in gc.get_objects() if isinstance(value, Dispatcher) and value.overloads
                   and value.py_func.__module__.startswith("latin_fmu_")]
        hits = sum(sum(k.stats.cache_hits.values()) for k in kernels)
        misses = sum(sum(k.stats.cache_misses.values()) for k in kernels)
    print(json.dumps({{"hits": hits, "misses": misses, "row": host.read().tolist(), "numba": "numba" in sys.modules}}))
    host.close()
"""


def start(fmu: Path, folder: Path, **environment: str) -> subprocess.Popen[str]:
    """A host of its own, in a process of its own, on a fresh extraction."""
    root = str(Path(__file__).parents[2])
    code = textwrap.dedent(_CODE.format(root=root, fmu=str(fmu), folder=str(folder), h=H))
    return subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, complaints = process.communicate(timeout=1500)
    assert process.returncode == 0, complaints
    printed: dict[str, Any] = json.loads(out.splitlines()[-1])
    return printed


@pytest.mark.skipif(library.loaded() is None, reason="no library for this machine")
def test_the_library_travels_in_the_fmu(fmus, opened, tmp_path):
    """No numba, no cache folder, and the numbers of this process."""
    with zipfile.ZipFile(fmus["2"]) as archive:
        assert any(library.file_name(library.target()) in name for name in archive.namelist())
    here = opened("2")
    here.start()
    assert here.step(0.0, H)
    again = result(start(fmus["2"], tmp_path / "fresh", LATIN_FMU_CACHE=str(tmp_path / "store")))
    assert not again["numba"]
    assert again["row"] == here.read().tolist()
    assert not (tmp_path / "store").exists()


@pytest.mark.slow
def test_without_a_library_the_second_extraction_compiles_nothing(fmus, tmp_path):
    """Two hosts that compile at once share a folder; a third finds all of it."""
    switches = {"LATIN_FMU_CACHE": str(tmp_path / "store"), "LATIN_FMU_LIBRARY": "0"}
    both = [start(fmus["2"], tmp_path / name, **switches) for name in ("one", "two")]
    first = [result(process) for process in both]
    third = result(start(fmus["2"], tmp_path / "three", **switches))
    assert third["misses"] == 0
    assert third["hits"] > 5
    alone = result(start(fmus["2"], tmp_path / "four", LATIN_FMU_LIBRARY="0", LATIN_FMU_CACHE="0"))
    for other in (*first, alone):
        assert other["misses"] > 5 or other["hits"] > 5 or other is alone
        assert other["row"] == pytest.approx(third["row"], rel=1e-9, abs=1e-12)
