"""Seconds of CPU that elementary operations take, on one core of a common server.

Measured: ``examples/cost_model.py --fit`` runs some hundred scenes, fits these numbers to their times and prints them
as they stand here. On another machine all change by about the same factor, so that shares and comparisons keep.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

CACHE: Final = 16e6
"""Bytes of operators and states that one core keeps at hand; what is beyond comes from memory every instant."""

SECONDS: Final[Mapping[str, float]] = MappingProxyType(
    {
        # set-up, once
        "run": 0.00611,
        "body": 0.000813,
        "class": 0.00188,
        "interface": 0.0025,
        "cell": 5.11e-05,
        "unknown": 0,
        "flop": 7.28e-11,
        "cube": 1.1e-11,
        "square": 0,
        "solved": 6.47e-10,
        "start": 2.04e-08,
        # an instant of the compiled march
        "march": 0,
        "vector": 5.89e-09,
        "sparse": 4.38e-10,
        "sweep": 1.01e-10,
        "dense": 1.12e-10,
        "beyond": 4.05e-11,
        "many_vector": 3.86e-09,
        "many_sparse": 2.87e-10,
        "many_sweep": 6.64e-11,
        "many_dense": 7.32e-11,
        "history": 3.11e-08,
        "bonds": 3.09e-10,
        # around the march: histories of a run, of each interface; velocities of sides without tangential unknowns
        "finish": 0.0031,
        "result": 0,
        "probe": 0.00106,
        "probe_value": 3.72e-08,
        # an instant in the interpreter
        "call": 0,
        "turn": 9.28e-05,
        "column": 1e-07,
        # what is kept
        "energy": 9.75e-05,
        "energy_entry": 1.8e-09,
        "field": 3.04e-05,
        "field_node": 2.64e-08,
        "stress": 3.64e-05,
        "stress_cell": 1.95e-07,
    }
)
