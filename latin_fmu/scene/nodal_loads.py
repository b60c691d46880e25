"""The kind of load that acts on nodes: the concentrated loads of decks, which no area spreads."""

from typing import Annotated, ClassVar

import numpy as np

from .fields import Vector, about
from .load_kinds import Array, LoadedFace, LoadKind


class NodalLoad(LoadKind):
    """A `nodal_force` acts on each node of the face, edge or point, as concentrated loads of decks do: its resultant
    depends on the mesh."""

    chosen_by: ClassVar[tuple[str, ...]] = ("nodal_force",)

    nodal_force: Annotated[Vector | None, about("force along x, y, z on each node of the face", "N")] = None

    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """The same force on each node."""
        forces: Array = np.tile(self._on_each(), (len(face.points), 1))
        return forces

    def largest_traction(self, face: LoadedFace, /) -> float:
        """As if spread over the area around the nodes."""
        return float(np.linalg.norm(self.mean_traction(face)))

    def mean_traction(self, face: LoadedFace) -> Array:
        """Resultant over the area around the nodes (3,) where the law is 1, Pa."""
        mean: Array = len(face.points) * self._on_each() / face.node_area
        return mean

    def arrow(self, _normal: Array, /) -> Array:
        """Along the force."""
        return self._on_each()

    def _on_each(self) -> Array:
        """The force along the global axes (3,), N."""
        return np.asarray(self.to_global(self.nodal_force or (0.0, 0.0, 0.0)), dtype=float)
