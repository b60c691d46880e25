"""The same matrices by this package and by Siconos, the rival that keeps its operators too.

Problems P2 and P3 with friction 0.3, same mesh and steps. Siconos: Moreau-Jean with one factorisation, two solves an
instant, non-smooth Gauss-Seidel on the contact points; it is given this package's factor and the matrix of the
contact points, built body by body, so that only the method differs. Ratio to the linear transient of the bonded mesh,
CPU time of one thread, everything from the matrices on in the timed region, in turn, median of several.

  tolerance  of Siconos' solver; the package runs with its defaults
  distance   of the normal resultants of all interfaces to the package's (other scheme, impulses between instants:
             a few per cent are the discretisation)

Without Siconos it prints a message only.

Moreau-Jean:

    (M + theta^2 h^2 K) (v+ - v) = h [theta f+ + (1 - theta) f - K (u + h theta v)] + H^T p
    u+ = u + h (theta v+ + (1 - theta) v)
    0 <= u_N + gap/h  perp  p_N >= 0,  Coulomb on p,  with u = H v+ the velocities of the points and p impulses, N s

Two solves an instant: the free velocity, and what the impulses add. W = H A^-1 H^T is built once, body by body. Contact
by libsiconos_numerics 4: 0 <= u_N perp p_N >= 0 and Coulomb's law at every point, u = W p + q; components N, t1, t2 of
a point in a row. The library is found by the dynamic linker; Debian and Ubuntu have it as libsiconos-numerics7.
"""

from __future__ import annotations

import ctypes
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from ctypes.util import find_library

import numpy as np
import scipy.sparse as sp
from floor import Floor
from harness import OWN, Case, contact_run, crushing, in_turn, prepared, tools, tower

from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.propagator import SubstructureModel
from latin_fmu.propagator.model import reduced_rank

TOLERANCES = (1e-3, 1e-6)
THETA = 0.5
MISSING = "Siconos (libsiconos_numerics) is not installed: Debian and Ubuntu have it as libsiconos-numerics7"
_SPARSE_BLOCK, _GAUSS_SEIDEL = 1, 500  # NM_SPARSE_BLOCK, SICONOS_FRICTION_3D_NSGS
_Doubles, _Unsigned = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_uint)


# -- contact ----------------------------------------------------------------------------------------------------------
class _Options(ctypes.Structure):
    """First fields of SolverOptions."""

    _fields_ = [
        ("solver", ctypes.c_int),
        ("is_set", ctypes.c_bool),
        ("n_int", ctypes.c_int),
        ("ints", ctypes.POINTER(ctypes.c_int)),
        ("n_double", ctypes.c_int),
        ("doubles", _Doubles),
    ]


def library() -> ctypes.CDLL | None:
    """The library with its signatures; None where it is not installed."""
    name = find_library("siconos_numerics")
    if name is None:
        return None
    found = ctypes.CDLL(name)
    pointer, number, count = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint
    signatures = {
        "SBCM_new_3x3": (pointer, [count, count, count, _Unsigned, _Unsigned, _Doubles]),
        "SBCM_to_SBM": (pointer, [pointer]),
        "NM_create_from_data": (pointer, [number, number, number, pointer]),
        "frictionContactProblem_new_with_data": (pointer, [number, number, pointer, _Doubles, _Doubles]),
        "solver_options_create": (ctypes.POINTER(_Options), [number]),
        "fc3d_driver": (number, [pointer, _Doubles, _Doubles, ctypes.POINTER(_Options)]),
    }
    for function, (result, arguments) in signatures.items():
        getattr(found, function).restype = result
        getattr(found, function).argtypes = arguments
    return found


class Contacts:
    """Contact points: W (3 n, 3 n), velocity per impulse, kg-1, and friction coefficients mu (n,)."""

    def __init__(self, found: ctypes.CDLL, w: tools.Array, mu: tools.Array, tolerance: float) -> None:
        self._library, n = found, len(mu)
        blocks = w.reshape(n, 3, n, 3).transpose(0, 2, 3, 1)  # column by column
        row, column = np.nonzero(np.abs(blocks).max(axis=(2, 3)))
        # kept: the library points into these arrays; its rows and columns count from 1
        self._row, self._column = (row + 1).astype(np.uint32), (column + 1).astype(np.uint32)
        self._blocks = np.ascontiguousarray(blocks[row, column])
        self.q, self.mu = np.zeros(3 * n), np.ascontiguousarray(mu, dtype=float)
        self.impulse, self._velocity = np.zeros((2, 3 * n))
        listed = found.SBCM_new_3x3(
            n,
            n,
            len(row),
            self._row.ctypes.data_as(_Unsigned),
            self._column.ctypes.data_as(_Unsigned),
            _doubles(self._blocks),
        )
        matrix = found.NM_create_from_data(_SPARSE_BLOCK, 3 * n, 3 * n, found.SBCM_to_SBM(listed))
        self._problem = found.frictionContactProblem_new_with_data(3, n, matrix, _doubles(self.q), _doubles(self.mu))
        self._options = found.solver_options_create(_GAUSS_SEIDEL)
        self._options.contents.doubles[0] = tolerance
        self._options.contents.ints[0] = 10_000

    def solve(self) -> int:
        """``impulse`` (3 n,) for the present ``q``, from the last one; iterations."""
        self._library.fc3d_driver(self._problem, _doubles(self.impulse), _doubles(self._velocity), self._options)
        return int(self._options.contents.ints[1])


