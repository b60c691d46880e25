"""Table [port], by name: faces that other models are connected to."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ..errors import Problem, shown
from .fields import Face, Real, SceneTable, _as_list, about, refusal, split_face
from .laws import InputLaw, Law
from .loads import Load
from .raw_scene import RawTable, face_problems, is_explicit, named_tables, parsed_face, single_table, text_list

Component = Literal["x", "y", "z", "rx", "ry", "rz"]
COMPONENTS: Final[tuple[Component, ...]] = ("x", "y", "z", "rx", "ry", "rz")
TRANSLATIONS: Final[tuple[Component, ...]] = ("x", "y", "z")
INPUTS: Final = {
    "force_in": ("force", "moment"),
    "motion_in": ("velocity", "angularVelocity"),
    "wave": ("incident", "incidentMoment"),
}
"""Words of the inputs of a port by its causality, of translations and of rotations."""
INPUT_UNITS: Final = (("N", "N m"), ("m s-1", "rad s-1"))
"""Units of inputs that are forces, and of those that are motions; of translations and of rotations."""
MOTIONS: Final = (("displacement", "rotation"), ("velocity", "angularVelocity"))
"""Words of the measured motion of a port, of translation and rotation."""
REFLECTED: Final = ("reflected", "reflectedMoment")
"""Words of the reflected wave, of translations and of rotations."""


def _check_components(components: tuple[Component, ...]) -> tuple[Component, ...]:
    if not components or len(set(components)) != len(components):
        allowed = f"different ones of {', '.join(COMPONENTS)}"
        raise refusal("components must be one to six different ones", value=list(components), allowed=allowed)
    return components


Components = Annotated[tuple[Component, ...], BeforeValidator(_as_list), AfterValidator(_check_components)]
Impedances = Annotated[tuple[Annotated[Real, about("impedance", gt=0)], ...], BeforeValidator(_as_list)]


class Port(SceneTable):
    """A face that another model is connected to, by the mean motion of the face: translation and rotation of its
    centre, as a least-squares fit by area. Everything is in SI units along the global axes.

    force_in: force and moment on the body are inputs; displacement, velocity, rotation, angular velocity are outputs.
    motion_in: the face moves as a rigid body by the velocities that are inputs; the force and moment that it exerts on
    what moves it are outputs. wave: the incident wave F + Z v is an input, F the force on the body; the reflected wave
    Z v - F, which is the incident wave of the port on the other side, is an output.
    """

    face: Annotated[Face, about('the face, "substructure.face"')]
    causality: Annotated[Literal["force_in", "motion_in", "wave"], about("what is set from outside")] = "force_in"
    components: Annotated[
        Components, about("connected components: forces along x, y, z, moments about them (rx, ry, rz)")
    ] = TRANSLATIONS
    impedance: Annotated[
        Impedances | None,
        about("list of Z, one number for each component of a wave port; of rotations in N m s", "N s m-1"),
    ] = None
    laws: Annotated[
        dict[Component, Law],
        about("time law of the input of a component, in SI units; default: input"),
        Field(default_factory=dict),
    ]

    @classmethod
    def unit_of_item(cls, key: str, raw: Any, unit: str, index: tuple[int, ...]) -> str:
        """Unit of an impedance, of a translation or of a rotation."""
        components = raw.get("components", TRANSLATIONS)
        if index and index[0] < len(components):
            turns = components[index[0]] not in TRANSLATIONS
        else:
            turns = False
        if key == "impedance" and turns:
            return "N m s"
        return unit

    @model_validator(mode="after")
    def _check_port(self) -> Self:
        n, impedance = len(self.components), self.impedance
        if self.causality != "wave" and impedance is not None:
            remedy = 'omit impedance, or set causality = "wave"'
            raise refusal(
                f"a port of causality {self.causality} has no impedance", value=list(impedance), remedy=remedy
            )
        if self.causality == "wave" and (impedance is None or len(impedance) != n):
            value = None
            if impedance is not None:
                value = list(impedance)
            allowed = f"impedance = [{n} number(s) > 0], one for each component, e.g. rho c A of a bar"
            raise refusal("a wave port needs the impedance of each component", value=value, allowed=allowed)
        for component in self.laws:
            if component not in self.components:
                allowed = ", ".join(self.components)
                raise refusal("a law of a component that is not connected", value=component, allowed=allowed)
        return self

    @property
    def body(self) -> str:
        """Substructure of the port."""
        return split_face(self.face)[0]

    @property
    def rotates(self) -> bool:
        """Whether any rotation is connected."""
        return any(component not in TRANSLATIONS for component in self.components)

    def law(self, component: Component) -> Law:
        """Law of the input of a component."""
        return self.laws.get(component, InputLaw())

    def inputs(self, name: str) -> dict[str, Component]:
        """Component of every input of the port by the name of the input, e.g. ``port.foot.force[3]``."""
        return {indexed(name, INPUTS[self.causality], c): c for c in self.components}

    def loads(self, name: str) -> dict[str, Load]:
        """Loads that act through the port, 1 N or 1 N m times their law, by the names of ``inputs``."""
        # its motion is prescribed: nothing loads the face
        if self.causality == "motion_in":
            return {}
        return {n: Load(face=self.face, law=self.law(c), **_unit(c)) for n, c in self.inputs(name).items()}


def indexed(port: str, words: tuple[str, str], component: Component) -> str:
    """Name of a quantity of a port, counted from 1; ``words`` of a translation and of a rotation."""
    number = COMPONENTS.index(component)
    return f"port.{port}.{words[number // 3]}[{number % 3 + 1}]"


def _unit(component: Component) -> dict[str, Any]:
    # "rx" ends with its axis
    vector = tuple(float(axis == component[-1]) for axis in TRANSLATIONS)
    return {"force" if component in TRANSLATIONS else "moment": vector}


def port_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the ports of a scene as written with its other tables."""
    for name, table in named_tables(raw, "port").items():
        where = f"port.{name}"
        yield from face_problems(raw, f"{where}.face", table.get("face"))
        if table.get("causality") == "wave":
            yield from _wave_problems(raw, where, table)
        if table.get("causality") == "motion_in":
            yield from _motion_problems(raw, where, table)


