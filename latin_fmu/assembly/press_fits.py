"""Press fits: faces that overlap until the static start presses them apart.

An interference is a negative initial gap. Nothing holds it but the bodies themselves, so that it is closed in a static
problem before the first instant, with the preloads and before the bolts are tightened; loads come after it. With
inertia the motion starts from that equilibrium, without inertia the first increment does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ..errors import Problems, SceneError
from ..fem.elements import Elements, Recovery, principal
from ..fem.mesh import Array
from ..latin.assembly import InterfaceUnit
from ..laws.contact import Contact
from ..laws.no_slip import NoSlip
from ..remarks import Remark
from ..scene.fields import GROUND, split_face
from ..scene.schema import Scene
from ..scene.settings import GivenStart, StaticStart
from .body import Body

LARGEST_STRAIN: Final = 1e-2
"""Largest strain of bodies that a fit may bring; linear elasticity knows nothing of more."""
_SLIDING = 1e-6  # coefficient of friction: next to none, but with unknowns along the face
_NOTHING = 1e-6  # of the traction that a fit can bring
_ROUND_OFF = 1e-9  # of the extent of an interface


def interference(unit: InterfaceUnit) -> Array:
    """How far the sides of an interface overlap at its points when nothing presses them apart, (n_point,), m. Layers
    that a preload compresses are in equilibrium: their compression is none."""
    gap = unit.geometry.gap
    if not unit.behaviour.opens or unit.attached:
        return np.zeros(len(gap))
    stiffness = float(getattr(unit.behaviour, "normal_stiffness", 0.0) or 0.0)
    if unit.behaviour.elastic and stiffness > 0.0:
        compressed = unit.preload / stiffness
    else:
        compressed = 0.0
    depth = np.maximum(0.0, -(gap + compressed))
    least = _ROUND_OFF * float(np.ptp(unit.geometry.points, axis=0).max(initial=0.0))
    return np.where(depth > least, depth, 0.0)


def fits(units: Iterable[InterfaceUnit]) -> dict[str, float]:
    """Interfaces with an interference, and the largest one of each, m."""
    depths = {unit.name: float(interference(unit).max(initial=0.0)) for unit in units}
    return {name: depth for name, depth in depths.items() if depth > 0.0}


def carried(scene: Scene, units: list[InterfaceUnit], problems: Problems) -> Scene:
    """The scene with a static start where it has press fits; bodies that move are added to ``problems``."""
    found = fits(units)
    if not found:
        return scene
    for name in found:
        bodies = [split_face(side)[0] for side in scene.joints[name].sides if side != GROUND]
        moving = [body for body in bodies if scene.substructure[body].motion_keys]
        if moving:
            problems.add(
                f"interface.{name}",
                "a press fit with a substructure that has an initial velocity: no static start can carry it",
                f"{found[name]:.4g} {scene.unit_system['m']} with {moving[0]}",
                "bodies at rest",
                f'remove the velocity of {moving[0]}, or set overlap = "ignore"',
            )
    if problems or not isinstance(scene.time.start, GivenStart):
        return scene
    # displacements that are given come instead of it, and ``initial_problems`` compares them with the overlap
    if any(set(s.initial_keys) - set(s.motion_keys) for s in scene.substructure.values()):
        return scene
    return scene.model_copy(update={"time": scene.time.model_copy(update={"start": StaticStart()})})


def sliding_ones(units: list[InterfaceUnit]) -> list[InterfaceUnit]:
    """The interfaces for the closing of fits: those whose sides never slide do so while they are pressed apart, and
    hold from then on. Held all the way, the shear of points that a support holds, too, would not be determined."""
    found, sliding = fits(units), []
    for unit in units:
        if unit.name in found and isinstance(unit.behaviour, NoSlip):
            sliding.append(replace(unit, behaviour=Contact(_SLIDING)))
        else:
            sliding.append(unit)
    return sliding


def fit_pressures(units: list[InterfaceUnit], approach: Mapping[str, float]) -> list[float]:
    """Pressure that each fit can bring, Pa; ``approach`` : of both bodies under a mean pressure, m Pa-1, by name."""
    pressures = []
    for name, depth in fits(units).items():
        unit = next(u for u in units if u.name == name)
        stiffness = float(getattr(unit.behaviour, "normal_stiffness", 0.0) or 0.0)
        softness = approach[name] + (1.0 / stiffness if stiffness > 0.0 else 0.0)
        if softness > 0.0:
            pressures += [depth / softness]
    return pressures


def strain_remark(
    bodies: Mapping[str, Body], units: list[InterfaceUnit], displacement: Mapping[str, Array], length: str
) -> Remark:
    """Largest strain of the bodies of the fits.

    Parameters
    ----------
    displacement : (n_full,) of each substructure, m, when the fits alone are carried. length : unit of length.

    Raises
    ------
    SceneError : a strain above ``LARGEST_STRAIN``.
    """
    found = fits(units)
    sides = {split_face(side)[0] for unit in units if unit.name in found for side in unit.sides if side != GROUND}
    largest = {name: _largest_strain(bodies[name], displacement[name]) for name in sorted(sides & set(displacement))}
    worst = max(largest, key=lambda name: largest[name])
    deepest = max(found, key=lambda name: found[name])
    if not largest[worst] <= LARGEST_STRAIN:
        raise SceneError.of(
            "the scene cannot be built",
            f"interface.{deepest}.interference",
            f"the press fit strains {worst} beyond the range of linear elasticity",
            f"{largest[worst]:.2g} with an interference of {found[deepest]:.4g} {length}",
            f"at most {LARGEST_STRAIN:g}",
            'correct the diameters, or set overlap = "ignore" where the meshes overlap on purpose',
        )
    names = ", ".join(found)
    text = f"press fit {names}: the largest strain is {largest[worst]:.3g}, in {worst}, before any load acts"
    return Remark("overlap", f"{text} (linear elasticity holds up to about {LARGEST_STRAIN:g})")


def loose_remarks(units: list[InterfaceUnit], traction: Mapping[str, Array], scale: float) -> list[Remark]:
    """Remarks on fits that carry nothing, because nothing holds their bodies against each other.

    traction : (n_point, n_component) by interface, Pa. scale : traction that the fits can bring, Pa.
    """
    loose = [name for name in fits(units) if np.abs(traction[name][:, 0]).max(initial=0.0) <= _NOTHING * scale]
    text = "carries no force: its bodies are not supported against each other and separate by the interference"
    return [Remark("overlap", f"press fit {name} {text}; hold both of them") for name in loose]


def _largest_strain(body: Body, displacement: Array) -> float:
    """Largest principal strain of an element, its mean over the element; 0 of a rigid body."""
    if body.rigid:
        return 0.0
    recovery = Recovery(Elements(body.mesh), body.shape.elasticity)
    return float(np.abs(principal(recovery.strain(displacement.reshape(1, -1, 3)))).max(initial=0.0))
