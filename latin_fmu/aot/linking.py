"""Object file and C stub to a library, by the compiler of ``ziglang``: no compiler of the machine is needed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from .objects import Target

_STUB: Final = Path(__file__).with_name("stub.c")


class LinkError(Exception):
    """The linker refused; its message."""


def link(content: bytes, manifest: str, target: Target, library: Path) -> None:
    """Write the library; ``manifest`` is the text it says of itself (see ``compiled.library.manifest``).

    Raises
    ------
    LinkError : the compiler is not there, or a symbol is undefined.
    """
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        made, source = Path(folder) / library.name, Path(folder) / "manifest.c"
        (Path(folder) / "kernels.o").write_bytes(content)
        export = "__declspec(dllexport)" if "windows" in target.zig else '__attribute__((visibility("default")))'
        text = manifest.replace("\n", "\\n")
        source.write_text(f'{export} const char latin_fmu_manifest[] = "{text}";\n', encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "ziglang",
            "cc",
            "-target",
            target.zig,
            "-shared",
            "-O3",
            "-fno-math-errno",
            "-fvisibility=hidden",
            "-s",
            "-o",
            str(made),
            str(Path(folder) / "kernels.o"),
            str(_STUB),
            str(source),
            *(() if "windows" in target.zig else ("-lm",)),
            *(("-Wl,--no-undefined",) if "linux" in target.zig else ()),
        ]
        cache = str(library.parent / "zig")  # nothing is written into the user's home
        environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if done.returncode:
            raise LinkError(f"{' '.join(command[1:4])} for {target.zig}: {done.stderr.strip()}")
        os.replace(made, library)