def _wave_problems(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    if single_table(raw, "time").get("quasi_static") is True:
        what, remedy = "a wave acts on velocities: not with quasi_static = true", 'choose "force_in" or "motion_in"'
        yield Problem(f"{where}.causality", what, "wave", remedy=f"{remedy}, or omit quasi_static")
    turned = [c for c in text_list(table.get("components")) if c not in TRANSLATIONS]
    if turned and is_explicit(raw):
        what = "dashpots of rotations couple the nodes of the face, which central differences cannot march"
        remedy = "omit the rotations, or choose an implicit time scheme"
        yield Problem(f"{where}.components", what, shown(turned), "x, y, z", remedy)


def _motion_problems(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    parsed = parsed_face(table.get("face"))
    if parsed is None:
        return
    body = named_tables(raw, "substructure").get(parsed[0], {})
    if body.get("rigid") is True:
        what = "the force on a rigid body whose motion is given is not known"
        remedy = f'choose "force_in" or "wave", or leave out substructure.{parsed[0]}.rigid'
        yield Problem(f"{where}.causality", what, "motion_in", '"force_in" or "wave"', remedy)


def port_laws(raw: Any) -> Iterator[tuple[str, Any, str | None]]:
    """Place of every law of a port, the law as written, and the unit of its input."""
    for name, table in named_tables(raw, "port").items():
        along, about = INPUT_UNITS[table.get("causality") == "motion_in"]
        for component, law in single_table(table, "laws").items():
            yield f"port.{name}.laws.{component}", law, along if component in TRANSLATIONS else about
