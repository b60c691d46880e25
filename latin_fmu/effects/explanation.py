"""``explain``: effects, choices, predicted cost and suggestions of a scene, as text and as plain data.

Suggestions: settings of a scene that would cost less, with their predicted saving and what is lost by them.

Nothing is changed. The saving is that of the whole run, set-up included. Where settings change the kind of a run, the
changed scene is built before it is suggested, and an explicit march is suggested with a step that is stable.
"""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from ..assembly.inactive_substructures import arrival_times, marched_share
from ..assembly.loaded_faces import BodyFace
from ..assembly.problem import DiscretisedProblem
from ..assembly.propagator_choice import chosen_propagators
from ..assembly.wave_pace import SLOW, load_pace, longest_transit
from ..building import discretise
from ..interface.laws import FRICTION, coulomb_coefficient
from ..propagator.explicit import ExplicitPropagator
from ..remarks import Remark, remarks_of
from ..scene.boundaries import Driven
from ..scene.fields import GROUND, split_face
from ..scene.laws import InputLaw
from ..scene.overrides import key_lines, line_of
from ..scene.readable_numbers import readable
from ..scene.schema import Scene
from ..scene.settings import WHOLE, AndersonTable
from .cost import STATIC, Prediction, RunClass, RunSize, march_counts, memory_need, operator_counts, seconds
from .scene_effects import EFFECTS, Effect, changed, without_friction

SCHEMA_VERSION = "1.4"
"""Of ``Explanation.report``: the first number changes when a key changes or goes, the second when one is added."""
_WIDTH = 118
_SHOWN = 2  # keys that are named before "and so many more"


