"""Predicted memory of a run, before anything is factorised, and whether it fits.

Memory is compared with what this process may take. The sizes of arrays are counted; what the libraries take in between
(matrices while they are assembled, factors while they are computed, copies while results are written) is a factor on
them, measured on boxes and blocks (``tests/test_memory.py``). They are estimates to some 30 %: a run is refused only
where they exceed the room.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

from ..errors import SceneError
from ..kernels.energy_parts import TERMS
from ..machine import memory_room
from .cost import Prediction

STREAMED: Final = 64e6
"""Bytes of interface histories from which on a run that may do so keeps them in a file."""
IN_MEMORY: Final = 20_000
"""Instants of such histories that are kept in memory, at most."""
_CELL: Final = 15e3  # bytes of matrices and meshes per cell
_OPERATORS: Final = 2.2  # peak while operators are made, over their size
_COPIES: Final = 3.0  # stored fields: as they were kept, as one array, and while they are written
_LIBRARIES: Final = 15e6  # loaded after the set-up
_WIDEST: Final = 4.0  # columns of the table of convergence, over the mean number of iterations
_PARTS = ("operators and meshes", "histories of interfaces", "fields", "energies and sensors", "records of windows")


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes that a run needs, beside those that the process has taken: operators and meshes, histories of interfaces
    and their copies, stored fields, energies and sensors, records of the windows."""

    operators: float
    interfaces: float
    fields: float
    energies: float
    windows: float

    @property
    def total(self) -> float:
        """Sum of all parts, bytes."""
        return float(sum(vars(self).values()))

    def text(self) -> str:
        """The parts that count, largest first."""
        parts = zip(vars(self).values(), _PARTS, strict=True)
        shown = sorted((size, name) for size, name in parts if size >= 0.01 * self.total)
        return ", ".join(f"{name} {amount(size)}" for size, name in reversed(shown))


def amount(size: float) -> str:
    """Bytes as MB or GB."""
    return f"{size / 1e9:.3g} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"


def memory_need(p: Prediction, stream: bool = False) -> MemoryNeed:
    """Memory of the run of a prediction; ``stream`` : histories of interfaces may go to a file."""
    scene, run, units = p.scene, p.run, p.discretised.units
    output, n_time = scene.output, run.n_instant + 1
    members = sum(c.size.members for c in run.classes)
    cells = sum(c.size.members * c.cells for c in run.classes)
    nodes = sum(c.size.members * c.nodes for c in run.classes)
    points = sum(u.geometry.n_point for u in units)
    opening = sum(u.geometry.n_point for u in units if u.behaviour.opens)
    sliding = sum(u.geometry.n_point for u in units if u.behaviour.n_component == 1)
    most = max((u.geometry.n_point for u in units), default=0)
    kept = 2 * run.n_flat + opening + 6 * sliding
    instants = ceil(n_time / output.interfaces_every)
    if stream and 8.0 * kept * instants > STREAMED:
        instants = IN_MEMORY
    numbers = kept + 9 * points + opening + 15 * most  # as histories in global axes, and copies of one interface
    numbers += output.surfaces * (2 * points + 9 * most)
    per_cell = 6 * (output.stress + output.strain) + 3 * (output.principal_stress and output.stress)
    per_node = 6 * output.keeps_fields + 6 * output.nodal_stress
    per_node += 3 * (output.principal_stress and output.nodal_stress)
    stored = run.n_instant // run.every + 1 if output.keeps_fields or output.stress else 0
    terms = len(TERMS) * (2 * members + 2) + 12 + 6 * len(units) if output.energy else 0
    window = run.n_instant / run.window
    return MemoryNeed(
        operators=_LIBRARIES + _CELL * cells + _OPERATORS * p.memory,
        interfaces=8.0 * numbers * instants,
        fields=8.0 * _COPIES * stored * (per_cell * cells + per_node * nodes),
        energies=8.0 * n_time * (terms + 12 * (len(scene.sensor) + 2 * len(scene.port)) + 4),
        windows=window * (8.0 + 16.0 * run.iterations * (1.0 + _WIDEST)),
    )


def least_output(p: Prediction) -> float:
    """Bytes that the results file takes at least, where its numbers are packed to a tenth."""
    need = memory_need(p)
    return 0.1 * (0.5 * need.interfaces + 0.5 * need.fields / _COPIES + need.energies)


def memory_line(p: Prediction, stream: bool = False) -> str:
    """A line on the memory that a run needs and may take."""
    need, (room, limit) = memory_need(p, stream), memory_room()
    free = f"; {amount(room)} may be taken ({limit})" if limit else ""
    return f"memory: about {amount(need.total)} ({need.text()}){free}"


def check_memory(p: Prediction, stream: bool = False) -> None:
    """Make sure that a run fits in the memory that this process may take.

    Raises
    ------
    SceneError : it does not; with the numbers, and settings with which it would.
    """
    need, (room, limit) = memory_need(p, stream), memory_room()
    if limit and need.total > room:
        raise SceneError.of(
            "the scene cannot be solved here",
            "memory",
            "the run needs more memory than it may take",
            f"about {amount(need.total)}: {need.text()}",
            f"{amount(max(room, 0.0))} ({limit})",
            _remedy(p, need, room),
        )


def _remedy(p: Prediction, need: MemoryNeed, room: float) -> str:
    """Settings with which the run fits: of fields first, then of interfaces and energies, then of operators."""
    output, settings = p.scene.output, []
    left = need.total
    for part, keys, every in (
        ("fields", ("fields", "stress", "strain", "nodal_stress", "principal_stress"), "every"),
        ("energies", ("energy",), None),
        ("interfaces", (), "interfaces_every"),
    ):
        size = getattr(need, part)
        if left <= room or size < 0.01 * need.total:
            continue
        others = left - size
        if every is not None and others < 0.8 * room:
            factor = ceil(size / (0.8 * room - others))
            settings.append(f"output.{every} = {factor * getattr(output, every)}")
            left = others + size / factor
        else:
            settings += [f"output.{key} = false" for key in keys if getattr(output, key)]
            left = others if keys else left
    if left > room:
        operators = need.operators > 0.5 * room
        settings.append("a coarser mesh" if operators else "fewer instants (time.instants)")
    return f"it fits with {' and '.join(settings)}" if left <= room else f"use {', '.join(settings)}"
