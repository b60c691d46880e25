"""March of bodies that no interface holds back: the linear transient by the same kernels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..propagator.direct import DirectPropagator
from .classes import ClassTable
from .instants import march_alone
from .work import coefficients


def march_bodies(bodies: Sequence[DirectPropagator], n_time: int) -> None:
    """March bodies without interfaces over all instants that they have begun, (n_time,) with the start; they must have
    started and want no energies."""
    channels = [np.zeros((0, len(body.names)), dtype=np.int64) for body in bodies]
    table = ClassTable(bodies, channels, [None] * len(bodies))
    table.begin(n_time)
    table.take_up()
    first = bodies[0].state.instant + 1
    march_alone(table.rows, coefficients(bodies[0].scheme, bodies[0].dt, 0.0), first, n_time - first)
    table.store(n_time - first, [None] * len(bodies))
