"""What a run keeps of its substructures at every instant: velocities under frictionless interfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from .assembly import Array, Assembly


class SlideProbes:
    """Tangential velocities of frictionless interfaces, read from the substructures.

    Such interfaces have no tangential unknowns; every point needs the velocity of its node on each side.

    Parameters
    ----------
    interfaces : numbers of the interfaces without tangential unknowns.

    Attributes
    ----------
    rows : per class (n_probe, n_dof) rows of the nodes of those faces, x y z of one point after the other; None
        where a class has none.
    """

    def __init__(self, assembly: Assembly, interfaces: Sequence[int]) -> None:
        propagators = self._propagators = assembly.propagators
        self._ground = [i for i in interfaces if assembly.interfaces[i].against_ground]
        self._places: list[tuple[int, int, slice, int, int]] = []  # class, member, rows, interface, side
        faces: list[list[sp.csr_array]] = [[] for _ in propagators]
        self._traces: list[sp.csr_array | None] = []
        for c, propagator in enumerate(propagators):
            for member, name in enumerate(propagator.names):
                at = 0
                for i in interfaces:
                    unit = assembly.interfaces[i]
                    for side, face in enumerate(unit.sides):
                        trace = unit.geometry.traces[side]
                        if trace is None or face.split(".")[0] != name:
                            continue
                        if member == 0:
                            faces[c].append(trace)
                        self._places.append((c, member, slice(at, at + trace.shape[0]), i, side))
                        at += trace.shape[0]
            full = sp.csr_array(sp.vstack(faces[c])) if faces[c] else None
            nodal = propagator.members[0].nodal
            self._traces.append(full if full is None or nodal is None else sp.csr_array(full @ nodal))
        self.rows = [
            None if full is None else sp.csr_array(full @ propagator.members[0].expansion)
            for full, propagator in zip(self._traces, propagators, strict=True)
        ]

    def read(self, assembly: Assembly, instants: slice, probed: Sequence[Array], slide: Mapping[int, Array]) -> None:
        """Write the velocities ``probed`` (n, n_probe, n_member) per class at n instants into ``slide``, (n_time, 2,
        n_point, 3) per interface."""
        for c, member, rows, i, side in self._places:
            values = probed[c][:, rows, member]
            forcing, trace = self._propagators[c].forcing, self._traces[c]
            if forcing.moves and trace is not None:
                part = sp.csr_array(trace[rows])
                imposed = [part @ forcing.imposed_v(t)[:, member] for t in range(instants.start, instants.stop)]
                values = values + np.stack(imposed)
            slide[i][instants, side] = values.reshape(len(values), -1, 3)
        for i in self._ground:
            slide[i][instants, 1] = assembly.ground[i][instants][:, None]
