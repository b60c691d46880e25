"""Geometric stiffness of stressed bodies: what their stress adds to the stiffness against rotations of the material.

A body in equilibrium under a stress sigma that is displaced by a small further u stores, to second order,

    1/2 int eps(u) : C : eps(u) dV + 1/2 int sigma_jk d_j u_i d_k u_i dV

(Zienkiewicz and Taylor, The Finite Element Method, vol. 2; Cook et al., Concepts and Applications of Finite Element
Analysis, chapter 18). The second integral is 1/2 u^T K_sigma u: tension stiffens a string, pressure lets a column
buckle. Between the nodes a and b its blocks are the same number on all three components,

    (K_sigma)_ab = I int grad N_a . sigma grad N_b dV

so that it has the pattern of the stiffness. Translations are without effect; a rotation of the whole body has the
energy of the forces on the body that do not turn with it. The stress at the points has the part of incompatible modes
(``elements``); the gradients of the further displacement are those of the nodes alone, with which frequencies and
buckling loads of plates one element thick are nearer to those of fine meshes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from .elasticity import Elasticity
from .elements import BENDING_CELLS, CellPoints, Elements, mode_slopes, symmetric, tensors
from .mesh import Array, Index


def geometric_stiffness(
    elements: Elements, material: Elasticity, displacement: Array, unstrained: Array, bending_modes: bool = False
) -> sp.csr_array:
    """K_sigma (3 n_node, 3 n_node), N m-1, of the stress that displacements make, and of what else stresses a body.

    Parameters
    ----------
    displacement : (n_node, 3), m. unstrained : (n_cell, 6) or (1, 6), Pa: stress beside C : eps(u), as that of hindered
    expansion. bending_modes : as in ``elements.stiffness``.

    Examples
    --------
    A bar of section A under a stress s stiffens against a turn by s A / L at each end: a string.

    >>> import numpy as np
    >>> from latin_fmu.fem.elasticity import Isotropic
    >>> from latin_fmu.fem.elements import Elements
    >>> from latin_fmu.fem.mesh import box_mesh
    >>> mesh = box_mesh((0.0, 0.0, 0.0), (2.0, 1.0, 1.0), (1, 1, 1))
    >>> pulled = np.array([[10.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    >>> matrix = geometric_stiffness(Elements(mesh), Isotropic(1.0, 1.0, 0.3), np.zeros((8, 3)), pulled)
    >>> lifted = np.where(mesh.nodes[:, :1] > 1.0, [0.0, 0.0, 1.0], 0.0).ravel()
    >>> round(float(lifted @ matrix @ lifted), 9)
    5.0
    """

    def parts() -> Iterator[tuple[Array, Index]]:
        done = 0
        for block, points in elements.points():
            n = len(block.cells)
            here = slice(done, done + n)
            done += n
            moduli = None if elements.moduli is None else elements.moduli[here]
            beside = unstrained if len(unstrained) == 1 else unstrained[here]
            bends = bending_modes and block.cell_type in BENDING_CELLS
            yield _of_cells(points, material, displacement[block.cells], moduli, beside, bends), np.arange(n)

    return elements.matrix(parts())


def _of_cells(
    points: CellPoints, material: Elasticity, nodal: Array, moduli: Array | None, unstrained: Array, bends: bool
) -> Array:
    """int grad N_a . sigma grad N_b (n_cell, n, n), N m-1, of some cells with displacements ``nodal`` (n_cell, n, 3),
    m; ``moduli`` (n_cell,) over that of the material, ``unstrained`` (n_cell or 1, 6) as above."""
    slopes = np.einsum("cpaj,cai->cpij", points.gradients, nodal, optimize=True)
    if bends:
        slopes += mode_slopes(points, material, nodal[None])[0]
    six = material.stress(symmetric(slopes))
    if moduli is not None:
        six *= moduli[:, None, None]
    stress = tensors(six + unstrained[:, None, :])
    pulled = (points.gradients * points.volumes[:, :, None, None]) @ stress
    return np.asarray(np.einsum("cpaj,cpbj->cab", pulled, points.gradients, optimize=True))
