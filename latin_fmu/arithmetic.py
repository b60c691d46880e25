"""Arithmetic that fails on absurd numbers, as an error that names what to check."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from .errors import SolverError


@contextmanager
def computable() -> Iterator[None]:
    """Context, or decorator: arithmetic that fails inside is a SolverError.

    Products of absurd numbers overflow or vanish in ways that no check of a single number foresees.
    """
    try:
        # absurd numbers overflow, which ends in an error or a status; other threads keep their settings
        with np.errstate(all="ignore"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise SolverError(
            f"arithmetic overflow or underflow with the numbers of the scene ({error.args[-1]}); "
            "check the units of materials, sizes, times and loads"
        ) from error
    except RuntimeError as error:  # how SuperLU reports a singular matrix
        if "singular" not in str(error):
            raise
        raise SolverError(
            "a matrix of the scene is singular: with generalized_alpha nodes of faces that may open have no mass, "
            "and a body with one layer of elements between such a face and a driven or fixed one has no other "
            'free node; use at least two layers of elements, or time.scheme = "hht"'
        ) from error
