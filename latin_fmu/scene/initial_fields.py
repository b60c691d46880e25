"""Displacements and velocities at t = 0 that differ from node to node: gradients about the mass centre, and files."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, Self

from pydantic import BeforeValidator, ValidationInfo, model_validator

from ..errors import Problem, shown
from .fields import BodyName, Real, SceneTable, Text, Vector, _as_list, about, refusal, units_in
from .laws import base_dir_of
from .number_files import Column, LengthUnit, SpeedUnit, factor, is_column, read_columns
from .raw_scene import RawTable, chosen_type, given, named_tables, single_table

Gradient = Annotated[tuple[Vector, Vector, Vector], BeforeValidator(_as_list)]
"""Rows d/dx, d/dy, d/dz of the components x, y and z of a field."""
_COLUMNS: Final = 6
VELOCITY_FIELDS: Final = ("initial_velocity_gradient", "initial_velocity_field")
DISPLACEMENT_FIELDS: Final = ("initial_displacement_gradient", "initial_displacement_field")


class _FieldFile(SceneTable):
    """Points and values read from a file with six columns: x, y, z and the components of the field along x, y, z.

    Every node takes the values of the point nearest to it, which has to lie on it. The points are kept with the scene
    in its units (`points`, `values`), which no longer needs the file afterwards.
    """

    file: Annotated[Text, about("file, relative to the scene file; lines above the numbers are its header")]
    columns: Annotated[
        tuple[Column, ...],
        BeforeValidator(_as_list),
        about("columns of x, y, z and of the three components: names in the header, or numbers from 1", "1"),
    ] = (1, 2, 3, 4, 5, 6)
    length_unit: Annotated[LengthUnit, about("unit of x, y, z: m, cm, mm, um, in, ft, or the factor to m", "m")] = "m"
    time: Annotated[
        Real | None, about("instant of a results file, where [initial_state] took the values from one", "s")
    ] = None
    points: Annotated[
        tuple[Vector, ...], BeforeValidator(_as_list), about("filled from the file; where given, it is not read", "m")
    ] = ()
    values: Annotated[
        tuple[Vector, ...],
        BeforeValidator(_as_list),
        about("filled from the file, one for each point, in the units of the scene", "1"),
    ] = ()

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("file"), str) or {"points", "values"} & data.keys():
            return data
        if data.get("time") is not None:
            what = "no points with the values of an instant"
            raise refusal(what, value=data["file"], remedy="name the results file and the instant in [initial_state]")
        columns = _as_list(data.get("columns", [1, 2, 3, 4, 5, 6]))
        if not isinstance(columns, list | tuple) or len(columns) != _COLUMNS or not all(map(is_column, columns)):
            return data
        rows = read_columns(base_dir_of(info.context), data["file"], columns)
        system = units_in(info.context)
        length, scale = factor(data.get("length_unit"), system), factor(data.get("unit"), system)
        points = tuple((length * r[0], length * r[1], length * r[2]) for r in rows)
        values = tuple((scale * r[3], scale * r[4], scale * r[5]) for r in rows)
        return {**data, "points": points, "values": values}

    @model_validator(mode="after")
    def _check_points(self) -> Self:
        if len(self.columns) != _COLUMNS:
            raise refusal("not six columns", value=list(self.columns), allowed="x, y, z and the three components")
        if not self.points or len(self.points) != len(self.values):
            counts = f"{len(self.points)} points, {len(self.values)} values"
            raise refusal("the field needs one value for each point", value=counts, allowed="one row or more")
        return self


class InitialStateTable(SceneTable):
    """Displacements and velocities of bodies at t = 0 from an instant of a results file with fields.

    The effective scene has them as `initial_displacement_field` and `initial_velocity_field` of the substructures. The
    file keeps them in single precision.
    """

    file: Annotated[Text, about("results file (.nc) of a run with output.fields = true, relative to the scene file")]
    time: Annotated[Real, about("instant of that run at which its fields were stored", "s", ge=0)]
    bodies: Annotated[
        tuple[BodyName, ...] | None,
        BeforeValidator(_as_list),
        about("substructures that start from this state, with the same names and meshes in that run; default: all"),
    ] = None


class VelocityFile(_FieldFile):
    """Velocities read from a file."""

    unit: Annotated[
        SpeedUnit, about("unit of the velocities: m/s, cm/s, mm/s, km/h, in/s, ft/s, or the factor to m/s", "m s-1")
    ] = "m/s"


class DisplacementFile(_FieldFile):
    """Displacements read from a file."""

    unit: Annotated[LengthUnit, about("unit of the displacements: m, cm, mm, um, in, ft, or the factor to m", "m")] = (
        "m"
    )


def field_problems(raw: Any) -> Iterator[Problem]:
    """Fields at t = 0 of a scene as written that bodies cannot have: rigid ones, and those of an equilibrium."""
    time = single_table(raw, "time")
    tightened = {table.get("substructure") for table in named_tables(raw, "bolt").values()}
    static = bool(tightened) or chosen_type(time, "start") == "static"
    for name, table in named_tables(raw, "substructure").items():
        for key in _given_fields(table):
            where, value = f"substructure.{name}.{key}", shown(table[key])
            if table.get("rigid") is True:
                remedy = "use initial_velocity, initial_spin and initial_displacement, or omit rigid"
                yield Problem(where, "a rigid body does not deform", value, "a uniform motion and a spin", remedy)
            elif time.get("quasi_static") is True:
                what = "without inertia every step is an equilibrium, whatever the motion at t = 0"
                yield Problem(where, what, value, None, "remove it, or omit quasi_static")
            elif key in DISPLACEMENT_FIELDS and static:
                what = "the displacements at t = 0 are those of the static equilibrium that the scene starts from"
                yield Problem(
                    where, what, value, None, 'remove it, or set time.start = "given" in a scene without bolts'
                )
            elif name in tightened:
                what = f"bolts are tightened at rest, before t = 0, and {name} is one"
                yield Problem(where, what, value, None, "remove it, or the bolt")


def _given_fields(table: RawTable) -> Iterator[str]:
    return (key for key in (*VELOCITY_FIELDS, *DISPLACEMENT_FIELDS) if given(table, key))
