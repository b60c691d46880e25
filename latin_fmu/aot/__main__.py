"""``python -m latin_fmu.aot [target ...]``: build the library into ``build/`` of the source tree, for this machine or
for targets (``linking.TARGETS``)."""

from __future__ import annotations

import gc
import logging
import sys

from ..compiled import library
from . import build, host
from .linking import TARGETS

if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    wanted = sys.argv[1:] or [own for own in [host()] if own is not None]
    if unknown := sorted(set(wanted) - TARGETS.keys()):
        sys.exit(f"python -m latin_fmu.aot: no such target: {', '.join(unknown)}; allowed: {', '.join(TARGETS)}")
    gc.disable()  # a quarter of numba's time otherwise: what it makes lives to the end
    build(library.PACKAGE.parent / "build", wanted)
