"""What might be changed in a scene without changing what it is about. Suggestions only: nothing is done unasked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ..assembly.inactive_substructures import arrival_times, marched_share
from ..assembly.prediction import predict
from ..assembly.run_sizes import ClassSizes, RunSizes
from ..fem.elasticity import wave_speeds
from ..scene.fields import GROUND, split_face
from .effect import Effect, Suggestion
from .sizes import Sizes

TINY_FRICTION = 1e-3
STIFF = 1e3  # times the wave impedance of every neighbour
UNRESOLVED = 0.2  # transit of a body over the step
COSTLY = 0.2  # share of the time
LATE = 0.7  # share of the instants at which substructures are marched
SLOW = 10.0  # duration of the run over the longest transit


def suggestions(sizes: Sizes, effects: list[Effect], instant: float) -> list[Suggestion]:
    """All suggestions; ``instant``: predicted CPU time of one instant, s."""
    makers: tuple[Callable[[Sizes, list[Effect], float], Iterator[Suggestion]], ...] = (
        _friction,
        _open_gaps,
        _rigid,
        _kept,
        _slow,
        _late,
        _propagator,
    )
    return [s for make in makers for s in make(sizes, effects, instant)]


def _friction(sizes: Sizes, _: list[Effect], instant: float) -> Iterator[Suggestion]:
    """Friction too small to matter."""
    for name, interface in sizes.scene.interface.items():
        mu = interface.friction_coefficient
        if 0 < mu < TINY_FRICTION:
            unit = next(u for u in sizes.discretised.units if u.name == name)
            n = unit.geometry.n_point
            saved = sizes.saved(sizes.without_friction([unit]))
            yield Suggestion(
                f"interface {name}: friction with mu = {mu:g} changes forces by less than {100 * mu:.2g} %; without it "
                f"{4 * n} of {sizes.n_flat} interface unknowns are gone",
                (f"interface.{name}.friction_coefficient=0",),
                max(0.0, 1 - saved / instant),
            )


def _open_gaps(sizes: Sizes, _: list[Effect], __: float) -> Iterator[Suggestion]:
    """Gaps that nothing in the scene can close before the end."""
    reach = sizes.scene.time.end * _fastest(sizes)
    if not np.isfinite(reach):
        return
    for unit in sizes.discretised.units:
        if unit.behaviour.opens and not unit.behaviour.compliant and unit.geometry.gap.min() > reach:
            yield Suggestion(
                f"interface {unit.name}: its gap of {unit.geometry.gap.min():.4g} m cannot close before the end (the "
                f"bodies move less than {reach:.2g} m): it costs a check per instant and may be left out"
            )


def _fastest(sizes: Sizes) -> float:
    """Bound on the closing speed of two faces, m s-1; infinite where the scene leaves it open."""
    scene = sizes.scene
    if any(any(s.body_force) or s.rigid for s in scene.substructure.values()):
        return float("inf")
    speeds = [0.0]
    for s in scene.substructure.values():
        spin = float(np.linalg.norm(s.initial_spin))
        if spin:
            return float("inf")
        speeds.append(2 * float(np.linalg.norm(s.initial_velocity)))
    for load in scene.load.values():
        if load.law.type == "input":
            return float("inf")
        body, _ = split_face(load.face)
        size = abs(load.pressure) if load.pressure is not None else float(np.linalg.norm(load.traction or 0.0))
        amplitude = float(np.abs(load.law.sample(sizes.discretised.time)).max())
        shape = sizes.discretised.bodies[body].shape
        # a face is driven at 2 p / rho c at most; every transit back and forth may add as much again
        transits = 1 + scene.time.end * shape.impedances[0] / shape.material.density / _shortest(sizes, body)
        speeds.append(2 * size * amplitude / min(shape.impedances) * transits)
    driven = [b for b in scene.boundary.values() if b.type in ("velocity", "displacement")]
    ground = [i for i in scene.interface.values() if i.ground_velocity is not None]
    return float("inf") if driven or ground else 2 * sum(speeds)


def _shortest(sizes: Sizes, body: str) -> float:
    return float(sizes.discretised.bodies[body].mesh.extent().min())


def _rigid(sizes: Sizes, _: list[Effect], instant: float) -> Iterator[Suggestion]:
    """Bodies whose waves are too fast for the step, or that are far stiffer than all they meet."""
    for name, body in sizes.discretised.bodies.items():
        if body.rigid:
            continue
        c_p = body.shape.impedances[0] / body.shape.material.density
        transit = float(body.mesh.extent().max()) / c_p
        others = [
            sizes.discretised.bodies[split_face(side)[0]]
            for u in sizes.discretised.units
            if any(split_face(s)[0] == name for s in u.sides)
            for side in u.sides
            if side != GROUND and split_face(side)[0] != name
        ]
        soft = max((o.shape.impedances[0] for o in others if not o.rigid), default=0.0)
        stiff = bool(soft) and body.shape.impedances[0] > STIFF * soft
        if not stiff and transit > UNRESOLVED * sizes.discretised.dt:
            continue
        why = (
            f"its wave impedance is {body.shape.impedances[0] / soft:.2g} times that of its neighbours"
            if stiff
            else f"a wave crosses it in {transit / sizes.discretised.dt:.2g} of a step"
        )
        own = next(
            c
            for c, k in zip(sizes.classes, sizes.discretised.classes, strict=True)
            if name in [m.name for m in k.members]
        )
        yield Suggestion(
            f"substructure {name}: {why}; as a rigid body it has 6 unknowns instead of {own.size.unknowns}",
            (f"substructure.{name}.rigid=true",),
            max(0.0, 1 - sizes.saved(_rigidified(sizes, own)) / instant),
        )


def _rigidified(sizes: Sizes, one: ClassSizes) -> RunSizes:
    """The run with one substructure of a class without elasticity."""
    rest = [c for c in sizes.classes if c is not one]
    fewer = [replace(one, size=replace(one.size, members=one.n_member - 1))] if one.n_member > 1 else []
    stiff = replace(one.size, members=1, entries=0, mass_entries=36, factor_entries=0.0, unknowns=6)
    return replace(sizes.run, classes=(*rest, *fewer, replace(one, size=stiff)))


def _kept(_: Sizes, effects: list[Effect], instant: float) -> Iterator[Suggestion]:
    """Output that takes a good part of the time."""
    keys = {"stress": "output.stress", "interior history": "output.fields", "energy balance": "output.energy"}
    for effect in effects:
        if effect.on and effect.name in keys and effect.cost > COSTLY * instant:
            yield Suggestion(
                f"{effect.name} takes {100 * effect.cost / instant:.0f} % of every instant",
                (f"{keys[effect.name]}=false",) if effect.name == "energy balance" else ("output.every=10",),
                1 - effect.cost / instant * (1.0 if effect.name == "energy balance" else 0.9),
            )


def _slow(sizes: Sizes, effects: list[Effect], _: float) -> Iterator[Suggestion]:
    """Loads that are slow against the waves."""
    if not next(e.on for e in effects if e.name == "inertia") or not hasattr(sizes.scene.time, "quasi_static"):
        return
    scene = sizes.scene
    if any(any(s.initial_velocity) or any(s.initial_spin) for s in scene.substructure.values()):
        return
    laws = [load.law for load in scene.load.values()] + [
        b.law for b in scene.boundary.values() if b.type in ("velocity", "displacement")
    ]
    if not laws or any(law.type in ("step", "rectangular_pulse", "input") for law in laws):
        return
    transit = _longest_transit(sizes)
    pace = min(_pace(law.sample(sizes.discretised.time), sizes.discretised.dt) for law in laws)
    ratio = pace / transit
    if not SLOW <= ratio < np.inf:
        return
    n = min(sizes.n_instant, 50)
    yield Suggestion(
        f"the loads are {ratio:.3g} times slower than the longest wave transit ({transit:.3g} s): a quasi-static run "
        f"in {n} increments would cost about {_fraction(n / sizes.n_instant)}",
        ("time.quasi_static=true", f"time.instants={n}"),
        n / sizes.n_instant,
    )


def _late(sizes: Sizes, _: list[Effect], instant: float) -> Iterator[Suggestion]:
    """Bodies that waves reach late or not at all."""
    scene, discretised = sizes.scene, sizes.discretised
    if scene.solver.skip_at_rest == "tolerance" or getattr(scene.time, "quasi_static", False) or not discretised.units:
        return
    arrival = arrival_times(scene, discretised.bodies, discretised.units, discretised.time)
    marched = {name: marched_share(t, discretised.time) for name, t in arrival.items()}
    share = float(np.mean(list(marched.values())))
    if share > LATE:
        return
    never = sum(t >= scene.time.end for t in arrival.values())
    yield Suggestion(
        f"{never} of {len(arrival)} substructures are not reached by a wave before the end, others late: passing over "
        f"what is at rest (to a hundredth of the tolerance) marches about {100 * share:.0f} % of all instants",
        ("solver.skip_at_rest=tolerance",),
        1 - sizes.saved(replace(sizes.run, classes=tuple(replace(c, marched=share) for c in sizes.classes))) / instant,
    )


def _pace(amplitude: np.ndarray, dt: float) -> float:
    """Time in which a sampled law changes by as much as it reaches, s."""
    steepest = float(np.abs(np.diff(amplitude)).max(initial=0.0))
    return float("inf") if steepest == 0.0 else float(np.abs(amplitude).max()) * dt / steepest


def _longest_transit(sizes: Sizes) -> float:
    """Across the whole assembly at the slowest shear speed, s."""
    nodes = np.concatenate([b.mesh.nodes for b in sizes.discretised.bodies.values()])
    materials = [b.shape.material for b in sizes.discretised.bodies.values() if not b.rigid]
    slowest = min((wave_speeds(m.young_modulus, m.poisson_ratio, m.density)[1] for m in materials), default=np.inf)
    return float(np.ptp(nodes, axis=0).max() / slowest)


def _fraction(share: float) -> str:
    return f"1/{1 / share:.2g}" if share < 1 else "the same"


def _propagator(sizes: Sizes, _: list[Effect], __: float) -> Iterator[Suggestion]:
    """Propagators that give another answer for much less."""
    predicted = predict(sizes.run)
    for kind, what, factor in predicted.cheaper():
        yield Suggestion(what, (f"solver.propagator={kind}",), factor)
