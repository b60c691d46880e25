"""Sizes of a scene before anything is factorised, what its run costs, and what leaving something out would save."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from ..assembly.problem import DiscretisedProblem
from ..assembly.run_cost import RunCost, march_saved, run_cost
from ..assembly.run_sizes import CONTACT, ClassSizes, RunSizes, expected_iterations, run_sizes
from ..latin.assembly import InterfaceUnit


class Sizes:
    """Sizes of a discretised problem; ``run`` : as the cost depends on them."""

    def __init__(self, discretised: DiscretisedProblem) -> None:
        self.discretised, self.scene = discretised, discretised.scene
        self.run = run_sizes(discretised)

    @cached_property
    def cost(self) -> RunCost:
        """Of the run, s."""
        return run_cost(self.run)

    @property
    def instant(self) -> float:
        """One instant of the march, all that is kept included, s."""
        return self.cost.march / self.n_instant

    def saved(self, without: RunSizes) -> float:
        """CPU seconds that an instant costs less without something, s."""
        return march_saved(self.run, without) / self.n_instant

    def without(self, units: Sequence[InterfaceUnit]) -> RunSizes:
        """The run without some of its interfaces."""
        rest = [u for u in self.discretised.units if u not in units]
        gone = sum(2 * u.geometry.n_point * u.behaviour.n_component for u in units)
        iterations = expected_iterations(self.scene, rest)
        return replace(
            self._fewer(gone),
            iterations=iterations,
            interfaces=len(rest),
            probed=_probed(rest),
            at_once=self.run.at_once and bool(rest),
        )

    def without_friction(self, units: Sequence[InterfaceUnit]) -> RunSizes:
        """The run without the tangential unknowns of some of its interfaces."""
        rest = [u for u in self.discretised.units if u not in units]
        gone = sum(2 * u.geometry.n_point * (u.behaviour.n_component - 1) for u in units)
        iterations = expected_iterations(self.scene, rest) if rest else 0.0
        return replace(
            self._fewer(gone),
            iterations=min(max(CONTACT, iterations), self.run.iterations),
            probed=(*_probed(rest), *(u.geometry.n_point for u in units)),
        )

    def _fewer(self, gone: int) -> RunSizes:
        left = 1.0 - gone / max(self.n_flat, 1)
        return replace(self.run.resized(channels=left, interface=left), n_flat=round(left * self.n_flat))

    @property
    def classes(self) -> tuple[ClassSizes, ...]:
        """Of identical substructures."""
        return self.run.classes

    @property
    def n_dof(self) -> int:
        """Unknowns of all substructures."""
        return sum(c.n_member * c.size.unknowns for c in self.classes)

    @property
    def n_flat(self) -> int:
        """Interface unknowns, both sides, ground included."""
        return self.run.n_flat

    @property
    def n_instant(self) -> int:
        """Number of steps."""
        return self.run.n_instant

    @property
    def n_stored(self) -> int:
        """Instants at which fields are kept."""
        return self.n_instant // self.run.every + 1

    @property
    def solved_at_once(self) -> bool:
        """Whether every instant is one linear solve: perfect interfaces only, windows of one instant."""
        return self.run.at_once

    @property
    def iterations(self) -> float:
        """LATIN iterations expected per instant (one solve of the bonds counts as one)."""
        return self.run.iterations

    @property
    def factor_bytes(self) -> int:
        """Factors and condensed operators."""
        return int(
            sum(8 * (c.size.factor_entries + c.size.interface**2 + 3 * c.size.channels**2) for c in self.classes)
        )


def _probed(units: Sequence[InterfaceUnit]) -> tuple[int, ...]:
    return tuple(u.geometry.n_point for u in units if u.behaviour.n_component == 1)
