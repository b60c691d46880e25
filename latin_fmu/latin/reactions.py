"""Reactions: resultant forces of the supports of a substructure, from its equation of motion at the dofs they hold.

With e the sum over the held dofs of a support, component by component, and F the tractions of the interfaces,

    R = e (M a + C v + K u) - e f - e T^T area F

is the force that the support exerts on the body. u, v and a are those of the instants; in explicit schemes, whose
accelerations and tractions are means over a step, K u, C v and f are means over it, too. Implicit schemes that weight
the forces of two instants satisfy the equation of motion at an instant up to their own order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..propagator import SubstructureModel
from .assembly import Array, Assembly, Index
from .outcome import ReactionHistory


@dataclass(frozen=True)
class Support:
    """A boundary condition that holds or drives dofs of an elastic substructure.

    Attributes
    ----------
    substructure, face : its body and face. dofs : held or driven full dofs, each in one support only.
    model : of the substructure, with the matrices of its mesh.
    parts : (3, n_full) sum of the parts of nodal vectors along the directions of the support, where they are no axes.
    """

    substructure: str
    face: str
    dofs: Index
    model: SubstructureModel
    parts: sp.csr_array | None = None

    @property
    def sum(self) -> sp.csr_array:
        """e (3, n_full): sum of the held dofs, component by component."""
        if self.parts is not None:
            return self.parts
        entries = (np.ones(len(self.dofs)), (self.dofs % 3, self.dofs))
        return sp.csr_array(sp.coo_array(entries, shape=(3, self.model.n_full)))

    def rows(self, mass: sp.csr_array | None) -> sp.csr_array:
        """e K, e C, e M one below the other, (9, n_full)."""
        e, nothing = self.sum, sp.csr_array((3, self.model.n_full))
        matrices = (self.model.stiffness, self.model.damping, mass)
        return sp.csr_array(sp.vstack([nothing if matrix is None else e @ matrix for matrix in matrices]))

    @property
    def loads(self) -> Array:
        """Resultants on the held dofs for amplitude 1, (n_load, 3), N."""
        return np.array([self.sum @ load.pattern for load in self.model.loads]).reshape(-1, 3)

    @property
    def spread(self) -> Array:
        """Resultants on the held dofs of unit tractions on the channels, (n_channel, 3), m2."""
        return np.asarray(self.model.channel_area[:, None] * (self.model.trace @ self.sum.T.toarray()))


@dataclass(frozen=True)
class Place:
    """A support among the classes: number of the class, of the member, rows, loads (n_load, 3), spread (n_channel, 3)
    and shapes (9, n_motion) of prescribed motions."""

    number: int
    member: int
    part: slice
    loads: Array
    spread: Array
    shapes: Array


class SupportProbes:
    """What the reactions of some supports need of the substructures.

    Attributes
    ----------
    rows : per class (n_row, n_dof), 9 for each support: e K, e C, e M from the dofs of a member. places : of the
        supports.
    """

    def __init__(self, assembly: Assembly, supports: Mapping[str, Support]) -> None:
        self.rows: list[sp.csr_array] = []
        self.places: dict[str, Place] = {}
        for c, propagator in enumerate(assembly.propagators):
            own = propagator.members[0]
            blocks = [sp.csr_array((0, own.expansion.shape[1]))]
            for name, support in supports.items():
                if support.substructure not in propagator.names:
                    continue
                lumped = assembly.scheme.explicit and own.nodal is None
                full = support.rows(own.mass if lumped else support.model.mass)
                full = full if own.nodal is None else sp.csr_array(full @ own.nodal)
                start = 9 * (len(blocks) - 1)
                self.places[name] = Place(
                    c,
                    propagator.names.index(support.substructure),
                    slice(start, start + 9),
                    support.loads,
                    support.spread,
                    np.asarray(full @ own.imposed_pattern),
                )
                blocks.append(sp.csr_array(full @ own.expansion))
            self.rows.append(sp.csr_array(sp.vstack(blocks)) if len(blocks) > 1 else blocks[0])

    def read(
        self,
        assembly: Assembly,
        sensed: Sequence[Array | None],
        tractions: Array,
        instants: slice,
        forces: Mapping[str, Array],
    ) -> None:
        """Write the two parts of the reactions at these instants into ``forces``, (n_time, 2, 3) by support.

        sensed : per class (n, 3, n_row, n_member) displacements, velocities and accelerations of ``rows``.
        tractions : (n, n_flat), Pa.
        """
        for name, place in self.places.items():
            kept, forcing = sensed[place.number], assembly.propagators[place.number].forcing
            assert kept is not None
            values = kept[:, :, place.part, place.member]
            imposed = forcing.motion_histories(place.member)
            if imposed is not None:
                values = values + np.stack([field[instants] @ place.shapes.T for field in imposed], axis=1)
            static = values[:, 0, :3] + values[:, 1, 3:6]
            for amplitude, load in zip(forcing.amplitudes[place.member], place.loads, strict=True):
                static = static - amplitude[instants, None] * load
            channels = assembly.channels[place.number][:, place.member]
            inertia = values[:, 2, 6:] - tractions[:, channels] @ place.spread
            forces[name][instants] = np.stack([static, inertia], axis=1)


def reaction_histories(
    assembly: Assembly, supports: Mapping[str, Support], forces: Mapping[str, Array]
) -> dict[str, ReactionHistory]:
    """Reactions from their two parts (n_time, 2, 3): means over the step and values of the instant."""
    histories = {}
    for name, support in supports.items():
        static, inertia = forces[name].transpose(1, 0, 2)
        if assembly.scheme.explicit:
            static = np.concatenate([static[:1], 0.5 * (static[1:] + static[:-1])])
        histories[name] = ReactionHistory(name, support.substructure, support.face, static + inertia)
    return histories
