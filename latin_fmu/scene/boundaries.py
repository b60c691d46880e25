"""Table [boundary.NAME]: what holds or moves a face from outside."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from ..errors import Problem, shown
from .fields import BOX_FACES, Face, LocalAxes, SceneTable, Series, _as_list, about, refusal
from .laws import ConstantLaw, Law
from .raw_scene import RawTable, face_problems, given, is_box, named_tables, parsed_face, text_list

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


def _check_axes(axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
    if not axes or len(set(axes)) != len(axes):
        raise refusal("components must be one to three different axes", value=list(axes), allowed="a subset of x, y, z")
    return axes


Axes = Annotated[tuple[Axis, ...], BeforeValidator(_as_list), AfterValidator(_check_axes)]
FacePair = Annotated[tuple[Face, Face], BeforeValidator(_as_list)]
_FACE = 'the face, "substructure.face"'
_AXES = "axes of the components; default: the global axes"


class Fixed(SceneTable):
    """No displacement along the components."""

    type: Literal["fixed"] = "fixed"
    face: Annotated[Face, about(_FACE)]
    components: Annotated[Axes, about("blocked components")] = AXES
    axes: Annotated[LocalAxes | None, about(_AXES)] = None


class Symmetry(SceneTable):
    """Plane of symmetry: no displacement along the normal of a plane face, however inclined."""

    type: Literal["symmetry"] = "symmetry"
    face: Annotated[Face, about(_FACE)]


class _Prescribed(SceneTable):
    type: str
    face: Annotated[Face, about(_FACE)]
    components: Annotated[Axes, about("components driven")]
    value: Series
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()
    axes: Annotated[LocalAxes | None, about(_AXES)] = None


class PrescribedVelocity(_Prescribed):
    """Velocity history value * law(t) along the components, from the velocity of the body at t = 0 on; a face that
    starts suddenly has the law "step"."""

    type: Literal["velocity"] = "velocity"
    value: Annotated[Series, about("one number per component", "m s-1")]


class PrescribedDisplacement(_Prescribed):
    """Displacement history value * law(t) along the components, from the displacement of the body at t = 0 on."""

    type: Literal["displacement"] = "displacement"
    value: Annotated[Series, about("one number per component", "m")]


class PrescribedAcceleration(_Prescribed):
    """Acceleration history value * law(t) along the components, from the initial velocity of the body on, which is rest
    unless the scene gives one; the time scheme integrates it as it does the motion of a free body, so that no velocity
    or path is left over that the history does not hold."""

    type: Literal["acceleration"] = "acceleration"
    value: Annotated[Series, about("one number per component", "m s-2")]


class Absorbing(SceneTable):
    """Lets waves out: dashpots rho c_p (normal) and rho c_s (tangential) per unit area."""

    type: Literal["absorbing"] = "absorbing"
    face: Annotated[Face, about(_FACE)]


class Periodic(SceneTable):
    """Two opposite faces of one substructure move together."""

    type: Literal["periodic"] = "periodic"
    faces: Annotated[FacePair, about('the two opposite faces, "substructure.face" each')]


Driven = PrescribedVelocity | PrescribedDisplacement | PrescribedAcceleration
"""Conditions that move a face from outside."""
Boundary = Annotated[Fixed | Symmetry | Driven | Absorbing | Periodic, Field(discriminator="type")]


DRIVEN = ("velocity", "displacement", "acceleration")
"""Types of conditions that move a face from outside."""


def boundary_problems(raw: Any) -> Iterator[Problem]:
    """All problems between keys of the boundary conditions, and between the conditions."""
    imposed: dict[tuple[str, str], str] = {}
    for name, table in named_tables(raw, "boundary").items():
        where, kind = f"boundary.{name}", table.get("type")
        yield from face_problems(raw, f"{where}.face", table.get("face"))
        if kind == "periodic":
            yield from _periodic_problems(raw, where, table)
        if kind in DRIVEN:
            yield from _length_problems(where, table)
        for place, component in _imposed(raw, table):
            other = imposed.setdefault((place, component), name)
            if other != name:
                yield Problem(
                    where,
                    f"{component} on {place!r} is already set by boundary {other!r}",
                    None,
                    "one condition per face and component",
                )


def _length_problems(where: str, table: RawTable) -> Iterator[Problem]:
    components, value = table.get("components"), table.get("value")
    if isinstance(components, (list, tuple)) and isinstance(value, (list, tuple)) and len(components) != len(value):
        yield Problem(f"{where}.value", "must have one number per component", shown(value), str(len(components)))


def _periodic_problems(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    faces = text_list(table.get("faces"))
    if len(faces) != 2:
        return
    for index, face in enumerate(faces):
        yield from face_problems(raw, f"{where}.faces[{index}]", face)
    first, second = parsed_face(faces[0]), parsed_face(faces[1])
    if first is None or second is None:
        return
    if first == second or first[0] != second[0]:
        yield Problem(f"{where}.faces", "periodic faces must be two different faces of one substructure", shown(faces))
    elif is_box(raw, first[0]) and first[1] in BOX_FACES and second[1] in BOX_FACES and first[1][0] != second[1][0]:
        # the first letter of a face of a box is its axis
        yield Problem(
            f"{where}.faces",
            "periodic faces must be opposite",
            shown(faces),
            ", ".join(f"{axis}min with {axis}max" for axis in AXES),
        )


def _imposed(raw: Any, table: RawTable) -> Iterator[tuple[str, str]]:
    """The (face, quantity) pairs that a condition sets."""
    kind, face = table.get("type"), table.get("face")
    if kind == "periodic":
        for place in dict.fromkeys(text_list(table.get("faces"))):
            yield place, "periodicity"
    elif not isinstance(face, str) or not isinstance(kind, str):
        return
    elif kind == "absorbing":
        yield face, "absorption"
    elif kind == "symmetry":
        parsed = parsed_face(face)
        if parsed is not None and is_box(raw, parsed[0]) and parsed[1] in BOX_FACES:
            yield face, parsed[1][0]
        else:
            # the normal is known with the mesh only
            yield face, "symmetry"
    elif kind == "fixed" or kind in DRIVEN:
        default = []
        if kind == "fixed":
            default = list(AXES)
        for component in dict.fromkeys(text_list(table.get("components")) or default):
            if component in AXES:
                # components along other axes cannot be compared with the global ones
                yield face, f"local {component}" if given(table, "axes") else component
