"""Table [boundary.NAME]: what holds or moves a face from outside."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from .fields import Face, Series, Table, _as_list, about, refusal
from .laws import ConstantLaw, Law

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


def _check_axes(axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
    if not axes or len(set(axes)) != len(axes):
        raise refusal("components must be one to three different axes", value=list(axes), allowed="a subset of x, y, z")
    return axes


Axes = Annotated[tuple[Axis, ...], BeforeValidator(_as_list), AfterValidator(_check_axes)]
FacePair = Annotated[tuple[Face, Face], BeforeValidator(_as_list)]
_FACE = 'the face, "substructure.face"'


class Fixed(Table):
    """No displacement along the components."""

    type: Literal["fixed"] = "fixed"
    face: Annotated[Face, about(_FACE)]
    components: Annotated[Axes, about("blocked components")] = AXES


class Symmetry(Table):
    """Plane of symmetry: no displacement along the normal of a plane face that faces an axis."""

    type: Literal["symmetry"] = "symmetry"
    face: Annotated[Face, about(_FACE)]


class PrescribedVelocity(Table):
    """Velocity history value * law(t) along the components."""

    type: Literal["velocity"] = "velocity"
    face: Annotated[Face, about(_FACE)]
    components: Annotated[Axes, about("components driven")]
    value: Annotated[Series, about("one number per component", "m s-1")]
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()


class PrescribedDisplacement(Table):
    """Displacement history value * law(t) along the components."""

    type: Literal["displacement"] = "displacement"
    face: Annotated[Face, about(_FACE)]
    components: Annotated[Axes, about("components driven")]
    value: Annotated[Series, about("one number per component", "m")]
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()


class Absorbing(Table):
    """Lets waves out: dashpots rho c_p (normal) and rho c_s (tangential) per unit area."""

    type: Literal["absorbing"] = "absorbing"
    face: Annotated[Face, about(_FACE)]


class Periodic(Table):
    """Two opposite faces of one substructure move together."""

    type: Literal["periodic"] = "periodic"
    faces: Annotated[FacePair, about('the two opposite faces, "substructure.face" each')]


Boundary = Annotated[
    Fixed | Symmetry | PrescribedVelocity | PrescribedDisplacement | Absorbing | Periodic, Field(discriminator="type")
]
