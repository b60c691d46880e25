"""Factors in single precision (``solver.precision = "float32"``): what they save, and what they cost in accuracy.

    python examples/benchmarks/precision.py [--quick]

    solve     A^-1 b with the operator M + c K of a cube of hexahedra: double precision; single precision; and single
              precision with one step of refinement, x + A^-1 (b - A x), which the product with A and a second solution
              make. ``error``: of x in the maximum norm, against double precision refined twice.
    march     the crushing of two cubes with friction in both precisions: ms per instant; relative L2 distance of the
              force histories; the balance of energies over the largest energy.

Single precision is to be the default only where one step of refinement leaves 1e-12 and it is still 1.3 times faster
than double precision; both are printed. CPU time of one thread, in turn, median.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from harness import contact_run, crushing, force_error, in_turn, prepared

from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.fem.dissection import nested_dissection
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.latin.outcome import Outcome

SOLVED, MARCHED, ROUNDS, TURNS = (14, 25, 36), (10, 18), 9, 3  # elements along an edge
QUICK = (6,), (4,), 2, 1
ALLOWED, FASTER = 1e-12, 1.3
Solve = Callable[[], np.ndarray]
NOTHING = np.zeros(0, dtype=np.int64)  # no dofs are kept for an interface


def block(n: int) -> tuple[sp.csr_array, np.ndarray]:
    """Operator M + 0.4 K of a cube of n^3 hexahedra, and the nested dissection of its nodes."""
    mesh = box_mesh(np.zeros(3), np.full(3, float(n)), (n, n, n))
    basis = Elements(mesh)
    return sp.csr_array(mass(basis, 1.0) + 0.4 * stiffness(basis, Isotropic(1.0, 1.0, 0.3))), np.repeat(
        nested_dissection(mesh), 3
    )


def refined(factor: CholeskyFactor, matrix: sp.csr_array, b: np.ndarray, steps: int) -> Solve:
    """Solution with so many steps of refinement."""

    def solve() -> np.ndarray:
        x = factor.solve(b)
        for _ in range(steps):
            x = x + factor.solve(b - matrix @ x)
        return x

    return solve


def solutions(n: int, rounds: int) -> bool:
    """Print the solutions with the operator of a cube; whether refined single precision is a good default."""
    matrix, rank = block(n)
    b = np.cos(np.arange(matrix.shape[0]))[:, None]
    double = CholeskyFactor(matrix, NOTHING, rank)
    single = CholeskyFactor(matrix, NOTHING, rank, np.float32)
    exact = refined(double, matrix, b, 2)()
    works = {
        "double": refined(double, matrix, b, 0),
        "single": refined(single, matrix, b, 0),
        "single, refined once": refined(single, matrix, b, 1),
    }
    seconds = in_turn(works, rounds)
    print(f"{matrix.shape[0]} unknowns, factor of {1e-6 * double.panels.nbytes:.0f} MB")
    errors = {name: float(np.abs(work() - exact).max() / np.abs(exact).max()) for name, work in works.items()}
    for name, s in seconds.items():
        gain = f"{seconds['double'] / s:6.2f} times as fast"
        print(f"    {name:22}{1e3 * s:9.2f} ms {gain}   error {errors[name]:.1e}", flush=True)
    good = errors["single, refined once"] <= ALLOWED
    return good and seconds["double"] >= FASTER * seconds["single, refined once"]


def marches(n: int, rounds: int) -> None:
    """Print the march of two cubes in both precisions."""
    runs: dict[str, Outcome] = {}

    def work(precision: str) -> Callable[[], None]:
        case = crushing(n, 0.3)
        case.description["output"] = {"energy": True}
        ready = prepared(case, {"propagator": "direct", "share_identical": False, "precision": precision})

        def march() -> None:
            runs[precision] = contact_run(ready)
            spent[precision].append(runs[precision].timings.march / (len(ready.time) - 1))

        return march

    spent: dict[str, list[float]] = {"float64": [], "float32": []}
    in_turn({precision: work(precision) for precision in spent}, rounds)
    first = float(np.median(spent["float64"]))
    print(f"2 x {n**3} elements")
    for precision, outcome in runs.items():
        own = float(np.median(spent[precision]))
        energy = outcome.energy
        assert energy is not None
        parts = np.abs(np.stack([energy[name] for name in ("kinetic", "elastic")])).max()
        balance = np.abs(energy["balance"]).max() / parts
        print(
            f"    {precision:22}{1e3 * own:9.2f} ms {first / own:6.2f} times as fast   "
            f"forces {force_error(outcome, runs['float64']):.1e}   balance {balance:.1e}",
            flush=True,
        )


def main(argv: list[str] | None = None) -> bool:
    """Print the tables; whether refined single precision is a good default for some size."""
    quick = "--quick" in (sys.argv[1:] if argv is None else argv)
    solved, marched, rounds, turns = QUICK if quick else (SOLVED, MARCHED, ROUNDS, TURNS)
    good = [solutions(n, rounds) for n in solved]
    for n in marched:
        marches(n, turns)
    found = "as a default" if any(good) else "as a setting, not as a default"
    print(f"single precision, refined once to {ALLOWED:g} and {FASTER:g} times faster: {found}")
    return any(good)


if __name__ == "__main__":
    main()
