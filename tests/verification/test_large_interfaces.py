"""Interfaces solved with by substitution against dense matrices: equal results, whatever a scene has in it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.compiled import PLAIN
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.effects.cost import Prediction
from latin_fmu.effects.explanation import choices
from latin_fmu.errors import SceneError
from latin_fmu.kernels.newton import BESIDE, N_FINISH
from latin_fmu.latin import search_direction
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, column, half_sine
from tests.scenes import given_motion, pressed_stack, rayleigh

pytestmark = pytest.mark.skipif(PLAIN, reason="the kernels are not compiled")

Tables = dict[str, Any]
CHEAP = 1e-3  # price of a product in iterations
TIGHT = {"tolerance": 1e-11, "force_tolerance": 1e-11, "max_iterations": 900, "newton": False}


def stack(n: int = 3, instants: int = 24, time: Tables | None = None, **solver: Any) -> Tables:
    """Blocks pressed and sheared on moving ground; those of one material are members of a class."""
    steel, soft = (Box(material, (0.01,) * 3, (3, 2, 2)) for material in (STEEL, ALUMINIUM))
    time = time or {"end": 5e-6, "instants": instants, "scheme": "hht"}
    output = {"fields": True, "energy": True}
    return pressed_stack([soft, *[steel] * (n - 1)], time, solver={**TIGHT, **solver}, output=output)


def plain(_: Tables) -> None:
    """Three blocks on the ground, two of one class."""


def many_members(tables: Tables) -> None:
    """Four members of a class, each between two interfaces: tiles of eight vectors."""
    tables.clear()
    tables.update(stack(6))


def non_matching(tables: Tables) -> None:
    tables["substructure"]["b2"]["box"]["elements"] = [2, 3, 2]


def damped(tables: Tables) -> None:
    rayleigh(tables)
    tables["boundary"] = {"quiet": {"type": "absorbing", "face": "b2.xmax"}}


def driven(tables: Tables) -> None:
    tables["boundary"] = {
        "drive": given_motion("b0.xmin", [2.0], {"type": "half_sine", "duration": 3e-6}),
        "held": {"type": "symmetry", "face": "b2.ymin"},
    }


def thrown(tables: Tables) -> None:
    tables["time"].pop("scheme")
    tables["substructure"]["b2"]["initial_velocity"] = [1.0, 0.0, -5.0]
    tables["interface"]["i1"]["gap"] = 2e-6


def bonded(tables: Tables) -> None:
    tables["interface"]["i0"] = {"sides": tables["interface"]["i0"]["sides"], "behaviour": "perfect"}


def all_bonded(tables: Tables) -> None:
    for name, interface in tables["interface"].items():
        tables["interface"][name] = {"sides": interface["sides"], "behaviour": "perfect"}
    tables["solver"]["bonds"] = "iterate"


def windows_of_six(tables: Tables) -> None:
    tables["solver"] |= {"window": 6, "tolerance": 1e-9, "force_tolerance": 1e-9}


def long_steps(tables: Tables) -> None:
    tables["time"] = {"end": 1e-4, "instants": 10, "scheme": "hht"}


def single_precision(tables: Tables) -> None:
    tables["solver"] |= {"precision": "float32", "tolerance": 1e-6, "force_tolerance": 1e-6}


LIMITS = {single_precision: 1e-4, windows_of_six: 1e-7}
CASES = [
    plain,
    many_members,
    non_matching,
    damped,
    driven,
    thrown,
    bonded,
    all_bonded,
    windows_of_six,
    long_steps,
    single_precision,
]


def solved(tables: Tables, form: str) -> latin_fmu.Solution:
    """Solution with one form of the interfaces."""
    tables = copy.deepcopy(tables)
    tables["solver"]["interface_operator"] = form
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables))


def apart(first: latin_fmu.Solution, second: latin_fmu.Solution, name: str) -> float:
    """Largest relative difference of a field of the interfaces, over the largest value of all."""
    trees = first.to_datatree(), second.to_datatree()
    pairs = [[tree[f"interfaces/{i}"][name].to_numpy() for tree in trees] for i in first.interfaces]
    scale = max(float(np.abs(b).max()) for _, b in pairs)
    return max(float(np.abs(a - b).max()) for a, b in pairs) / scale


@pytest.mark.parametrize("change", CASES, ids=lambda change: change.__name__)
def test_equal_answers(change: Callable[[Tables], None]) -> None:
    tables = stack()
    change(tables)
    exact, dense = solved(tables, "exact"), solved(tables, "dense")
    assert exact.converged
    assert dense.converged
    limit = LIMITS.get(change, 1e-9)
    assert apart(exact, dense, "traction") < limit
    assert apart(exact, dense, "velocity") < limit
    assert exact.energy is not None
    assert dense.energy is not None


def long_plates(m: int, instants: int, friction: float = 0.3, **solver: Any) -> latin_fmu.Scene:
    """Two plates of m x m x 2 elements, pressed and released in steps of 100 us, hundreds of transits of an element:
    aluminium that widens more than steel slips, then sticks."""
    size, elements = (1e-3 * m, 1e-3 * m, 2e-3), (m, m, 2)
    tables = column(
        {"lower": Box(ALUMINIUM, size, elements), "upper": Box(STEEL, size, elements)},
        {"crush": {"friction_coefficient": friction}},
        {"end": 1e-4 * instants, "instants": instants, "scheme": "hht"},
        load={"press": {"face": "upper.zmax", "pressure": 2e8, "law": half_sine(2e-3)}},
        solver={"share_identical": False, **solver},
    )
    held = [(body, side) for body in ("lower", "upper") for side in ("xmin", "ymin")]
    tables["boundary"] = {
        f"{body}_{side}": {"type": "symmetry", "face": f"{body}.{side}"} for body, side in [*held, ("lower", "zmin")]
    }
    return latin_fmu.scene_from_dict(tables)


@pytest.fixture
def cheap_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps by products are made where iterations would cost less, too."""
    monkeypatch.setattr(search_direction, "product_price", lambda *_: CHEAP)


