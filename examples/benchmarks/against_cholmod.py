"""The same factors and the same linear march by CHOLMOD, beside this package.

    python examples/benchmarks/against_cholmod.py [--quick] [--rounds N] [--factors] [--impact]

Needs CHOLMOD through scikit-sparse (LGPL; nothing in the package uses it), with a BLAS made for the machine:

    apt-get install libsuitesparse-dev libopenblas-dev
    pip install "scikit-sparse<0.5"          # 0.5 is for SuiteSparse 7

Without it the columns of this package are printed alone. CPU time of one thread, all in one process, in turn, median.
CHOLMOD in its supernodal form, up to 20,000 unknowns also in its simplicial form (above, its factorisation takes many
times as long), ordered by METIS, by its own nested dissection (NESDIS) and by AMD.

  factors  operator M + c K of bodies: seconds of ordering and analysis, of the factorisation, of one solution, by the
           order of supernodal CHOLMOD with the shortest set-up; ``set-up`` is ours over that. Entries of the factor in
           our order, and over those in the order of METIS by CHOLMOD, both without the zeros of supernodes
  impact   problem P2 with friction (``harness``), from the matrices on: march with contact over the fastest
           CHOLMOD march of the bonded mesh, same scheme and steps, factorised once and solved once per instant; beside
           it the floor of this package, the same march by its own kernels, and its factor in the loop of CHOLMOD
"""

from __future__ import annotations

import importlib
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import scipy.sparse as sp
from floor import Floor
from harness import OWN, Case, contact_run, cpu, crushing, in_turn, prepared, tools
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.cholesky.symbolic import analyse, quotient_graph
from latin_fmu.cholesky.tree import column_counts, elimination_tree
from latin_fmu.fem.dissection import nested_dissection
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import Mesh, box_mesh

Array = NDArray[np.float64]
MISSING = (
    'no CHOLMOD here (apt-get install libsuitesparse-dev libopenblas-dev; pip install "scikit-sparse<0.5"): '
    "our own numbers alone"
)
NONE = np.zeros(0, dtype=np.int64)
CUBES, QUICK_CUBES = (14, 25, 36), (6,)  # elements along an edge
FILES = ("bolted_beam", "lap_joint", "punched_plates")
SIMPLICIAL = 20_000  # unknowns up to which that form is tried
TWO = 2  # fastest marches of CHOLMOD that are measured in turn


@dataclass(frozen=True)
class Way:
    """A form and an order of CHOLMOD."""

    mode: str
    order: str

    def __str__(self) -> str:
        return f"CHOLMOD {self.mode}, {self.order.upper()}"

    def analysis(self, library: Any, matrix: sp.csc_matrix) -> Any:
        """Order and pattern of the factor."""
        return library.analyze(matrix, mode=self.mode, ordering_method=self.order)


WAYS = tuple(Way(mode, order) for mode in ("supernodal", "simplicial") for order in ("metis", "nesdis", "amd"))


def library() -> Any:
    """``sksparse.cholmod`` of scikit-sparse 0.4, or None."""
    try:
        found = importlib.import_module("sksparse.cholmod")
    except ImportError:
        return None
    return found if hasattr(found, "analyze") else None


# -- factors ----------------------------------------------------------------------------------------------------------
def bodies(quick: bool) -> Iterator[tuple[str, Mesh, sp.csr_array]]:
    """Names, meshes and operators of cubes of hexahedra and of the largest parts of shipped mesh files."""
    for n in QUICK_CUBES if quick else CUBES:
        yield f"cube {n} x {n} x {n}", *_operator(box_mesh(np.zeros(3), np.full(3, float(n)), (n, n, n)))
    for name in () if quick else FILES:
        parts = discretise(latin_fmu.load_scene(tools.MODELS / name / "scene.toml")).bodies
        largest = max(parts, key=lambda part: parts[part].mesh.n_node)
        yield f"{name}, {largest}", *_operator(parts[largest].mesh)


def _operator(mesh: Mesh) -> tuple[Mesh, sp.csr_array]:
    """M + c K of a free body; a step of about the transit of an element."""
    basis = Elements(mesh)
    stiff, heavy = stiffness(basis, Isotropic(1.0, 1.0, 0.3)), mass(basis, 1.0)
    return mesh, sp.csr_array(heavy + heavy.diagonal().mean() / stiff.diagonal().mean() * stiff)


def fill(matrix: sp.csr_array, rank: Array) -> int:
    """Entries of the factor in an order, without the zeros of supernodes."""
    graph = quotient_graph(matrix, NONE, np.argsort(np.argsort(rank, kind="stable")).astype(float))
    parent = elimination_tree(graph.pointers, graph.neighbours, graph.n_interior)
    counts = column_counts(graph.pointers, graph.neighbours, parent, graph.weight)
    return int(counts.sum()) + matrix.shape[0]


Times = tuple[float, float, float]  # ordering and analysis, factorisation, one solution, s


def medians(rounds: Sequence[Times]) -> Times:
    """Medians of each."""
    first, second, third = (median(part) for part in zip(*rounds, strict=True))
    return first, second, third


def own_times(mesh: Mesh, matrix: sp.csr_array, b: Array) -> Times:
    """Of this package."""
    kept: dict[str, Any] = {}

    def analysed() -> None:
        kept["shape"] = analyse(matrix, NONE, np.repeat(nested_dissection(mesh), 3))

    def factorised() -> None:
        kept["factor"] = CholeskyFactor(matrix, NONE, symbolic=kept["shape"])

    return cpu(analysed), cpu(factorised), cpu(lambda: kept["factor"].solve(b[:, None]))


