"""Build backend and its hook: a wheel carries the kernels compiled for the machine it is built on, and the library of
the FMUs of this machine. It carries the models of ``latin-fmu demo``, too.

``LATIN_FMU_TARGET`` names other targets, with spaces between them. The wheel is for the first one (cross-built:
linked, not tried); its FMUs run on each of them: ``linux-x86_64 windows-x86_64`` is a wheel for Linux whose FMUs run on
Windows, too. Each further target costs half a minute or more, and 0.4 MB. ``none`` builds a wheel without a library,
which reads and draws results and runs nothing. An editable install compiles the libraries into ``build/``, where the
package finds them until a kernel changes; then ``python -m latin_fmu.aot`` makes them anew.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# hatchling builds the whole wheel for pip to read its metadata, as its hooks may change them; this one does not
os.environ.pop("PIP_BUILD_TRACKER", None)

from hatchling.build import *  # noqa: F403
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

TAGS = {
    "linux-x86_64": "manylinux_2_17_x86_64",
    "linux-aarch64": "manylinux_2_17_aarch64",
    "windows-x86_64": "win_amd64",
    "darwin-aarch64": "macosx_11_0_arm64",
}

MODEL_FILES = (".toml", ".md", ".json", ".msh", ".csv", ".py")  # what a wheel takes of models: no results, no figures


def compile_kernels(root: Path, targets: Sequence[str]) -> None:
    """Libraries of the kernels in ``build/``; those that are there and fit stay. Raises CalledProcessError."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-m", "latin_fmu.aot", *targets], cwd=root, env=environment, check=True)


class Kernels(BuildHookInterface):  # type: ignore[type-arg]
    """Compile the kernels in a process of their own and put the libraries into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called for the wheel, not for its metadata."""
        root = Path(self.root)
        sys.path.insert(0, str(root))
        from latin_fmu.aot import host

        targets = (os.environ.get("LATIN_FMU_TARGET") or host() or "none").split()
        if unknown := sorted(set(targets) - {*TAGS, "none"}):
            raise ValueError(
                f"LATIN_FMU_TARGET: no such target: {', '.join(unknown)}; allowed: {', '.join(TAGS)}, none"
            )
        targets = [target for target in targets if target in TAGS]
        if not targets:
            self.app.display_warning(
                "no library of kernels for this machine: it reads and draws results, and runs nothing"
            )
        if version == "editable":
            if targets:
                compile_kernels(root, targets)
            return
        for file in sorted(path for path in root.glob("models/**/*") if path.suffix in MODEL_FILES):
            build_data["force_include"][str(file)] = f"latin_fmu/{file.relative_to(root).as_posix()}"
        if not targets:
            return
        from fmu_build import bridge
        from latin_fmu.compiled.library import file_name

        self.app.display_info(f"compiling the kernels for {', '.join(targets)}: one to two minutes")
        compile_kernels(root, targets)
        for target in targets:
            for kind in bridge.KINDS:
                library = root / "build" / bridge.file_name(target, kind)
                if not library.is_file():
                    bridge.compiled(target, kind, root / "build", bridge.zig(target))
                build_data["force_include"][str(library)] = f"fmu_build/bridge/{library.name}"
            build_data["force_include"][str(root / "build" / file_name(target))] = f"latin_fmu/{file_name(target)}"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{TAGS[targets[0]]}"
