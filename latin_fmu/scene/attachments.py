"""Tables [point_mass], [spring] and [coupling], by name: what is fixed to points and faces of substructures."""

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, Field, model_validator

from ..errors import Problem
from .damping import DampingRatios
from .fields import GROUND, Direction, Face, Flag, Name, Real, SceneTable, Vector, _as_list, about, refusal, split_face
from .interfaces import BRANCH, DASHPOT, Interface, side_by_side
from .ports import COMPONENTS, TRANSLATIONS, Components
from .raw_scene import RawTable, face_problems, given, is_explicit, named_tables, reference_problems


class Place(SceneTable):
    """A point of a substructure, or a face: its mean motion by area, translation and rotation, as a least-squares fit.

    A `face` alone stands for its centre; with `point`, for that point, joined to the mean motion of the face by a rigid
    arm.
    """

    _on_ground: ClassVar[bool] = False  # whether the ground may be meant

    substructure: Annotated[Name | None, about("name of a [substructure.NAME] table, with `point`")] = None
    face: Annotated[Face | None, about('face whose mean motion is used, "substructure.face"')] = None
    point: Annotated[
        Vector | None, about("a point in or on the substructure at t = 0; with `face` an arbitrary point", "m")
    ] = None

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        if self._on_ground and self.substructure == GROUND and self.face is None:
            return self
        if self.face is not None and self.substructure is not None:
            raise refusal("the face names its substructure already", value=self.substructure, remedy="remove the key")
        if self.face is None and (self.substructure is None or self.point is None):
            if self.substructure is not None:
                missing = "'point'"
            else:
                if self.point:
                    missing = "'substructure'"
                else:
                    missing = "'face'"
            raise refusal(f"{missing} is missing", allowed="'face', or 'substructure' with 'point'")
        return self

    @property
    def body(self) -> str:
        """Substructure of the place."""
        if self.face is not None:
            return split_face(self.face)[0]
        return str(self.substructure)


class PointMass(Place):
    """A mass without size on a substructure: at a point, or spread evenly over a `face`.

    With `face` and `point`, or `inertia`, it is a rigid mass at that point, which moves with the mean motion of the
    face by a rigid arm; it does not stiffen the face.
    """

    mass: Annotated[Real, about("mass", "kg", gt=0)]
    inertia: Annotated[
        Vector | None, about("principal moments of inertia about x, y, z at the point, with `face`", "kg m2")
    ] = None

    @model_validator(mode="after")
    def _check_inertia(self) -> Self:
        if self.inertia is None:
            return self
        if self.face is None:
            raise refusal("a point of a solid has no rotation for an inertia", remedy="use 'face', or omit it")
        # the moments about two axes are never less than that about the third one
        if min(self.inertia) < 0 or 2 * max(self.inertia) > sum(self.inertia) * (1 + 1e-9):
            allowed = "numbers >= 0, none larger than the sum of the other two"
            raise refusal("not the moments of inertia of a body", value=list(self.inertia), allowed=allowed)
        return self

    @property
    def spread(self) -> bool:
        """Whether the mass is spread evenly over a face."""
        return self.face is not None and self.point is None and self.inertia is None


class End(Place):
    """A place on a substructure (a point, a face, a point on an arm from a face), or the ground.

    "substructure.face" alone stands for a face, "ground" for the ground; the ground may have a point, too.
    """

    _on_ground: ClassVar[bool] = True

    @property
    def against_ground(self) -> bool:
        """Whether this is the ground."""
        return self.substructure == GROUND

    @property
    def side(self) -> str:
        """Side of an interface: the face, the whole boundary of the substructure for a point, or the ground."""
        if self.against_ground:
            return GROUND
        return self.face or f"{self.substructure}.*"


def _as_end(value: object) -> object:
    if not isinstance(value, str):
        return value
    if value == GROUND:
        return {"substructure": GROUND}
    return {"face": value}


OneEnd = Annotated[End, BeforeValidator(_as_end)]
Ends = Annotated[tuple[OneEnd, OneEnd], BeforeValidator(_as_list)]
OneOrTwoEnds = Annotated[tuple[OneEnd, ...], BeforeValidator(_as_list)]


