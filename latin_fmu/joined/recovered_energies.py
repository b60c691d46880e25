"""Energies of an assembly that was marched by its modes: those of its march, and of the motion that this leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..kernels.energy_parts import ELASTIC, INTERFACE_WORK, KINETIC, PRESTRESS, WORK_OF_LOADS
from ..latin.assembly import Array
from .reduced_run import ReducedMarch
from .tied_assembly import MASS, STIFFNESS, TiedAssembly


def assembly_energies(
    march: ReducedMarch, histories: tuple[Array, Array], tables: Mapping[Any, Array], layers: Array
) -> Array:
    """Energies (n_time, N_TERM) of the assembly, J: those of the march, and of the motion B d of driven faces and the
    static responses to the loads, which it is relative to.

    histories : of the modes, displacements, velocities and accelerations (n_time, 3, n_mode), and of the relative
    motions (n_time, n_r). tables : of the march by number of the class. layers : energy (n_time,) of the springs
    between sides, which the march has among that of the bodies, and which belongs to the interfaces.
    """
    n = len(layers)
    terms = tables[0][:, :, 0].copy()
    drives, reduced = march.drives, march.reduced
    moved = drives.shapes.shape[1]
    m = reduced.n_mode
    modes, relative = (history[:n] for history in histories)
    if moved and n > 1:
        speed = np.gradient(relative, march.bodies.dt, axis=0)
    else:
        speed = np.zeros_like(relative)
    k_d, m_d = (drives.shapes.T @ reduced.tied.times(kind, drives.shapes) for kind in (STIFFNESS, MASS))
    d, rate = drives.motions[0, :, :n].T, drives.motions[1, :, :n].T
    count = reduced.drives.shape[1]
    of_stiffness, of_mass = (reduced.drives[:, count - k * moved : count - (k - 1) * moved] for k in (3, 1))
    # forces on the march have the sign of their inertia reversed
    inertia = modes[:, 1] @ of_mass[:m] + speed @ of_mass[m:]
    springs = modes[:, 0] @ of_stiffness[:m] + relative @ of_stiffness[m:]
    kinetic = 0.5 * np.einsum("ti,ij,tj->t", rate, m_d, rate) - (rate * inertia).sum(axis=1)
    elastic = 0.5 * np.einsum("ti,ij,tj->t", d, k_d, d) - (d * springs).sum(axis=1)
    elastic += _of_static_responses(march, count - 3 * moved, n)
    terms[:, KINETIC] += kinetic
    terms[:, ELASTIC] += elastic
    terms[:, WORK_OF_LOADS] += kinetic - kinetic[0] + elastic - elastic[0]
    terms[:, ELASTIC] -= layers
    terms[:, INTERFACE_WORK] -= layers - layers[0]
    return terms


def part_prestress(terms: Array, tied: TiedAssembly, shapes: Array, amplitudes: Array) -> None:
    """Take u.K_sigma u / 2 of the bodies out of the elastic energy among ``terms`` (n_time, N_TERM), J, as a term of
    its own; u of ``shapes`` (n_full, k) times ``amplitudes`` (n_time, k)."""
    stressed = [(tied.where[m.name], m.geometric) for m in tied.models if m.geometric is not None]
    # of all bodies first: one product with the amplitudes
    energies = np.zeros((shapes.shape[1], shapes.shape[1]))
    for where, geometric in stressed:
        energies += shapes[where].T @ np.asarray(geometric @ shapes[where])
    energy = 0.5 * ((amplitudes @ energies) * amplitudes).sum(axis=1)
    terms[:, PRESTRESS] += energy
    terms[:, ELASTIC] -= energy


def _of_static_responses(march: ReducedMarch, n_load: int, n: int) -> Array:
    """Energy (n,), J, of the static responses to the ``n_load`` loads of the scene that modes and relative motions
    leave."""
    reduced, first = march.reduced, march.reduced.rigid.shape[1]
    flexibility = reduced.forces[: reduced.tied.n_free, :n_load].T @ reduced.static_loads[:, :n_load]
    modes = reduced.drives[first : reduced.n_mode, :n_load]
    flexibility = flexibility - modes.T @ (modes / reduced.marched.values[:, None])
    a = march.drives.amplitudes[:n_load, :n].T
    return np.asarray(0.5 * np.einsum("ti,ij,tj->t", a, flexibility, a))
