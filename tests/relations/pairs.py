"""Pairs of runs that must agree: comparison, named exemptions, and the table of both."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from .random_scenes import Tables
from .relations import Apart, Relation, Results, Run, distances, load_of, run

SHARE: Final = 0.05
"""Of all pairs: what a reason may cover at most."""
EXEMPT: Final = {
    "not converged": "one of both runs reports that it has not converged: it promises nothing",
    "sides alike": "the points of an interface are those of a side that nothing tells from the other one, and a remark "
    "says so: swapped, or with one of the bodies cut in two, they are those of the other side",
}
SAID: Final = "points are those of side E: facets, stiffness and volume"
OPENING: Final = ("contact", "no_slip", "soft_contact")
"""Laws that carry nothing where they are open."""
NOTHING: Final = 1e-12
"""Of the largest traction of an interface: what open points may carry."""
ROUND_OFF: Final = 1e-9
"""Of the load: less is no force."""
OPEN: Final = 1e-9
"""Of the largest gap of an interface: less is none."""


@dataclass
class Pairs:
    """Pairs of runs that were compared, exempted, and too far apart.

    Attributes
    ----------
    compared : pairs by relation. exempt : by reason. largest : difference over its limit by relation, of those that
        were compared. faults : sentences. refused : pairs whose runs are both refused. steps : of points that are open
        at their start, and those among them in which a point lands.
    """

    compared: Counter[str] = field(default_factory=Counter)
    exempt: Counter[str] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    refused: int = 0
    steps: Counter[str] = field(default_factory=Counter)

    def add(self, seed: object, tables: Tables, base: Run, relation: Relation, folder: Path) -> None:
        """Compare the second run of a relation with the first one of a scene."""
        rng = np.random.default_rng(_number(seed, relation))
        changed = relation.change(tables, rng, folder)
        if changed is None:
            return
        other, back = changed
        second = run(other, folder, relation.solve)
        if bool(base.refused) and bool(second.refused) and not base.results:
            self.refused += 1
            return
        self.compared[relation.name] += 1
        if not second.results or not base.results:
            name, apart, limit = second.refused or base.refused, np.inf, relation.limit
        elif relation.apart is not None:
            name, apart, limit = relation.apart(base, second, load_of(tables))
        else:
            name, apart, limit = _apart(base, back(second.results), relation, load_of(tables))
        if apart <= limit:
            share = apart / limit if limit else 0.0
            self.largest[relation.name] = max(self.largest.get(relation.name, 0.0), share)
        elif reason := _reason(base, second, relation):
            self.exempt[reason] += 1
        else:
            self.faults.append(f"{seed} {relation.name}: {name} by {apart:.2g}, allowed {limit:.2g}")

    def open_points(self, seed: object, base: Run, force: float) -> None:
        """Points of a run that are open at both ends of a step carry nothing; those that land in it are counted.

        A point that is pressed is closed, whatever gap the time scheme leaves it. ``force`` : of a load, N; interfaces
        whose tractions are round-off beside it are left out.
        """
        if base.solution is None:
            return
        for name, history in base.solution.interfaces.items():
            size = np.linalg.norm(history.traction, axis=2)
            if history.behaviour not in OPENING or history.gap is None:
                continue
            if size.max(initial=0.0) * history.areas.sum() <= ROUND_OFF * force:
                continue
            pressed = np.einsum("tpc,pc->tp", history.traction, history.normals) != 0.0
            is_open = (history.gap > OPEN * np.abs(history.gap).max(initial=0.0)) & ~pressed
            landing = is_open[:-1] & pressed[1:]
            both = is_open[:-1] & is_open[1:]
            self.steps["open"] += int(is_open[:-1].sum())
            self.steps["landing"] += int(landing.sum())
            carried = float(size[1:][both].max(initial=0.0))
            if carried > NOTHING * size.max(initial=0.0):
                self.faults.append(f"{seed} open points of {name} carry {carried / size.max():.2g} of the largest")

    def merge(self, other: Pairs) -> None:
        """Add what another one has compared."""
        self.compared += other.compared
        self.exempt += other.exempt
        self.steps += other.steps
        self.refused += other.refused
        self.faults += other.faults
        for name, share in other.largest.items():
            self.largest[name] = max(self.largest.get(name, 0.0), share)

    def report(self) -> str:
        """Pairs by relation, exemptions by reason, landing steps, and what is too far apart."""
        lines = [f"{sum(self.compared.values())} pairs; {self.refused} whose runs are both refused"]
        for name, count in self.compared.items():
            lines.append(f"  {name:18s} {count:6d}   largest difference {self.largest.get(name, 0.0):.2g} of its limit")
        lines += [f"  exempt: {self.exempt[reason]} {reason} ({why})" for reason, why in EXEMPT.items()]
        n_open, landing = self.steps["open"], self.steps["landing"]
        share = 100.0 * landing / n_open if n_open else 0.0
        lines.append(f"  {n_open} steps of open points, {share:.2g} % of them landing")
        return "\n".join([*lines, *self.faults])

    def check(self) -> None:
        """Fail where pairs are apart, or a reason covers too many."""
        assert not self.faults, self.report()
        assert max(self.exempt.values(), default=0) <= SHARE * sum(self.compared.values()), self.report()

    def as_data(self) -> dict[str, Any]:
        """Plain data, which ``Pairs(**data)`` takes."""
        return {
            "compared": dict(self.compared),
            "exempt": dict(self.exempt),
            "largest": self.largest,
            "faults": self.faults,
            "refused": self.refused,
            "steps": dict(self.steps),
        }

    @staticmethod
    def of_data(data: dict[str, Any]) -> Pairs:
        """Those of ``as_data``."""
        counters = {key: Counter(data[key]) for key in ("compared", "exempt", "steps")}
        return Pairs(**(data | counters))


def _apart(base: Run, found: Results, relation: Relation, force: float) -> Apart:
    expected = {name: base.results[name] for name in found}
    # what goes on step by step has no values at the start
    first = int(any(np.isnan(values[0]).any() for values in found.values()))
    found, expected = ({n: v[first:] for n, v in results.items()} for results in (found, expected))
    apart = distances(expected, found, force)
    worst = max(apart, key=lambda name: apart[name])
    return worst, apart[worst], relation.limit


def _number(seed: object, relation: Relation) -> int:
    """A number of a pair that is the same in every run, and another one for every seed and every relation."""
    return zlib.crc32(f"{seed} {relation.name}".encode())


def _reason(base: Run, second: Run, relation: Relation) -> str:
    """Why a pair may be further apart than its limit; empty where it may not."""
    if not base.converged or not second.converged:
        return "not converged"
    if relation.name in ("swapped", "cut by a bond") and any(SAID in warning for warning in base.warnings):
        return "sides alike"
    return ""