@dataclass(frozen=True)
class Explanation:
    """Effects, choices and cost of a scene.

    Attributes
    ----------
    scene : its name. effects : every effect, on or off. choices : settings that the solver takes, in words.
    prediction : CPU seconds of set-up and instants, memory, unknowns. suggestions : what might be changed.
    warnings : remarks on the scene, as of ``check``, without those that need factors of matrices.
    unchecked : what these would be on, and who knows.
    lines : line of every key of the scene file.
    """

    scene: str
    effects: list[Effect]
    choices: dict[str, str]
    prediction: dict[str, Any]
    suggestions: list[Suggestion]
    warnings: tuple[Remark, ...]
    unchecked: tuple[str, ...]
    lines: dict[str, int]

    def report(self) -> dict[str, Any]:
        """Plain data for JSON."""
        instant = self._shared
        return {
            "schema_version": SCHEMA_VERSION,
            "scene": self.scene,
            "effects": [
                {**e.report(instant), "lines": [line_of(self.lines, key) for key in e.why]} for e in self.effects
            ],
            "choices": self.choices,
            "prediction": self.prediction,
            "suggestions": [s.report() for s in self.suggestions],
            "warnings": list(self.warnings),
            "warning_codes": [remark.code for remark in self.warnings],
            "unchecked": list(self.unchecked),
        }

    def text(self) -> str:
        """The explanation as lines of text."""
        on, off = ([e for e in self.effects if e.on is state] for state in (True, False))
        lines = [self._headline(), "", "On:"]
        for effect in on:
            lines += self._described(effect)
        lines += ["", "Off (not allocated, not called, not in the file):"]
        width = max((len(e.name) for e in off), default=0)
        lines += [f"  {e.name:<{width}}  {e.reason}; to switch it on: {e.switch}" for e in off]
        lines += ["", "Chosen:", *(f"  {key:<16}  {value}" for key, value in self.choices.items())]
        lines += ["", "Suggestions (nothing is changed automatically):"]
        for suggestion in self.suggestions:
            lines += suggestion.lines(_WIDTH)
        if not self.suggestions:
            lines += ["  none"]
        if self.warnings:
            lines += ["", *(f"warning: {w}" for w in self.warnings)]
        if self.unchecked:
            lines += ["", *(f"not checked: {text}" for text in self.unchecked)]
        return "\n".join(lines)

    @property
    def _shared(self) -> float:
        """What shares of effects are of, s: the predicted CPU time of an instant, or where what each effect would save
        alone adds up to more, that sum, so that shares add up to 1."""
        return max(float(self.prediction["cpu_seconds_instant"]), sum(e.cost for e in self.effects if e.on))

    def _headline(self) -> str:
        p = self.prediction
        total = p["cpu_seconds_set_up"] + p["cpu_seconds_instants"]
        return textwrap.fill(
            f"{self.scene}: {p['unknowns']} unknowns, {p['interface_unknowns']} interface unknowns, {p['instants']} "
            f"instants; predicted {total:.2g} s of CPU time ({p['cpu_seconds_set_up']:.2g} s set-up; to a factor "
            f"of about 2) and {readable(p['memory_bytes'], 'B', 3)} of memory",
            _WIDTH,
            break_on_hyphens=False,
        )

    def _described(self, effect: Effect) -> list[str]:
        """Reason, numbers, keys and switch of an effect that is on."""
        share = effect.cost / self._shared
        numbers = [f"{effect.unknowns} unknowns"] if effect.unknowns else []
        if effect.memory:
            numbers += [readable(effect.memory, "B", 3)]
        if share >= 0.005:
            numbers += [f"{100 * share:.0f} % of an instant"]
        head = f"  {effect.name}: {effect.reason}" + (f" [{', '.join(numbers)}]" if numbers else "")
        lines = textwrap.wrap(head, _WIDTH, subsequent_indent="      ")
        if effect.kernels:
            lines.append(f"      calls   {', '.join(effect.kernels)}")
        return [*lines, f"      why     {self._why(effect)}", f"      switch  {effect.switch}"]

    def _why(self, effect: Effect) -> str:
        shown = []
        for key in effect.why[:_SHOWN]:
            line = line_of(self.lines, key)
            shown.append(f"{key} (line {line})" if line else f"{key} (default)")
        more = len(effect.why) - _SHOWN
        return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def explain(scene: Scene, text: str = "") -> Explanation:
    """Effects of a scene, what each adds, and the cost of the run; nothing is factorised or solved.

    The time to prepare meshes, matrices and interfaces is measured; what comes after is predicted.

    Parameters
    ----------
    scene : from ``load_scene``. text : of its file, for the line numbers; those of the scene written out where empty.

    Raises
    ------
    SceneError : the scene cannot be built.
    """
    start = time.process_time()
    discretised = discretise(scene)
    preparation = time.process_time() - start
    p = Prediction(discretised, preparation).with_tables()
    effects = [effect(p) for effect in EFFECTS]
    predicted = {
        "cpu_seconds_set_up": round(preparation + p.operators, 4),
        "cpu_seconds_instants": round(p.march, 4),
        "cpu_seconds_instant": p.instant,
        "memory_bytes": int(memory_need(p).total),
        "unknowns": p.total("unknowns"),
        "interface_unknowns": p.run.n_flat,
        "instants": p.run.n_instant,
        "iterations_per_instant": p.run.iterations,
    }
    proposed = suggestions(p, effects)
    _, memory = chosen_propagators(scene, discretised.classes)
    remarks = (*discretised.remarks, *remarks_of("memory", memory))
    return Explanation(scene.name, effects, choices(p), predicted, proposed, remarks, _unchecked(p), key_lines(text))


def _unchecked(p: Prediction) -> tuple[str, ...]:
    """Remarks that nothing but factors of matrices, an equilibrium or the run itself can give."""
    lines = []
    if p.discretised.units and not p.scene.time.quasi_static:
        lines.append("resolution of waves at the interfaces needs factors: latin-fmu check")
    if p.scene.time.start.type == "static" and not p.scene.time.quasi_static:
        lines.append("convergence of the static start needs its solution: latin-fmu run")
        if p.scene.bolt and any(coulomb_coefficient(unit.behaviour) for unit in p.discretised.units):
            lines.append(
                "damping: that of scheme and step by latin-fmu modes; that of the joints by latin-fmu backbone, where "
                "small losses need a tolerance of 1e-8 and short elements at the rims of the pressure"
            )
    lines.append("slip, rotations, strains and faces that never touch need a run: latin-fmu run")
    return tuple(lines)


