"""The scene of a static start: no inertia, and of all that acts what is there at t = 0, raised in increments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..reader import scene_from_dict
from ..scene.boundaries import Absorbing, PrescribedDisplacement, PrescribedVelocity
from ..scene.fields import GROUND, split_face
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from ..scene.time_settings import StaticStart

_MOST = 500  # iterations of an increment
_Tables = dict[str, Any]


def resting(scene: Scene) -> list[str]:
    """Substructures without a velocity of their own."""
    return [n for n, s in scene.substructure.items() if not (any(s.initial_velocity) or any(s.initial_spin))]


def static_interfaces(scene: Scene) -> list[str]:
    """Interfaces that carry something at rest: not dashpots, nor those of bodies that move."""
    still = {GROUND, *resting(scene)}
    return [
        name
        for name, interface in scene.interface.items()
        if interface.behaviour != "viscous_joint" and all(split_face(side)[0] in still for side in interface.sides)
    ]


def static_scene(scene: Scene, amplitudes: Mapping[str, float]) -> Scene:
    """The quasi-static scene whose last instant is the equilibrium under what acts at t = 0.

    Parameters
    ----------
    amplitudes : at t = 0, of loads that are set from outside; those left out have their start value.
    """
    assert isinstance(scene.time.start, StaticStart)
    data, still = scene.tables(), resting(scene)
    data["substructure"] = {n: data["substructure"][n] for n in still}
    data["interface"] = {n: data["interface"][n] for n in static_interfaces(scene)}
    for interface in data["interface"].values():
        interface.pop("ground_velocity", None)
    data["boundary"] = dict(_boundaries(scene, data["boundary"], still))
    data["load"] = dict(_loads(scene, data["load"], still, amplitudes))
    for material in data["material"].values():
        material |= {"rayleigh_mass": 0.0, "rayleigh_stiffness": 0.0}
    data["time"] = {"end": 1.0, "instants": scene.time.start.increments, "quasi_static": True}
    data["solver"] = {"max_iterations": _MOST, "share_identical": scene.solver.share_identical}
    for key in ("sensor", "accuracy", "output"):
        data.pop(key, None)
    return scene_from_dict(data, scene.base_dir)


def something_acts(scene: Scene) -> bool:
    """Whether anything moves or strains a body of a static scene."""
    return (
        bool(scene.load)
        or any(i.preload or i.preload_force or i.interference for i in scene.interface.values())
        or any(any(s.body_force) for s in scene.substructure.values())
        or any(isinstance(b, PrescribedDisplacement) for b in scene.boundary.values())
    )


def _boundaries(scene: Scene, tables: _Tables, still: list[str]) -> Iterator[tuple[str, _Tables]]:
    for name, boundary in scene.boundary.items():
        table = tables[name]
        face = table["faces"][0] if "faces" in table else table["face"]
        if split_face(face)[0] not in still or isinstance(boundary, Absorbing):
            continue
        if isinstance(boundary, PrescribedVelocity):
            table = {**table, "value": [0.0] * len(boundary.value), "law": "constant"}
        elif isinstance(boundary, PrescribedDisplacement):
            table = {**table, "law": _raised(float(boundary.law.sample(np.zeros(1))[0]))}
        yield name, table


def _loads(
    scene: Scene, tables: _Tables, still: list[str], amplitudes: Mapping[str, float]
) -> Iterator[tuple[str, _Tables]]:
    for name, load in scene.load.items():
        amplitude = float(load.law.sample(np.zeros(1))[0])
        if isinstance(load.law, InputLaw):
            amplitude = amplitudes.get(name, amplitude)
        if amplitude != 0.0 and split_face(load.face)[0] in still:
            yield name, {**tables[name], "law": _raised(amplitude)}


def _raised(amplitude: float) -> _Tables:
    return {"type": "table", "times": [0.0, 1.0], "values": [0.0, amplitude]}
