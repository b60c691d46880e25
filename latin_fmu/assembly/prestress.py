"""Geometric stiffness of the bodies of an assembly in the state that its motion starts from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..fem.elements import Elements
from ..fem.geometric_stiffness import geometric_stiffness
from ..latin.assembly import Array
from ..propagator.model import OperatorPattern
from .body import Body
from .bolts import CutStress, OpenedMesh
from .shank_facets import chosen_elements


@dataclass(frozen=True)
class Prestress:
    """What the stress of a state adds to the stiffness of bodies.

    Attributes
    ----------
    stiffness : K_sigma (n_full, n_full), N m-1, by body; bodies without stress have none. words : what it changes.
    period : of the vibration that it changes most, s, infinite where it hardly changes any. drives : largest
        acceleration that it gives a body in a rigid rotation, over the angle, s-2, by body. pressure : (n_point,) of
        the contacts in the state, Pa, by interface.
    """

    stiffness: Mapping[str, sp.csr_array]
    words: str
    period: float
    drives: Mapping[str, float]
    pressure: Mapping[str, Array]

    def added(self, name: str, stiffness: sp.csr_array) -> sp.csr_array:
        """K + K_sigma of a body that has one, with the zeros of both: its pattern does not depend on its stress."""
        matrix = self.stiffness[name]
        return OperatorPattern([stiffness, matrix]).sum([1.0, 1.0], [stiffness, matrix])


Cuts = dict[str, CutStress]
"""What K_sigma adds to the cut of a bolt and the sections of its shank, by bolt."""


def body_stiffness(body: Body, displacement: Array, unstrained: Array, opened: OpenedMesh | None) -> sp.csr_array:
    """K_sigma (3 n_node, 3 n_node), N m-1, of an elastic body.

    Parameters
    ----------
    displacement : (3 n_node,), m. unstrained : (n_cell or 1, 6), Pa, as for ``geometric_stiffness``.
    opened : its mesh with the cuts of its bolts open; None where it has none.
    """
    shape = body.shape
    if opened is None:
        nodal = displacement.reshape(-1, 3)
        return geometric_stiffness(shape.elements, shape.elasticity, nodal, unstrained, shape.bending_modes)
    matrix, together = _of_opened(body, displacement, unstrained, opened), opened.together
    merged = sp.csr_array(together.T @ matrix @ together)
    merged.sort_indices()
    return merged


def _of_opened(body: Body, displacement: Array, unstrained: Array, opened: OpenedMesh) -> sp.csr_array:
    """K_sigma of all dofs of a mesh whose cuts are open."""
    shape, elements = body.shape, Elements(opened.mesh, body.shape.moduli)
    apart = opened.displacement(displacement.reshape(-1, 3))
    return geometric_stiffness(elements, shape.elasticity, apart, unstrained, shape.bending_modes)


def cut_stresses(body: Body, displacement: Array, unstrained: Array, opened: OpenedMesh) -> Cuts:
    """What K_sigma of a body (parameters: ``body_stiffness``) is of the jumps in the cuts of its bolts: a shank is as
    stiff against them with its stress as against all other motions."""
    shape, apart = body.shape, opened.displacement(displacement.reshape(-1, 3))
    matrix = _of_opened(body, displacement, unstrained, opened)
    cuts: Cuts = {}
    for cut, (name, jump) in zip(opened.cuts, opened.jumps(), strict=True):
        pulled = matrix @ jump.ravel()
        rows = []
        for section in cut.sections:
            beside = unstrained if len(unstrained) == 1 else unstrained[section.side]
            part = chosen_elements(opened.mesh, shape.moduli, section.side)
            of_part = geometric_stiffness(part, shape.elasticity, apart, beside, shape.bending_modes)
            rows.append(section.rows(opened, of_part, cut.directions))
        together = np.asarray(opened.together.T @ pulled)
        cuts[name] = CutStress(together, float(jump.ravel() @ pulled), tuple(rows))
    return cuts


def rigid_stiffness(points: Array, forces: Array, nodal: Array) -> sp.csr_array:
    """K_sigma (n_full, n_full), N m-1, of a rigid body with forces (n_point, 3), N, at points (n_point, 3), m, of
    places relative to its mass centre, through which its weight acts.

    Its stress has the integral sum sym(f x^T), whatever its distribution, and a small rotation theta the energy
    1/2 (theta^2 tr - theta . sum . theta), that of forces which do not turn with the body.

    nodal : (3, n_full) rotation of the body, rad, per full dof.
    """
    moment = np.einsum("pi,pj->ij", forces, points)
    moment = 0.5 * (moment + moment.T)
    turning = np.trace(moment) * np.eye(3) - moment
    return sp.csr_array(nodal.T @ turning @ nodal)
