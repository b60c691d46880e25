"""The assembly as the solver sees it: propagators, interfaces, and the flat vectors between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..propagator import DirectPropagator
from ..time_scheme import TimeScheme
from .layout import Array, Index, InterfaceUnit, Layout


class Assembly:
    """Substructure classes and interfaces tied together by index arrays.

    Parameters
    ----------
    time : (n_time,) instants, s, equally spaced.
    propagators : one per class of identical substructures.
    channels : for each propagator the flat indices (n_channel, n_member).
    interfaces, layout : see there.
    impedance : (n_flat,) material impedance of the side, rho c_p or rho c_s; 0 for ground. Pa s m-1
    characteristic_traction : size of the tractions the loads can bring, Pa (scale of negligible ones).
    scheme : time scheme.
    """

    def __init__(
        self,
        time: Array,
        propagators: Sequence[DirectPropagator],
        channels: Sequence[Index],
        interfaces: Sequence[InterfaceUnit],
        layout: Layout,
        impedance: Array,
        characteristic_traction: float,
        scheme: TimeScheme,
    ) -> None:
        self.time, self.dt = time, float(time[1] - time[0])
        self.propagators, self.channels = list(propagators), list(channels)
        self.interfaces, self.layout, self.scheme = list(interfaces), layout, scheme
        self.impedance = impedance
        self.characteristic_traction = characteristic_traction
        self._ground = [
            (
                layout.channels(i, 1),
                unit.geometry.frames[:, : unit.behaviour.n_component],
                unit.ground_velocity,
            )
            for i, unit in enumerate(self.interfaces)
            if unit.ground_velocity is not None
        ]
        self.rigid = self._rigid_channels()

    def _rigid_channels(self) -> Index:
        """Channels of points where a side cannot move at all (ground, or every direction held)."""
        moves = np.zeros(self.layout.n_flat, dtype=bool)
        for propagator, channels in zip(self.propagators, self.channels, strict=True):
            moves[channels] = (np.diag(propagator.operators.compliance) > 0)[:, None]
        rigid = np.zeros(self.layout.n_flat, dtype=bool)
        for group in self.layout.groups:
            group.block(rigid)[...] = ~group.block(moves).any(axis=-1, keepdims=True)
        return np.flatnonzero(rigid)

    @property
    def n_instant(self) -> int:
        """Number of steps."""
        return len(self.time) - 1

    @property
    def n_substructure(self) -> int:
        """Number of substructures."""
        return sum(len(p.names) for p in self.propagators)

    def gather(self, per_class: Sequence[Array]) -> Array:
        """Flat vector from (n_channel, n_member) arrays of every class; ground entries 0."""
        flat = np.zeros(self.layout.n_flat)
        for channels, values in zip(self.channels, per_class, strict=True):
            flat[channels] = values
        return flat

    def ground_velocity(self, flat: Array, instant: int) -> None:
        """Write the velocities of moving ground into a flat vector."""
        for channels, frames, velocity in self._ground:
            assert velocity is not None
            flat[channels] = frames @ velocity[instant]

    def ground_displacement(self, flat: Array, instant: int) -> None:
        """Write the displacements of moving ground (trapezoid of its velocity) into a flat vector."""
        for channels, frames, velocity in self._ground:
            assert velocity is not None
            travel = self.dt * (velocity[1 : instant + 1] + velocity[:instant]).sum(axis=0) / 2
            flat[channels] = frames @ travel

    def ground_acceleration(self, flat: Array, instant: int) -> None:
        """Write the accelerations of moving ground (backward differences) into a flat vector."""
        for channels, frames, velocity in self._ground:
            assert velocity is not None
            i = max(instant, 1)
            flat[channels] = frames @ ((velocity[i] - velocity[i - 1]) / self.dt)

    def motion(self) -> tuple[Array, Array, Array]:
        """Displacement, velocity, acceleration of every channel in the present state of the propagators."""
        instant = self.propagators[0].state.instant if self.propagators else 0
        u = self.gather([p.channel_displacement() for p in self.propagators])
        v = self.gather([p.channel_velocity() for p in self.propagators])
        a = self.gather([p.channel_acceleration() for p in self.propagators])
        self.ground_displacement(u, instant)
        self.ground_velocity(v, instant)
        self.ground_acceleration(a, instant)
        return u, v, a

    def snapshot(self) -> list[object]:
        """State of every propagator."""
        return [p.snapshot() for p in self.propagators]

    def restore(self, snapshot: Sequence[object]) -> None:
        """Back to a snapshot."""
        for propagator, state in zip(self.propagators, snapshot, strict=True):
            propagator.restore(state)  # type: ignore[arg-type]
