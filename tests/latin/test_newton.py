"""Newton steps: elimination in an envelope, tangents of the laws, the end of an instant, ways of getting there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.compiled import PLAIN
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.kernels import envelope
from latin_fmu.latin import search_direction
from latin_fmu.latin.search_direction import LARGEST, ordered_blocks, relative_operator
from latin_fmu.laws import dispatch as laws
from latin_fmu.laws.dispatch import LAWS
from latin_fmu.laws.parts import PointState, Unknowns
from latin_fmu.stability.scenes import STEEL, Box, Description, column, rubbing

RNG = np.random.default_rng(5)


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets kernels call each other in Python."""
    for module in (envelope, laws):
        for name, value in vars(module).items():
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)


# -- the matrix ---------------------------------------------------------------------------------------------------
SHAPES = {
    "one block": ([19], [0], [0]),
    "chain": ([7, 11, 3], [0, 0, 1], [1, 2, 2]),
    "an empty block": ([9, 0, 5, 8], [0, 0, 1, 2], [1, 2, 3, 3]),
    "apart": ([4, 12], [0, 1], [0, 1]),
}


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("shape", SHAPES)
def test_elimination_in_the_envelope(shape: str) -> None:
    """Solutions are those of NumPy; a column that has no pivot is reported."""
    sizes, *ends = SHAPES[shape]
    low, high = (np.array(e) for e in ends)
    start = np.concatenate([[0], np.cumsum(sizes)])
    n, blocks = int(start[-1]), len(sizes)
    matrix = np.zeros((n, n))
    for b in range(blocks):
        for c in range(low[b], high[b] + 1):
            part = np.s_[start[b] : start[b + 1], start[c] : start[c + 1]]
            matrix[part] = RNG.normal(size=matrix[part].shape)
    row_at, pivots = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    numbers = np.full(envelope.place_rows(blocks, start, low, high, row_at), np.nan)
    for b in range(blocks):
        ends = start[low[b]], start[high[b] + 1]
        for i in range(start[b], start[b + 1]):
            numbers[row_at[i] + ends[0] : row_at[i] + ends[1]] = matrix[i, ends[0] : ends[1]]
    form, scratch = (blocks, start, low, high, row_at), np.empty(envelope.PANEL * (envelope.TILE + 1) + 2)
    kept = numbers.copy()
    assert envelope.factorise(*form, numbers, pivots, scratch) > 0.0
    x = RNG.normal(size=n)
    expected = np.linalg.solve(matrix, x)
    envelope.substitute(*form, numbers, pivots, x)
    assert x == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    for i in range(start[1]):  # the first column has nothing but zeros
        kept[row_at[i]] = 0.0
    for i in range(start[1], n):
        if row_at[i] + 0 >= 0 and low[np.searchsorted(start, i, "right") - 1] == 0:
            kept[row_at[i]] = 0.0
    assert envelope.factorise(*form, kept, pivots, scratch) == 0.0


def test_blocks_of_a_chain_are_neighbours() -> None:
    """Interfaces of a stack in any order make a block tridiagonal matrix; one body that all share a full one."""
    from latin_fmu.building import build

    boxes = {f"b{i}": Box(STEEL, (0.01,) * 3, (1, 1, 1)) for i in range(5)}
    scene = column(boxes, {f"i{i}": {"friction_coefficient": 0.3} for i in range(4)}, {"end": 1e-6, "instants": 1})
    scene["interface"] = {f"i{i}": scene["interface"][f"i{i}"] for i in (2, 0, 3, 1)}
    assembly = build(latin_fmu.scene_from_dict(scene)).assembly
    order, low, high = ordered_blocks(assembly, assembly.owners()[0])
    assert (low.tolist(), high.tolist()) == ([0, 0, 1, 2], [1, 2, 3, 3])
    names = [assembly.interfaces[i].name for i in order]
    assert names in (sorted(names), sorted(names)[::-1])
    fields = relative_operator(assembly)
    assert fields["n_unknown"] == 4 * 4 * 3
    assert fields["n_matrix"] == 12 * (24 + 36 + 36 + 24) < LARGEST


# -- tangents of the laws -----------------------------------------------------------------------------------------
Z, RATE = np.array([0.7, 1.3]), 2.0
PARAMETERS = {
    "perfect": [0.0, 0.0],
    "contact": [0.4, 0.0],
    "no_slip": [0.1, 0.0],
    "elastic_layer": [3.0, 1.5],
    "soft_contact": [0.4, 5.0],
    "viscous_joint": [2.0, 0.6],
    "maxwell_joint": [3.0, 1.5, 0.4, 0.8],
}


