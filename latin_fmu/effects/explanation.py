"""``explain``: effects, choices, prediction and suggestions of a scene, as text and as plain data."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any

from ..assembly.build import discretise
from ..scene.lines import key_lines, line_of
from ..scene.schema import Scene
from .choices import choices, prediction
from .effect import Effect, Suggestion
from .registry import EFFECTS
from .sizes import Sizes
from .suggestions import suggestions

SCHEMA_VERSION = "1.0"
"""Of ``Explanation.report``: the first number changes when a key changes or goes, the second when one is added."""
_WIDTH = 118
_SHOWN = 2  # keys that are named before "and so many more"


@dataclass(frozen=True)
class Explanation:
    """What a scene calls for.

    Attributes
    ----------
    scene : its name. effects : every effect, on or off. choices : what the solver takes, in words.
    prediction : cost of the run (see ``choices.prediction``). suggestions : what might be changed.
    warnings : remarks on the scene, as of ``check``. lines : line of every key of the scene file.
    """

    scene: str
    effects: list[Effect]
    choices: dict[str, str]
    prediction: dict[str, Any]
    suggestions: list[Suggestion]
    warnings: tuple[str, ...]
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
        }

    def text(self) -> str:
        """For a reader."""
        on, off = ([e for e in self.effects if e.on is state] for state in (True, False))
        lines = [self._headline(), "", "On:"]
        for effect in on:
            lines += self._told(effect)
        lines += ["", "Off (not allocated, not called, not in the file):"]
        width = max((len(e.name) for e in off), default=0)
        lines += [f"  {e.name:<{width}}  {e.reason}; to switch it on: {e.switch}" for e in off]
        lines += ["", "Chosen:", *(f"  {key:<16}  {value}" for key, value in self.choices.items())]
        lines += ["", "Suggestions (nothing is changed unasked):"]
        for suggestion in self.suggestions:
            lines += _suggested(suggestion)
        if not self.suggestions:
            lines.append("  none")
        lines += ["", *(f"warning: {w}" for w in self.warnings)] if self.warnings else []
        return "\n".join(lines)

    def _headline(self) -> str:
        p = self.prediction
        total = p["cpu_seconds_set_up"] + p["cpu_seconds_instants"]
        return textwrap.fill(
            f"{self.scene}: {p['unknowns']} unknowns, {p['interface_unknowns']} interface unknowns, {p['instants']} "
            f"instants; predicted {total:.2g} s of CPU time ({p['cpu_seconds_set_up']:.2g} s set-up) and "
            f"{_bytes(p['memory_bytes'])} on the machine the cost model was fitted on",
            _WIDTH,
        )

    def _told(self, effect: Effect) -> list[str]:
        share = effect.cost / self.prediction["cpu_seconds_instant"]
        numbers = [f"{effect.unknowns} unknowns"] if effect.unknowns else []
        numbers += [_bytes(effect.memory)] if effect.memory else []
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
    """Which effects a scene calls for, what each adds, and what the run will cost; nothing is factorised or solved.

    Parameters
    ----------
    scene : from ``load_scene``. text : of its file, for the line numbers; those of the scene written out where empty.

    Raises
    ------
    SceneError : the scene cannot be built.
    """
    discretised = discretise(scene)
    sizes = Sizes(discretised)
    effects = [effect(sizes) for effect in EFFECTS]
    predicted = prediction(sizes, effects)
    return Explanation(
        scene.name,
        effects,
        choices(sizes),
        predicted,
        suggestions(sizes, effects, predicted["cpu_seconds_instant"]),
        discretised.remarks,
        key_lines(text),
    )


def _suggested(suggestion: Suggestion) -> list[str]:
    lines = textwrap.wrap(f"* {suggestion.what}", _WIDTH, initial_indent="  ", subsequent_indent="    ")
    change = " ".join(f"--set {s}" for s in suggestion.settings)
    if change:
        factor = suggestion.factor
        cost = "" if factor is None or factor > 0.995 else f"   (predicted cost x {factor:.2g})"
        lines.append(f"    {change}{cost}")
    return lines


def _bytes(count: int) -> str:
    """A size a person reads."""
    size, unit = float(count), "B"
    for larger in ("kB", "MB", "GB"):
        if size < 1000:
            break
        size, unit = size / 1000, larger
    return f"{size:.3g} {unit}"
