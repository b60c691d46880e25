"""What can drive a run from outside, one row for each kind of table that has a law over time.

A row says where the laws of its tables are, how their inputs are called, what they mean, and whether they drive the run
as loads, motions or waves (``kernels.inputs``). Variables, histories, the laws that the scene keeps, what communication
steps go on from and the image that C marches follow from the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from ..kernels.inputs import DISPLACEMENT, LOAD, MOTION, WAVE
from ..scene.body_loads import BODY_LOADS
from ..scene.boundaries import Driven
from ..scene.laws import InputLaw, TimeLaw
from ..scene.ports import COMPONENTS, Port
from ..scene.schema import Scene
from .variable import AXES, Variable, input_variable

Words = tuple[str, str, str]  # unit, unit of the rate, meaning


def _always(_: Any) -> bool:
    return True


@dataclass(frozen=True)
class InputKind:
    """A row: the laws of a kind of table.

    Attributes
    ----------
    name : of an input, with the name of its table in braces. tables : of the scene, by name, or one. law : field of a
        table that holds the law, or of a field of it. meaning : of its amplitude, likewise. drives : LOAD, MOTION,
        DISPLACEMENT or WAVE, from a table. acts : whether a table drives the run at all. moment : of the value.
    settable : whether the law may be set from outside; else the row is for the law of the scene alone.
    """

    name: str
    tables: str
    law: str
    meaning: str
    drives: Callable[[Any], int] = lambda _: LOAD
    acts: Callable[[Any], bool] = _always
    moment: str = "at the start of the step"
    settable: bool = True

    def sources(self, scene: Scene) -> Iterator[Source]:
        """Every law of a scene of this kind."""
        for name, table in self.acting(scene).items():
            law = table
            for field in self.law.split("."):
                law = getattr(law, field)
            words = "1", "s-1", f"amplitude that multiplies {self.meaning.format(name)}"
            yield Source(self.name.format(name), law, self.drives(table), words, self.moment)

    def with_laws(self, scene: Scene, laws: Mapping[str, TimeLaw]) -> Scene:
        """The scene with other laws of these inputs, by name."""
        tables, named = self.acting(scene), {name: self.name.format(name) for name in self.acting(scene)}
        return self.updated(scene, {n: _with(tables[n], self.law, laws[s]) for n, s in named.items() if s in laws})

    def acting(self, scene: Scene) -> dict[str, Any]:
        """The tables of this kind, by name; one that has no name by an empty one."""
        tables = getattr(scene, self.tables)
        named: dict[str, Any] = {}
        if isinstance(tables, dict):
            named = tables
        elif tables is not None:
            named = {"": tables}
        return {name: table for name, table in named.items() if self.acts(table)}

    def updated(self, scene: Scene, new: Mapping[str, Any]) -> Scene:
        """The scene with some of its tables replaced."""
        old = getattr(scene, self.tables)
        if not new:
            return scene.model_copy()
        if isinstance(old, dict):
            return scene.model_copy(update={self.tables: {**old, **new}})
        return scene.model_copy(update={self.tables: new[""]})


def _with(table: Any, path: str, law: TimeLaw) -> Any:
    """A table with another law at a path of fields."""
    field, _, rest = path.partition(".")
    return table.model_copy(update={field: _with(getattr(table, field), rest, law) if rest else law})


@dataclass(frozen=True)
class PortInputs(InputKind):
    """A row: the laws of the ports of a causality. words : of translations and of rotations."""

    words: tuple[Words, Words] = (("", "", ""), ("", "", ""))

    def sources(self, scene: Scene) -> Iterator[Source]:
        """Every law of a scene of this kind."""
        for name, port in self.acting(scene).items():
            for source, component in port.inputs(name).items():
                unit, per_second, meaning = self.words[COMPONENTS.index(component) // 3]
                about = f"{meaning.format(name)}, {AXES[COMPONENTS.index(component) % 3]}"
                yield Source(source, port.law(component), self.drives(port), (unit, per_second, about), self.moment)

    def with_laws(self, scene: Scene, laws: Mapping[str, TimeLaw]) -> Scene:
        """The scene with other laws of these inputs, by name."""
        new: dict[str, Port] = {}
        for name, port in self.acting(scene).items():
            changes = {component: laws[source] for source, component in port.inputs(name).items() if source in laws}
            if changes:
                new[name] = port.model_copy(update={"laws": {**port.laws, **changes}})
        return self.updated(scene, new)


class Source(NamedTuple):
    """A law over time: what its input is called, the law, how it drives the run, words and moment of the input."""

    name: str
    law: TimeLaw
    drives: int
    words: Words
    moment: str

    @property
    def start(self) -> float:
        """Start value of the input; 0 of a law of the scene."""
        if isinstance(self.law, InputLaw):
            return self.law.start_value
        return 0.0

    def variables(self) -> Iterator[Variable]:
        """Value and rate of the input."""
        unit, per_second, what = self.words
        value, rate = (input_variable(self.name, part) for part in ("value", "rate"))
        about = f"{what}, {self.moment}"
        yield Variable(value, "input", "continuous", "real", about, unit, self.start)
        yield Variable(rate, "input", "continuous", "real", f"rate of the {what}, over the step", per_second, 0.0)


def _of(causality: str) -> Callable[[Port], bool]:
    return lambda port: port.causality == causality


INPUTS: Final = (
    InputKind("{}", "load", "law", "load {}"),
    PortInputs(
        *("", "port", "laws", ""),
        acts=_of("force_in"),
        words=(
            ("N", "N s-1", "force on the body through port {}"),
            ("N m", "N m s-1", "moment on the body through port {}, about its centre"),
        ),
    ),
    PortInputs(
        *("", "port", "laws", "", lambda _: WAVE),
        acts=_of("wave"),
        moment="at the end of the step, at its start where the rate is set",
        words=(
            ("N", "N s-1", "incident wave F + Z v of port {}, F the force on the body"),
            ("N m", "N m s-1", "incident wave M + Z omega of port {}, M the moment on the body"),
        ),
    ),
    *(InputKind(k.name, k.tables, k.law_key, k.meaning, acts=k.acts, settable=k.settable) for k in BODY_LOADS),
    PortInputs(
        *("", "port", "laws", "", lambda _: MOTION),
        acts=_of("motion_in"),
        words=(("m s-1", "m s-2", "velocity of port {}"), ("rad s-1", "rad s-2", "angular velocity of port {}")),
    ),
    InputKind(
        "boundary.{}",
        "boundary",
        "law",
        "the motion of boundary {}",
        lambda boundary: DISPLACEMENT if boundary.type == "displacement" else MOTION,
        lambda boundary: isinstance(boundary, Driven),
    ),
    InputKind(
        "ground.{}",
        "interface",
        "ground_velocity.law",
        "the velocity of the ground of interface {}",
        lambda _: MOTION,
        lambda interface: interface.ground_velocity is not None,
    ),
)
"""In the order of the inputs."""


def sources_of(scene: Scene) -> Iterator[Source]:
    """Every law of a scene that drives it, in the order of the inputs."""
    for kind in INPUTS:
        yield from kind.sources(scene)


def given_of(scene: Scene) -> tuple[Source, ...]:
    """What is set from outside, in the order of the inputs."""
    return tuple(source for source in sources_of(scene) if isinstance(source.law, InputLaw))


def inputs_of(scene: Scene) -> dict[str, InputLaw]:
    """Laws set from outside, by the names of their inputs."""
    return {source.name: source.law for source in sources_of(scene) if isinstance(source.law, InputLaw)}


def settable_of(scene: Scene) -> dict[str, TimeLaw]:
    """Laws of a scene that can be set from outside, by the names of their inputs."""
    return {source.name: source.law for kind in INPUTS if kind.settable for source in kind.sources(scene)}


def acting_of(scene: Scene) -> list[str]:
    """What loads or moves a body without anything set from outside, in words; empty where nothing does."""
    sources = [source for source in sources_of(scene) if not isinstance(source.law, InputLaw)]
    # names of loads alone have no dot
    named = [(source.name if "." in source.name else f"load {source.name}", source.law) for source in sources]
    return [*(f"{name} ({getattr(law, 'type', 'own law')})" for name, law in named), *scene.standing]


def with_laws(scene: Scene, laws: Mapping[str, TimeLaw]) -> Scene:
    """The scene with other laws of what drives it, by the names of ``sources_of``."""
    for kind in INPUTS:
        scene = kind.with_laws(scene, laws)
    return scene
