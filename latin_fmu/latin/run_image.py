"""The image of an assembly: its classes, interfaces and the rules of its iteration as records and blocks of memory."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..kernels.laws import LAWS
from ..propagator.image import Image
from .assembly import Assembly
from .direction import Direction
from .layout import Array
from .settings import Settings
from .slide_probes import SlideProbes

_LONGEST_STATIC = 20.0  # step of the acceleration without inertia, in lengths of the residual
REUSE: Final = 1e-2
"""Change of q up to which the solution of a substructure is reused, in tolerances."""


def negligible(settings: Settings) -> float:
    """Squared relative change of the fields up to which solutions are reused; below zero where none is."""
    if not settings.skip_unchanged or settings.quasi_static:
        return -1.0
    return (REUSE * min(settings.tolerance, 0.1 * settings.force_tolerance)) ** 2


def make_image(assembly: Assembly, settings: Settings, direction: Direction, probes: SlideProbes) -> Image:
    """Image of an assembly whose propagators have begun, are started and bound to a direction."""
    layout, static = assembly.layout, assembly.quasi_static
    ground, _, _ = assembly.ground_tables()
    run: dict[str, Any] = {
        "n_interface": len(assembly.interfaces),
        "n_ground": len(ground),
        "depth": settings.anderson_depth,
        "max_iterations": settings.max_iterations,
        "tangential": int(not layout.normal.all()),
        "layers": int(any(g.behaviour.elastic for g in layout.groups)),
        "static": int(static),
        "area": layout.area,
        "interface": layout.interface,
        "ground": ground,
        # without inertia no energy is added where a penetration within the tolerance is pushed out
        "deepest": -np.inf if static else 0.0,
        "longest_step": _LONGEST_STATIC if static else np.inf,
        "n_coarse": 0 if direction.coarse is None else direction.coarse.size,
        "direct_bonds": 0,
        **rules(settings),
        "rest_traction": assembly.rest_traction,
    }
    groups = [
        {
            "law": law_of(group.behaviour),
            "elastic": int(group.behaviour.elastic),
            "opens": int(group.behaviour.opens),
            "start": group.start,
            "n_point": group.n_point,
            "n_component": group.n_component,
            "n_parameter": group.parameters.shape[1],
            "parameters": group.parameters.astype(float),
            "initial_gap": group.gap,
        }
        for group in layout.groups
    ]
    window = settings.window or assembly.n_instant
    return Image(
        assembly.propagators,
        assembly.channels,
        layout.normal,
        probes.rows,
        run,
        groups,
        min(window, assembly.n_instant),
        len(assembly.time),
        histories(assembly),
    )


def rules(settings: Settings) -> dict[str, float]:
    """Numbers of the record of the run that may change during it."""
    return {
        "tolerance": settings.tolerance,
        "force_tolerance": settings.force_tolerance,
        "relaxation": settings.relaxation,
        "reuse": negligible(settings),
    }


def law_of(behaviour: Any) -> int:
    """Code of the law for the kernels; -1 where the behaviour's own ``local`` is called."""
    return LAWS[behaviour.name] if getattr(behaviour, "compiled", False) else -1


def histories(assembly: Assembly) -> dict[str, Array]:
    """Motion of the ground at the instants of the segment, and how far the loads go on as they did."""
    scheme, dt = assembly.scheme, assembly.dt
    _, velocity, displacement = assembly.ground_tables()
    acceleration = assembly.ground_accelerations()
    displacement = displacement + scheme.gap_lead(dt) * velocity
    one, zero = np.ones(1), np.zeros(1)
    layer_v, layer_a = (float(scheme.layer_jump(zero, *va, dt)[0][0]) for va in ((one, zero), (zero, one)))
    going_on = continuation(assembly) if assembly.quasi_static else np.ones(len(assembly.time))
    return {
        "ground_velocity": velocity,
        "ground_displacement": displacement,
        "ground_acceleration": acceleration,
        "ground_layer": displacement + layer_v * velocity + layer_a * acceleration,
        "continuation": going_on,
    }


def continuation(assembly: Assembly) -> Array:
    """How far each increment of the loads continues the one before: the part of it along that one, 0 ... 1, by the
    instant (n_time,) that it leads to; 1 where there is none before."""
    n_time = len(assembly.time)
    along, size, change = np.zeros(n_time), np.zeros(n_time), np.zeros(n_time)
    for propagator in assembly.propagators:
        before = last = propagator.forcing.at(0)
        for t in range(1, n_time):
            coming = propagator.forcing.at(t)
            along[t] += float(np.vdot(coming - last, last - before))
            size[t] += float(np.vdot(last - before, last - before))
            change[t] += float(np.vdot(coming - last, coming - last))
            before, last = last, coming
    ground = np.zeros(n_time, dtype=bool)
    for velocity in assembly.ground.values():
        ground[1:] |= np.einsum("ti,ti->t", velocity[1:], velocity[:-1]) > 0.0
    part = np.divide(along, size, out=ground.astype(float), where=(size > 0) & (change > 0))
    part[:2] = 1.0  # at the start of a run there are no velocities; a segment continues the one before
    share: Array = np.clip(part, 0.0, 1.0)
    return share
