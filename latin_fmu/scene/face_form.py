"""Form of the faces of an interface: what they deviate from their meshes, added to the gap.

The form is a distance along N over the place on the face, as it is measured on both faces together. At a point x with
the unit normal N, seen from the centre c,

    r = (x - c) - ((x - c) . N) N

and x_1, x_2 are the components of r along two directions of the table. Only distances count: which of the two faces
bears the form makes no difference to contact at small displacements.
"""

from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from .fields import Direction, LocalAxes, Real, SceneTable, Series, Text, Vector, _as_list, about, refusal, units_in
from .laws import base_dir_of
from .number_files import Column, LengthUnit, factor, is_column, read_columns

Array = NDArray[np.float64]
_CENTRE: Final = "where the form is measured from, in the place of the middle of the points of the interface"
_AXES: Final = "directions of x and y on the face"
_MOST: Final = 13  # powers of a polynomial along x and along y, from 0
_BEYOND: Final = 1e-9  # of the extent of a table: points that far outside lie on its edge
_Rows = Annotated[tuple[Series, ...], BeforeValidator(_as_list)]


def _on_face(points: Array, normals: Array, centre: Array) -> Array:
    """Places (n, 3) along the face, from the centre."""
    r = points - centre
    along: Array = r - np.einsum("pi,pi->p", r, normals)[:, None] * normals
    return along


class Crown(SceneTable):
    """A crown of the faces, in the parabola of Hertz: r^2 / (2 radius) all around the centre; with an `axis` across it
    only, plus the square along it over 2 `radius_along` where that is given.

    The radius is that of both faces together: 1 / radius = 1 / R + 1 / R'.
    """

    type: Literal["crown"] = "crown"
    radius: Annotated[Real, about("radius of the crown", "m", gt=0)]
    axis: Annotated[Direction | None, about("axis of a cylinder; a sphere if omitted", "1")] = None
    radius_along: Annotated[Real | None, about("radius of the sections along that axis", "m", gt=0)] = None
    centre: Annotated[Vector | None, about(_CENTRE, "m")] = None

    @model_validator(mode="after")
    def _check_axis(self) -> Self:
        if self.radius_along is not None and self.axis is None:
            raise refusal("radius_along without an axis", value=self.radius_along, remedy="give the axis")
        return self

    @property
    def directions(self) -> Array:
        """Unit vectors (n, 3) that lie in the face."""
        if self.axis is None:
            return np.zeros((0, 3))
        direction: Array = np.array([self.axis]) / np.linalg.norm(self.axis)
        return direction

    def sample(self, points: Array, normals: Array, centre: Array) -> Array:
        """Form at points (n, 3) with unit normals (n, 3), (n,), m; ``centre`` (3,) where the table names none."""
        r = _on_face(points, normals, centre)
        squares: Array = np.einsum("pi,pi->p", r, r)
        if self.axis is None:
            return squares / (2 * self.radius)
        along: Array = (r @ self.directions[0]) ** 2
        rise = (squares - along) / (2 * self.radius)
        if self.radius_along is None:
            return rise
        return rise + along / (2 * self.radius_along)


class Polynomial(SceneTable):
    """Sum of c_ij x^i y^j, less its smallest value at the points of the interface: the faces touch there."""

    type: Literal["polynomial"] = "polynomial"
    coefficients: Annotated[
        _Rows, about("rows i = 0, 1, ... (power of x) of c_ij, j = 0, 1, ... (power of y), in m^(1 - i - j)", "m")
    ]
    axes: Annotated[LocalAxes, about(_AXES)]
    centre: Annotated[Vector | None, about(_CENTRE, "m")] = None

    @classmethod
    def unit_of_item(cls, key: str, _: Any, __: str, index: tuple[int, ...]) -> str:
        """Unit of a coefficient by its powers: c_ij x^i y^j is a length."""
        if key == "coefficients":
            power = 1 - sum(index)
        else:
            power = 1
        if power not in (0, 1):
            return f"m{power}"
        if power:
            return "m"
        return "1"

    @model_validator(mode="after")
    def _check_powers(self) -> Self:
        lengths = (len(self.coefficients), *map(len, self.coefficients))
        if not any(lengths[1:]) or max(lengths) > _MOST:
            raise refusal("too few or too many powers", value=max(lengths), allowed=f"1 to {_MOST} rows and columns")
        return self

    @property
    def directions(self) -> Array:
        """Unit vectors (2, 3) of x and y, which lie in the face."""
        return np.array(self.axes.rows[:2])

    def sample(self, points: Array, normals: Array, centre: Array) -> Array:
        """Form at points (n, 3) with unit normals (n, 3), (n,), m; ``centre`` (3,) where the table names none."""
        x, y = (_on_face(points, normals, centre) @ self.directions.T).T
        rise = np.zeros(len(points))
        for i, row in enumerate(self.coefficients):
            for j, c in enumerate(row):
                rise += c * x**i * y**j
        values: Array = rise - rise.min()
        return values