def _interfaces(p: Prediction) -> str:
    """How each class of substructures solves with its interfaces."""
    large = [c.size for c in p.run.classes if c.size.swept]
    names = [
        c.members[0].name
        for c, run_class in zip(p.discretised.classes, p.run.classes, strict=True)
        if run_class.size.swept
    ]
    if not large:
        return "dense matrices"
    read, whole = (readable(8.0 * max(x), "B", 3) for x in ([s.swept for s in large], [s.factor for s in large]))
    dense = readable(8.0 * max(0.5 * s.channels**2 for s in large), "B", 3)
    if len(large) == len(p.run.classes):
        others = ""
    else:
        others = "; others dense"
    where = f"{', '.join(names[:_SHOWN])}{' ...' if len(names) > _SHOWN else ''}{others}"
    if (tables := p.tables) is not None:
        reach = readable(tables.reach, p.scene.unit_system.label("m"), 3)
        rule = f"truncated at {tables.truncation:.2g} of the largest entry, points within {reach}"
        return f"sparse tables, {rule}, in {where}"
    return f"exact, by substitution through {read} of a factor of {whole} (a dense matrix: {dense}) in {where}"


def choices(p: Prediction) -> dict[str, str]:
    """Window, search direction, acceleration and propagator, in words."""
    solver, run = p.scene.solver, p.run
    if run.window > 1:
        window = f"windows of {run.window} instants"
    else:
        window = "windows of one instant"
    if solver.window == WHOLE:
        window = f"one window over all {run.n_instant} instants"
    direction: str = solver.search_direction.type
    if direction == "automatic":
        direction += ": 1 / D_ii of one instant" if solver.window == 1 else ": rho c, or half the row value"
    factor = solver.search_direction.factor
    acceleration = "none (plain iteration)"
    if isinstance(solver.acceleration, AndersonTable):
        acceleration = f"anderson, depth {solver.acceleration.depth}"
    if not p.discretised.units:
        window = "no interface: one linear march"
        direction = "none"
        acceleration = "none"
    elif run.at_once:
        window = "every instant at once: perfect interfaces only"
        direction = "none"
        acceleration = "none"
    march = {}
    if p.tries_modes:
        march["march"] = (
            "by the modes of the assembly and the relative motions of its contacts, with an estimate of its error; "
            f"predicted and described is the march of its bodies, taken where the error is above "
            f"{100 * solver.reduction_error:g} % (solver.reduction_error)"
        )
    return march | {
        "window": window,
        "search direction": direction + (f", times {factor:g}" if factor != 1 else ""),
        "acceleration": acceleration,
        "interfaces": _interfaces(p),
        "propagator": f"{run.propagator.kind}, scheme {p.discretised.scheme_in_words}",
    }


TINY_FRICTION = 1e-3
STIFF = 1e3  # times the wave impedance of every neighbour
UNRESOLVED = 0.2  # transit of a body over the step
WORTH: Final = 0.1
"""Share of the CPU time of a run that a suggested change saves at least."""
COSTLY = 0.2  # share of the time
TENTH = 10  # instants between stored fields
LATE = 0.7  # share of the instants at which substructures are marched
CHEAP = 0.4  # cost of another propagator over that of the chosen one
MORE_STEPS = 10.0  # most steps of an explicit march over those of the scene
LUMPED = "with a lumped mass: contact forces change by some per cent on coarse meshes"
LARGE = 2e6  # numbers of a factor that does not stay in the cache
CLEARLY = 0.9  # cost with factors in single precision over that in double precision
ROUNDED = "results move by 1e-8 to 1e-6, and forces and momentum balance to 1e-6 instead of round-off"
TRUNCATED = "with some modes instead of the mesh: the response above them is lost, a warning of the run states how much"


