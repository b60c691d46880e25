"""The floor of every cost of contact: the linear transient of the same mesh with the interfaces bonded.

One factorisation and one solve per instant; no implicit method that marches full finite elements is below.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from latin_fmu.assembly.merged_assembly import Merged, merge
from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.kernels import entries
from latin_fmu.propagator import DirectPropagator
from latin_fmu.propagator.base import full_displacement
from latin_fmu.propagator.image import Image, ImageClass
from latin_fmu.propagator.model import reduced_rank

NOTHING = np.zeros((0, 1))


class Floor:
    """Linear transients of the bonded mesh: same steps, same scheme (HHT), same loads."""

    def __init__(self, ready: DiscretisedProblem) -> None:
        self._ready = ready
        members = [m for c in ready.classes for m in c.members]
        self._merged: Merged = merge(members, ready.units, ready.info)
        _ = self._merged.model.reduced, self._rank

    @property
    def marches(self) -> dict[str, Callable[[], object]]:
        """What a linear transient can be marched with here."""
        return {"compiled march": self.compiled, "lean march": self.lean, "SuperLU": self.superlu}

    @property
    def best(self) -> Callable[[], object]:
        """The fastest of them on every mesh looked at."""
        return self.compiled

    def compiled(self) -> DirectPropagator:
        """The kernels of the package's march, no interpreter between the instants."""
        return self._compiled()[0]

    def march(self) -> float:
        """CPU seconds of that march, factorisation and set-up left out."""
        return self._compiled()[1]

    def _compiled(self) -> tuple[DirectPropagator, float]:
        """The body at the end of its march by the kernels, and the CPU seconds of the march."""
        body, steps = self._begun(), len(self._ready.time) - 1
        image = self._image(body)
        start = clock.process_time()
        for first in range(1, steps + 1, image.rows):
            image.set({"first_row": first})
            image.call(entries.MARCH, first, min(image.rows, steps + 1 - first))
        body.instant = steps
        return body, clock.process_time() - start

    def displacements(self) -> Iterator[np.ndarray]:
        """Displacements of the nodes of all blocks (n_node, 3), m, instant by instant."""
        body = self._begun()
        for _ in self._instants(body):
            yield full_displacement(body, 0)

    def _image(self, body: DirectPropagator) -> Image:
        image = Image([ImageClass(body, np.zeros((0, 1), dtype=np.int64))], np.zeros(0, dtype=bool))
        image.begin(len(self._ready.time), {})
        image.bind(1)
        image.write()
        return image

    def _instants(self, body: DirectPropagator) -> Iterator[int]:
        """March the body, one instant a call of the kernels."""
        image = self._image(body)
        for instant in range(1, len(self._ready.time)):
            image.set({"first_row": instant})
            image.call(entries.MARCH, instant, 1)
            body.instant = instant
            yield instant

    def _begun(self) -> DirectPropagator:
        ready = self._ready
        body = DirectPropagator([self._merged.model], ready.scheme, ready.dt, False)
        body.begin([self._merged.histories(ready.timeline, ready.time)], ready.dt)
        body.start(NOTHING, None)  # at rest, without load
        return body

    def lean(self) -> np.ndarray:
        """The factor of the package in the shortest loop there is."""
        return self.kept()()

    def kept(self) -> Callable[[], np.ndarray]:
        """``lean`` with a factor made now."""
        matrix = self._operator()
        factor = CholeskyFactor(matrix, np.zeros(0, dtype=np.int64), self._rank)
        none = np.zeros((0, 1))

        def solve(b: np.ndarray) -> np.ndarray:
            y, _ = factor.forward(b[:, None])
            return factor.backward(y, none)[:, 0]

        return lambda: self._loop(solve)

    @property
    def unknowns(self) -> int:
        """Of the bonded mesh."""
        return len(self._rank)

    def by(self, factorise: Callable[[sp.csr_array], Callable[[np.ndarray], np.ndarray]]) -> np.ndarray:
        """The same loop with another solver, made from the operator in the timed region."""
        return self._loop(factorise(self._operator()))

    def superlu(self) -> np.ndarray:
        """SciPy's SuperLU in the nested-dissection order of the mesh, in the same loop."""
        order = np.argsort(self._rank, kind="stable")
        matrix = sp.csc_array(self._operator()[order][:, order])
        factor = spla.splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        x = np.empty(len(order))

        def solve(b: np.ndarray) -> np.ndarray:
            x[order] = factor.solve(b[order])
            return x

        return self._loop(solve)

    @cached_property
    def _rank(self) -> np.ndarray:
        model = self._merged.model
        assert model.ordering is not None
        return reduced_rank(model.expansion, model.ordering)

    def _operator(self) -> sp.csr_array:
        mass, _, stiffness = self._merged.model.reduced
        c_mass, _, c_stiffness = self._ready.scheme.operator(self._ready.dt)
        return sp.csr_array(c_mass * mass + c_stiffness * stiffness)

    def _loop(self, solve: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Displacements at the end of M a + K u = f by HHT, one product with K and one solve per instant."""
        ready, model, scheme = self._ready, self._merged.model, self._ready.scheme
        dt, memory, stiffness = ready.dt, scheme.memory_weight, model.reduced[2]
        history = self._merged.histories(ready.timeline, ready.time)
        pattern = np.stack([np.asarray(model.expansion.T @ load.pattern) for load in model.loads], axis=1)
        amplitude = np.stack(history.amplitudes, axis=1)
        weighted = scheme.force_weight * amplitude[1:] - memory * amplitude[:-1]
        u, v, a = np.zeros((3, pattern.shape[0]))
        for now in weighted:
            free_u, free_v = scheme.predict(u, v, a, dt)
            a = solve(pattern @ now - stiffness @ (scheme.force_weight * free_u - memory * u)).copy()
            u = free_u + scheme.displacement_gain(dt) * a
            v = free_v + scheme.velocity_gain(dt) * a
        return u
