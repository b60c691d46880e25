"""Threads of a run: the same bits with any number of them; large factors in pieces against factors in one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cholesky import pieces, substitution
from latin_fmu.cholesky.symbolic import analyse
from latin_fmu.compiled import PLAIN
from latin_fmu.fem.dissection import nested_dissection
from latin_fmu.fem.elements import Elements, mass
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.latin import run_state
from latin_fmu.latin.run_state import distributed
from latin_fmu.machine import in_threads
from latin_fmu.stability.scenes import STEEL, Box, column, rubbing

pytestmark = pytest.mark.skipif(PLAIN, reason="the kernels of a run are plain Python: one thread")

Tables = dict[str, Any]


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small factors are cut, and threads help small scenes."""
    monkeypatch.setattr(pieces, "SMALLEST", 15_000)
    monkeypatch.setattr(run_state, "_IDLE", 0)


def stack(blocks: int, elements: int, **solver: Any) -> Tables:
    """Blocks with friction on the ground, one on the other, pressed and sheared."""
    bodies = {f"b{i}": Box(STEEL, (0.01,) * 3, (elements,) * 3) for i in range(blocks)}
    loads = {f"press_{n}": {"face": f"{n}.xmin", "traction": [5e6, 0.0, -2e7], "law": {"type": "step"}} for n in bodies}
    contacts = {f"i{i}": {"friction_coefficient": 0.3} for i in range(blocks - 1)}
    time = {"end": 3e-6, "instants": 6}
    tables = column(bodies, contacts, time, load=loads, solver=solver, output={"energy": True})
    tables["interface"] = {"floor": rubbing("b0.zmin", "ground", 0.3), **tables["interface"]}
    return tables


def exact(tables: Tables) -> None:
    tables["solver"]["interface_operator"] = "exact"


def windows(tables: Tables) -> None:
    tables["solver"]["window"] = 3


def single(tables: Tables) -> None:
    tables["solver"]["precision"] = "float32"


def damped(tables: Tables) -> None:
    tables["material"]["steel"] |= {"frame": "absolute", "rayleigh_mass": 1e3, "rayleigh_stiffness": 1e-8}


def static(tables: Tables) -> None:
    tables["time"] = {"end": 1.0, "instants": 3, "quasi_static": True}
    tables["boundary"] = {"held": {"type": "fixed", "face": "b0.xmax"}}


def solved(tables: Tables, threads: int) -> Any:
    tables["solver"]["threads"] = threads
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome


def alone(blocks: int, elements: int) -> Tables:
    return stack(blocks, elements, share_identical=False)