@pytest.mark.usefixtures("cheap_steps")
def test_newton_steps_by_products() -> None:
    """Long steps end with Newton steps that take products alone: the tractions of steps with a factorised matrix."""
    tight = {"tolerance": 1e-8, "force_tolerance": 1e-8}
    exact, dense = (
        latin_fmu.solve(long_plates(8, 10, interface_operator=form, **tight)) for form in ("exact", "dense")
    )
    assert exact.converged
    assert dense.converged
    assert sum(w.newton_steps for w in exact.windows) >= 10
    mean = [np.mean([w.iterations for w in s.windows]) for s in (exact, dense)]
    assert mean[0] <= 1.2 * mean[1]
    assert apart(exact, dense, "traction") < 1e-5


def products(friction: float) -> float:
    """Products of a Newton step at the last instant of six that ended with some."""
    run = SegmentedRun(long_plates(8, 6, friction, interface_operator="exact", tolerance=1e-6, force_tolerance=1e-6))
    assert run.advance(6e-4, 6).accepted
    assert run.run is not None
    finish = run.run.image.field("finish", N_FINISH)
    steps = abs(finish[0])
    return float((finish[5] / steps - BESIDE) / CHEAP)


@pytest.mark.usefixtures("cheap_steps")
def test_the_tied_assembly_preconditions_steps_by_products(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points that all stick have the matrix of the tied assembly: two products; a few where some slip."""
    assert 1.0 <= products(5.0) <= 2.5
    assert 1.0 <= products(0.1) <= 10.0
    monkeypatch.setattr(search_direction, "tied_fields", lambda *_: {})
    assert products(5.0) > 20.0


@pytest.mark.usefixtures("cheap_steps")
def test_rough_steps_take_fewer_products(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps far from the tolerances that may leave a hundredth of their residual, and closely solved ones."""
    taken = []
    for rough in (5e3, 0.0):
        monkeypatch.setattr(search_direction, "_ROUGH", rough)
        taken.append(products(0.1))
    assert taken[0] < 0.8 * taken[1]


@pytest.mark.usefixtures("cheap_steps")
def test_newton_steps_by_products_at_several_interfaces() -> None:
    """The same where one body has two interfaces, perfect or with friction, and classes have several members."""
    tables = stack(5, time={"end": 1e-3, "instants": 10, "scheme": "hht"})
    bonded(tables)
    tables["solver"] |= {"newton": True, "tolerance": 1e-4, "force_tolerance": 1e-4}
    tables["load"]["press"]["law"] = half_sine(1e-3)
    exact, dense = solved(tables, "exact"), solved(tables, "dense")
    assert exact.converged
    assert dense.converged
    assert sum(w.newton_steps for w in exact.windows) > 0
    assert apart(exact, dense, "traction") < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.1, 0.3, 0.6])
