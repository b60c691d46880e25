"""Tables [interface.NAME] and [contact.NAME]: how substructures and the ground act on each other."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, create_model

from ..errors import Problem, did_you_mean, shown
from .damping import DampingRatios
from .face_form import FaceForm
from .fields import GROUND, Direction, Name, Real, SceneTable, Side, Text, Vector, _as_list, about, refusal
from .laws import ConstantLaw, Law
from .raw_scene import RawTable, face_problems, given, named_tables, number, reference_problems, text_list
from .strain_damping import StrainDamping

_OPENING: Final = ("gap", "interference", "overlap", "form", "preload", "preload_force")
# Keys of an interface that only some behaviours take. A parameter without a default value has to be given.
TAKES: Final[Mapping[str, tuple[str, ...]]] = {
    "perfect": ("overlap",),
    "contact": ("friction_coefficient", *_OPENING),
    "no_slip": _OPENING,
    "elastic_layer": (
        "normal_stiffness",
        "tangential_stiffness",
        "overlap",
        "preload",
        "preload_force",
        "damping_ratios",
    ),
    "soft_contact": ("normal_stiffness", "friction_coefficient", *_OPENING),
    "viscous_joint": ("normal_viscosity", "tangential_viscosity", "overlap"),
    "maxwell_joint": ("normal_stiffness", "tangential_stiffness", "relaxation_time", "overlap"),
}
BEHAVIOUR_NAMES: Final = tuple(sorted(TAKES))
_ALL: Final = tuple(dict.fromkeys(key for keys in TAKES.values() for key in keys))
MEANINGLESS: Final[Mapping[str, tuple[str, ...]]] = {
    name: tuple(key for key in _ALL if key not in keys) for name, keys in TAKES.items()
}
_PRESSED: Final = ("preload", "preload_force")
PARAMETERS: Final = tuple(key for key in _ALL if key not in (*_OPENING, "damping_ratios"))
BRANCH: Final = "_branch"
"""What the name of a joint gets, before a number, for the Maxwell joints of its damping by strain."""
DASHPOT: Final = "_viscosity"
"""What it gets for the interface of its viscosity, where it has a stiffness, too."""


def key_problems(where: str, table: RawTable, behaviour: str) -> Iterator[Problem]:
    """Keys without effect with this behaviour, and keys that it needs."""
    if behaviour == "perfect":
        kind = "a perfect connection"
    else:
        kind = f'behaviour = "{behaviour}"'
    for key in MEANINGLESS.get(behaviour, ()):
        if given(table, key):
            taking = " or ".join(f'"{name}"' for name, keys in TAKES.items() if key in keys)
            yield Problem(
                f"{where}.{key}",
                f"{key!r} has no effect with {kind}",
                shown(table[key]),
                None,
                f"remove it, or choose behaviour = {taking}",
            )
    for key in TAKES.get(behaviour, ()):
        if key in PARAMETERS and Interface.model_fields[key].default is None and not given(table, key):
            yield Problem(f"{where}.{key}", f"missing: {kind} requires it", None, "a number >= 0")
    yield from _value_problems(where, table, behaviour)


def _value_problems(where: str, table: RawTable, behaviour: str) -> Iterator[Problem]:
    pressed = [key for key in _PRESSED if (number(table, key) or 0.0) > 0.0 and key in TAKES.get(behaviour, ())]
    if len(pressed) > 1:
        yield Problem(f"{where}.{pressed[1]}", f"given together with {pressed[0]!r}", None, "one of them")
    gap = number(table, "gap")
    if (number(table, "interference") or 0.0) > 0.0 and "interference" in TAKES.get(behaviour, ()):
        yield from _interference_problems(where, table, pressed)
    for key in pressed[:1]:
        if given(table, "form"):
            yield Problem(
                f"{where}.{key}",
                "an interface whose faces touch in part carries no even preload",
                f"{number(table, key):g} with a form of the faces",
                f"{key} > 0 only without form",
                "press the faces by a load or by bolts, or remove the form",
            )
        if gap is not None and gap > 0.0:
            yield Problem(
                f"{where}.{key}",
                "an open interface carries no preload",
                f"{number(table, key):g} with gap = {gap:g}",
                f"{key} > 0 only where gap = 0",
                "set gap = 0 or remove the preload",
            )
    if number(table, "normal_stiffness") != 0.0:
        return
    if behaviour == "soft_contact" or (behaviour == "elastic_layer" and pressed):
        if behaviour == "soft_contact":
            what = "without stiffness the layer carries no force"
        else:
            what = "without stiffness the layer holds no preload"
        yield Problem(f"{where}.normal_stiffness", what, "0", "> 0")


def _interference_problems(where: str, table: RawTable, pressed: Sequence[str]) -> Iterator[Problem]:
    """Keys beside an interference that say something else on the place of the faces."""
    if given(table, "gap") and table["gap"] != 0:
        yield Problem(
            f"{where}.interference",
            "given together with 'gap'",
            f"{number(table, 'interference'):g} with gap = {shown(table['gap'])}",
            "one of them",
            "remove gap: overlapping faces have no gap",
        )
    for key in pressed[:1]:
        yield Problem(
            f"{where}.interference",
            f"given together with {key!r}",
            None,
            "one of them",
            "an interference presses the faces by itself",
        )


_GAP_RULES = ("measured", "closed")
_LARGEST = sys.float_info.max


def _check_behaviour(name: str) -> str:
    if name not in BEHAVIOUR_NAMES:
        raise refusal(
            "unknown behaviour",
            value=name,
            allowed=", ".join(BEHAVIOUR_NAMES),
            remedy=did_you_mean(name, BEHAVIOUR_NAMES),
        )
    return name


def _check_gap(value: object) -> object:
    if value is None or value in _GAP_RULES:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= _LARGEST:
        return float(value)
    if isinstance(value, str):
        what = "not a gap"
    else:
        if isinstance(value, int | float):
            what = "out of range"
        else:
            what = "must be a number"
    remedy = did_you_mean(value, _GAP_RULES)
    raise refusal(what, value=value, allowed='number, >= 0 [m], "measured" or "closed"', remedy=remedy)


Overlap = Literal["interference", "ignore", "refuse"]
PointsAt = Literal["nodes", "corners"]
Gap = Annotated[float | Literal["measured", "closed"], BeforeValidator(_check_gap)]
Behaviour = Annotated[Text, AfterValidator(_check_behaviour)]
Sides = Annotated[tuple[Side, Side], BeforeValidator(_as_list)]


class GroundVelocity(SceneTable):
    """Translation of the rigid ground: velocity(t) = amplitude a(t) direction / |direction|."""

    direction: Annotated[Direction, about("direction of the motion (its length does not count)", "1")]
    amplitude: Annotated[Real, about("velocity where the law is 1", "m s-1")]
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()

    @property
    def vector(self) -> tuple[float, float, float]:
        """Velocity of the ground where the law is 1, m s-1."""
        x, y, z = self.direction
        scale = max(abs(x), abs(y), abs(z))  # keeps the squares below from over- or underflowing
        factor = self.amplitude / math.hypot(x / scale, y / scale, z / scale)
        return (x / scale * factor, y / scale * factor, z / scale * factor)


class GroundPlane(SceneTable):
    """Rigid ground behind a plane."""

    point: Annotated[Vector, about("a point of the plane", "m")]
    normal: Annotated[Direction, about("normal of the plane, out of the ground (its length does not count)", "1")]


class Interface(SceneTable):
    """Two faces that meet. The normal N points from the first side (E) to the second (E')."""

    sides: Annotated[Sides, about('two faces "substructure.face"; the second may be "ground" (rigid)')]
    behaviour: Annotated[Behaviour, about(f"what happens there: {', '.join(BEHAVIOUR_NAMES)}")] = "contact"
    friction_coefficient: Annotated[Real, about("Coulomb's coefficient mu (contact, soft_contact)", "1", ge=0)] = 0.0
    ground: Annotated[
        GroundPlane | None, about("position of the ground; default: directly behind the face, which must be plane")
    ] = None
    points_from: Annotated[
        Literal["automatic", "E", "Ep"],
        about(
            "side whose nodes give the points where nodes do not match; automatic: the side that is wholly covered, "
            "else the one with the smaller facets, then of the softer, then of the smaller body; E where all are alike"
        ),
    ] = "automatic"
    points_at: Annotated[
        PointsAt,
        about(
            "points on facets of second order: all nodes, or their corners alone, with pressures linear between them "
            "(a quarter of the points)"
        ),
    ] = "nodes"
    search: Annotated[
        Real | None, about("only points where the faces are nearer than this along N; default: all points", "m", gt=0)
    ] = None
    gap: Annotated[
        Gap | None,
        about(
            'initial distance along N (behaviours that open): "measured" on the meshes (the default), "closed" '
            "(zero, whatever the distance of the meshes), or a number, which counts whatever their distance",
            "m",
        ),
    ] = None
    interference: Annotated[
        Real,
        about(
            "interference of the faces of a press fit (behaviours that open); default: the overlap of the meshes",
            "m",
            ge=0,
        ),
    ] = 0.0
    overlap: Annotated[
        Overlap,
        about(
            'meshes that overlap: "interference", a press fit (behaviours that open; up to 0.5 % of radius or '
            'thickness), "ignore", as if they touched, or "refuse"'
        ),
    ] = "interference"
    form: Annotated[
        FaceForm | None, about("form of the faces, added to the gap: crown, polynomial or table (behaviours that open)")
    ] = None
    preload: Annotated[
        Real, about("pressure already there at t = 0, in equilibrium (contacts, elastic_layer)", "Pa", ge=0)
    ] = 0.0
    preload_force: Annotated[Real, about("the same as a normal force, spread evenly over the face", "N", ge=0)] = 0.0
    normal_stiffness: Annotated[
        Real | None, about("stiffness per area along N (elastic_layer, maxwell_joint, soft_contact)", "N m-3", ge=0)
    ] = None
    tangential_stiffness: Annotated[
        Real | None, about("stiffness per area across N (elastic_layer, maxwell_joint)", "N m-3", ge=0)
    ] = None
    damping_ratios: Annotated[DampingRatios | None, about("damping by strain, as of a material (elastic_layer)")] = None
    relaxation_time: Annotated[
        Real | None, about("viscosity over stiffness of spring and dashpot in series (maxwell_joint)", "s", gt=0)
    ] = None
    normal_viscosity: Annotated[Real | None, about("viscosity per area along N (viscous_joint)", "N s m-3", ge=0)] = (
        None
    )
    tangential_viscosity: Annotated[
        Real | None, about("viscosity per area across N (viscous_joint)", "N s m-3", ge=0)
    ] = None
    ground_velocity: Annotated[GroundVelocity | None, about("motion of the ground; at rest if omitted")] = None

    @property
    def against_ground(self) -> bool:
        """True where the second side is the rigid ground."""
        return self.sides[1] == GROUND

    @property
    def at_corners(self) -> bool:
        """Whether the corners of facets alone are points."""
        return self.points_at == "corners"

    @property
    def number_gap(self) -> float | None:
        """The gap where it is a number, m."""
        if isinstance(self.gap, str):
            return None
        return self.gap

    @property
    def behaves_open(self) -> bool:
        """True where the sides may come apart."""
        return "interference" in TAKES[self.behaviour]

    @property
    def takes_ratio(self) -> bool:
        """Whether [damping] gives it its ratio."""
        return self.behaviour == "elastic_layer" and self.damping_ratios is None

    def dampers(self, name: str) -> "dict[str, Interface]":
        """Maxwell joints and the dashpot side by side with an elastic layer that stand for its damping, by name."""
        if self.damping_ratios is None or self.behaviour != "elastic_layer":
            return {}
        return side_by_side(self, name, self.damping_ratios.damping)

    def initial_pressure(self, area: float) -> float:
        """Pressure at t = 0 on a face of the given area, m2; Pa."""
        return self.preload + self.preload_force / area


def side_by_side(layer: Interface, name: str, damping: StrainDamping) -> dict[str, Interface]:
    """Maxwell joints and a dashpot that give an elastic layer the damping by strain, by name."""
    stiffness = {key: getattr(layer, key) or 0.0 for key in ("normal_stiffness", "tangential_stiffness")}
    plain = layer.model_copy(update={"preload": 0.0, "preload_force": 0.0, "damping_ratios": None})
    branches = {}
    for count, (strength, time) in enumerate(zip(damping.strengths, damping.times, strict=True), start=1):
        keys = {key: strength * value for key, value in stiffness.items()}
        joint = {"behaviour": "maxwell_joint", "relaxation_time": time, **keys}
        branches[f"{name}{BRANCH}{count}"] = plain.model_copy(update=joint)
    if damping.viscosity > 0.0:
        viscous = {
            "behaviour": "viscous_joint",
            "normal_viscosity": damping.viscosity * stiffness["normal_stiffness"],
            "tangential_viscosity": damping.viscosity * stiffness["tangential_stiffness"],
            **dict.fromkeys(stiffness),
        }
        branches[name + DASHPOT] = plain.model_copy(update=viscous)
    return branches


NamePair = Annotated[tuple[Name, Name], BeforeValidator(_as_list)]
NamePairs = Annotated[tuple[NamePair, ...], BeforeValidator(_as_list)]
Names = Annotated[tuple[Name, ...], BeforeValidator(_as_list)]


class _ContactKeys(SceneTable):
    search: Annotated[Real, about("boundaries nearer than this along the normal become an interface", "m", gt=0)]
    parts: Annotated[Names | None, about("substructures included in the search; default: all")] = None
    behaviour: Annotated[Behaviour, about("what happens there, as for an interface")] = "contact"
    gap: Annotated[Gap | None, about("initial distance, as for an interface", "m")] = None
    overlap: Annotated[Overlap, about("meshes that overlap, as for an interface")] = "interference"
    form: Annotated[FaceForm | None, about("form of the faces, as for an interface")] = None
    points_at: Annotated[PointsAt, about("points on facets of second order, as for an interface")] = "nodes"

    @property
    def exceptions(self) -> frozenset[frozenset[str]]:
        """Pairs of substructures that are left out."""
        return frozenset(frozenset(pair) for pair in getattr(self, "except"))

    def interface(self, first: str, second: str) -> Interface:
        """The interface between two faces."""
        taken = TAKES[self.behaviour]
        keys = [k for k in ("gap", "overlap", "form", *PARAMETERS) if k in taken and getattr(self, k) is not None]
        values: dict[str, Any] = {key: getattr(self, key) for key in keys}
        values["points_at"] = self.points_at
        return Interface(sides=(first, second), behaviour=self.behaviour, search=self.search, **values)


_SEARCH = (
    "Interfaces found between boundaries; a pair with an interface in the scene is left as it is, and one that several "
    "searches find belongs to the first of them."
)


if TYPE_CHECKING:

    class ContactSearch(_ContactKeys):
        """Interfaces found between boundaries (``_SEARCH``)."""
else:
    # parameters as in [interface.NAME]; "except" is a keyword of Python and cannot be written in the body of a class
    ContactSearch = create_model(
        "ContactSearch",
        __base__=_ContactKeys,
        __doc__=_SEARCH,
        **{key: (field.annotation, field) for key, field in Interface.model_fields.items() if key in PARAMETERS},
        **{"except": (Annotated[NamePairs, about("pairs of substructures that are excluded")], ())},
    )


# -- checks with other tables ---
def interface_problems(raw: Any) -> Iterator[Problem]:
    """Problems of interfaces, and of searches for them, of a scene as written."""
    for name, table in named_tables(raw, "interface").items():
        where = f"interface.{name}"
        sides = text_list(table.get("sides"))
        for index, side in enumerate(sides):
            yield from face_problems(raw, f"{where}.sides[{index}]", side)
        if len(sides) == 2:
            yield from _pair_problems(where, table, sides)
        behaviour = table.get("behaviour")
        yield from key_problems(where, table, behaviour if isinstance(behaviour, str) else "contact")
    yield from _contact_problems(raw)


def _pair_problems(where: str, table: RawTable, sides: list[str]) -> Iterator[Problem]:
    if sides[0] == GROUND:
        if sides[1] != GROUND:
            remedy = "name the ground second"
        else:
            remedy = "name a face of a substructure first"
        yield Problem(f"{where}.sides[0]", "the first side cannot be the ground", None, "a substructure face", remedy)
    elif sides[0] == sides[1]:
        yield Problem(f"{where}.sides", "a face cannot meet itself", shown(sides), "two different faces")
    for key in ("ground_velocity", "ground"):
        if given(table, key) and GROUND not in sides:
            yield Problem(
                f"{where}.{key}",
                "there is no ground on this interface",
                None,
                f'only where the second side is "{GROUND}"',
            )
    for key in ("points_from", "search"):
        if given(table, key) and table[key] != "automatic" and GROUND in sides:
            yield Problem(
                f"{where}.{key}",
                "there is no second face on this interface",
                shown(table[key]),
                None,
                f'remove it: the second side is "{GROUND}"',
            )
    if table.get("gap") in ("measured", "closed") and GROUND in sides and not given(table, "ground"):
        yield Problem(
            f"{where}.gap",
            "the gap cannot be measured: the ground has no place",
            shown(table["gap"]),
            "a number >= 0 [m]",
            "give the distance, or the place: ground = {point = [...], normal = [...]}",
        )


def _contact_problems(raw: Any) -> Iterator[Problem]:
    """Keys of a search that its behaviour does not take; names that no substructure has."""
    for name, table in named_tables(raw, "contact").items():
        where, behaviour = f"contact.{name}", table.get("behaviour", "contact")
        if isinstance(behaviour, str):
            yield from key_problems(where, table, behaviour)
        pairs = table.get("except")
        named = [("parts", part) for part in text_list(table.get("parts"))]
        named += [("except", n) for pair in (pairs if isinstance(pairs, list | tuple) else ()) for n in text_list(pair)]
        for key, part in named:
            yield from reference_problems(raw, f"{where}.{key}", "substructure", part)
