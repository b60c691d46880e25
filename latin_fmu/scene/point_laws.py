"""Time laws given by points, in the scene or in a file: linear in between, held at both ends."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationInfo, model_validator

from .fields import Series, Table, Text, about, refusal
from .law_file import base_dir_of, read_law_file

Array = NDArray[np.float64]
Points = tuple[float, ...]


def _interpolated(t: ArrayLike, times: Points, values: Points) -> Array:
    return np.asarray(np.interp(np.asarray(t, dtype=np.float64), times, values), dtype=np.float64)


def _integral(t0: float, t1: float, times: Points, values: Points) -> float:
    knots = np.asarray(times)
    t = np.concatenate(([t0], knots[(knots > t0) & (knots < t1)], [t1]))
    return float(np.trapezoid(_interpolated(t, times, values), t))


def _check_points(times: Points, values: Points) -> None:
    if len(times) < 2:
        raise refusal("a table needs two points or more", value=len(times), allowed="at least 2 times")
    if len(times) != len(values):
        raise refusal(
            "times and values differ in number",
            value=f"{len(times)} times, {len(values)} values",
            allowed="one value per time",
        )
    t = np.asarray(times)
    falls = np.flatnonzero(t[1:] <= t[:-1])
    if falls.size:
        i = int(falls[0])
        raise refusal(
            "times do not increase",
            value=f"times[{i + 1}] = {times[i + 1]!r} after {times[i]!r}",
            allowed="strictly increasing times",
            remedy="write a jump as two close times",
        )


class TableLaw(Table):
    """Given points, linear in between, held at both ends."""

    type: Literal["table"] = "table"
    times: Annotated[Series, about("strictly increasing times, two or more", "s")]
    values: Annotated[Series, about("a at these times", "1")]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_points(self.times, self.values)
        return self

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return _interpolated(times, self.times, self.values)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return _integral(t0, t1, self.times, self.values)


class CsvLaw(Table):
    """Points read from a file of two columns, time (s) and value; linear in between, held at both ends.

    The points are kept with the scene (`times`, `values`), which no longer needs the file afterwards.
    """

    type: Literal["csv"] = "csv"
    file: Annotated[Text, about("file, relative to the scene file; a header line is allowed")]
    times: Annotated[Series, about("filled from the file; where given, the file is not read", "s")] = ()
    values: Annotated[Series, about("filled from the file", "1")] = ()

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        if isinstance(data, dict) and isinstance(data.get("file"), str) and not {"times", "values"} & data.keys():
            times, values = read_law_file(base_dir_of(info.context), data["file"])
            return {**data, "times": times, "values": values}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_points(self.times, self.values)
        return self

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return _interpolated(times, self.times, self.values)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return _integral(t0, t1, self.times, self.values)
