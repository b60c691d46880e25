"""Memory a resolution needs, and what there is."""

from __future__ import annotations

import math
import os

from ..scene.schema import Scene
from .refinement import Resolution


def memory_foreseen(scene: Scene, at: Resolution) -> float:
    """Bytes of factors and histories at a resolution: 60 entries a dof in bars, n^(4/3) growth in solids."""
    largest = 0.0
    for body in scene.substructure.values():
        if body.box is None:
            continue
        counts = [max(1.0, n * at.mesh) if n > 1 else 1.0 for n in body.box.elements]
        dofs = 3.0 * math.prod(n + 1 for n in counts)
        width = math.prod(sorted(n + 1 for n in counts)[:2]) * 3.0  # dofs of the smallest cross-section
        largest += 8.0 * dofs * min(width, 6.0 * dofs ** (1.0 / 3.0) * 10.0)
    return largest


def memory_of_the_machine() -> float:
    """Bytes of physical memory; infinite where the system does not tell."""
    try:
        return 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return math.inf
