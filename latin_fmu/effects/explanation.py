"""``explain``: effects, choices, predicted cost and suggestions of a scene, as text and as plain data."""

from __future__ import annotations

import textwrap
import time
from dataclasses import dataclass
from typing import Any

from ..assembly.build import discretise
from ..assembly.propagator_choice import chosen_propagators
from ..remarks import Remark, remarks_of
from ..results.summary import readable
from ..scene.overrides import key_lines, line_of
from ..scene.schema import Scene
from ..scene.settings import WHOLE, AndersonTable
from .cost import Prediction
from .scene_effects import EFFECTS, Effect
from .suggestions import Suggestion, suggestions

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
        instant = self.prediction["cpu_seconds_instant"]
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
        lines += [] if self.suggestions else ["  none"]
        lines += ["", *(f"warning: {w}" for w in self.warnings)] if self.warnings else []
        lines += ["", *(f"not checked: {text}" for text in self.unchecked)] if self.unchecked else []
        return "\n".join(lines)

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
        share = effect.cost / self.prediction["cpu_seconds_instant"]
        numbers = [f"{effect.unknowns} unknowns"] if effect.unknowns else []
        numbers += [readable(effect.memory, "B", 3)] if effect.memory else []
        numbers += [f"{100 * share:.0f} % of an instant"] if share >= 0.005 else []
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
    kept = sum(e.memory for e in effects if e.name not in ("elastic bodies", "inertia", "damping"))
    predicted = {
        "cpu_seconds_set_up": round(preparation + p.operators, 4),
        "cpu_seconds_instants": round(p.march, 4),
        "cpu_seconds_instant": p.instant,
        "memory_bytes": int(p.memory + kept),
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
    made = []
    if p.discretised.units and not p.scene.time.quasi_static:
        made.append("whether mesh and step resolve waves at the interfaces needs factors: latin-fmu check")
    if p.scene.time.start.type == "static" and not p.scene.time.quasi_static:
        made.append("how far the static start converges needs its solution: latin-fmu check")
    made.append("slip, rotations, strains, faces that never touch are known at the end: latin-fmu run")
    return tuple(made)


def _interfaces(p: Prediction) -> str:
    """How each class of substructures solves with its interfaces."""
    large = [c.size for c in p.run.classes if c.size.swept]
    names = [c.members[0].name for c, own in zip(p.discretised.classes, p.run.classes, strict=True) if own.size.swept]
    if not large:
        return "dense matrices"
    read, whole = (readable(8.0 * max(x), "B", 3) for x in ([s.swept for s in large], [s.factor for s in large]))
    dense = readable(8.0 * max(0.5 * s.channels**2 for s in large), "B", 3)
    others = "" if len(large) == len(p.run.classes) else "; others dense"
    where = f"{', '.join(names[:_SHOWN])}{' ...' if len(names) > _SHOWN else ''}{others}"
    if (tables := p.tables) is not None:
        reach = readable(tables.reach, p.scene.unit_system.label("m"), 3)
        rule = f"truncated at {tables.truncation:.2g} of the largest entry, points within {reach}"
        return f"sparse tables, {rule}, in {where}"
    return f"exact, by substitution through {read} of a factor of {whole} (a dense matrix: {dense}) in {where}"


def choices(p: Prediction) -> dict[str, str]:
    """Window, search direction, acceleration and propagator, in words."""
    solver, run = p.scene.solver, p.run
    window = f"windows of {run.window} instants" if run.window > 1 else "windows of one instant"
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
        window, direction, acceleration = "no interface: one linear march", "none", "none"
    elif run.at_once:
        window, direction, acceleration = "every instant at once: perfect interfaces only", "none", "none"
    return {
        "window": window,
        "search direction": direction + (f", times {factor:g}" if factor != 1 else ""),
        "acceleration": acceleration,
        "interfaces": _interfaces(p),
        "propagator": f"{run.propagator.kind}, scheme {p.discretised.scheme_in_words}",
    }