class FaceTable(SceneTable):
    """Values over a grid of x and y, bilinear in between, less the smallest value at the points of the interface: the
    faces touch there. Points outside the grid are an error.

    In a file every row is a point of the grid, x, y and value, in any order.
    """

    type: Literal["table"] = "table"
    axes: Annotated[LocalAxes, about(_AXES)]
    centre: Annotated[Vector | None, about(_CENTRE, "m")] = None
    file: Annotated[
        Text | None, about("file of the grid, relative to the scene file; lines above the numbers are its header")
    ] = None
    columns: Annotated[
        tuple[Column, Column, Column],
        BeforeValidator(_as_list),
        about("columns of x, y and value in the file: names in the header, or numbers from 1", "1"),
    ] = (1, 2, 3)
    length_unit: Annotated[
        LengthUnit, about("unit of x and y in the file, or the factor to the units of the scene", "1")
    ] = "m"
    value_unit: Annotated[
        LengthUnit, about("unit of the values in the file, or the factor to the units of the scene", "1")
    ] = "m"
    x: Annotated[Series, about("increasing places along x, two or more; filled from a file", "m")] = ()
    y: Annotated[Series, about("increasing places along y, two or more; filled from a file", "m")] = ()
    values: Annotated[_Rows, about("a row for every x, with a value for every y; filled from a file", "m")] = ()

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("file"), str) or {"x", "y", "values"} & data.keys():
            return data
        columns = data.get("columns", [1, 2, 3])
        if not (isinstance(columns, list | tuple) and len(columns) == 3 and all(is_column(c) for c in columns)):
            return data
        rows = read_columns(base_dir_of(info.context), data["file"], list(columns))
        system = units_in(info.context)
        length, height = (factor(data.get(key, "m"), system) for key in ("length_unit", "value_unit"))
        grid = {(length * row[0], length * row[1]): height * row[2] for row in rows}
        x, y = (tuple(sorted({place[i] for place in grid})) for i in (0, 1))
        # fewer places than rows: one is there twice
        if len(grid) < len(rows) or len(grid) < len(x) * len(y):
            raise refusal(
                "the points of the file are no grid",
                value=f"{len(rows)} rows, {len(x)} different x, {len(y)} different y",
                allowed="one row for every pair of an x and a y",
            )
        return {**data, "x": x, "y": y, "values": tuple(tuple(grid[a, b] for b in y) for a in x)}

    @model_validator(mode="after")
    def _check_grid(self) -> Self:
        for name, places in (("x", self.x), ("y", self.y)):
            if len(places) < 2 or not bool((np.diff(places) > 0).all()):
                raise refusal(f"{name} is no increasing series", value=list(places[:4]), allowed="two or more")
        if len(self.values) != len(self.x) or any(len(row) != len(self.y) for row in self.values):
            lengths = sorted({len(row) for row in self.values})
            raise refusal(
                "values do not fit x and y",
                value=f"{len(self.values)} rows of {', '.join(map(str, lengths)) or 'no'} values",
                allowed=f"{len(self.x)} rows (x) of {len(self.y)} values (y)",
            )
        return self

    @property
    def directions(self) -> Array:
        """Unit vectors (2, 3) of x and y, which lie in the face."""
        return np.array(self.axes.rows[:2])

    def sample(self, points: Array, normals: Array, centre: Array) -> Array:
        """Form at points (n, 3) with unit normals (n, 3), (n,), m, NaN outside the grid; ``centre`` (3,) where the
        table names none."""
        at = _on_face(points, normals, centre) @ self.directions.T
        place, inside = [], np.ones(len(points), dtype=bool)
        for along, knots in zip(at.T, (np.asarray(self.x), np.asarray(self.y)), strict=True):
            beyond = _BEYOND * (knots[-1] - knots[0])
            inside &= (along >= knots[0] - beyond) & (along <= knots[-1] + beyond)
            # a place on the last knot belongs to the cell before it
            cell = np.clip(np.searchsorted(knots, along, side="right") - 1, 0, len(knots) - 2)
            place.append((cell, np.clip((along - knots[cell]) / (knots[cell + 1] - knots[cell]), 0.0, 1.0)))
        (i, s), (j, t) = place
        z = np.asarray(self.values)
        rise = (1 - s) * ((1 - t) * z[i, j] + t * z[i, j + 1]) + s * ((1 - t) * z[i + 1, j] + t * z[i + 1, j + 1])
        values: Array = np.where(inside, rise, np.nan)
        return values - (values[inside].min() if inside.any() else 0.0)


FaceForm = Annotated[Crown | Polynomial | FaceTable, Field(discriminator="type")]
