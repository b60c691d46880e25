"""FMI 3.0 adapter: the functions the exporter's library calls, handed on to the participant."""

from __future__ import annotations

import ctypes
from typing import Any

from .adapter import Adapter


class Fmi3Adapter(Adapter):
    """Mixed into ``Fmi3Slave``. The exporter drops start time, stop time and tolerance."""

    def exit_initialization_mode(self) -> None:
        """Build; a failure is logged, and every step refused."""
        self.participant.initialize()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """False is a discard."""
        return bool(self.participant.step(current_time, step_size))

    def terminate(self) -> None:
        """Write results, where asked for."""
        self.participant.terminate()

    def get_float64(self, references: list[int]) -> list[float]:
        """Reals and arrays of reals."""
        found = list(self.participant.get(references))
        missing = self.participant.size(references) - len(found)
        return found + [0.0] * missing  # the library reads that many

    def get_int32(self, references: list[int]) -> list[int]:
        """Integers."""
        return [int(value) for value in self.get_float64(references)]

    def get_uint64(self, references: list[int]) -> list[Any]:
        """Sizes."""
        return [ctypes.c_uint64(int(value)) for value in self.get_float64(references)]

    def get_string(self, references: list[int]) -> list[str]:
        """Strings."""
        found = list(self.participant.get_texts(references))
        return found if len(found) == len(references) else [""] * len(references)

    def set_float64(self, references: list[int], values: list[float]) -> None:
        """Reals and arrays of reals."""
        self.participant.set(references, values)

    def set_int32(self, references: list[int], values: list[int]) -> None:
        """Integers."""
        self.participant.set(references, values)

    def set_uint64(self, references: list[int], values: list[int]) -> None:
        """Sizes."""
        self.participant.set(references, values)

    def set_string(self, references: list[int], values: list[str]) -> None:
        """Strings."""
        self.participant.set_texts(references, values)