def test_long_steps_of_a_large_face(friction: float) -> None:
    """1,681 points at steps of 100 us: every instant converged, by iterations where Newton steps would cost more."""
    windows = latin_fmu.solve(long_plates(40, 20, friction)).windows
    assert all(w.converged and not w.fallbacks for w in windows)
    assert np.mean([w.iterations for w in windows]) <= 30
    assert sum(w.newton_steps for w in windows) >= 10


def test_quasi_static() -> None:
    """Pressed and sheared without inertia, bodies that float at first; with and without Newton steps."""
    for newton in (False, True):
        tables = stack(time={"end": 1.0, "instants": 6, "quasi_static": True})
        tables["solver"] |= {"tolerance": 1e-9, "force_tolerance": 1e-9, "newton": newton}
        tables["load"]["press"]["law"] = {"type": "step"}
        tables["load"]["shear"] |= {"traction": [2e7, 5e6, 0.0], "law": half_sine(1.5)}
        tables["output"]["energy"] = False
        exact, dense = solved(tables, "exact"), solved(tables, "dense")
        assert exact.converged
        assert dense.converged
        assert apart(exact, dense, "traction") < 1e-6


def test_static_start() -> None:
    """Motion from an equilibrium with tractions, which are the first reference."""
    tables = stack()
    tables["load"]["press"]["law"] = {"type": "step"}
    del tables["load"]["shear"]
    tables["time"]["start"] = {"type": "static"}
    exact, dense = solved(tables, "exact"), solved(tables, "dense")
    assert apart(exact, dense, "traction") < 1e-6


def test_segments_and_snapshots() -> None:
    """A run in two segments, the second one repeated from a snapshot: the same to the last bit."""
    tables = stack()
    tables["solver"] |= {"interface_operator": "exact", "tolerance": 1e-4, "force_tolerance": 1e-3}
    scene = latin_fmu.scene_from_dict(tables)
    run = SegmentedRun(scene)
    run.advance(scene.time.end / 3, 8)
    snapshot = run.snapshot()
    first = run.advance(scene.time.end, 16)
    run.restore(snapshot)
    again = run.advance(scene.time.end, 16)
    for name in first.interfaces:
        np.testing.assert_array_equal(first.interfaces[name].traction, again.interfaces[name].traction)


