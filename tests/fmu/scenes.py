"""The small scenes of the session tests, which live in a folder of their own."""

from __future__ import annotations

import importlib.util
from pathlib import Path

_SPEC = importlib.util.spec_from_file_location("cosim_scenes", Path(__file__).parents[1] / "cosim" / "scenes.py")
assert _SPEC is not None
assert _SPEC.loader is not None
_module = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_module)
blocks, bar = _module.blocks, _module.bar
