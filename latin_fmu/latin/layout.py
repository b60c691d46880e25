"""Where each interface quantity lives: one flat vector of channels for the whole assembly.

Interfaces of one kind (same behaviour class and number of components) form a group, stored as a block
(side, point, component) so that their local stage is one vectorised call. Substructures see the same numbers
through index arrays: gather to (channel, member), scatter back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..interface import Behaviour, InterfaceGeometry

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class InterfaceUnit:
    """One interface, ready to be solved.

    Attributes
    ----------
    name : name in the scene. sides : faces, the second may be "ground". behaviour, geometry : see there.
    preload : contact pressure at the start, Pa.
    """

    name: str
    sides: tuple[str, str]
    behaviour: Behaviour
    geometry: InterfaceGeometry
    preload: float

    @property
    def against_ground(self) -> bool:
        """Whether side E' is the rigid ground."""
        return self.geometry.traces[1] is None


@dataclass(frozen=True)
class Group:
    """Interfaces of one kind, their points concatenated.

    Attributes
    ----------
    behaviour : a member's behaviour (its static methods serve all).
    start : offset in the flat vector. n_point, n_component : block shape (2, n_point, n_component).
    parameters : (n_point, n_parameter). gap : (n_point,), m. preload : (n_point,), Pa.
    members : interface index -> its points.
    """

    behaviour: Behaviour
    start: int
    n_point: int
    n_component: int
    parameters: Array
    gap: Array
    preload: Array
    members: dict[int, slice]

    @property
    def stop(self) -> int:
        """End of the block in the flat vector."""
        return self.start + 2 * self.n_point * self.n_component

    def block(self, flat: Array) -> Array:
        """View (..., 2, n_point, n_component) of flat vectors (..., n_flat)."""
        view: Array = flat[..., self.start : self.stop].reshape(*flat.shape[:-1], 2, self.n_point, self.n_component)
        return view


class Layout:
    """Flat layout of all channels; see the module docstring."""

    def __init__(self, interfaces: Sequence[InterfaceUnit]) -> None:
        kinds: dict[tuple[type, int], list[int]] = {}
        for i, unit in enumerate(interfaces):
            kinds.setdefault((type(unit.behaviour), unit.behaviour.n_component), []).append(i)
        self.groups: list[Group] = []
        self._group_of: dict[int, Group] = {}
        start = 0
        for (_, n_component), members in kinds.items():
            units = [interfaces[i] for i in members]
            counts = [u.geometry.n_point for u in units]
            ends = np.cumsum(counts)
            group = Group(
                units[0].behaviour,
                start,
                int(ends[-1]),
                n_component,
                np.concatenate([u.behaviour.point_parameters(n) for u, n in zip(units, counts, strict=True)]),
                np.concatenate([u.geometry.gap for u in units]),
                np.concatenate([np.full(n, u.preload) for u, n in zip(units, counts, strict=True)]),
                {i: slice(int(e) - n, int(e)) for i, n, e in zip(members, counts, ends, strict=True)},
            )
            self.groups.append(group)
            self._group_of.update(dict.fromkeys(members, group))
            start = group.stop
        self.n_flat = start
        self.area = np.zeros(start)
        self.normal = np.zeros(start, dtype=bool)
        self.interface = np.zeros(start, dtype=np.int64)  # the interface that each channel belongs to
        for group in self.groups:
            normal = group.block(self.normal)
            normal[..., 0] = True
            for i, points in group.members.items():
                group.block(self.area)[:, points] = interfaces[i].geometry.areas[:, None]
                self.interface[self.channels(i, 0)] = self.interface[self.channels(i, 1)] = i

    def group(self, interface: int) -> Group:
        """Group of an interface."""
        return self._group_of[interface]

    def channels(self, interface: int, side: int) -> Index:
        """Flat indices (n_point, n_component) of one side of an interface."""
        group = self._group_of[interface]
        points, width = group.members[interface], group.n_component
        first = group.start + (side * group.n_point + points.start) * width
        picked: Index = np.arange(first, first + (points.stop - points.start) * width).reshape(-1, width)
        return picked
