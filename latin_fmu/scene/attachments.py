"""Tables [point_mass], [spring] and [coupling], by name: what is fixed to points and faces of substructures."""

from collections.abc import Iterator
from typing import Annotated, Any, Self

from pydantic import model_validator

from ..errors import Problem
from .fields import Face, Name, Real, Table, Vector, about, refusal, split_face
from .raw_scene import RawTable, face_problems, given, is_explicit, named_tables, unknown_name


class Place(Table):
    """A point of a substructure, or a face: its mean motion by area, translation and rotation, as a least-squares fit.

    A `face` alone stands for its centre; with `point`, for that point, joined to the mean motion of the face by a rigid
    arm.
    """

    substructure: Annotated[Name | None, about("name of a [substructure.NAME] table, with `point`")] = None
    face: Annotated[Face | None, about('face whose mean motion counts, "substructure.face"')] = None
    point: Annotated[
        Vector | None, about("a point in or on the substructure; with `face` anywhere, before any motion", "m")
    ] = None

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        if self.face is not None and self.substructure is not None:
            raise refusal("the face names its substructure already", value=self.substructure, remedy="remove the key")
        if self.face is None and (self.substructure is None or self.point is None):
            missing = "'point'" if self.substructure is not None else "'substructure'" if self.point else "'face'"
            raise refusal(f"{missing} is missing", allowed="'face', or 'substructure' with 'point'")
        return self

    @property
    def body(self) -> str:
        """Substructure of the place."""
        return split_face(self.face)[0] if self.face is not None else str(self.substructure)


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
            raise refusal("a point of a solid has no rotation for an inertia", remedy="use 'face', or leave it out")
        if min(self.inertia) < 0 or 2 * max(self.inertia) > sum(self.inertia) * (1 + 1e-9):
            allowed = "numbers >= 0, none larger than the sum of the other two"
            raise refusal("not the moments of inertia of a body", value=list(self.inertia), allowed=allowed)
        return self

    @property
    def spread(self) -> bool:
        """Whether the mass is spread evenly over a face."""
        return self.face is not None and self.point is None and self.inertia is None


def places_of(scene: Any) -> Iterator[tuple[str, Place]]:
    """Key and place of all attachments of a `Scene`."""
    for name, mass in scene.point_mass.items():
        yield f"point_mass.{name}", mass


def attachment_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the attachments of a scene as written, with other tables."""
    for name, table in named_tables(raw, "point_mass").items():
        where = f"point_mass.{name}"
        yield from _place_problems(raw, where, table)
        if is_explicit(raw) and given(table, "face") and (given(table, "point") or given(table, "inertia")):
            yield Problem(
                where,
                "a mass with an arm or inertia has no lumped mass, which central differences need",
                None,
                "a mass at a point, or spread evenly over a face",
                "leave out its point or inertia, or choose an implicit scheme",
            )


def _place_problems(raw: Any, where: str, place: RawTable) -> Iterator[Problem]:
    """Unknown names in a place."""
    substructures, body = named_tables(raw, "substructure"), place.get("substructure")
    if substructures and isinstance(body, str) and body not in substructures:
        yield unknown_name(f"{where}.substructure", "substructure", body, substructures)
    if isinstance(place.get("face"), str):
        yield from face_problems(raw, f"{where}.face", place["face"])
