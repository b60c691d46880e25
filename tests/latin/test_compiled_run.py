"""The compiled march against the long road: same iterations, same fields, whatever a scene has in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.segments import SegmentedRun
from latin_fmu.compiled import COMPILES
from latin_fmu.latin import compiled_run, windows
from latin_fmu.latin.threads import dealt

pytestmark = pytest.mark.skipif(not COMPILES, reason="compilation is off")

Tables = dict[str, Any]


def stack(n: int = 3, behaviour: str = "contact", **solver: Any) -> Tables:
    """Blocks of two materials pressed and sheared, the lowest on moving ground."""
    names = [f"b{i}" for i in range(n)]
    contact: Tables = {"behaviour": behaviour}
    if behaviour == "contact":
        contact["friction_coefficient"] = 0.3
    box = {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 2]}
    return {
        "name": "stack",
        "material": {
            "soft": {"young_modulus": 70e9, "poisson_ratio": 0.3, "density": 2700.0},
            "hard": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0},
        },
        "substructure": {
            name: {"material": ("soft", "hard")[i % 2], "box": {"origin": [0.0, 0.0, 0.01 * i], **box}}
            for i, name in enumerate(names)
        },
        "interface": {
            "floor": {"sides": ["b0.zmin", "ground"], **contact},
            **{f"i{i}": {"sides": [f"b{i}.zmax", f"b{i + 1}.zmin"], **contact} for i in range(n - 1)},
        },
        "load": {
            "press": {"face": f"{names[-1]}.zmax", "pressure": 2e8, "law": {"type": "half_sine", "duration": 5e-6}},
            "shear": {"face": f"{names[-1]}.zmax", "traction": [5e7, 1e7, 0.0], "law": {"type": "step"}},
        },
        "time": {"end": 6e-6, "instants": 30},
        "solver": solver,
    }  # fmt: skip


def moving_ground(tables: Tables) -> None:
    tables["interface"]["floor"]["ground_velocity"] = {
        "direction": [0.0, 0.0, 1.0], "amplitude": 3.0, "law": {"type": "half_sine", "duration": 4e-6},
    }  # fmt: skip


def driven_face(tables: Tables) -> None:
    tables["boundary"] = {
        "drive": {"type": "velocity", "face": "b0.xmin", "components": ["x"], "value": [2.0],
                  "law": {"type": "half_sine", "duration": 3e-6}},
    }  # fmt: skip


def damped(tables: Tables) -> None:
    for material in tables["material"].values():
        material |= {"rayleigh_mass": 1e3, "rayleigh_stiffness": 1e-8}
    tables["boundary"] = {"quiet": {"type": "absorbing", "face": "b2.xmax"}}


def thrown(tables: Tables) -> None:
    tables["substructure"]["b2"]["initial_velocity"] = [1.0, 0.0, -5.0]
    tables["interface"]["i1"]["gap"] = 2e-6


def frictionless(tables: Tables) -> None:
    for interface in tables["interface"].values():
        interface["friction_coefficient"] = 0.0


def mixed(tables: Tables) -> None:
    tables["interface"]["i0"] = {"sides": ["b0.zmax", "b1.zmin"], "behaviour": "perfect"}
    tables["interface"]["i1"] = {
        "sides": ["b1.zmax", "b2.zmin"], "behaviour": "viscous_joint", "normal_viscosity": 1e7,
        "tangential_viscosity": 1e6,
    }  # fmt: skip


def layers(tables: Tables) -> None:
    """One that bonds and one, compressed from the start, that opens and slides, on a ground and under a face that move;
    one instant takes the long road."""
    moving_ground(tables)
    driven_face(tables)
    tables["interface"]["floor"] |= {
        "behaviour": "soft_contact",
        "normal_stiffness": 2e15,
        "interference": 2e-7,
    }
    tables["interface"]["i0"] = {
        "sides": ["b0.zmax", "b1.zmin"], "behaviour": "elastic_layer", "normal_stiffness": 1e15,
        "tangential_stiffness": 3e14, "preload": 3e7,
    }  # fmt: skip


def free_layers(tables: Tables) -> None:
    """Without tangential unknowns."""
    moving_ground(tables)
    tables["interface"]["floor"] |= {
        "behaviour": "soft_contact", "normal_stiffness": 2e15, "friction_coefficient": 0.0, "gap": 1e-7,
    }  # fmt: skip
    tables["interface"]["i1"] = {
        "sides": ["b1.zmax", "b2.zmin"], "behaviour": "elastic_layer", "normal_stiffness": 1e15,
        "tangential_stiffness": 0.0,
    }  # fmt: skip


def damped_layers(tables: Tables) -> None:
    layers(tables)
    damped(tables)


def massless_layers(tables: Tables) -> None:
    layers(tables)
    massless(tables)


def explicit_layers(tables: Tables) -> None:
    layers(tables)
    del tables["boundary"]
    tables["time"]["scheme"] = {"type": "central_difference"}
    tables["time"] |= {"instants": 60}


def reduced_layers(tables: Tables) -> None:
    layers(tables)
    tables["solver"]["propagator"] = {"type": "reduced", "modes": 20}


def many(tables: Tables) -> None:
    """Classes of five and of four identical blocks between the first and the last."""
    tables.update(stack(11))
    damped(tables)
    del tables["boundary"]


def apart(tables: Tables) -> None:
    """No interface at all: what is compared are the fields."""
    del tables["interface"]
    driven_face(tables)
    with_everything_kept(tables)


def unlike(tables: Tables) -> None:
    tables["solver"]["share_identical"] = False


def massless(tables: Tables) -> None:
    tables["time"]["scheme"] = {"type": "massless_contact"}


def with_everything_kept(tables: Tables) -> None:
    tables["output"] = {"fields": True, "energy": True, "every": 4}


CHANGES: list[Callable[[Tables], None]] = [
    moving_ground, driven_face, damped, thrown, frictionless, mixed, unlike, massless, with_everything_kept,
    many, apart, layers, free_layers, damped_layers, massless_layers, explicit_layers, reduced_layers,
]  # fmt: skip


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_both_roads_give_the_same_fields(
    change: Callable[[Tables], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = stack()
    change(tables)
    fast = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    monkeypatch.setattr(windows, "marches", lambda _: False)
    slow = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    assert not fast.interfaces or any(history.traction.any() for history in fast.interfaces.values())
    assert [w.iterations for w in fast.windows] == [w.iterations for w in slow.windows]
    assert (fast.converged, fast.passes, fast.marched) == (slow.converged, slow.passes, slow.marched)
    for name, history in fast.interfaces.items():
        other = slow.interfaces[name]
        for field in ("traction", "velocity", "gap"):
            mine, its = getattr(history, field), getattr(other, field)
            if its is not None:
                assert np.abs(mine - its).max() <= 1e-9 * np.abs(its).max(initial=1e-300), (name, field)
    assert fast.interface_indicator == pytest.approx(slow.interface_indicator, rel=1e-6)
    for name, kept in fast.substructures.items():
        if kept.displacement is not None:
            np.testing.assert_allclose(
                kept.displacement, slow.substructures[name].displacement, rtol=0, atol=1e-14
            )
    if fast.energy is not None and slow.energy is not None:
        for term, values in fast.energy.items():
            scale = max(np.abs(v).max() for v in slow.energy.values())
            assert np.abs(values - slow.energy[term]).max() <= 1e-9 * scale, term


@pytest.mark.parametrize(
    "change", [layers, massless_layers, explicit_layers], ids=lambda change: change.__name__
)
def test_segments_and_snapshots_of_layers(
    change: Callable[[Tables], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut, taken back and gone through again, on both roads: what layers remember is handed over."""
    ends: dict[tuple[bool, str], Any] = {}
    for compiled in (True, False):
        if not compiled:
            monkeypatch.setattr(windows, "marches", lambda _: False)
        tables = stack()
        change(tables)
        scene = latin_fmu.scene_from_dict(tables)
        whole, n = latin_fmu.solve(scene), scene.time.n_step
        run = SegmentedRun(scene)
        run.advance(scene.time.end / 3, n // 3)
        blob = run.snapshot()
        first = run.advance(scene.time.end, n - n // 3)
        run.restore(blob)
        again = run.advance(scene.time.end, n - n // 3)
        for name, history in whole.interfaces.items():
            cut = first.interfaces[name].traction
            np.testing.assert_array_equal(cut, again.interfaces[name].traction)
            largest = np.abs(history.traction).max()
            assert np.abs(cut[1:] - history.traction[n // 3 + 1 :]).max() <= 1e-9 * largest, name
            ends[compiled, name] = cut
    for (compiled, name), cut in ends.items():
        if compiled:
            assert np.abs(cut - ends[False, name]).max() <= 1e-9 * np.abs(cut).max(), name


@pytest.mark.parametrize(
    "change", [unlike, thrown, driven_face, frictionless, layers], ids=lambda change: change.__name__
)
def test_threads_change_nothing(change: Callable[[Tables], None]) -> None:
    """To the last bit."""
    outcomes = []
    for threads in (1, 2, 3):
        tables = stack(4)
        change(tables)
        tables["solver"]["threads"] = threads
        outcomes.append(latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome)
    for other in outcomes[1:]:
        assert other.marched == outcomes[0].marched
        for name, history in outcomes[0].interfaces.items():
            for field in ("traction", "velocity", "gap"):
                np.testing.assert_array_equal(getattr(history, field), getattr(other.interfaces[name], field))


@pytest.mark.parametrize("change", [thrown, layers, explicit_layers], ids=lambda change: change.__name__)
def test_the_length_of_a_call_changes_nothing(
    change: Callable[[Tables], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit: calls are as long as the machine is fast."""
    outcomes = []
    for longest in (64, 3, 1):
        monkeypatch.setattr(compiled_run, "_LONGEST", longest)
        tables = stack()
        change(tables)
        outcomes.append(latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome)
    for name, history in outcomes[0].interfaces.items():
        for other in outcomes[1:]:
            np.testing.assert_array_equal(history.traction, other.interfaces[name].traction)


def test_classes_are_dealt_by_cost() -> None:
    hands = dealt([1.0, 8.0, 2.0, 5.0], 2)
    assert [hand.tolist() for hand in hands] == [[1], [0, 2, 3]]
    assert len(dealt([1.0], 4)) == 1


def test_an_instant_that_needs_a_fall_back_takes_the_long_road(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tolerance below round-off: nothing converges in the kernels, and the run tells the fall-backs all the same."""
    tables = stack(2, tolerance=1e-20, max_iterations=20)
    fast = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    monkeypatch.setattr(windows, "marches", lambda _: False)
    slow = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    assert [w.fallbacks for w in fast.windows] == [w.fallbacks for w in slow.windows]
    assert any(w.fallbacks for w in fast.windows)


@pytest.mark.parametrize(
    "change",
    [frictionless, mixed, apart, free_layers, damped_layers, massless_layers, explicit_layers],
    ids=lambda change: change.__name__,
)
def test_no_interpreter_in_the_loop(
    change: Callable[[Tables], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no instant calls for a fall-back the window solver is never entered, whatever the interfaces are."""
    seen: list[int] = []
    monkeypatch.setattr(windows.Run, "advance", lambda *_: seen.append(1))
    tables = stack()
    change(tables)
    latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert not seen