def _doubles(values: tools.Array) -> ctypes._Pointer[ctypes.c_double]:
    return values.ctypes.data_as(_Doubles)


# -- march ------------------------------------------------------------------------------------------------------------
class MoreauJean:
    """A scene whose interfaces are all frictional contacts, every block a class of its own."""

    def __init__(self, ready: DiscretisedProblem, found: ctypes.CDLL, tolerance: float) -> None:
        self._ready, self._library, self._tolerance = ready, found, tolerance
        self.models: list[SubstructureModel] = [c.members[0] for c in ready.classes]
        n = sum(u.geometry.n_point for u in ready.units)
        row, sign = np.zeros(ready.layout.n_flat, dtype=int), np.zeros(ready.layout.n_flat)
        self.first = np.cumsum([0, *(u.geometry.n_point for u in ready.units)])
        for i in range(len(ready.units)):
            for side in (0, 1):
                flat = ready.layout.channels(i, side)
                row[flat] = 3 * self.first[i] + np.arange(flat.size).reshape(flat.shape)
                sign[flat] = 2 * side - 1
        self.rows = [row[c.channels[:, 0]] for c in ready.classes]
        traces = [
            sp.diags_array(sign[c.channels[:, 0]]) @ m.trace @ m.expansion
            for c, m in zip(ready.classes, self.models, strict=True)
        ]
        self.traces = [sp.csr_array(t) for t in traces]
        spread = [sp.csr_array((np.ones(len(r)), (r, np.arange(len(r)))), shape=(3 * n, len(r))) for r in self.rows]
        self.h = sp.csr_array(sp.hstack([s @ t for s, t in zip(spread, self.traces, strict=True)]))
        self.mass = sp.csr_array(sp.block_diag([m.reduced[0] for m in self.models], format="csr"))
        self.stiffness = sp.csr_array(sp.block_diag([m.reduced[2] for m in self.models], format="csr"))
        self.mu = np.concatenate(
            [np.full(u.geometry.n_point, ready.scene.interface[u.name].friction_coefficient) for u in ready.units]
        )
        self.gap = np.concatenate([u.geometry.gap for u in ready.units])
        self.iterations = 0

    def run(self) -> tools.Array:
        """Factorise and march; normal contact forces (n_time, n_interface), N, over the step that ends there."""
        self.iterations = 0
        solve, contacts = self._factorise()
        h, h_t, dt = self.h, sp.csr_array(self.h.T), self._ready.dt
        pattern, amplitude = self._loads()
        mean = THETA * amplitude[1:] + (1.0 - THETA) * amplitude[:-1]
        u, v = np.zeros((2, self.mass.shape[0]))
        gap, forces = self.gap.copy(), np.zeros((len(mean) + 1, len(self.first) - 1))
        for i, now in enumerate(mean):
            free = v + solve(dt * (pattern @ now - self.stiffness @ (u + dt * THETA * v)))
            contacts.q[:] = h @ free
            contacts.q[::3] += gap / dt
            self.iterations += contacts.solve()
            new = free + solve(h_t @ contacts.impulse)
            u += dt * (THETA * new + (1.0 - THETA) * v)
            v = new
            gap += dt * (h @ v)[::3]
            forces[i + 1] = np.add.reduceat(contacts.impulse[::3], self.first[:-1]) / dt
        return forces

    def _factorise(self) -> tuple[Solve, Contacts]:
        """One factor for all blocks, and W from a factor of each block."""
        dt, n = self._ready.dt, len(self.gap)
        w = np.zeros((3 * n, 3 * n))
        matrix = sp.csr_array(self.mass + (THETA * dt) ** 2 * self.stiffness)
        ranks, start = [], 0.0
        for model in self.models:
            assert model.ordering is not None
            rank = reduced_rank(model.expansion, model.ordering)
            ranks.append(rank + start)
            start += float(rank.max()) + 1.0
        solve = Solve(matrix, np.concatenate(ranks))
        # columns of different blocks do not meet: one right-hand side holds one of each
        offsets = np.cumsum([0, *(t.shape[1] for t in self.traces)])
        sides = np.zeros((matrix.shape[0], max(len(r) for r in self.rows)))
        for trace, begin, end in zip(self.traces, offsets[:-1], offsets[1:], strict=True):
            sides[begin:end, : trace.shape[0]] = trace.T.toarray()
        answers = solve.factor.solve(sides)
        for rows, trace, begin, end in zip(self.rows, self.traces, offsets[:-1], offsets[1:], strict=True):
            w[np.ix_(rows, rows)] += trace @ answers[begin:end, : trace.shape[0]]
        held = np.flatnonzero(w.diagonal() <= 0.0)  # directions of a symmetry plane: nothing happens there
        w[held, held] = w.diagonal().max()
        return solve, Contacts(self._library, 0.5 * (w + w.T), self.mu, self._tolerance)

    def _loads(self) -> tuple[tools.Array, tools.Array]:
        """Reduced patterns (n_dof, n_load) and their amplitudes (n_time, n_load)."""
        ready, columns, amplitudes, start = self._ready, [], [], 0
        total = self.mass.shape[0]
        for model in self.models:
            reduced = [np.asarray(model.expansion.T @ load.pattern) for load in model.loads]
            for pattern, law in zip(reduced, ready.timeline.histories(model, ready.time).amplitudes, strict=True):
                column = np.zeros(total)
                column[start : start + len(pattern)] = pattern
                columns.append(column)
                amplitudes.append(law)
            start += model.expansion.shape[1]
        return np.stack(columns, axis=1), np.stack(amplitudes, axis=1)