class Spring(SceneTable):
    """A linear spring, a dashpot, or both side by side, without mass, between two places.

    It acts along one direction, and by `lateral_stiffness` and `lateral_viscosity` equally across it. Its force is
    proportional to the displacement (velocity) of the second end relative to the first one. Across the line of its ends
    its two forces would make a couple: between bodies that may turn as one, both ends then have the same `point`.
    """

    ends: Annotated[
        Ends, about('two places: "substructure.face", {substructure, point}, {face, point}; the second may be "ground"')
    ]
    direction: Annotated[
        Direction | None, about("direction of the stiffness; default: the line that joins the ends", "1")
    ] = None
    stiffness: Annotated[Real, about("stiffness along the direction", "N m-1", ge=0)] = 0.0
    lateral_stiffness: Annotated[Real, about("stiffness across the direction", "N m-1", ge=0)] = 0.0
    viscosity: Annotated[Real, about("viscosity along the direction", "N s m-1", ge=0)] = 0.0
    lateral_viscosity: Annotated[Real, about("viscosity across the direction", "N s m-1", ge=0)] = 0.0
    damping_ratios: Annotated[
        DampingRatios | None, about("strain damping of its stiffness, as for a material; without viscosities")
    ] = None

    @model_validator(mode="after")
    def _check_spring(self) -> Self:
        first, second = self.ends
        if not (self.elastic or self.viscous):
            raise refusal("without stiffness and viscosity the spring does nothing", allowed="one of them > 0")
        if self.damping_ratios is not None and (self.viscous or not self.elastic):
            raise refusal("damping ratios are those of a stiffness alone", remedy="omit the viscosities")
        if first.against_ground:
            raise refusal("the first end cannot be the ground", remedy="name the ground second")
        if self.direction is None and second.against_ground and second.point is None:
            remedy = 'give direction, or {substructure = "ground", point = [...]}'
            raise refusal("the ground has no place, so that the spring has no direction", remedy=remedy)
        return self

    @property
    def elastic(self) -> bool:
        """Whether it has a stiffness."""
        return self.stiffness > 0 or self.lateral_stiffness > 0

    @property
    def viscous(self) -> bool:
        """Whether it has a viscosity."""
        return self.viscosity > 0 or self.lateral_viscosity > 0

    @property
    def takes_ratio(self) -> bool:
        """Whether [damping] gives it its ratio."""
        return self.elastic and not self.viscous and self.damping_ratios is None

    def interfaces(self, name: str) -> dict[str, Interface]:
        """The interfaces that stand for the spring, by name; stiffness and viscosity of the whole, per area 1."""
        sides, interfaces = (self.ends[0].side, self.ends[1].side), {}
        if self.elastic:
            interfaces[name] = Interface(
                sides=sides,
                behaviour="elastic_layer",
                normal_stiffness=self.stiffness,
                tangential_stiffness=self.lateral_stiffness,
            )
            if self.damping_ratios is not None:
                interfaces |= side_by_side(interfaces[name], name, self.damping_ratios.damping)
        if self.viscous:
            # a dashpot alone keeps the name of its table
            interfaces[name + DASHPOT * self.elastic] = Interface(
                sides=sides,
                behaviour="viscous_joint",
                normal_viscosity=self.viscosity,
                tangential_viscosity=self.lateral_viscosity,
            )
        return interfaces


class CouplingTable(SceneTable):
    """Two places that move as one, or a face that moves as a rigid body.

    Distributing: the mean motions of both places are those of one rigid body; force and moment spread over the faces,
    which still deform. With `rigid` the faces themselves move as rigid bodies; one end alone is a rigid face, or with
    `components` one whose nodes move so along some axes and freely along the others: `["z"]`, all alike along z;
    `["z", "rx", "ry"]`, a face across z that stays plane.
    """

    ends: Annotated[
        OneOrTwoEnds,
        about('two places, as for a spring; the second may be "ground"; one face alone with `rigid`'),
        Field(min_length=1, max_length=2),
    ]
    rigid: Annotated[Flag, about("whether the faces move as rigid bodies")] = False
    rotations: Annotated[
        Flag, about("whether rotations are coupled as well; otherwise only the first point, as by a ball joint")
    ] = True
    components: Annotated[
        Components,
        about(
            "of one rigid face or node set: the motions that it has (rx, ry, rz: rotations) along those of the axes x, "
            "y, z that are named; along the others its nodes are free"
        ),
    ] = COMPONENTS

    @model_validator(mode="after")
    def _check_coupling(self) -> Self:
        if self.ends[0].against_ground:
            raise refusal("the first end cannot be the ground", remedy="name the ground second")
        if len(self.ends) == 1 and not self.rigid:
            raise refusal("one end alone is joined to nothing", remedy="name a second end, or set rigid = true")
        if len(self.ends) == 2 and all(end.face is None and not end.against_ground for end in self.ends):
            raise refusal("two points have no rotation to keep them together", remedy="use a spring, or a face")
        if self.rigid and all(end.face is None for end in self.ends):
            raise refusal("no face that could be rigid", remedy="name a face, or omit rigid")
        if len(self.components) < len(COMPONENTS) and len(self.ends) == 2:
            remedy = "name one end, or omit components"
            raise refusal("components are those of one rigid face", value=list(self.components), remedy=remedy)
        if not set(self.components) & set(TRANSLATIONS):
            raise refusal("no axis along which the nodes move as one", allowed="one of x, y, z among the components")
        return self

    def interfaces(self, name: str) -> dict[str, Interface]:
        """The interface that stands for the coupling of two places, by name."""
        if len(self.ends) == 1:
            return {}
        return {name: Interface(sides=(self.ends[0].side, self.ends[1].side), behaviour="perfect")}


