"""Largest stresses at the nodes of the bodies of a run: von Mises and principal, everywhere and away from edges of
contacts, during the run and at its start, when the bolts are tight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..fem.elasticity import von_mises
from ..fem.elements import principal
from ..latin.outcome import Array, Outcome, SubstructureHistory
from ..scene.readable_numbers import readable, readable_vector
from ..scene.units import UnitSystem
from .dataset import Recovered
from .groups import finite

_AT_ONCE: Final = 4_000_000  # numbers of the stresses of some instants, about 30 MB
_ALIKE: Final = 0.01  # of the largest value: stresses that differ by less are said once
KINDS: Final = ("von_mises", "principal")
"""Von Mises stress, and the largest principal stress."""


@dataclass(frozen=True)
class PeakStress:
    """A largest stress of a body: Pa, its instant, s, and place (3,), m, in the reference configuration."""

    stress: float
    time: float
    place: Array

    def report(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {"stress": finite(self.stress), "time": finite(self.time), "place": [finite(x) for x in self.place]}


@dataclass(frozen=True)
class LargestStressesAt:
    """Largest stresses of one kind over some instants: ``everywhere``, and ``away`` from edges of contacts and supports
    (None where every cell touches one)."""

    everywhere: PeakStress
    away: PeakStress | None


@dataclass(frozen=True)
class BodyStresses:
    """Largest stresses of a body by kind (``KINDS``): at the start, and over all stored instants."""

    start: Mapping[str, LargestStressesAt]
    run: Mapping[str, LargestStressesAt]

    def report(self) -> dict[str, Any]:
        """Plain data: ``start`` and ``run``, of each the kinds, ``everywhere`` and ``away``."""

        def of(found: LargestStressesAt) -> dict[str, Any]:
            away = None
            if found.away is not None:
                away = found.away.report()
            return {"everywhere": found.everywhere.report(), "away_from_contact_edges": away}

        return {when: {kind: of(found) for kind, found in getattr(self, when).items()} for when in ("start", "run")}


def body_stresses(outcome: Outcome, recovered: Mapping[str, Recovered]) -> dict[str, BodyStresses]:
    """Largest stresses by body, of those whose stresses at the nodes the scene requests."""
    found = {}
    for name, history in outcome.substructures.items():
        request = recovered.get(name)
        if request is not None and request.nodal_stress and history.displacement is not None and len(history.time):
            found[name] = _of_body(history, request)
    return found


def _of_body(history: SubstructureHistory, request: Recovered) -> BodyStresses:
    tables = {kind: np.full((2, len(history.time)), -np.inf) for kind in KINDS}
    nodes = {kind: np.zeros((2, len(history.time)), dtype=np.int64) for kind in KINDS}
    away = np.ones(len(history.nodes), dtype=bool)
    if history.marks is not None:
        away = ~history.marks.contact_edge
    for instants, stress in _blocks(history, request):
        for row, chosen in enumerate((np.arange(len(away)), np.flatnonzero(away))):
            for i, six in enumerate(stress[:, chosen], instants.start):
                for kind in KINDS if len(chosen) else ():
                    node, tables[kind][row, i] = largest_of(six, kind)
                    nodes[kind][row, i] = chosen[node]

    def over(kind: str, instants: slice) -> LargestStressesAt:
        peaks: list[PeakStress | None] = []
        for values, numbers in zip(tables[kind][:, instants], nodes[kind][:, instants], strict=True):
            i = int(values.argmax())
            peak = PeakStress(float(values[i]), float(history.time[instants][i]), history.nodes[numbers[i]])
            peaks.append(peak if np.isfinite(peak.stress) else None)
        assert peaks[0] is not None
        return LargestStressesAt(peaks[0], peaks[1])

    return BodyStresses(
        {kind: over(kind, slice(0, 1)) for kind in KINDS}, {kind: over(kind, slice(None)) for kind in KINDS}
    )


def _blocks(history: SubstructureHistory, request: Recovered) -> Iterator[tuple[slice, Array]]:
    """Stresses (n, n_node, 6) of some instants at a time."""
    displacement = history.displacement
    assert displacement is not None
    size = max(1, _AT_ONCE // (6 * len(history.nodes)))
    for first in range(0, len(history.time), size):
        instants = slice(first, min(first + size, len(history.time)))
        yield instants, request.stress_at_nodes(displacement[instants], history.time[instants])


def stress_of(six: Array, kind: str) -> Array:
    """One of ``KINDS`` (n,), Pa, of stresses (n, 6)."""
    if kind == "von_mises":
        return von_mises(six)
    return np.asarray(principal(six)[:, 0])


def largest_of(six: Array, kind: str) -> tuple[int, float]:
    """Number and value of the largest of stresses (n, 6) by one of ``KINDS``, Pa."""
    size = von_mises(six)
    if kind == "von_mises":
        number = int(size.argmax())
        return number, float(size[number])
    return largest_principal(six, size)


def largest_principal(stress: Array, mises: Array) -> tuple[int, float]:
    """Node and value of the largest principal stress of some (n, 6); ``mises`` (n,) of the same.

    A principal value is at most the mean stress and 2/3 of the von Mises stress: values are computed where this bound
    exceeds the value at its largest alone.
    """
    bound = stress[:, :3].mean(axis=1) + 2.0 / 3.0 * mises
    first = int(bound.argmax())
    reached = float(principal(stress[first])[0])
    # at least the one of the largest bound, which round-off might exclude
    candidates = np.union1d(np.flatnonzero(bound >= reached), first)
    values = principal(stress[candidates])[:, 0]
    best = int(values.argmax())
    return int(candidates[best]), float(values[best])


def largest_body(found: Mapping[str, BodyStresses]) -> str | None:
    """The body with the largest von Mises stress of the run, away from edges of contacts where there is any; None
    without stresses."""

    def size(name: str) -> float:
        largest = found[name].run["von_mises"]
        return (largest.away or largest.everywhere).stress

    return max(found, key=size, default=None)


def stress_rows(found: Mapping[str, BodyStresses], units: UnitSystem) -> list[tuple[str, str]]:
    """Name and text of every body: the largest von Mises stress with and without cells at edges of contacts, where and
    when; both at the start, too, and of the largest principal stress."""
    rows = []
    for name, of in found.items():
        largest, start = of.run["von_mises"], of.start["von_mises"]
        clauses = [f"von Mises stress up to {_placed(largest.everywhere, units)}"]
        if largest.away is None:
            clauses.append("every cell touches the edge of a contact")
        elif largest.away.stress < (1.0 - _ALIKE) * largest.everywhere.stress:
            clauses.append(f"away from edges of contacts {_placed(largest.away, units)}")
        if largest.everywhere.time > start.everywhere.time:
            clauses.append(f"at the start {_both(start, units)}")
        clauses.append(f"largest principal stress {_both(of.run['principal'], units)}")
        rows.append((f"body {name}", "; ".join(clauses)))
    return rows


def _placed(peak: PeakStress, units: UnitSystem) -> str:
    """A stress, where and when."""
    place = readable_vector(peak.place.tolist(), units.label("m"), 3)
    return f"{_size(peak, units)} at {place}, {readable(peak.time, 's', 3)}"


def _both(found: LargestStressesAt, units: UnitSystem) -> str:
    """A stress and, where it is another, the one away from edges of contacts."""
    there = _size(found.everywhere, units)
    if found.away is None or found.away.stress >= (1.0 - _ALIKE) * found.everywhere.stress:
        return there
    return f"{there} (away {_size(found.away, units)})"


def _size(peak: PeakStress, units: UnitSystem) -> str:
    return readable(peak.stress, units.label("Pa"), 3)