@dataclass(frozen=True)
class Suggestion:
    """A change that is proposed, never made.

    Attributes
    ----------
    what : a sentence. settings : what to write, as for ``--set``. factor : predicted cost of the whole run after over
        before, None where the cost does not change or is not known. loss : what is lost, in words; empty where the
        result stays the same to the tolerance.
    """

    what: str
    settings: tuple[str, ...] = ()
    factor: float | None = None
    loss: str = ""

    def report(self) -> dict[str, Any]:
        """Suggestion as plain data, for JSON."""
        factor = None if self.factor is None else round(self.factor, 4)
        return {"what": self.what, "settings": list(self.settings), "cost_factor": factor, "loss": self.loss}

    def lines(self, width: int) -> list[str]:
        """Lines of text for a reader, at most ``width`` wide."""
        sentence = self.what + (f" ({self.loss})" if self.loss else "")
        lines = textwrap.wrap(f"* {sentence}", width, initial_indent="  ", subsequent_indent="    ")
        if self.settings:
            # a factor that rounds to 1 is no saving
            if self.factor is None or self.factor > 0.995:
                cost = ""
            else:
                cost = f"   (predicted cost x {self.factor:.2g})"
            lines.append("    " + " ".join(f"--set {s}" for s in self.settings) + cost)
        return lines


Maker = Callable[[Prediction, list[Effect]], Iterator[Suggestion]]


def suggestions(p: Prediction, effects: list[Effect]) -> list[Suggestion]:
    """All suggestions for a scene with these effects."""
    makers: tuple[Maker, ...] = (_friction, _open_gaps, _rigid, _stored, _slow, _late, _single, _propagator)
    found = [s for make in makers for s in make(p, effects)]
    # a setting that saves next to nothing is noise; what has no predicted cost is advice of another kind
    return [s for s in found if s.factor is None or s.factor <= 1.0 - WORTH]


