"""FMUs built once, instances freed at the end of a test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("fmpy")

from fmu_build.build import build_fmu
from tests.cosim.scenes import blocks

from .host import Host


@pytest.fixture(scope="session", autouse=True)
def store(tmp_path_factory) -> Iterator[Path]:
    """Compiled kernels of the FMUs: for these tests only, hosts in other processes included."""
    folder = tmp_path_factory.mktemp("kernels")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LATIN_FMU_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="session")
def fmus(tmp_path_factory) -> dict[str, Path]:
    """FMU of the two blocks, by version of the FMI."""
    folder = tmp_path_factory.mktemp("fmus")
    return {fmi: build_fmu(blocks(), folder / f"blocks{fmi}.fmu", fmi, python=True) for fmi in ("2", "3")}


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
