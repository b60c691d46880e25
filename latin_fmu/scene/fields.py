"""Building blocks of the scene tables: strict field types, units and the base class of every table."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic.functional_validators import ModelWrapValidatorHandler
from pydantic_core import InitErrorDetails, PydanticCustomError

from .unit_values import Misfit, in_scene_units
from .units import SI, UnitSystem

GROUND = "ground"
BOX_FACES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")
ALL_OF_IT = "*"  # the face that is the whole boundary of a substructure
NAME_PATTERN = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}")
FACE_PATTERN = re.compile(r"[A-Za-z][A-Za-z0-9_]*\.[^\s.](?:.*\S)?")  # names of faces of a file may have dots
_LONGEST_VALUE = 70
NAME_RULE = "a letter, then letters, digits or underscores, 100 in all at most"
FACE_RULE = 'written "substructure.face"'


class SceneTable(BaseModel):
    """A table of the scene file: immutable, and an unknown key is an error.

    Texts with units in a table made in Python are numbers of SI, or of the system of the context; the scene that the
    table becomes part of converts them into its own.

    Modules with tables do without ``from __future__ import annotations``: pydantic would evaluate every text again.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        validate_default=True,
        defer_build=True,
        model_title_generator=lambda table: table.__name__.removesuffix("Table"),
    )

    _texts: dict[str, Any] = PrivateAttr(default_factory=dict)  # keys as written, where texts with units were

    @model_validator(mode="wrap")
    @classmethod
    def _read_units(cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        try:
            return handler(data)
        # the tables of a scene have numbers by now: only a table on its own comes here with texts
        except ValidationError:
            if not isinstance(data, dict):
                raise
            numbers, misfits = in_scene_units(cls, data, units_in(info.context))
            if misfits:
                details = [InitErrorDetails(type=_refusal_of(m), loc=m.place, input=m.value) for m in misfits]
                raise ValidationError.from_exception_data(cls.__name__, details) from None
            if numbers is data:
                raise
            table = handler(dict(numbers))
            table._texts = {key: data[key] for key, value in numbers.items() if value is not data[key]}
            return table


def entry(table: object, key: str) -> Any:
    """What stands at a key; None where nothing does, or where the table is no table at all."""
    if isinstance(table, Mapping):
        return table.get(key)
    return None


def units_in(context: Any) -> UnitSystem:
    """System of units of the scene that is read; SI for a table on its own."""
    system = entry(context, "units")
    if isinstance(system, UnitSystem):
        return system
    return SI


def about(
    meaning: str,
    unit: str | None = None,
    *,
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
) -> FieldInfo:
    """Describe a field: what it means, its unit and its range (for messages, reference and JSON schema)."""
    extra: dict[str, Any] | None = None
    if unit is not None:
        extra = {"unit": unit}
    described: FieldInfo = Field(description=meaning, json_schema_extra=extra, gt=gt, ge=ge, lt=lt, le=le)
    return described


def refusal(
    what: str, *, value: object = None, allowed: str | None = None, remedy: str | None = None
) -> PydanticCustomError:
    """An error to raise from a validator; it becomes one `Problem` at the place of the field."""
    if isinstance(value, str):
        value = value[:_LONGEST_VALUE].encode("utf-8", "backslashreplace").decode()
    context = {"what": what, "value": value, "allowed": allowed, "remedy": remedy}
    return PydanticCustomError("scene_problem", "{what}", context)


def _refusal_of(misfit: Misfit) -> PydanticCustomError:
    return refusal(misfit.what, value=misfit.value, allowed=misfit.allowed, remedy=misfit.remedy)


def _check_text(text: str) -> str:
    # halves of surrogate pairs, which stand for bytes that are no UTF-8
    if any(0xD800 <= ord(character) <= 0xDFFF for character in text):
        raise refusal("not valid text", value=text, allowed="characters that UTF-8 can hold")
    return text


def _check_name(name: str) -> str:
    if NAME_PATTERN.fullmatch(name) is None:
        raise refusal("not a valid name", value=name, allowed=NAME_RULE)
    return name


def _check_body_name(name: str) -> str:
    if name == GROUND:
        raise refusal(f"the name {GROUND!r} is reserved for the rigid ground", remedy="choose another name")
    return name


def _check_face(face: str) -> str:
    if FACE_PATTERN.fullmatch(face) is None:
        raise refusal("not a valid face", value=face, allowed=FACE_RULE)
    return face


def _check_side(face: str) -> str:
    if face != GROUND and FACE_PATTERN.fullmatch(face) is None:
        raise refusal("not a valid side", value=face, allowed=f'{FACE_RULE}, or "{GROUND}"')
    return face


def _as_list(value: object) -> object:
    """Let arrays (anything with ``tolist``) stand for lists in scenes built in Python."""
    tolist = getattr(value, "tolist", None)
    if callable(tolist):
        return tolist()
    return value


def _check_directed(vector: Sequence[float]) -> Sequence[float]:
    if not any(vector):
        raise refusal("a direction cannot be zero", value=list(vector), allowed="a vector that is not zero")
    return vector


def tagged(value: object) -> object:
    """A bare string stands for a table with that type: ``"automatic"`` is ``{type = "automatic"}``."""
    if isinstance(value, str):
        return {"type": value}
    return value


def tagged_or(default: str) -> Callable[[object], object]:
    """As `tagged`, and a table without a type has the default one: ``{factor = 2}``."""

    def complete(value: object) -> object:
        if isinstance(value, Mapping) and "type" not in value:
            return {"type": default, **value}
        return tagged(value)

    return complete


def by_type(tables: Any, default: str) -> BeforeValidator:
    """Validator of a union of tables chosen by their `type`: see `tagged_or`. The schema allows the name alone of a
    table without required keys."""
    fields = [table.model_fields for table in get_args(tables)]
    names = tuple(keys["type"].default for keys in fields if not any(key.is_required() for key in keys.values()))
    return BeforeValidator(tagged_or(default), json_schema_input_type=Literal[names] | tables if names else tables)


def split_face(face: str) -> tuple[str, str]:
    """``"bar.zmax"`` -> ``("bar", "zmax")``: substructure and face (or surface group) names."""
    substructure, _, name = face.partition(".")
    return substructure, name


Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0)]
Count = Annotated[int, Field(strict=True)]
PositiveCount = Annotated[int, Field(strict=True, ge=1)]
Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True), AfterValidator(_check_text)]
Name = Annotated[
    str, Field(strict=True, json_schema_extra={"pattern": f"^{NAME_PATTERN.pattern}$"}), AfterValidator(_check_name)
]
BodyName = Annotated[Name, AfterValidator(_check_body_name)]
Face = Annotated[Text, AfterValidator(_check_face)]
Side = Annotated[Text, AfterValidator(_check_side)]
Vector = Annotated[tuple[Real, Real, Real], BeforeValidator(_as_list)]
Direction = Annotated[tuple[Real, Real, Real], BeforeValidator(_as_list), AfterValidator(_check_directed)]
Series = Annotated[tuple[Real, ...], BeforeValidator(_as_list)]


