"""Build hook: a wheel carries the kernels compiled for the machine it is built on, or for ``LATIN_FMU_TARGET``, and for
Linux and Windows (x86-64), on which compiled FMUs run, and the libraries of other FMUs for all platforms: an FMU made
on one runs on the others. It carries the models of ``latin-fmu demo``, too.

Libraries of compiled FMUs for AArch64 (Linux, macOS) are those of a source tree, or of a wheel for that machine: they
are 0.4 MB each in a wheel that may have 2, and a pass of the optimiser each in every build.

``LATIN_FMU_TARGET=windows-x86_64`` cross-builds a wheel for Windows (linked, not tried there); ``none`` builds a wheel
without a library, whose kernels numba compiles at the first run. An editable install compiles the library of this
machine into ``build/``, where the package finds it until a kernel changes; then see ``python -m latin_fmu.aot``.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

TAGS = {
    "linux-x86_64": "manylinux_2_17_x86_64",
    "linux-aarch64": "manylinux_2_17_aarch64",
    "windows-x86_64": "win_amd64",
    "darwin-aarch64": "macosx_11_0_arm64",
}

MODEL_FILES = (".toml", ".md", ".json", ".msh", ".csv", ".py")  # what a wheel takes of models: no results, no figures
COMPILED = ("linux-x86_64", "windows-x86_64")  # targets of compiled FMUs


def compile_kernels(root: Path, targets: Sequence[str]) -> None:
    """Libraries of the kernels in ``build/``; those that are there and fit stay. Raises CalledProcessError."""
    environment = {**os.environ, "LATIN_FMU_LIBRARY": "0", "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-m", "latin_fmu.aot", *targets], cwd=root, env=environment, check=True)


class Kernels(BuildHookInterface):  # type: ignore[type-arg]
    """Compile the kernels in a process of their own and put the library into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called for the metadata and for the wheel; the second time the library is there."""
        root = Path(self.root)
        if version == "editable":
            self._compile_in_place(root)
            return
        for file in sorted(path for path in root.glob("models/**/*") if path.suffix in MODEL_FILES):
            build_data["force_include"][str(file)] = f"latin_fmu/{file.relative_to(root).as_posix()}"
        sys.path.insert(0, str(root))
        from fmu_build import bridge

        for platform in bridge.PLATFORMS:
            library = root / "build" / bridge.file_name(platform)
            if not library.is_file():
                bridge.compiled(platform, root / "build", bridge.zig(platform))
            build_data["force_include"][str(library)] = f"fmu_build/bridge/{library.name}"
        from latin_fmu.aot import host
        from latin_fmu.compiled.library import file_name

        target = os.environ.get("LATIN_FMU_TARGET") or host()
        if target in (None, "none"):
            self.app.display_warning("no library of kernels for this machine: numba compiles them at the first run")
            return
        targets = sorted({target, *COMPILED})
        compile_kernels(root, targets)
        for name in map(file_name, targets):
            build_data["force_include"][str(root / "build" / name)] = f"latin_fmu/{name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{TAGS[target]}"

    def _compile_in_place(self, root: Path) -> None:
        """The library of this machine for an editable install, which is good without one, too."""
        sys.path.insert(0, str(root))
        from latin_fmu.aot import host

        target = os.environ.get("LATIN_FMU_TARGET") or host()
        if target in (None, "none"):
            return
        try:
            compile_kernels(root, [str(target)])
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"no library of kernels ({error}): numba compiles them at the first run")