def _friction(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Friction with a negligible coefficient."""
    for unit in p.discretised.units:
        mu = coulomb_coefficient(unit.behaviour) or 0.0
        if 0 < mu < TINY_FRICTION:
            yield Suggestion(
                f"interface {unit.name}: friction with mu = {mu:g} changes forces by less than {100 * mu:.2g} %; "
                # two sides, two tangential components
                f"without it {4 * unit.geometry.n_point} of {p.run.n_flat} interface unknowns are gone",
                (f"interface.{unit.name}.{FRICTION}=0",),
                _factor(p, without_friction(p, [unit])),
                f"tangential forces, up to {100 * mu:.2g} % of the normal ones",
            )


def _factor(p: Prediction, run: RunSize) -> float:
    """Predicted cost of a changed run over the present one, both with their set-up."""
    after = p.preparation + seconds(operator_counts(run)) + seconds(march_counts(run))
    return after / (p.preparation + p.operators + p.march)


def _open_gaps(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Gaps that nothing in the scene can close before the end."""
    travel, length = p.scene.time.end * _fastest(p), p.scene.unit_system["m"]
    for unit in p.discretised.units if np.isfinite(travel) else ():
        gap = float(unit.geometry.gap.min())
        # a layer acts at a distance of its own: its gap is not that of the meshes
        if unit.behaviour.opens and not unit.behaviour.compliant and gap > travel:
            yield Suggestion(
                f"interface {unit.name}: its gap of {gap:.4g} {length} cannot close before the end (the bodies move "
                f"less than {travel:.2g} {length}): it costs a check per instant and can be omitted"
            )


def _fastest(p: Prediction) -> float:
    """Bound on the closing speed of two faces, m s-1; infinite where the scene has none."""
    scene, bodies = p.scene, p.discretised.bodies
    driven = any(isinstance(b, Driven) for b in scene.boundary.values())
    driven |= bool(scene.port) or any(i.ground_velocity is not None for i in scene.interface.values())
    driven |= any(s.rigid or set(s.motion_keys) - {"initial_velocity"} for s in scene.substructure.values())
    laws = scene.force_laws
    # no bound
    if driven or laws.keys() != scene.load.keys() or any(isinstance(law, InputLaw) for law in laws.values()):
        return float("inf")
    speed = sum(2 * float(np.linalg.norm(s.initial_velocity)) for s in scene.substructure.values())
    for load in scene.load.values():
        body = bodies[split_face(load.face)[0]]
        size = load.largest_traction(BodyFace.of(bodies, load.face))
        amplitude = float(np.abs(load.law.sample(p.discretised.time)).max())
        # a face is driven at 2 p / rho c at most; every transit back and forth may add as much again
        shortest = float(body.mesh.extent().min())
        transits = 1 + scene.time.end * body.shape.impedances[0] / body.shape.material.density / shortest
        speed += 2 * size * amplitude / min(body.shape.impedances) * transits
    return 2 * speed  # either face may come with this speed


def _rigid(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Bodies with waves too fast for the step, or far stiffer than all neighbours (an equilibrium has no waves)."""
    static = p.run.static or p.discretised.scene.time.start.type == "static"
    for name, body in p.discretised.bodies.items() if not static else ():
        if body.rigid or p.discretised.scene.temperatures_of(name):  # a rigid body does not expand
            continue
        transit = body.mesh.size * body.shape.material.density / body.shape.impedances[0]  # c = Z / rho
        pairs = [[split_face(side)[0] for side in u.sides if side != GROUND] for u in p.discretised.units]
        others = [p.discretised.bodies[n] for pair in pairs if name in pair for n in pair if n != name]
        soft = max((o.shape.impedances[0] for o in others if not o.rigid), default=0.0)
        stiff = bool(soft) and body.shape.impedances[0] > STIFF * soft
        if not stiff and transit > UNRESOLVED * p.discretised.dt:
            continue
        why = f"a wave crosses it in {transit / p.discretised.dt:.2g} of a step"
        if stiff:
            why = f"its wave impedance is {body.shape.impedances[0] / soft:.2g} times that of its neighbours"
        settings = (f"substructure.{name}.rigid=true",)
        if changed(p, settings) is None:
            continue
        place = next(i for i, c in enumerate(p.discretised.classes) if name in [m.name for m in c.members])
        run_class = p.run.classes[place]
        yield Suggestion(
            f"substructure {name}: {why}; as a rigid body it has 6 unknowns instead of {run_class.size.unknowns}",
            settings,
            _factor(p, _rigidified(p, run_class)),
            "waves and stresses in it, and its part in the stiffness of the contact",
        )


def _rigidified(p: Prediction, one: RunClass) -> RunSize:
    """The run with one substructure of a class without elasticity."""
    # the rest of the class stays elastic, with one member less
    rest = [c for c in p.run.classes if c is not one]
    if one.size.members > 1:
        rest.append(replace(one, size=replace(one.size, members=one.size.members - 1)))
    rigid = replace(one.size, members=1, stiffness=0, mass=36, factor=0.0, unknowns=6)  # a full matrix of six dofs
    return replace(p.run, classes=(*rest, replace(one, size=rigid)))


def _stored(p: Prediction, effects: list[Effect]) -> Iterator[Suggestion]:
    """Output that takes a good part of the time."""
    cost = {e.name: e.cost / p.instant for e in effects}
    terms = [name for name in ("interior history", "stress") if cost.get(name, 0.0) > COSTLY]
    if terms and p.run.every == 1 and p.run.n_instant >= 2 * TENTH:
        share = sum(cost[name] for name in terms)
        if len(terms) > 1:
            verb = "take"
        else:
            verb = "takes"
        yield Suggestion(
            f"{' and '.join(terms)} {verb} {100 * share:.0f} % of every instant",
            (f"output.every={TENTH}",),
            _factor(p, replace(p.run, every=TENTH)),
            f"fields and stresses between every {TENTH}th instant; forces and the motion stay as they are",
        )
    if cost.get("energy balance", 0.0) > COSTLY:
        yield Suggestion(
            f"energy balance takes {100 * cost['energy balance']:.0f} % of every instant",
            ("output.energy=false",),
            _factor(p, replace(p.run, energy=False)),
            "the energies of the results; the motion stays as it is",
        )


def _slow(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Loads that are slow against the waves."""
    scene = p.scene
    moving = any(s.motion_keys for s in scene.substructure.values())
    transit = longest_transit(p.discretised.bodies)
    if p.run.static or moving or transit == 0.0:  # 0: rigid bodies alone
        return
    ratio = load_pace(scene, p.discretised.time) / transit
    if not SLOW <= ratio < np.inf:  # inf: constant laws
        return
    n = min(p.run.n_instant, 50)
    settings = ("time.quasi_static=true", f"time.{'step' if scene.time.step is not None else 'instants'}=")
    settings = (settings[0], settings[1] + (f"{scene.time.end / n!r}" if settings[1].endswith("step=") else str(n)))
    if changed(p, settings) is None:
        return
    # every increment is a window of its own, whatever the window of the scene
    iterations = replace(p.run, static=True, window=1, iterations=STATIC, n_instant=n, increments=0, unbalanced=False)
    yield Suggestion(
        f"the loads are {ratio:.3g} times slower than the longest wave transit ({transit:.3g} s): a quasi-static run "
        f"in {n} increments follows them",
        settings,
        _factor(p, iterations),
        "waves and vibrations",
    )


def _late(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Bodies that waves reach late or not at all."""
    scene, discretised = p.scene, p.discretised
    if scene.solver.skip_at_rest == "tolerance" or p.run.static or not discretised.units:
        # requested already, or nothing that could be at rest
        return
    arrival = arrival_times(scene, discretised.bodies, discretised.units, discretised.time)
    share = float(np.mean([marched_share(t, discretised.time) for t in arrival.values()]))
    if share <= LATE:
        never = sum(t >= scene.time.end for t in arrival.values())
        fewer = replace(p.run, classes=tuple(replace(c, marched=share) for c in p.run.classes))
        yield Suggestion(
            f"{never} of {len(arrival)} substructures are not reached by a wave before the end, others late: "
            f"without those at rest (to a hundredth of the tolerance) {100 * share:.0f} % of all instants are marched",
            ("solver.skip_at_rest=tolerance",),
            _factor(p, fewer),
        )


def _single(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Factors larger than the cache in single precision: half of them is read."""
    settings, marched = ("solver.precision=float32",), p.run.propagator
    largest = max((c.size.factor for c in p.run.classes), default=0.0)
    if marched.kind != "direct" or marched.precision != "float64" or largest < LARGE:
        return
    factor = _factor(p, replace(p.run, propagator=replace(marched, precision="float32")))
    if factor < CLEARLY and changed(p, settings) is not None:
        size = f"{8e-6 * largest:.0f} MB"
        what = f"the largest factor has {size}, more than a cache holds; in single precision half of it is read"
        yield Suggestion(what, settings, factor, ROUNDED)


def _propagator(p: Prediction, _: list[Effect]) -> Iterator[Suggestion]:
    """Propagators with another result at much less cost."""
    if p.run.static or p.run.propagator.kind == "explicit":
        return
    reduced = replace(p.run, propagator=replace(p.run.propagator, kind="reduced"))
    settings: tuple[str, ...] = ("solver.propagator=reduced",)
    if p.run.propagator.kind != "reduced" and _factor(p, reduced) < CHEAP and changed(p, settings) is not None:
        yield Suggestion("the reduced propagator costs less", settings, _factor(p, reduced), TRUNCATED)
    explicit = replace(p.run, propagator=replace(p.run.propagator, kind="explicit"))
    if _factor(p, explicit) >= CHEAP:
        return
    settings = ("solver.propagator=explicit", "time.scheme=central_difference")
    marched = changed(p, settings)
    if marched is None:
        return
    # the stable step needs the largest eigenvalue of the changed scene: lumped masses, own step
    steps = max(1.0, p.discretised.dt / _stable_step(marched))
    if steps > 1.0:
        n = int(np.ceil(p.run.n_instant * steps))
        step = p.scene.time.step is not None
        # the step divides the interval: round-off would leave a short step at the end
        settings += (f"time.step={p.scene.time.end / n!r}" if step else f"time.instants={n}",)
        explicit = replace(explicit, n_instant=n)
    if steps <= MORE_STEPS and _factor(p, explicit) < CHEAP and changed(p, settings) is not None:
        yield Suggestion("the explicit propagator costs less", settings, _factor(p, explicit), LUMPED)


def _stable_step(explicit: DiscretisedProblem) -> float:
    """Longest stable step of an explicit problem, s."""
    propagators = (ExplicitPropagator(c.members, explicit.scheme, explicit.dt, energy=False) for c in explicit.classes)
    return min(propagator.stability.longest for propagator in propagators)