def plates(m: int, h: int = 2, end: float = 1.5e-6, behaviour: str = "contact", **solver: Any) -> latin_fmu.Scene:
    """Two plates of m x m x h elements, 10 instants."""
    box = Box(STEEL, (1e-3 * m, 1e-3 * m, 1e-3 * h), (m, m, h))
    tables = column(
        {"lower": box, "upper": box},
        {"crush": {"friction_coefficient": 0.3} if behaviour == "contact" else {"behaviour": behaviour}},
        {"end": end, "instants": 10, "scheme": "hht"},
        load={"press": {"face": "upper.zmax", "pressure": 2e8, "law": half_sine(1e-5)}},
        solver={"share_identical": False, **solver},
    )
    return latin_fmu.scene_from_dict(tables)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_forces_at_a_working_tolerance(tolerance: float) -> None:
    """Tractions within half of the tolerance of those with dense matrices, in single precision too (1e-4)."""
    tight = {"tolerance": tolerance, "force_tolerance": tolerance}
    exact, dense = (latin_fmu.solve(plates(12, interface_operator=form, **tight)) for form in ("exact", "dense"))
    first, second = (s.to_datatree()["interfaces/crush"]["traction"].to_numpy() for s in (exact, dense))
    assert np.linalg.norm(first - second) < 0.5 * tolerance * np.linalg.norm(second)


def test_an_instant_starts_alike_in_every_form() -> None:
    """From the last tractions and the velocities under them: equal iterations, fewer than from the last velocities
    (4.7)."""
    tables = stack(2, instants=80, tolerance=1e-3, force_tolerance=1e-2)
    tables["time"]["end"] = 3e-6
    exact, dense = (solved(tables, form) for form in ("exact", "dense"))
    counts = [[w.iterations for w in s.windows] for s in (exact, dense)]
    assert counts[0] == counts[1]
    assert np.mean(counts[1]) < 4.5


@pytest.mark.parametrize(
    ("given", "form"),
    [
        ({"m": 8}, "dense matrices"),
        ({"m": 12}, "dense matrices"),
        ({"m": 16}, "sparse tables, truncated at"),
        ({"m": 16, "h": 6}, "dense matrices"),
        ({"m": 16, "end": 1.5e-4}, "dense matrices"),
        ({"m": 16, "window": 5}, "dense matrices"),
        ({"m": 16, "behaviour": "perfect"}, "dense matrices"),
        ({"m": 28, "window": 5}, "exact, by substitution"),
    ],
    ids=str,
)
def test_the_form_that_costs_less(given: dict[str, Any], form: str) -> None:
    """Large faces of thin bodies where steps are short are solved with without dense matrices from 250 points on;
    where steps are long, in which Newton steps take dense matrices, and in long windows, from 700 points on."""
    assert choices(Prediction(discretise(plates(**given))))["interfaces"].startswith(form)


def test_the_form_is_told() -> None:
    assert choices(Prediction(discretise(plates(28))))["interfaces"].endswith("in lower, upper")
    forced = choices(Prediction(discretise(plates(8, interface_operator="exact"))))["interfaces"]
    assert forced.startswith("exact, by substitution through ")
    large = [Prediction(discretise(plates(24, interface_operator=form))) for form in ("exact", "dense")]
    assert large[0].memory < large[1].memory
    assert large[0].operators < large[1].operators


def test_the_predicted_cost_is_that_of_the_form_that_runs() -> None:
    """Products by tables read less than substitution in single precision, and that less than in double precision."""
    forms: list[dict[str, Any]] = [
        {"interface_operator": "sparse"},
        {"interface_operator": "exact"},
        {"interface_operator": "exact", "tolerance": 1e-7, "force_tolerance": 1e-6},
    ]
    told = [Prediction(discretise(plates(24, **form))).with_tables() for form in forms]
    products = [p.run.classes[0].size.product for p in told]
    swept = told[0].run.classes[0].size.swept
    assert products[1:] == [swept, 2.0 * swept]
    tables = told[0].tables
    assert tables is not None
    assert 0.0 < products[0] == 0.5 * tables.entries[0] < 0.25 * swept
    assert told[0].march < told[1].march < told[2].march
    assert told[0].operators > told[1].operators  # which fills them


@pytest.mark.parametrize("propagator", ["explicit", "reduced", "cg"])
def test_refused_without_a_factor_of_all_dofs(propagator: str) -> None:
    with pytest.raises(SceneError, match=r"solver\.interface_operator.*requires the direct propagator"):
        plates(4, interface_operator="exact", propagator=propagator)
