"""``python -m latin_fmu.aot [target ...]``: build the library into ``build/`` of the source tree."""

from __future__ import annotations

import logging
import sys

from ..compiled import library
from . import build, host

if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    wanted = sys.argv[1:] or [own for own in [host()] if own is not None]
    build(library.PACKAGE.parent / "build", wanted)