def tractions(law: int, jump: np.ndarray, reach: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """The law at one point."""
    out = np.zeros(3)
    laws.apply(law, PointState(jump, Z, reach, RATE, parameters), out)
    return out


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("name", LAWS)
def test_tangent_is_the_derivative(name: str) -> None:
    """J = sum of c r / (z + s) against differences, at points that are open, stick and slip; the proximal term is
    that share of z on normal and sticking components and nothing elsewhere."""
    law, parameters = LAWS[name], np.array(PARAMETERS[name])
    counts = set()
    for _ in range(60):
        jump, reach = RNG.normal(size=3), np.abs(RNG.normal(size=3)) * 0.3
        columns, rows, softness = np.empty(9), np.empty(9), np.empty(9)
        args = law, PointState(jump, Z, reach, RATE, parameters), np.zeros(9)
        made = laws.tangent(*args, Unknowns(columns, rows, softness, 0.0))
        counts.add(made)
        tangent = np.zeros((3, 3))
        for i in range(made):
            row = rows[3 * i : 3 * i + 3]
            z = Z[0] if row[0] != 0 else Z[1]
            tangent += np.outer(columns[3 * i : 3 * i + 3], row) / (z + softness[4 * i])
        step = 1e-6
        differences = np.stack(
            [
                (
                    tractions(law, jump + step * e, reach, parameters)
                    - tractions(law, jump - step * e, reach, parameters)
                )
                / (2 * step)
                for e in np.eye(3)
            ],
            axis=1,
        )
        assert tangent == pytest.approx(differences, abs=1e-7)
        again = np.empty(9)
        laws.tangent(*args, Unknowns(columns, rows, again, 0.01))
        added = {0.0, 0.01 * Z[0], 0.01 * Z[1]}
        assert all(min(abs(again[4 * i] - softness[4 * i] - a) for a in added) < 1e-12 for i in range(made))
    assert counts == {"contact": {0, 2, 3}, "soft_contact": {0, 2, 3}, "no_slip": {0, 1, 2, 3}}.get(name, {3})


# -- two unknowns by hand ------------------------------------------------------------------------------------------
@pytest.mark.usefixtures("in_python")
def test_slip_of_one_point_by_hand() -> None:
    """One point that slips along t1 under the pressure P, A = diag(a_n, a_t, a_t) with a coupling b of N and t1:

    unknowns p (traction along N) and y (across): columns (1, -mu, 0) and (0, 0, 1), rows N and t2
    matrix [[a_n - mu b, 0], [0, a_t + z_t (|G|/(mu P) - 1)]] with G the traction of sticking
    """
    mu, pressure, slip = 0.4, 2.0, 3.0  # with no gap: jump_n = -z_n P, jump_t = z_t slip
    jump = np.array([-Z[0] * pressure, Z[1] * slip, 0.0])
    columns, rows, softness = np.empty(9), np.empty(9), np.empty(9)
    parameters = np.array([mu, 0.0])
    point = PointState(jump, Z, np.zeros(1), RATE, parameters)
    assert laws.tangent(LAWS["contact"], point, np.zeros(9), Unknowns(columns, rows, softness, 0.0)) == 2
    a = np.array([[2.0, 0.5, 0.0], [0.5, 3.0, 0.0], [0.0, 0.0, 3.0]])
    c, r = columns.reshape(3, 3)[:2], rows.reshape(3, 3)[:2]
    matrix = r @ a @ c.T + softness.reshape(3, 3)[:2, :2]
    across = 3.0 + Z[1] * (slip / (mu * pressure) - 1.0)
    assert matrix == pytest.approx(np.array([[2.0 - mu * 0.5, 0.0], [0.0, across]]))


# -- instants -----------------------------------------------------------------------------------------------------
def pressed(instants: int = 4, friction: float = 0.3, step: float = 1e-4, **solver: Any) -> Description:
    """Two plates pressed and pushed by a load that makes part of the points slip and some open, at a long step."""
    boxes = {"low": Box(STEEL, (0.05, 0.02, 0.004), (6, 2, 1)), "high": Box(STEEL, (0.05, 0.02, 0.004), (6, 2, 1))}
    time = {"end": instants * step, "instants": instants, "scheme": "hht"}
    scene = column(boxes, {"joint": {"friction_coefficient": friction}}, time, solver=solver)
    scene["boundary"]["held"] = {"type": "fixed", "face": "low.zmin"}
    scene["load"]["press"] = {"face": "high.zmax", "pressure": 2e7}
    scene["load"]["push"] = {"face": "high.xmax", "traction": [2e7, 3e6, 5e7]}
    return scene


def solve(tables: Description) -> latin_fmu.Solution:
    """Solution of a scene, converged."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert solution.converged, solution.status
    return solution


def apart(one: latin_fmu.Solution, other: latin_fmu.Solution) -> float:
    """Largest difference of tractions, relative."""
    pairs = [(h.traction, other.interfaces[n].traction) for n, h in one.interfaces.items()]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def steps(solution: latin_fmu.Solution) -> int:
    """Newton steps of a run."""
    return sum(w.newton_steps for w in solution.windows)


TIGHT = {"tolerance": 1e-11, "force_tolerance": 1e-10, "max_iterations": 1000}


@pytest.mark.parametrize("static", [False, True])
def test_solution_is_that_of_the_iteration(static: bool) -> None:
    """Both ways to 1e-9 at a tight tolerance; statuses of all three kinds occur. The step is one at which the iteration
    alone gets there."""
    tables = pressed(8, step=2e-6, **TIGHT)
    if static:
        tables["time"] = {"end": 1.0, "instants": 4, "quasi_static": True}
    by_newton = solve(tables)
    tables["solver"]["newton"] = False
    by_iteration = solve(tables)
    assert steps(by_newton) > 0 == steps(by_iteration)
    assert apart(by_newton, by_iteration) < 1e-9
    assert {0, 1, 2} == set(np.unique(by_newton.interfaces["joint"].contact_status[1:]))
    assert sum(w.iterations for w in by_newton.windows) < 0.5 * sum(w.iterations for w in by_iteration.windows)


@pytest.mark.parametrize("form", ["dense", "exact"])
def test_steps_without_inertia_leave_a_share(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where all points stick, each step leaves at most a tenth of the residual, the share that its products stop at;
    the upper plate floats."""
    monkeypatch.setattr(search_direction, "_PRICE_ON_ITERATION", 0.0)
    tables = pressed(1, friction=5.0, interface_operator=form, **TIGHT)
    tables["time"] = {"end": 1.0, "instants": 1, "quasi_static": True}
    tables["load"]["push"]["traction"] = [2e6, 3e5, 0.0]
    window = solve(tables).windows[0]
    errors = np.array(window.error_indicator[-window.newton_steps - 1 :])
    assert window.newton_steps >= 3
    assert (errors[1:] < 0.1 * errors[:-1]).all()


def test_error_falls_quadratically(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the proximal term, two steps lead from 1e-3 to round-off; with it each gives about two digits."""
    few = solve(pressed(1, **TIGHT)).windows[0]
    monkeypatch.setattr(search_direction, "_PROXIMAL", 0.0)
    window = solve(pressed(1, **TIGHT)).windows[0]
    errors = np.array(window.error_indicator[-window.newton_steps :])
    before = errors[errors > 1e-13][-2:]
    assert errors[-1] < 1e-11
    assert before[0] < 1e-2 or len(errors) <= 4
    assert errors[-1] < max(1e-13, 10.0 * errors[-2] ** 2)
    assert window.newton_steps <= few.newton_steps


def test_points_held_by_several_interfaces() -> None:
    """A block in a corner of three walls: the nodes of its edges belong to two and three interfaces."""
    scene = column({"b": Box(STEEL, (0.01,) * 3, (2, 2, 2))}, {}, {"end": 4e-4, "instants": 4, "scheme": "hht"})
    for axis in "xyz":
        scene["interface"][axis] = rubbing(f"b.{axis}min", "ground", 0.3)
        push = np.roll([-3e7, 1.5e7, 0.5e7], "xyz".index(axis)).tolist()
        scene["load"][axis] = {"face": f"b.{axis}max", "traction": push}
    solution = solve(scene)
    assert steps(solution) > 0
    assert max(w.iterations for w in solution.windows) <= 20  # 65 without Newton steps


# -- the same by other ways ---------------------------------------------------------------------------------------
@pytest.mark.skipif(PLAIN, reason="the kernels are Python")
def test_snapshots_are_exact() -> None:
    """Whether the last instant ended with a Newton step belongs to the state."""
    scene = latin_fmu.scene_from_dict(pressed(6, tolerance=1e-4))
    run, other = SegmentedRun(scene), SegmentedRun(scene)
    assert run.advance(3e-4, 3).accepted
    kept = run.snapshot()
    first = run.advance(6e-4, 3)
    other.restore(kept)
    again = other.advance(6e-4, 3)
    counts = [(w.iterations, w.newton_steps) for w in first.windows]
    assert [(w.iterations, w.newton_steps) for w in again.windows] == counts
    assert sum(n for _, n in counts) > 0
    np.testing.assert_array_equal(again.interfaces["joint"].traction, first.interfaces["joint"].traction)