@pytest.mark.parametrize(
    ("blocks", "elements", "change"),
    [
        (1, 5, None),
        (2, 5, None),
        (3, 5, None),
        (12, 2, None),
        (1, 5, exact),
        (3, 5, exact),
        (1, 5, windows),
        (2, 5, static),
        (1, 5, damped),
        (3, 5, single),
    ],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_threads_change_nothing(blocks: int, elements: int, change: Any) -> None:
    """To the last bit: one block and blocks of a class, in pieces, in tiles, with sweeps, in windows, in statics."""
    tables = stack(blocks, elements)
    if change:
        change(tables)
    same_bits(*[solved(tables, threads) for threads in (1, 2, 3)])


@pytest.mark.parametrize("change", [None, exact, windows], ids=lambda value: getattr(value, "__name__", str(value)))
def test_threads_of_single_blocks_change_nothing(change: Any) -> None:
    """Every block is a class of its own."""
    tables = alone(5, 3)
    if change:
        change(tables)
    same_bits(*[solved(tables, threads) for threads in (1, 2, 3)])


def same_bits(first: Any, *others: Any) -> None:
    assert first.marched
    for other in others:
        assert other.marched == first.marched
        assert [w.iterations for w in other.windows] == [w.iterations for w in first.windows]
        for name, history in first.interfaces.items():
            for field in ("traction", "velocity", "gap"):
                np.testing.assert_array_equal(getattr(history, field), getattr(other.interfaces[name], field))
        for name, term in first.energy.items():
            np.testing.assert_array_equal(term, other.energy[name])


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize("change", [None, exact], ids=["dense", "exact"])
def test_pieces_solve_the_same_system(blocks: int, change: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A factor in pieces and in one, to round-off."""
    tables = stack(blocks, 5, tolerance=1e-9, force_tolerance=1e-8, max_iterations=400)
    if change:
        change(tables)
    cut = solved(tables, 2)
    monkeypatch.setattr(pieces, "SMALLEST", 10**9)
    whole = solved(tables, 1)
    for name, history in whole.interfaces.items():
        assert np.abs(history.traction - cut.interfaces[name].traction).max() <= 1e-7 * np.abs(history.traction).max()


@pytest.mark.parametrize("elements", [(6, 6, 6), (16, 16, 2), (3, 3, 40)])
@pytest.mark.parametrize("kept", [0, 40])
def test_pieces_of_a_tree(elements: tuple[int, int, int], kept: int) -> None:
    """Every supernode is in one piece; pieces of one level are independent; the two halves are about equal."""
    mesh = box_mesh(np.zeros(3), np.asarray(elements, dtype=float), elements)
    matrix = mass(Elements(mesh), 1.0)
    shape = analyse(matrix, np.arange(3 * kept), np.repeat(nested_dissection(mesh), 3))
    count, levels, table = pieces.pieces(shape)
    assert count >= 3
    assert levels in (2, 3)
    numbers = table[levels + 1 : levels + 1 + substitution.STRIDE * count].reshape(count, -1)
    own, handed = [], []
    for line in numbers:
        ranges, front = (table[line[k] : line[k] + line[k + 1]] for k in (substitution.RANGES, substitution.FRONT))
        own.append({s for a, b in ranges.reshape(-1, 2) for s in range(a, b)})
        handed.append(front)
    assert sorted(s for piece in own for s in piece) == list(range(len(shape.first) - 1))
    owner = np.empty(len(shape.first) - 1, dtype=np.int64)
    for number, piece in enumerate(own):
        owner[list(piece)] = number
    level = np.searchsorted(table[: levels + 1], np.arange(count), side="right") - 1
    for s in range(len(owner)):
        rows = shape.rows[shape.row_start[s] : shape.row_start[s + 1]]
        inside = rows[rows < shape.n_interior]
        above = owner[np.searchsorted(shape.first, inside, side="right") - 1]
        assert ((above == owner[s]) | (level[above] > level[owner[s]])).all()
        assert np.isin(rows[~np.isin(rows, inside[above == owner[s]])], handed[owner[s]]).all()
    size = np.diff(shape.panel_start)
    below = [float(size[list(piece)].sum()) for piece in own[: table[1]]]
    assert max(below) <= 0.6 * sum(below)


def test_classes_are_distributed_by_cost() -> None:
    hands = distributed([1.0, 8.0, 2.0, 5.0], 2, ())
    assert [hand.tolist() for hand in hands] == [[1], [3, 2, 0]]
    assert [hand.tolist() for hand in distributed([1.0, 1.0], 2, (0, 1))] == [[0], [1]]
    assert [hand.tolist() for hand in distributed([4.0, 1.0, 1.0], 2, (0,))] == [[1], [2]]


def test_results_of_threads_are_in_order() -> None:
    """Of each item, with the settings for errors of the caller; the first error is raised."""
    with np.errstate(over="ignore"):
        assert in_threads(3, lambda x: (x, np.geterr()["over"]), range(5)) == [(x, "ignore") for x in range(5)]

    def fail(x: int) -> None:
        raise ValueError(x)

    with pytest.raises(ValueError, match=r"^0$"):
        in_threads(2, fail, range(5))
