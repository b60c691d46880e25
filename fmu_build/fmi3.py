"""FMI 3.0 adapter: the functions the exporter's library calls, handed on to the participant."""

from __future__ import annotations

import ctypes
from typing import Any

from .co_simulation_adapter import CoSimulationAdapter


class Fmi3Adapter(CoSimulationAdapter):
    """Mixed into ``Fmi3Slave``. The exporter drops start time, stop time and tolerance."""

    def get_float64(self, references: list[int]) -> list[float]:
        """Reals and arrays of reals."""
        return self._numbers(references)

    def get_int32(self, references: list[int]) -> list[int]:
        """Integers."""
        return [int(value) for value in self._numbers(references)]

    def get_uint64(self, references: list[int]) -> list[Any]:
        """Sizes."""
        return [ctypes.c_uint64(int(value)) for value in self._numbers(references)]

    def set_float64(self, references: list[int], values: list[float]) -> None:
        """Reals and arrays of reals."""
        self._set_numbers(references, values)

    def set_int32(self, references: list[int], values: list[int]) -> None:
        """Integers."""
        self._set_numbers(references, values)

    def set_uint64(self, references: list[int], values: list[int]) -> None:
        """Sizes."""
        self._set_numbers(references, values)
