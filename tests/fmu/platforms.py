"""Compiled FMUs on platforms other than Linux x86-64: AArch64 Linux in qemu, Windows in wine.

    python -m tests.fmu.platforms

The program builds the FMU of five scenes, drives it by ``steps.c`` on each platform that can run here, and prints how
far the outputs are from those on Linux x86-64. It needs the libraries of the kernels (``python -m latin_fmu.aot
linux-x86_64 linux-aarch64 windows-x86_64``), ziglang, and the Debian packages qemu-user and libc6-arm64-cross, or wine.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import fmpy
import numpy as np

from fmu_build.bridge import BUILD, PLATFORMS, zig
from fmu_build.build import compiled_files, write_archive
from fmu_build.compiled import libraries
from latin_fmu import load_scene
from latin_fmu.compiled.library import suffix
from latin_fmu.errors import InputError
from latin_fmu.scene.schema import Scene
from tests.cosim.scenes import blocks

MODELS = Path(__file__).parents[2] / "models"
NATIVE = "linux-x86_64"
LIMIT = 1e-11  # of the largest value of a unit
LEFT_OUT = ("solver.", "energy.balance")  # the course of the iteration, a difference of equal numbers
MOST_STEPS = 400

Outputs = dict[tuple[str | None, str], np.ndarray]


def model(name: str) -> Callable[[], Scene]:
    """A shipped model, read when it is needed."""
    return lambda: load_scene(MODELS / name / "scene.toml")


SCENES: dict[str, Callable[[], Scene]] = {
    "blocks": blocks,
    **{name: model(name) for name in ("impact_bar", "two_specimen_crushing", "beam_in_traction", "pressed_plates")},
}


@dataclass(frozen=True)
class Platform:
    """How a program of another target is run here.

    fmi : versions for which it has a folder of binaries. runner : the command before the program, of which the first
    word must be there. needs : files that must be there. packages : Debian's names of both. drive : letter by which the
    program reaches the root folder. portable : it takes the FMU that needs no AVX2.
    """

    target: str
    fmi: tuple[str, ...]
    runner: tuple[str, ...]
    needs: tuple[str, ...] = ()
    packages: str = ""
    drive: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    portable: bool = False

    @property
    def name(self) -> str:
        """Its target, with a mark where it takes the portable FMU."""
        return f"{self.target}{'-portable' if self.portable else ''}"

    def lacks(self) -> str | None:
        """Why it cannot run here."""
        if find_spec("ziglang") is None:
            return "no compiler: pip install ziglang"
        if shutil.which(self.runner[0]) is None or not all(Path(path).exists() for path in self.needs):
            return f"{self.target} cannot be run here: apt-get install {self.packages}"
        try:
            known = libraries(self.portable)
        except InputError:
            known = {}
        missing = [self.target] if self.target not in known else []
        missing += [NATIVE] if NATIVE not in libraries() else []
        end = "-portable" if self.portable else ""
        return f"no library of the kernels: python -m latin_fmu.aot {missing[0]}{end}" if missing else None


CROSS = "/usr/aarch64-linux-gnu"
ELSEWHERE = (
    Platform(
        "linux-aarch64",
        ("3",),
        # a processor of ARMv8.0: what the library needs, and no extension
        ("qemu-aarch64", "-cpu", "cortex-a53", "-L", CROSS),
        (f"{CROSS}/lib/ld-linux-aarch64.so.1",),
        "qemu-user libc6-arm64-cross",
    ),
    Platform(
        "windows-x86_64",
        ("2", "3"),
        ("wine",),
        packages="wine",
        drive="Z:",
        environment={"WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree=;mshtml="},
    ),
)
PORTABLE = Platform(
    NATIVE, ("2", "3"), ("qemu-x86_64", "-cpu", "Nehalem"), packages="qemu-user", portable=True
)  # a processor of 2009, without AVX
HERE = Platform(NATIVE, ("2", "3"), ("env",))


def host(platform: Platform, folder: Path) -> Path:
    """``steps.c``, compiled for a platform into a folder, once."""
    program = folder / f"steps-{platform.target}.exe"
    if not program.is_file():
        options = ["-std=c11", "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror"]
        command = [*zig(platform.target), *options, str(Path(__file__).with_name("steps.c")), "-o", str(program)]
        cache = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(BUILD / "zig"))
        subprocess.run(command, check=True, env={**os.environ, **cache})
    return program


def outputs(platform: Platform, fmu: Path, fmi: str, folder: Path) -> Outputs:
    """Real outputs of an FMU by unit and name, after each step of its experiment, on a platform; every fifth step is
    made with other inputs, taken back through a serialized state, and made again.

    Raises
    ------
    RuntimeError : the host ends with an error; what it says.
    """
    inside = folder / fmu.stem
    if not inside.is_dir():
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(inside)
    described = fmpy.read_model_description(str(fmu))
    reals = [v for v in described.modelVariables if v.type in ("Real", "Float64") and not v.dimensions]
    given = [v for v in reals if v.causality == "input"]
    read = [v for v in reals if v.causality == "output"]
    experiment = described.defaultExperiment
    h, end = float(experiment.stepSize), float(experiment.stopTime)
    n = min(MOST_STEPS, round(end / h))
    inputs = [
        " ".join(str((0.3 + 0.7 * i / n) if v.name.endswith(".value") else 0.7 / end) for v in given) for i in range(n)
    ]
    lines = [inputs[0], *(f"{'back ' if i % 5 == 4 else ''}{h!r} {row}" for i, row in enumerate(inputs))]
    name = described.coSimulation.modelIdentifier + suffix(platform.target)
    library = inside / "binaries" / PLATFORMS[platform.target][fmi] / name
    path = f"{platform.drive}{(inside / 'resources').as_posix()}"
    resources = f"file://{'/' if platform.drive else ''}{path}" if fmi == "2" else f"{path}/"
    token = described.guid if fmi == "2" else described.instantiationToken
    references = (",".join(str(v.valueReference) for v in some) for some in (given, read))
    command = [
        *platform.runner,
        str(host(platform, folder)),
        f"{platform.drive}{library}",
        resources,
        token,
        *references,
    ]
    environment = {**os.environ, "WINEPREFIX": str(folder / "wine"), **platform.environment}
    lines_in, told, said = (folder / f"{name}.txt" for name in ("given", "told", "said"))
    lines_in.write_text("\n".join(lines), encoding="utf-8")
    with lines_in.open() as source, told.open("w") as out, said.open("w") as error:  # Windows' services hold pipes open
        done = subprocess.run(
            command, stdin=source, stdout=out, stderr=error, env=environment, timeout=300, check=False
        )
    if done.returncode:
        raise RuntimeError(f"{fmu.name} on {platform.target}: {done.returncode}: {said.read_text().strip()}")
    rows = np.array([[float.fromhex(word) for word in line.split()] for line in told.read_text().splitlines()])
    assert rows.shape == (n + 1, len(read))
    return {(v.unit, v.name): rows[:, i] for i, v in enumerate(read)}


def difference(found: Outputs, expected: Outputs) -> tuple[float, str]:
    """Largest difference of two sets of outputs over the largest value of that unit, and the name of that output; a gap
    that is closed, say, is round-off beside those that are open."""
    names = [(unit, name) for unit, name in expected if not name.startswith(LEFT_OUT)]
    peaks: dict[str | None, float] = {}
    for unit, name in names:
        peaks[unit] = max(peaks.get(unit, 0.0), float(np.abs(expected[unit, name]).max()))
    errors = [(float(np.abs(found[key] - expected[key]).max()), key) for key in names]
    return max((error / peaks[unit] if error else 0.0, name) for error, (unit, name) in errors)


def compared(platform: Platform, fmi: str, folder: Path) -> Iterator[tuple[str, float, str]]:
    """Scene, difference and name of the output with it, for each scene in turn."""
    for name, scene in SCENES.items():
        found = []
        for one in (platform, HERE):
            fmu = folder / f"{name}{fmi}{'p' if one.portable else ''}.fmu"
            if not fmu.is_file():
                write_archive(fmu, compiled_files(scene(), fmi, portable=one.portable))  # type: ignore[arg-type]
            found.append(outputs(one, fmu, fmi, folder))
        there, here = found
        yield name, *difference(there, here)


def main() -> int:
    """Print a table; 1 where an output is off by more than ``LIMIT``, or a platform cannot run here."""
    code = 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        for platform in (*ELSEWHERE, PORTABLE):
            reason = platform.lacks()
            if reason is not None:
                sys.stdout.write(f"{platform.name}: not run: {reason}\n")
                code = 1
                continue
            for fmi in platform.fmi:
                for name, error, output in compared(platform, fmi, Path(place)):
                    sys.stdout.write(f"{platform.name}, FMI {fmi}, {name}: {error:.1e} of the peak ({output})\n")
                    code = max(code, int(not error <= LIMIT))
    return code


if __name__ == "__main__":
    sys.exit(main())