class Solve:
    """A^-1 b for vectors, one factor."""

    def __init__(self, matrix: sp.csr_array, rank: tools.Array) -> None:
        self.factor = CholeskyFactor(matrix, np.zeros(0, dtype=np.int64), rank)
        self._none = np.zeros((0, 1))

    def __call__(self, b: tools.Array) -> tools.Array:
        y, _ = self.factor.forward(b[:, None])
        return self.factor.backward(y, self._none)[:, 0]


# -- comparison -------------------------------------------------------------------------------------------------------
def cases(quick: bool) -> list[Case]:
    """What is compared."""
    chosen = [crushing(4, 0.3), tower(2, 4), tower(16, 4)]
    if quick:
        return chosen
    return [*chosen[:1], crushing(10, 0.3), *(tower(blocks, n) for n in (4, 6) for blocks in (2, 4, 8, 16))]


def compare(case: Case, rounds: int) -> None:
    """Print one case."""
    found = library()
    assert found is not None
    ready = prepared(case, OWN)
    outcome = contact_run(ready)
    forces = np.stack([outcome.interfaces[u.name].normal_resultant() for u in ready.units], axis=1)
    rivals = {tolerance: MoreauJean(ready, found, tolerance) for tolerance in TOLERANCES}
    distances = {t: float(np.linalg.norm(r.run() - forces) / np.linalg.norm(forces)) for t, r in rivals.items()}
    floor = Floor(ready)
    works: dict[str, Callable[[], object]] = {"floor": floor.best, "own": lambda: contact_run(ready)}
    works |= {f"{tolerance:g}": rival.run for tolerance, rival in rivals.items()}
    floor.best()
    seconds = in_turn(works, rounds)
    unit = seconds["floor"]
    print(f"{case.case}, {case.n_blocks} blocks: floor {unit:.4f} s")
    print(f"    latin_fmu           ratio {seconds['own'] / unit:6.2f}   {outcome.passes:5.2f} passes")
    for tolerance, rival in rivals.items():
        print(
            f"    Siconos, {tolerance:7.0e}    ratio {seconds[f'{tolerance:g}'] / unit:6.2f}   "
            f"{rival.iterations / outcome.time.size:5.2f} sweeps   distance {distances[tolerance]:.4f}",
            flush=True,
        )


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three small cases")
    parser.add_argument("--rounds", type=int, default=5, help="repetitions")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Compare and print."""
    arguments = options(argv)
    if library() is None:
        print(MISSING)
        return 0
    for case in cases(arguments.quick):
        compare(case, arguments.rounds)
    return 0


if __name__ == "__main__":
    main()
