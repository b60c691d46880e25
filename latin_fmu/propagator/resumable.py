"""Motion of a class of substructures that can be taken back, cut into segments of time and begun again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from .forcing import Forcing
from .model import Array, SubstructureModel


class Meter(Protocol):
    """Account of energies as a march uses it (``energy.EnergyMeter``)."""

    dt: float

    @property
    def totals(self) -> dict[str, Array]:
        """Terms at the present instant."""
        ...

    def start(self, state: Any, interface: Array) -> None:
        """Energies at t = 0."""
        ...

    def advance(self, state: Any, interface: Array) -> None:
        """Add the step that ends in ``state``."""
        ...

    def snapshot(self) -> object:
        """State of the account."""
        ...

    def restore(self, snapshot: object) -> None:
        """Back to a snapshot."""
        ...

    def tree(self) -> dict[str, object]:
        """State as plain arrays."""
        ...

    def resume(self, tree: dict[str, Any]) -> None:
        """Take up such a state."""
        ...


@dataclass(frozen=True)
class Motion:
    """Displacements, velocities, accelerations and residual forces (n_dof, n_member) at an instant."""

    instant: int  # time index
    u: Array
    v: Array
    a: Array
    residual: Array


class Resumable:
    """Keeps the motion of its members in arrays (n_dof, n_member) that are never changed in place.

    Whoever is made from it sets ``members``, ``forcing``, ``meter`` and the first ``state``; ``_free`` holds what was
    predicted of the next instant, None where nothing was.
    """

    members: list[SubstructureModel]
    forcing: Forcing
    state: Motion
    meter: Meter | None
    _begun = False
    _resumed: list[tuple[Array, Array]] | None = None
    _free: Any = None

    def full_displacement(self, member: int) -> Array:
        """Displacements of all nodes, (n_node, 3), m."""
        return self._full(self.state.u, self.forcing.imposed_u(self.state.instant), member)

    def full_velocity(self, member: int) -> Array:
        """Velocities of all nodes, (n_node, 3), m s-1."""
        return self._full(self.state.v, self.forcing.imposed_v(self.state.instant), member)

    def _full(self, field: Array, imposed: Array, member: int) -> Array:
        model = self.members[member]
        return model.node_values(model.expansion @ field[:, member] + imposed[:, member])

    def snapshot(self) -> tuple[Motion, object]:
        """All that determines the next instants."""
        return self.state, None if self.meter is None else self.meter.snapshot()

    def restore(self, snapshot: tuple[Motion, object]) -> None:
        """Back to a snapshot (states are never changed in place)."""
        self.state, self._free = snapshot[0], None
        if self.meter is not None:
            self.meter.restore(snapshot[1])

    def restart(self) -> None:
        """Back to the initial values; ``begin`` must follow."""
        self._begun, self._resumed = False, None
        self.forcing.resume([None] * len(self.members))

    def tree(self) -> dict[str, object]:
        """The present state as plain arrays: all that the next segment needs."""
        state = self.state
        motions = [[u, a] for u, a in self.forcing.end(state.instant)]
        meter = None if self.meter is None else self.meter.tree()
        arrays = {"u": state.u, "v": state.v, "a": state.a, "residual": state.residual}
        return {**arrays, "motions": motions, "meter": meter}

    def resume(self, tree: dict[str, Any]) -> None:
        """Take up a state given by ``tree``; ``begin`` must follow."""
        self.state = Motion(0, tree["u"], tree["v"], tree["a"], tree["residual"])
        self._resumed, self._free = [(u, a) for u, a in tree["motions"]], None
        if self.meter is not None:
            self.meter.resume(tree["meter"])
