"""FMUs built once, instances freed at the end of a test."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("fmpy")

from fmu_build.bridge import zig
from fmu_build.build import build_fmu
from latin_fmu.compiled import library
from tests.cosim.scenes import blocks

from .host import KINDS, Host


@pytest.fixture(scope="session")
def fmus(tmp_path_factory) -> dict[str, Path]:
    """FMU of the two blocks, by version of the FMI."""
    folder = tmp_path_factory.mktemp("fmus")
    return {fmi: build_fmu(blocks(), folder / f"blocks{fmi}.fmu", fmi, python=True) for fmi in ("2", "3")}


@pytest.fixture(scope="session")
def compiled_fmus(tmp_path_factory) -> dict[str, Path]:
    """Compiled FMU of the two blocks, by version of the FMI."""
    folder = tmp_path_factory.mktemp("compiled")
    return {fmi: build_fmu(blocks(), folder / f"blocks{fmi}.fmu", fmi) for fmi in ("2", "3")}


@pytest.fixture(scope="session", params=KINDS)
def made(request) -> dict[str, Path]:
    """FMUs of the two blocks of both kinds, one after the other, by version of the FMI."""
    fmus: dict[str, Path] = request.getfixturevalue("compiled_fmus" if request.param == "compiled" else "fmus")
    return fmus


@pytest.fixture(scope="session")
def compiler(tmp_path_factory) -> list[str]:
    """Compiler of this machine, else that of the wheel."""
    if shutil.which("cc"):
        return ["cc"]
    try:
        command = zig(library.target())
    except ModuleNotFoundError:
        pytest.skip("no C compiler: pip install ziglang")
    folder = str(tmp_path_factory.mktemp("zig"))
    return ["env", f"ZIG_GLOBAL_CACHE_DIR={folder}", f"ZIG_LOCAL_CACHE_DIR={folder}", *command]


@pytest.fixture(scope="session")
def programs(compiler, tmp_path_factory) -> dict[str, Path]:
    """The hosts in C."""
    folder = tmp_path_factory.mktemp("hosts")
    for name in ("steps", "host"):
        options = ["-std=c99", "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror", "-ldl", "-lpthread"]
        command = [*compiler, str(Path(__file__).with_name(f"{name}.c")), "-o", str(folder / name), *options]
        subprocess.run(command, check=True)
    return {name: folder / name for name in ("steps", "host")}


@pytest.fixture(params=["2", "3"])
def fmi(request) -> str:
    return str(request.param)


@pytest.fixture
def opened(fmus, tmp_path) -> Iterator[Callable[..., Host]]:
    """Open an FMU of the two blocks, or another one."""
    hosts: list[Host] = []

    def open_fmu(fmi: str = "2", path: Path | None = None, folder: str = "") -> Host:
        place = tmp_path / (folder or f"instance {len(hosts)}")  # a path with a space
        hosts.append(Host(path or fmus[fmi], place, alone=bool(folder)))
        return hosts[-1]

    yield open_fmu
    for host in hosts:
        host.close()
