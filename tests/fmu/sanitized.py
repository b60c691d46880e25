"""Plugin of pytest: FMUs are built with libraries whose C files are compiled for the sanitizers of gcc.

    LD_PRELOAD=... python -m pytest -p tests.fmu.sanitized tests/fmu/test_states.py

``tests/fmu/test_sanitizers.py`` runs it. An access outside of an object, or what C does not define, ends the process.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import fmu_build.build
import fmu_build.compiled
from fmu_build import bridge
from latin_fmu.aot import linking
from latin_fmu.compiled import library
from latin_fmu.cosim import c_runtime

OPTIONS = ("-g", "-O1", "-fno-omit-frame-pointer", "-D_GNU_SOURCE", "-shared", "-fPIC")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
KERNELS = bridge.BUILD / f"_kernels-{library.target()}.o"
_ELF = b"\x7fELF"


def made(target: Path, sources: list[Path], *more: str, options: tuple[str, ...] = SANITIZERS) -> Path:
    """A library of C files by gcc."""
    subprocess.run(["gcc", *OPTIONS, *options, "-o", str(target), *map(str, sources), *more], check=True)
    return target


def kernels_library(folder: Path, options: tuple[str, ...] = SANITIZERS, kernels: bytes = b"") -> Path:
    """The library of a compiled FMU; ``kernels``: their object file, that of the source tree where there is none."""
    content = kernels or KERNELS.read_bytes()
    (folder / "kernels.o").write_bytes(content[content.index(_ELF) :])  # behind the key of its sources
    (folder / "manifest.c").write_text(f'const char latin_fmu_functions[] = "{c_runtime.digest()}";\n')
    files = [path for path in c_runtime.sources() if path.suffix == ".c"]
    sources = [folder / "manifest.c", Path(linking.__file__).with_name("stub.c"), *files]
    more = (str(folder / "kernels.o"), "-fno-math-errno", "-fvisibility=hidden", "-lm")
    return made(folder / "kernels.so", sources, *more, options=options)


@pytest.fixture(autouse=True, scope="session")
def sanitized_libraries() -> Iterator[None]:
    """Put the libraries of both kinds of FMUs in the place of those of the package."""
    own = library.target()
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as changed:
        folder = Path(name)
        more = ("-ldl", "-lm", "-fvisibility=hidden")
        bridged = {
            kind: made(folder / f"{kind}.so", bridge.sources(kind), *bridge.options(kind), *more)
            for kind in bridge.KINDS
        }
        changed.setattr(bridge, "libraries", lambda kind: {own: bridged[kind]})
        content = {own: kernels_library(folder).read_bytes()}
        for place in (fmu_build.compiled, fmu_build.build):
            changed.setattr(place, "libraries", lambda _portable=False: content)
        yield
