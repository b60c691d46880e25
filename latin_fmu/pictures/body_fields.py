"""Fields of the bodies of a results file for pictures: displacements without the motion of the base, stresses at the
nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import Problem, ResultsError
from ..fem.mesh import Array
from ..results.groups import datasets_of
from ..results.stresses import largest_of, stress_of

NOTHING: Final = "nothing to draw"
STRESSES: Final = MappingProxyType({"von_mises": "von Mises stress", "principal": "largest principal stress"})
"""Stresses that bodies are coloured by, and what they are called."""
_RIGID: Final = 0.01  # of the motion of the base: supports that differ by more have no motion in common


@dataclass(frozen=True)
class Look:
    """What is drawn of bodies.

    Attributes
    ----------
    interface : whose pressure is drawn, too; None for the one with the largest force. magnify : factor on the
        displacements, None for a largest one of 5 % of the size. stress : one of ``STRESSES`` that colours the bodies,
        None for the displacement.
    """

    interface: str | None = None
    magnify: float | None = None
    stress: str | None = None


PLAIN_LOOK: Final = Look()


def stored_bodies(tree: xr.DataTree, stress: str | None = None) -> dict[str, xr.Dataset]:
    """Substructures with displacements and meshes, and with stresses at the nodes where a ``stress`` is drawn.

    Raises
    ------
    ResultsError : the file has none.
    """
    bodies = datasets_of(tree, "substructures")
    bodies = {name: d for name, d in bodies.items() if "displacement" in d and "cell_nodes" in d}
    if not bodies:
        what, remedy = "the results hold no displacements of bodies", "run with --set output.fields=true"
        raise ResultsError([Problem("substructures", what, remedy=remedy)], NOTHING)
    if stress is not None and not any("nodal_stress" in dataset for dataset in bodies.values()):
        what, remedy = "the results hold no stresses at the nodes", "run with --set output.nodal_stress=true"
        raise ResultsError([Problem("substructures", what, remedy=remedy)], NOTHING)
    return bodies


def at_instants(dataset: xr.Dataset, name: str, instants: Array) -> Array:
    """Values (n, n_node, ...) of a variable at the stored instants nearest to these, s; 0 where a node has none."""
    return np.asarray(np.nan_to_num(dataset[name].sel(time=instants, method="nearest").values))


def base_motion(bodies: Mapping[str, xr.Dataset], instants: Array) -> Array:
    """Translation (n, 3) that the supports have in common, m; 0 where there are none or where they move apart."""
    held = [
        at_instants(dataset, "displacement", instants)[:, dataset["support"].values == 1]
        for dataset in bodies.values()
        if "support" in dataset
    ]
    moved = np.concatenate([np.zeros((len(instants), 0, 3)), *held], axis=1)
    if not moved.shape[1]:
        return np.zeros((len(instants), 3))
    mean: Array = moved.mean(axis=1)
    apart = float(np.abs(moved - mean[:, None]).max(initial=0.0))
    if apart > _RIGID * float(np.linalg.norm(mean, axis=1).max(initial=0.0)):
        return np.zeros_like(mean)
    return mean


def away(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Nodes (n_node,) of a body that are in no cell at the edge of a contact."""
    if "contact_edge" not in dataset:
        return np.ones(dataset.sizes["node"], dtype=bool)
    return np.asarray(dataset["contact_edge"].values == 0)


def nodal_stress(dataset: xr.Dataset, stress: str, time: float) -> Array:
    """One of ``STRESSES`` (n_node,) of a body at an instant, Pa; NaN where the file has none."""
    if "nodal_stress" not in dataset:
        return np.full(dataset.sizes["node"], np.nan)
    return stress_of(at_instants(dataset, "nodal_stress", np.array([time]))[0], stress)


def largest_stresses(bodies: Mapping[str, xr.Dataset], stress: str, instants: Array) -> tuple[Array, Array]:
    """Largest values (n,) of the bodies at instants, away from edges of contacts and anywhere, Pa; the first are the
    second where every cell touches one."""
    found = np.zeros((2, len(instants)))
    for dataset in bodies.values():
        if "nodal_stress" not in dataset:
            continue
        far = away(dataset)
        for i, six in enumerate(at_instants(dataset, "nodal_stress", instants)):
            for row, fields in enumerate((six[far], six)):
                if len(fields):
                    found[row, i] = max(found[row, i], largest_of(fields, stress)[1])
    if not found[0].any():
        found[0] = found[1]
    return found[0], found[1]
