"""Tables in the image of a run that are products of a few numbers and another table: a file has the numbers alone.

Of an assembly that is marched by its modes (``joined.reduced_assembly``) three tables on the relative motions have rows
that are sums of the m rows of G, as long as there are relative motions: the rows of the stiffness lambda of zeta - G r,
those of its damping, and the part of the factor below the modes. The first is kept, and of the others, a file has
(k, m) factors. They follow from these to round-off; a run has them as they come from the file (``settled``), so that
a session and an FMU have the same bits.

A product is ``HEAD`` words, in their order, and then its factors row by row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import scipy.linalg as la

from ..latin.outcome import Array
from ..propagator.patches import leave_out_digits

HEAD: Final = (
    *("target", "target_row", "target_column", "rows", "columns"),
    *("source", "source_row", "source_column", "terms"),
)
"""Words of a product: places of the first numbers in the fixed block, what is between rows and between columns, and
the numbers of rows, columns and factors of a row."""
_ROUND_OFF: Final = 1e-14  # of the largest number of a row
OF_RESPONSE: Final = 8e-5
OF_INVERSE: Final = 2e-7
"""Rounding of Y and S^-1 at the default tolerance of the iteration, ``_TOLERANCE``, or a looser one, in proportion at a
tighter one: outputs change by less than a tenth of what the tolerance leaves open."""
_TOLERANCE: Final = 1e-3
_SHOWN: Final = 2.0**-26
"""Relative step of numbers of the matrix of outputs."""
_WORTH: Final = 3  # times as many numbers as factors that a table has at least


class StridedTable(NamedTuple):
    """A table (rows, columns) in the fixed block: place of its first number, and what is between rows and columns."""

    place: int
    row: int
    column: int
    rows: int
    columns: int

    def of(self, fixed: Array) -> Array:
        """A view of it in a fixed block."""
        strides = tuple(fixed.itemsize * apart for apart in (self.row, self.column))
        return np.lib.stride_tricks.as_strided(fixed[self.place :], (self.rows, self.columns), strides)


@dataclass(frozen=True)
class Product:
    """A table that is ``factors`` (rows, terms) times a source."""

    target: StridedTable
    source: StridedTable
    factors: Array

    @property
    def words(self) -> Array:
        """Its words in a file, those of ``HEAD`` as whole numbers."""
        first, then = self.target, self.source
        head = first.place, first.row, first.column, first.rows, first.columns, *then[:3], then.rows
        return np.concatenate([np.array(head, dtype="<i8").view("<f8"), self.factors.ravel()])


def products(classes: Any, fixed: Array) -> Iterator[Product]:
    """Tables of the records of classes in a fixed block that need not be kept."""
    for row in classes:
        source = _stiffness_rows(row)
        for target in _tables_beside(row, fixed):
            found = _product(target, source, fixed)
            if found is not None:
                yield found


def settled(classes: Any, fixed: Array) -> list[Product]:
    """``products`` of a run, whose tables are set to what they give."""
    found = list(products(classes, fixed))
    for product in found:
        _fill(product, fixed)
    return found


def shorten(run: Any, classes: Any, fixed: Array, tolerance: float) -> None:
    """Leave out digits that neither the iteration nor an output of a run by modes shows: of Y and S^-1 in patches, and
    of the matrix of the outputs, which multiplies motions of single precision. A file could not compress them.

    tolerance : of the iteration, on sqrt(eta).
    """
    share = min(tolerance / _TOLERANCE, 1.0)
    whole, single = fixed.view(np.int64), fixed.view(np.float32)
    for row in classes:
        for header, numbers, there, rounding in (
            ("inverse_header", "schur_inverse", row["patched"], OF_INVERSE),
            ("response_header", "response", row["patched"] and row["halved"], OF_RESPONSE),
        ):
            if there:
                leave_out_digits(whole[int(row[header]) :], single[int(row[numbers]) :], share * rounding)
    end = fixed.view(np.int64)[int(run["output_starts"] + run["output_rows"])]
    values = fixed[int(run["output_values"]) :][:end]
    digits, powers = np.frexp(values)
    values[:] = np.ldexp(np.rint(digits / _SHOWN) * _SHOWN, powers)


def _fill(product: Product, fixed: Array) -> None:
    """Set the table of a product, in the order of sums of image.c."""
    target = product.target.of(fixed)
    target[:] = 0.0
    for factors, row in zip(product.factors.T, product.source.of(fixed), strict=True):
        target += factors[:, None] * row


def without(fixed: Array, found: list[Product]) -> Array:
    """The fixed block with zeros in the place of products, a copy where there are some."""
    if not found:
        return fixed
    left = fixed.copy()
    for product in found:
        product.target.of(left)[:] = 0.0
    return left


def multiply(words: Array, fixed: Array) -> None:
    """Fill in the products that a file has in ``words``."""
    at, whole = 0, words.view("<i8")
    while at < len(words):
        head = dict(zip(HEAD, whole[at : at + len(HEAD)].tolist(), strict=True))
        at += len(HEAD)
        rows, columns, terms = head["rows"], head["columns"], head["terms"]
        target = StridedTable(head["target"], head["target_row"], head["target_column"], rows, columns)
        source = StridedTable(head["source"], head["source_row"], head["source_column"], terms, columns)
        _fill(Product(target, source, words[at : at + rows * terms].reshape(rows, terms)), fixed)
        at += rows * terms


def _stiffness_rows(row: Any) -> StridedTable:
    """Rows of the stiffness of the modes of a class on its interface dofs, which are its last."""
    n, size = int(row["n"]), int(row["n_inner"])
    return StridedTable(int(row["elastic_rows"]) + n - size, n, 1, int(row["n_elastic"] - row["n_inertial"]), size)


def _tables_beside(row: Any, fixed: Array) -> Iterator[StridedTable]:
    """Those of damping, and those below the supernodes of the factor, of a class with a stiffness of its face."""
    n, size = int(row["n"]), int(row["n_inner"])
    if not row["on_face"] or not size or row["n_elastic"] <= row["n_inertial"]:
        return
    if row["n_viscous"]:
        yield StridedTable(int(row["viscous_rows"]) + n - size, n, 1, int(row["n_viscous"]), size)
    if row["single"]:
        return
    whole, count = fixed.view(np.int64), int(row["n_super"]) + 1
    first, starts, places = (whole[row[name] : row[name] + count] for name in ("first", "row_start", "panel_start"))
    for s in range(count - 1):
        width, below = int(first[s + 1] - first[s]), int(starts[s + 1] - starts[s])
        if below >= size:  # interface dofs are the last ones
            at = int(row["panels"] + places[s]) + width * (width + below - size)
            yield StridedTable(at, 1, width, width, size)


def _product(target: StridedTable, source: StridedTable, fixed: Array) -> Product | None:
    """The table as a product with the source, None where it is none to round-off, or not worth it."""
    wanted, given = target.of(fixed), source.of(fixed)
    if target.columns < _WORTH * source.rows:
        return None
    sizes = np.linalg.norm(given, axis=1)
    there = sizes > 0.0
    factors = np.zeros((target.rows, source.rows))
    factors[:, there] = la.lstsq((given[there] / sizes[there, None]).T, wanted.T)[0].T / sizes[there]
    off = np.abs(factors @ given - wanted).max(axis=1)
    if (off > _ROUND_OFF * np.abs(wanted).max(axis=1)).any():
        return None
    return Product(target, source, factors)
