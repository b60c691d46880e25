"""``python -m latin_fmu.aot [target ...]``: build the library into ``build/`` of the source tree, for this machine or
for targets (``linking.TARGETS``)."""

from __future__ import annotations

import gc
import logging
import sys
from importlib.util import find_spec

from ..compiled import library
from . import build, host
from .linking import TARGETS

if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    wanted = sys.argv[1:] or [host() or f"{library.target()} (this machine, whose C library may be another)"]
    if unknown := sorted(set(wanted) - TARGETS.keys()):
        sys.exit(f"python -m latin_fmu.aot: no such target: {', '.join(unknown)}; allowed: {', '.join(TARGETS)}")
    if missing := [package for package in ("numba", "ziglang") if find_spec(package) is None]:
        sys.exit(f"python -m latin_fmu.aot: no {' and '.join(missing)} here; remedy: pip install -e '.[kernels]'")
    gc.disable()  # a quarter of numba's time otherwise: what it makes lives to the end
    build(library.PACKAGE.parent / "build", wanted)
