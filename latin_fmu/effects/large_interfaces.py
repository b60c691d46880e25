"""Large interfaces of a run before it: dense matrices, substitution or sparse tables, and what a product of the
iteration reads in each form. Nothing is factorised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..assembly.problem import DiscretisedProblem, settings_of
from ..assembly.propagator_choice import ClassSize
from ..latin.assembly import Array, class_points
from ..propagator.direct import ConjugateGradients
from ..propagator.interface_probing import ROUGH, Points, truncation_of
from ..propagator.interface_sweeps import long_steps
from ..propagator.model import SubstructureModel
from ..time_scheme import TimeScheme

_SAMPLED = 1e-3  # residual of the columns of ``_reach``, in truncations
_COLOURS = 1.4  # colours of a table, over the points within its radius of a point inside
_OF_CHECK = 0.8  # columns of the tables of the force residual, over those of Y


@dataclass(frozen=True)
class Tables:
    """Sparse tables of Y: their truncation, the distance that they reach, m, and of each class with any the entries, of
    four bytes, and the columns that are solved for (0 elsewhere)."""

    truncation: float
    reach: float
    entries: tuple[float, ...]
    columns: tuple[float, ...]

    def in_sizes(self, sizes: Sequence[ClassSize]) -> list[ClassSize]:
        """The sizes of the classes with products by tables."""
        rows = zip(sizes, self.entries, self.columns, strict=True)
        return [replace(s, product=0.5 * e, columns=c) if s.swept else s for s, e, c in rows]


def short_steps(d: DiscretisedProblem, sizes: Sequence[ClassSize]) -> bool:
    """Whether a force on an interface without dense matrices reaches little beyond its point in a window."""
    settings = settings_of(d.scene)
    if settings.window != 1 or settings.quasi_static or not any(s.swept for s in sizes):
        return False
    weights = d.scheme.operator(float(d.time[1] - d.time[0]))
    own = (c.members[0].reduced for c, size in zip(d.classes, sizes, strict=True) if size.swept)
    return not any(long_steps(weights, mass, stiffness) for mass, _, stiffness in own)


def iterated(d: DiscretisedProblem, sizes: Sequence[ClassSize]) -> list[ClassSize]:
    """The sizes with what a product by substitution reads: half where the iteration may take single precision."""
    settings = settings_of(d.scene)
    rough = min(settings.tolerance, settings.force_tolerance) >= ROUGH
    half = 0.5 if rough and short_steps(d, sizes) else 1.0
    return [replace(s, product=half * s.product) for s in sizes]


def tables(d: DiscretisedProblem, sizes: Sequence[ClassSize]) -> Tables | None:
    """Tables of the run; None where it has none."""
    settings = settings_of(d.scene)
    truncation = truncation_of(min(settings.tolerance, settings.force_tolerance))
    if not settings.tables or not truncation or not short_steps(d, sizes):
        return None
    dt, reach = float(d.time[1] - d.time[0]), 0.0
    entries, columns = [0.0] * len(sizes), [0.0] * len(sizes)
    for i, (c, size) in enumerate(zip(d.classes, sizes, strict=True)):
        if not size.swept:
            continue
        points = class_points(d.layout, d.units, c.channels)
        radius, share, inside = _reach(c.members[0], d.scheme, dt, points, truncation)
        if share > settings.tables:
            return None
        reach, width = max(reach, radius), points.channels.shape[1]
        entries[i] = share * size.channels**2
        columns[i] = (1.0 + _OF_CHECK) * width * _COLOURS * inside
    return Tables(truncation, reach, tuple(entries), tuple(columns))


def _reach(
    model: SubstructureModel, scheme: TimeScheme, dt: float, points: Points, truncation: float
) -> tuple[float, float, float]:
    """Distance beyond which the blocks of Y are below the truncation, m, their share of all blocks, and the largest
    number of points within the distance: by columns of conjugate gradients for points in the middle and at the ends of
    a face, without any factor."""
    mass, damping, stiffness = model.reduced
    weights = scheme.operator(dt)
    matrix = weights[0] * mass + weights[2] * stiffness + (0.0 if damping is None else weights[1] * damping)
    trace, picked = model.reduced_trace, points.picked()[:4]
    at, component = np.nonzero(points.channels[picked] >= 0)
    own = points.channels[picked][at, component]
    forces = trace[own].T.toarray()
    softness = (trace[own] @ ConjugateGradients(sp.csr_array(matrix), _SAMPLED * truncation).solve(forces)).diagonal()
    dashpots = np.zeros(trace.shape[0])
    for e in np.unique(component):
        here = points.channels[:, e]
        dashpots[here[here >= 0]] = 1.0 / max(softness[component == e].max(), np.finfo(float).tiny)
    matrix = matrix + trace.T @ sp.diags_array(dashpots) @ trace
    moved = np.abs(trace @ ConjugateGradients(sp.csr_array(matrix), _SAMPLED * truncation).solve(forces))
    on_points = np.where(points.channels[..., None] >= 0, moved[points.channels], 0.0).max(axis=1)
    apart: Array = np.linalg.norm(points.positions[:, None] - points.positions[picked[at]], axis=2)
    kept = on_points > truncation * on_points.max(initial=0.0)
    reach = float(apart[kept].max(initial=0.0))
    return reach, float(kept.mean()), float((apart <= 1.0001 * reach).sum(axis=0).max(initial=0))
