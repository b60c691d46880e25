"""What the LATIN stages ask of a propagator: one instant of a class of identical substructures.

Every substructure model and time scheme reduces, at the new instant, to

    v = v_free + D lambda

on the channels of all interfaces of the substructure together. Rules

1. ``predict`` marches to the next instant under its loads and gives W_0, the answer at the channels to q = 0;
   ``respond(W_0, q)`` = W_0 + Y q with Y = (1 + D k)^-1 D for the k of the last ``bind``; ``commit`` ends the instant
   with the tractions found. A commit without a predict before it is an error of the caller.
2. D is constant for a time step; ``operators`` is the same object as long as the step is.
3. Everything is linear in loads, initial values and tractions; a member does not see the others.
4. ``snapshot``/``restore`` within a segment, ``tree``/``resume`` between segments hold all that the next instant
   needs: a march that goes on from them is the same to the last bit.
5. ``channel_displacement`` is what gaps are read from (``TimeScheme.gap_lead`` ahead of the instant).
6. The account of energies closes with the scheme's own identity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from .condensed import Index
from .model import Array, Histories, SubstructureModel


class MassFactor(Protocol):
    """What solves with the mass matrix, at the start only."""

    def solve(self, b: Array) -> Array:
        """M^-1 b for b (n_dof, m)."""
        ...


class InterfaceOperators(Protocol):
    """Constant operators at the interfaces for one time step."""

    @property
    def area(self) -> Array:
        """Area of the channels, (n_channel,), m2."""
        ...

    @property
    def dofs(self) -> Index:
        """Dofs that the channels see, (n_gamma,)."""
        ...

    @property
    def compliance(self) -> Array:
        """Velocities of the channels per nodal force on them, (n_channel, n_channel), symmetric, m s-1 N-1."""
        ...

    @property
    def admittance(self) -> Array:
        """D: velocities of the channels per traction, (n_channel, n_channel), m3 N-1 s-1."""
        ...


class Instant(Protocol):
    """State of a class: what is common to all propagators."""

    @property
    def instant(self) -> int:
        """Time index."""
        ...


class Energies(Protocol):
    """Account of energies of the members."""

    @property
    def totals(self) -> Mapping[str, Array]:
        """Terms of ``propagator.energy.TERMS`` at the present instant, (n_member,) each, J."""
        ...


class Propagator(Protocol):
    """March of a class of identical substructures (rules in the module docstring).

    Arrays over channels are (n_channel, n_member).
    """

    @property
    def members(self) -> list[SubstructureModel]:
        """The substructures, one column each."""
        ...

    @property
    def names(self) -> list[str]:
        """Their names."""
        ...

    @property
    def state(self) -> Instant:
        """Present state."""
        ...

    @property
    def operators(self) -> InterfaceOperators:
        """Operators of the present time step."""
        ...

    @property
    def dt(self) -> float:
        """Time step, s."""
        ...

    @property
    def meter(self) -> Energies | None:
        """Account of energies, where asked for."""
        ...

    @property
    def n_channel(self) -> int:
        """Interface channels of one member."""
        ...

    @property
    def n_dof(self) -> int:
        """Unknowns of one member."""
        ...

    @property
    def k(self) -> Array:
        """Search direction bound last, (n_channel, 1), Pa s m-1."""
        ...

    @property
    def response(self) -> Array:
        """Y for that search direction, (n_channel, n_channel)."""
        ...

    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """Set what drives the members over a run, or over the segment that goes on from the present state."""
        ...

    # -- start at t = 0
    def initial_unbalance(self, traction: Array) -> Array:
        """M a of the free dofs under tractions, (n_dof, n_member), N."""
        ...

    def mass_factor(self) -> MassFactor:
        """Solver with M."""
        ...

    def initial_channels(self, factor: Any, unbalance: Array) -> tuple[Array, Array]:
        """With the factor of M: channel accelerations, and T M^-1 T^T (n_channel, n_channel)."""
        ...

    def start(self, traction: Array, factor: Any) -> None:
        """Consistent state at t = 0; ``factor`` of M, None for a start at rest in equilibrium."""
        ...

    # -- one instant
    def bind(self, k: Array) -> None:
        """Take a search direction (n_channel,), Pa s m-1."""
        ...

    def predict(self) -> Array:
        """W_0 of the next instant, m s-1."""
        ...

    def respond(self, w_0: Array, q: Array) -> Array:
        """W = W_0 + Y q."""
        ...

    def commit(self, traction: Array, account: bool = True) -> None:
        """End the instant with tractions, Pa; ``account``: count its energy."""
        ...

    # -- reading the state
    def channel_velocity(self) -> Array:
        """Velocities at the channels, m s-1."""
        ...

    def channel_displacement(self) -> Array:
        """Displacements at the channels that gaps are read from, m."""
        ...

    def channel_acceleration(self) -> Array:
        """Accelerations at the channels, m s-2."""
        ...

    def full_displacement(self, member: int) -> Array:
        """Displacements of all nodes of a member, (n_node, 3), m."""
        ...

    def full_velocity(self, member: int) -> Array:
        """Velocities of all nodes of a member, (n_node, 3), m s-1."""
        ...

    # -- windows and segments
    def snapshot(self) -> object:
        """All that determines the next instants of this segment."""
        ...

    def restore(self, snapshot: Any) -> None:
        """Back to a snapshot."""
        ...

    def restart(self) -> None:
        """Back to the initial values; ``begin`` must follow."""
        ...

    def tree(self) -> dict[str, object]:
        """All that the next segment needs, as plain arrays."""
        ...

    def resume(self, tree: dict[str, Any]) -> None:
        """Take up a state given by ``tree``; ``begin`` must follow."""
        ...
