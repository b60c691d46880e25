"""What a study reads of an assembly marched by its modes: contacts as they were marched, sensors, reactions and bolts,
and of bonds their normal resultants alone.

Tractions of bonds at every point take the motion of all dofs at every instant (``recovered_fields``). Their resultants
R are sums of few rows: with the rows y that give R by the forces g on the bodies (``bond_forces``),

    R = y g = (y K) u + (y C) v + (y M) a - y f - y (forces of the other interfaces)

which are rows of the motion, exact and as cheap as a sensor.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..latin.assembly import Array, Index
from ..time_scheme import MaxwellBranches
from .motion_rows import bond_rows, carried_rows
from .recovered_fields import Motions, RecoveredRecorder
from .reduced_run import ReducedMarch
from .tied_assembly import DAMPING, MASS, STIFFNESS, STRAINED


def follows_resultants(march: ReducedMarch) -> bool:
    """Whether resultants can be read without the motion of all points: layers, and the sliding of interfaces without
    tangential unknowns, take it."""
    units = march.bodies.interfaces
    return not march.tied.joints.linear and all(unit.behaviour.n_component != 1 for unit in units)


class ResultantRecorder(RecoveredRecorder):
    """Histories of an assembly that was marched as a reduced one, without the motion of single points: velocities of
    the sides of contacts are those of E over E', bonds have no histories."""

    def _velocities(self, flat_w: Array) -> None:
        """Those of the ground alone."""
        self._ground(flat_w)

    def _move_sides(self, flat_w: Array, sides: tuple[Index, Index], relative: Array) -> None:
        """Set velocities of E from those of E', which are those of the ground or zero."""
        flat_w[:, sides[0]] = flat_w[:, sides[1]] + relative

    def _recover_bonds(self, flat_f: Array) -> None:
        """Resultants of the bonds."""
        bonded, units = self._march.tied.joints.bonded, self._march.bodies.interfaces
        self.unread = frozenset(units[i].name for i in bonded)
        if bonded and self.request.bond_resultants:
            sums = bond_resultants(self._motions, flat_f)
            self.bond_resultants = {units[i].name: series for i, series in zip(bonded, sums.T, strict=True)}

    def _read_series(self, n: int) -> None:
        """Sensors, reactions and bolts; bonds have no tractions here, those on held dofs are sums of few rows."""
        super()._read_series(n)
        for name, support in self.request.supports.items():
            rows, _ = carried_rows(self._march, support)
            if rows.count_nonzero():
                self._series["force"][name][:n, 1] -= sums_of_bonds(self._motions, self.rows.f_hat[:n], rows)

    def _recover_bodies(self) -> None:
        """None: no field is stored."""


def bond_resultants(motions: Motions, flat_f: Array) -> Array:
    """Normal resultants (n_time, n_bond) of all bonds, N, positive in compression; as ``sums_of_bonds``."""
    # the last row of each bond
    rows = [of_bond[3:] for of_bond in bond_rows(motions.march).values()]
    return sums_of_bonds(motions, flat_f, sp.csr_array(sp.vstack(rows)))


def sums_of_bonds(motions: Motions, flat_f: Array, rows: sp.csr_array) -> Array:
    """Sums (n_time, k) of the tractions of bonds by their rows (k, n_full); ``flat_f`` : tractions (n_time, n_flat) of
    the other interfaces, Pa."""
    march = motions.march
    tied, layout = march.tied, march.bodies.layout
    n, drives = len(flat_f), march.drives
    n_load = drives.n_load
    total = -(rows @ drives.forces[:, :n_load] @ drives.amplitudes[:n_load, :n]).T
    total -= flat_f @ (sp.diags_array(layout.area) @ (tied.trace @ rows.T)).toarray()
    return np.asarray(total + _internal(motions, rows))


def _internal(motions: Motions, rows: sp.csr_array) -> Array:
    """rows (K u + C v + M a), (n_time, k), of the bodies."""
    tied = motions.march.tied
    of_branches: dict[MaxwellBranches, list[str]] = {}
    for model in tied.models:
        of_branches.setdefault(model.branches, []).append(model.name)
    total = np.zeros((len(motions.modes), rows.shape[0]))
    parts = [(STIFFNESS, names) for names in of_branches.values()]
    parts += [(DAMPING, [*tied.where]), (MASS, [*tied.where])]
    for kind, names in parts:
        products = tied.rows_times(kind, rows, names)
        if not products.count_nonzero():
            continue
        moved = motions.sensed(products)
        if kind == STIFFNESS:
            model = next(m for m in tied.models if m.name == names[0])
            strained = moved[0]
            if any(m.unrelaxed is not None for m in tied.models if m.name in names):
                strained = motions.sensed(tied.rows_times(STRAINED, rows, names))[0]
            total += moved[0] + motions.relaxing(model, strained)
        else:
            total += moved[1 if kind == DAMPING else 2]
    return total
