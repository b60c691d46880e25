"""Groups of a results file as plain arrays: what xarray shows and netCDF stores, without either."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

Columns = dict[str, tuple[object, ...]]


@dataclass
class Variable:
    """An array with the names of its dimensions and its attributes."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: dict[str, Any] = field(default_factory=dict)


@dataclass
class Group:
    """Variables of one group; ``labels`` names the coordinates among them.

    A coordinate with the name of its only dimension labels what lies along it, in the groups below too.
    """

    variables: dict[str, Variable]
    labels: frozenset[str] = frozenset()
    attrs: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, columns: Columns, coordinates: Mapping[str, object] | None = None, attrs: dict[str, Any] | None = None
    ) -> Group:
        """From (dimensions, values) by name, and labels along dimensions by the name of the dimension."""
        given = {**columns, **(coordinates or {})}
        made: dict[str, Variable] = {}
        for name, entry in given.items():
            dims, values = entry if isinstance(entry, tuple) else (name, entry)
            names = (dims,) if isinstance(dims, str) else tuple(dims)
            made[name] = Variable(names, np.asarray(values))
        return cls(made, frozenset(coordinates or ()), attrs or {})

    @classmethod
    def of_dataset(cls, dataset: xr.Dataset) -> Group:
        """From xarray."""
        variables = {
            str(name): Variable(tuple(map(str, v.dims)), v.values, dict(v.attrs))
            for name, v in dataset.variables.items()
        }
        return cls(variables, frozenset(map(str, dataset.coords)), dict(dataset.attrs))

    def dataset(self) -> xr.Dataset:
        """For xarray."""
        import xarray as xr

        made = {name: (v.dims, v.values, v.attrs) for name, v in self.variables.items()}
        data = {name: v for name, v in made.items() if name not in self.labels}
        return xr.Dataset(data, {name: made[name] for name in made if name in self.labels}, self.attrs)

    def indexes(self) -> dict[str, Variable]:
        """Coordinates that label their own dimension."""
        return {name: v for name, v in self.variables.items() if name in self.labels and v.dims == (name,)}

    def sizes(self) -> dict[str, int]:
        """Length of every dimension, in the order of the variables."""
        found: dict[str, int] = {}
        for variable in self.variables.values():
            found.update(zip(variable.dims, variable.values.shape, strict=True))
        return found


def _by_depth(paths: Iterable[str]) -> list[str]:
    """Paths and those above them, level by level as xarray lists them."""

    def depth(path: str) -> int:
        return len(PurePosixPath(path).parts)

    given = sorted(paths, key=depth)
    found = {str(p): None for path in given for p in (*reversed(PurePosixPath(path).parents), path)}
    return sorted(found, key=depth)


def with_labels(groups: Mapping[str, Group]) -> Iterator[tuple[str, Group]]:
    """Groups by path, with the labels of their dimensions from the groups above where they have none of their own."""
    for path in _by_depth(groups):
        group = groups.get(path) or Group({})
        above = [groups[str(p)] for p in PurePosixPath(path).parents if str(p) in groups]
        handed = {name: v for other in reversed(above) for name, v in other.indexes().items()}
        sizes = group.sizes()
        missing = {name: v for name, v in handed.items() if name in sizes and name not in group.variables}
        yield path, Group({**group.variables, **missing}, group.labels | set(missing), group.attrs)