def their_times(found: Any, way: Way, matrix: sp.csc_matrix, b: Array) -> Times:
    """Of CHOLMOD in one way."""
    kept: dict[str, Any] = {}

    def analysed() -> None:
        kept["factor"] = way.analysis(found, matrix)

    return cpu(analysed), cpu(lambda: kept["factor"].cholesky_inplace(matrix)), cpu(lambda: kept["factor"](b))


def compare_factors(quick: bool, rounds: int) -> None:
    """Print a line for every body and solver."""
    found = library()
    print(f"{'':58}{'unknowns':>9}{'order s':>9}{'factor s':>9}{'solve ms':>10}{'entries':>10}  over METIS  set-up")
    for name, mesh, matrix in bodies(quick):
        b, rank = np.cos(np.arange(matrix.shape[0])), np.repeat(nested_dissection(mesh), 3)
        entries = fill(matrix, rank)
        columns = sp.csc_matrix(matrix)
        ways = WAYS if found is not None else ()
        with threadpool_limits(1):
            first = {way: their_times(found, way, columns, b) for way in ways if way.mode == "supernodal"}
            best = min(first, key=lambda way: sum(first[way][:2]), default=None)
            turns = [(own_times(mesh, matrix, b), best and their_times(found, best, columns, b)) for _ in range(rounds)]
        own = medians([turn[0] for turn in turns])
        head = f"{matrix.shape[0]:9d}"
        line = f"{name + ', this package':58}{head}{_shown(own)}{entries / 1e6:8.2f} M"
        if best is None:
            print(line, flush=True)
            continue
        theirs = medians([turn[1] for turn in turns if turn[1]])
        metis = np.argsort(Way("simplicial", "metis").analysis(found, columns).P()).astype(float)
        print(f"{line}{entries / fill(matrix, metis):12.2f}{sum(own[:2]) / sum(theirs[:2]):8.2f}")
        print(f"{name + ', ' + str(best):58}{head}{_shown(theirs)}", flush=True)


def _shown(times: Times) -> str:
    return f"{times[0]:9.3f}{times[1]:9.3f}{1e3 * times[2]:10.2f}"


# -- impact -----------------------------------------------------------------------------------------------------------
def march(found: Any, way: Way, floor: Floor) -> Array:
    """Linear march of the bonded mesh by CHOLMOD."""

    def factorised(matrix: sp.csr_array) -> Callable[[Array], Array]:
        columns = sp.csc_matrix(matrix)
        factor = way.analysis(found, columns)
        factor.cholesky_inplace(columns)
        return factor.__call__

    return floor.by(factorised)


def impacts(quick: bool) -> list[Case]:
    """P2 with 1000 and 5832 elements in each of the two blocks."""
    return [crushing(4, 0.3)] if quick else [crushing(10, 0.3), crushing(18, 0.3)]


def compare_impact(case: Case, rounds: int) -> dict[str, float]:
    """Print one case; CPU seconds of every march measured in turn."""
    ready = prepared(case, OWN)
    floor, found = Floor(ready), library()
    passes = contact_run(ready).passes
    works: dict[str, Callable[[], object]] = {
        "contact and friction": lambda: contact_run(ready),
        "own floor": floor.best,
        "own factor, same loop": floor.lean,
    }
    floor.best(), floor.lean()
    elements = int(np.prod(case.description["substructure"]["b1"]["box"]["elements"]))
    print(
        f"{case.case}: 2 x {elements} elements, {floor.unknowns} unknowns bonded, scheme {ready.scheme.name}, "
        f"{passes:.2f} passes per instant"
    )
    if found is not None:
        ways = [way for way in WAYS if way.mode == "supernodal" or floor.unknowns <= SIMPLICIAL]
        marches = {str(way): partial(march, found, way, floor) for way in ways}
        once = {name: in_turn({name: work}, 1)[name] for name, work in marches.items()}
        print("  once: " + ", ".join(f"{name} {s:.3f} s" for name, s in once.items()), flush=True)
        works |= {name: marches[name] for name in sorted(once, key=lambda name: once[name])[:TWO]}
    seconds = in_turn(works, rounds)
    peers = [s for name, s in seconds.items() if name.startswith("CHOLMOD")]
    for name, s in seconds.items():
        over = f"   over the best CHOLMOD march {s / min(peers):5.2f}" if peers else ""
        print(f"  {name:32}{s:9.4f} s   over our floor {s / seconds['own floor']:5.2f}{over}", flush=True)
    return seconds


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small bodies")
    parser.add_argument("--rounds", type=int, default=3, help="repetitions")
    parser.add_argument("--factors", action="store_true", help="factors alone")
    parser.add_argument("--impact", action="store_true", help="impact alone")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> list[dict[str, float]]:
    """Compare and print; CPU seconds of the marches of each impact."""
    said = options(argv)
    if library() is None:
        print(MISSING)
    if said.factors or not said.impact:
        compare_factors(said.quick, said.rounds)
    if said.factors and not said.impact:
        return []
    return [compare_impact(case, said.rounds) for case in impacts(said.quick)]


if __name__ == "__main__":
    main()