def places_of(scene: Any) -> Iterator[tuple[str, Place]]:
    """Key and place of all attachments of a `Scene` to its substructures."""
    for name, mass in scene.point_mass.items():
        yield f"point_mass.{name}", mass
    for key in ("spring", "coupling"):
        for name, joint in getattr(scene, key).items():
            for i, end in enumerate(joint.ends):
                if not end.against_ground:
                    yield f"{key}.{name}.ends[{i}]", end


def joints_of(scene: Any) -> dict[str, Interface]:
    """Everything that a `Scene` solves as an interface: its interfaces, and those of springs and couplings."""
    joints: dict[str, Interface] = {}
    for name, interface in scene.interface.items():
        joints |= {name: interface, **interface.dampers(name)}
    for name, joint in (*scene.spring.items(), *scene.coupling.items()):
        joints |= joint.interfaces(name)
    return joints


def attachment_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the attachments of a scene as written, with other tables."""
    for name, table in named_tables(raw, "point_mass").items():
        where = f"point_mass.{name}"
        yield from _place_problems(raw, where, table)
        if is_explicit(raw) and given(table, "face") and (given(table, "point") or given(table, "inertia")):
            yield Problem(
                where,
                "a mass with an arm or inertia has no lumped mass, which central differences require",
                None,
                "a mass at a point, or spread evenly over a face",
                "omit its point or inertia, or choose an implicit scheme",
            )
    taken = dict.fromkeys(named_tables(raw, "interface"), "interface")
    tables = [(key, *item) for key in ("spring", "coupling") for item in named_tables(raw, key).items()]
    for key, name, table in tables:
        where, ends = f"{key}.{name}", table.get("ends")
        if key == "coupling" and table.get("rigid") is True and is_explicit(raw):
            what = "a rigid face has no lumped mass, which central differences need"
            yield Problem(f"{where}.rigid", what, "true", "false", "omit rigid, or choose an implicit scheme")
        for i, end in enumerate(ends if isinstance(ends, list | tuple) else ()):
            place = _as_end(end)
            if isinstance(place, Mapping) and place.get("substructure") != GROUND:
                yield from _place_problems(raw, f"{where}.ends[{i}]", place)
        names = [name]
        if key == "spring":
            names.append(name + DASHPOT)
        for used in names:
            if used in taken:
                yield Problem(
                    where, f"the results of {taken[used]} {used} have this name", name, None, "choose another name"
                )
            taken[used] = key
    layers = {
        n: "interface" for n, t in named_tables(raw, "interface").items() if t.get("behaviour") == "elastic_layer"
    }
    for name, key in {**layers, **dict.fromkeys(named_tables(raw, "spring"), "spring")}.items():
        for other in taken:
            if re.fullmatch(re.escape(name + BRANCH) + r"\d+", other):
                what = f"the damping of {key} {name} has this name"
                yield Problem(f"{taken[other]}.{other}", what, other, None, "choose another name")


def _place_problems(raw: Any, where: str, place: RawTable) -> Iterator[Problem]:
    """Unknown names in a place."""
    yield from reference_problems(raw, f"{where}.substructure", "substructure", place.get("substructure"))
    yield from face_problems(raw, f"{where}.face", place.get("face"))