class LocalAxes(SceneTable):
    """Axes of a condition or material: x, then y made perpendicular to it in the plane of both, then z = x cross y."""

    x: Annotated[Direction, about("direction of the local x axis (its length does not count)", "1")]
    y: Annotated[Direction, about("a direction in the plane of local x and y, on the side of y", "1")]

    @model_validator(mode="after")
    def _check_plane(self) -> Self:
        # sine of the angle between them: z loses as many digits as it is small
        if not math.hypot(*self._across()) > 1e-6:
            raise refusal("x and y are parallel", value=[*self.x, *self.y], allowed="directions that span a plane")
        return self

    def _across(self) -> tuple[float, float, float]:
        """Direction of x cross y, of the length of the sine between them."""
        (a, b, c), (d, e, f) = (_unit(v) for v in (self.x, self.y))
        return (b * f - c * e, c * d - a * f, a * e - b * d)

    @property
    def rows(self) -> tuple[tuple[float, float, float], ...]:
        """Unit vectors of the local axes, one a row."""
        (a, b, c), (d, e, f) = _unit(self.x), _unit(self._across())
        return (a, b, c), (e * c - f * b, f * a - d * c, d * b - e * a), (d, e, f)

    def to_global(self, vector: tuple[float, float, float]) -> tuple[float, float, float]:
        """Global components of a vector given along the local axes."""
        x, y, z = (sum(v * row[i] for v, row in zip(vector, self.rows, strict=True)) for i in range(3))
        return (x, y, z)


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    scale = max(map(abs, vector))  # keeps the squares from over- or underflowing
    if scale:
        x, y, z = (v / scale for v in vector)
    else:
        x, y, z = vector
    length = math.hypot(x, y, z) or 1.0
    return (x / length, y / length, z / length)
