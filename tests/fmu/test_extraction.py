"""A freshly extracted FMU with Python holds the compiled kernels, and says so where they do not fit its host."""

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

from fmu_build import build
from latin_fmu.compiled import library
from tests.cosim.scenes import blocks

from .host import Host

H = 0.6e-6
_CODE = """
    import json, sys
    from pathlib import Path
    sys.path[:0] = [{root!r}]
    from tests.fmu.host import Host
    host = Host(Path({fmu!r}), Path({folder!r}))
    host.start()
    assert host.step(0.0, {h!r})
    of_the_build = sorted({{"numba", "llvmlite"}} & set(sys.modules))
    print(json.dumps({{"row": host.read().tolist(), "of the build": of_the_build}}))
    host.close()
"""


def result(fmu: Path, folder: Path, **environment: str) -> dict[str, Any]:
    """What a process of its own prints, on a fresh extraction."""
    root = str(Path(__file__).parents[2])
    code = textwrap.dedent(_CODE.format(root=root, fmu=str(fmu), folder=str(folder), h=H))
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    assert done.returncode == 0, done.stderr
    printed: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return printed


def test_the_library_travels_in_the_fmu(fmus, opened, tmp_path):
    """No compiler, nothing written into the home of the host, and the numbers of this process."""
    with zipfile.ZipFile(fmus["2"]) as archive:
        assert any(library.file_name(library.target()) in name for name in archive.namelist())
    here = opened("2")
    here.start()
    assert here.step(0.0, H)
    home = tmp_path / "home"
    home.mkdir()
    again = result(fmus["2"], tmp_path / "fresh", HOME=str(home), XDG_CACHE_HOME=str(home))
    assert again["of the build"] == []
    assert again["row"] == here.read().tolist()
    assert not list(home.iterdir())


def test_a_host_without_kernels_is_told_so(tmp_path, monkeypatch):
    """One whose processor or system is another than those of the libraries inside."""
    whole = build.package_files()
    bare = {name: content for name, content in whole.items() if "_kernels-" not in name}
    assert len(bare) < len(whole)
    monkeypatch.setattr(build, "package_files", lambda: bare)
    host = Host(build.build_fmu(blocks(), tmp_path / "bare.fmu", python=True), tmp_path / "fmu")
    try:
        with pytest.raises(Exception, match=r"fmi2EnterInitializationMode|fmi2ExitInitializationMode"):
            host.start()
        said = " ".join(text for _, _, text in host.messages)
        assert f"{library.file_name(library.target())}: the library of compiled kernels is not in " in said
        assert f"make the FMU where a library for {library.target()} is: in a source tree python -m latin_f" in said
        assert "Traceback" not in said
    finally:
        host.close()
