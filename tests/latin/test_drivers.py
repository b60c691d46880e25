"""The compiled driver against the stages taken one by one: the same bits, whatever a scene has in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.compiled import PLAIN
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.latin import recorder, windows
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box
from tests.scenes import given_motion, pressed_stack, rayleigh

pytestmark = pytest.mark.skipif(PLAIN, reason="the kernels of a run are plain Python: too slow")

Tables = dict[str, Any]


def stack(n: int = 3, behaviour: str = "contact", **solver: Any) -> Tables:
    """Blocks of two materials pressed and sheared, the lowest on moving ground."""
    contact: Tables = {"behaviour": behaviour}
    if behaviour == "contact":
        contact["friction_coefficient"] = 0.3
    boxes = [Box(replace(m, name=kind), (0.01,) * 3, (2,) * 3) for m, kind in ((ALUMINIUM, "soft"), (STEEL, "hard"))]
    time = {"end": 6e-6, "instants": 30}
    return pressed_stack([boxes[i % 2] for i in range(n)], time, contact, shear=(5e7, 1e7, 0.0), solver=solver)


def moving_ground(tables: Tables) -> None:
    tables["interface"]["floor"]["ground_velocity"] = {
        "direction": [0.0, 0.0, 1.0],
        "amplitude": 3.0,
        "law": {"type": "half_sine", "duration": 4e-6},
    }


def driven_face(tables: Tables) -> None:
    tables["boundary"] = {"drive": given_motion("b0.xmin", [2.0], {"type": "half_sine", "duration": 3e-6})}


def damped(tables: Tables) -> None:
    rayleigh(tables)
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
        "sides": ["b1.zmax", "b2.zmin"],
        "behaviour": "viscous_joint",
        "normal_viscosity": 1e7,
        "tangential_viscosity": 1e6,
    }


def layers(tables: Tables) -> None:
    """One that bonds and one, compressed from the start, that opens and slides, on a ground and under a face that move;
    one instant takes the Python driver."""
    moving_ground(tables)
    driven_face(tables)
    tables["interface"]["floor"] |= {"behaviour": "soft_contact", "normal_stiffness": 2e15, "preload": 4e8}
    tables["interface"]["i0"] = {
        "sides": ["b0.zmax", "b1.zmin"],
        "behaviour": "elastic_layer",
        "normal_stiffness": 1e15,
        "tangential_stiffness": 3e14,
        "preload": 3e7,
    }


def free_layers(tables: Tables) -> None:
    """Without tangential unknowns."""
    moving_ground(tables)
    tables["interface"]["floor"] |= {
        "behaviour": "soft_contact",
        "normal_stiffness": 2e15,
        "friction_coefficient": 0.0,
        "gap": 1e-7,
    }
    tables["interface"]["i1"] = {
        "sides": ["b1.zmax", "b2.zmin"],
        "behaviour": "elastic_layer",
        "normal_stiffness": 1e15,
        "tangential_stiffness": 0.0,
    }


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


def apart(tables: Tables) -> None:
    """No interface at all: what is compared are the fields."""
    del tables["interface"]
    driven_face(tables)
    with_everything_kept(tables)


def massless(tables: Tables) -> None:
    tables["time"]["scheme"] = {"type": "massless_contact"}


def landing(tables: Tables) -> None:
    """Contact nodes without mass, a viscous layer, damping, driven faces and moving ground."""
    thrown(tables)
    damped(tables)
    driven_face(tables)
    moving_ground(tables)
    tables["time"]["scheme"] = {"type": "generalized_alpha"}
    with_everything_kept(tables)


def landing_layers(tables: Tables) -> None:
    layers(tables)
    end, instants = tables["time"]["end"], tables["time"]["instants"]
    # up to where the upper block slides: there round-off decides between two states that both satisfy the laws
    tables["time"] |= {"end": end / 2, "instants": instants // 2}
    tables["time"]["scheme"] = {"type": "generalized_alpha", "landing_damping": 0.0}


def with_everything_kept(tables: Tables) -> None:
    tables["output"] = {"fields": True, "energy": True, "every": 4}


def same_bits(one: Any, other: Any) -> None:
    """Two outcomes are the same to the last bit."""
    assert [w.iterations for w in one.windows] == [w.iterations for w in other.windows]
    for mine, its in zip(one.windows, other.windows, strict=True):
        np.testing.assert_array_equal(mine.error_indicator, its.error_indicator)
        np.testing.assert_array_equal(mine.force_mismatch, its.force_mismatch)
    assert (one.converged, one.passes, one.marched) == (other.converged, other.passes, other.marched)
    assert one.interface_indicator == other.interface_indicator
    for name, history in one.interfaces.items():
        for field in ("traction", "velocity", "gap"):
            np.testing.assert_array_equal(getattr(history, field), getattr(other.interfaces[name], field))
    for name, kept in one.substructures.items():
        for field in ("displacement", "velocity"):
            mine = getattr(kept, field)
            if mine is not None:
                np.testing.assert_array_equal(mine, getattr(other.substructures[name], field))
    assert (one.energy is None) == (other.energy is None)
    for term, values in (one.energy or {}).items():
        np.testing.assert_array_equal(values, other.energy[term])


def both_drivers(tables: Tables, python_driver: Callable[[], None], windows_of_one: bool = True) -> Any:
    """The outcome, the same to the last bit with both drivers."""
    fast = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    python_driver()
    slow = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    assert not fast.interfaces or any(history.traction.any() for history in fast.interfaces.values())
    assert not windows_of_one or len(fast.windows) == tables["time"]["instants"]
    same_bits(fast, slow)
    return fast


def alike(n: int, behaviour: str = "contact", **solver: Any) -> Tables:
    """n blocks alike side by side on the ground, each pressed and sheared in its own way: one class of n members."""
    tables = stack(1, behaviour, **solver)
    box = {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 2]}
    contact = {key: value for key, value in tables["interface"]["floor"].items() if key != "sides"}
    tables["substructure"], tables["interface"], tables["load"] = {}, {}, {}
    for i in range(n):
        tables["substructure"][f"b{i}"] = {"material": "soft", "box": {"origin": [0.02 * i, 0.0, 0.0], **box}}
        tables["interface"][f"floor{i}"] = {"sides": [f"b{i}.zmin", "ground"], **contact}
        tables["load"][f"press{i}"] = {
            "face": f"b{i}.zmax",
            "traction": [2e7 + 4e6 * i, 1e7, -1e8 - 1e7 * i],
            "law": {"type": "half_sine", "duration": 3e-6 + 1e-7 * i},
        }
    return tables


def layered(n: int) -> Tables:
    """The same on elastic layers."""
    tables = alike(n, "elastic_layer")
    for interface in tables["interface"].values():
        interface |= {"normal_stiffness": 1e15, "tangential_stiffness": 3e14}
    return tables


def softly(n: int) -> Tables:
    """The same on soft contact."""
    tables = alike(n, "soft_contact")
    for interface in tables["interface"].values():
        interface |= {"normal_stiffness": 2e15, "friction_coefficient": 0.2}
    return tables


def shaken(n: int) -> Tables:
    """The same on moving ground, one face of each moved."""
    tables = alike(n)
    for i in range(n):
        tables["interface"][f"floor{i}"]["ground_velocity"] = {
            "direction": [0.0, 0.0, 1.0],
            "amplitude": 3.0 + i,
            "law": {"type": "half_sine", "duration": 4e-6},
        }
    tables["boundary"] = {
        f"drive{i}": given_motion(f"b{i}.xmin", [1.0 + i], {"type": "half_sine", "duration": 3e-6}) for i in range(n)
    }
    return tables


def explicitly(n: int) -> Tables:
    """The same with central differences."""
    tables = alike(n)
    tables["time"] |= {"scheme": {"type": "central_difference"}, "instants": 60}
    return tables


def reduced(n: int) -> Tables:
    """The same on few modes."""
    return alike(n, propagator={"type": "reduced", "modes": 20})


@pytest.mark.parametrize("n", [1, 3, 11])
@pytest.mark.parametrize("make", [alike, layered, softly, shaken, explicitly, reduced], ids=lambda make: make.__name__)
def test_members_of_a_class_together(make: Callable[[int], Tables], n: int, python_driver: Callable[[], None]) -> None:
    """One after the other, or eight at a time: the drivers agree to the bit; so do members alone and together, to
    round-off."""
    tables = make(n)
    tables["output"] = {"energy": n in (1, 11)}
    tables["solver"] |= {"tolerance": 1e-10, "force_tolerance": 1e-9, "skip_unchanged": False}
    together = both_drivers(tables, python_driver)
    tables["solver"]["share_identical"] = False
    alone = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    for name, history in together.interfaces.items():
        other = alone.interfaces[name].traction
        assert np.abs(history.traction - other).max() <= 1e-7 * np.abs(other).max(), name


@pytest.mark.parametrize(
    "change", [layers, massless_layers, landing_layers, explicit_layers], ids=lambda change: change.__name__
)
def test_segments_and_snapshots_of_layers(change: Callable[[Tables], None], python_driver: Callable[[], None]) -> None:
    """Cut, taken back and gone through again, with both drivers: the state of layers is handed over."""
    ends: dict[tuple[bool, str], Any] = {}
    for compiled in (True, False):
        if not compiled:
            python_driver()
        tables = stack()
        change(tables)
        scene = latin_fmu.scene_from_dict(tables)
        whole, n = latin_fmu.solve(scene), scene.time.n_step
        run = SegmentedRun(scene)
        run.advance(scene.time.end / 3, n // 3)
        snapshot = run.snapshot()
        first = run.advance(scene.time.end, n - n // 3)
        run.restore(snapshot)
        again = run.advance(scene.time.end, n - n // 3)
        for name, history in whole.interfaces.items():
            cut = first.interfaces[name].traction
            np.testing.assert_array_equal(cut, again.interfaces[name].traction)
            largest = np.abs(history.traction).max()
            assert np.abs(cut[1:] - history.traction[n // 3 + 1 :]).max() <= 1e-9 * largest, name
            ends[compiled, name] = cut
    for (compiled, name), cut in ends.items():
        if compiled:
            np.testing.assert_array_equal(cut, ends[False, name])


@pytest.mark.parametrize("change", [thrown, layers, explicit_layers], ids=lambda change: change.__name__)
def test_the_length_of_a_call_changes_nothing(
    change: Callable[[Tables], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit: calls are as long as the machine is fast."""
    outcomes = []
    for longest in (64, 3, 1):
        monkeypatch.setattr(windows, "_FIRST", longest)
        monkeypatch.setattr(windows, "_SECONDS", 60.0 if longest == 64 else 0.0)
        tables = stack()
        change(tables)
        outcomes.append(latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome)
    for name, history in outcomes[0].interfaces.items():
        for other in outcomes[1:]:
            np.testing.assert_array_equal(history.traction, other.interfaces[name].traction)


@pytest.mark.parametrize("kind", ["direct", "explicit", "reduced"])
@pytest.mark.parametrize("window", [1, 4])
def test_fields_of_many_instants_are_those_read_at_each(
    kind: str, window: int, bars_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = bars_scene(output={"fields": True, "stress": True, "every": 5}, time={"end": 2.4, "instants": 96})
    tables["solver"] = {"propagator": {"type": kind}, "window": window}
    law = {"type": "table", "times": [0.0, 2.4], "values": [0.0, 1.0]}
    tables["boundary"]["held"] = {"type": "velocity", "face": "c.zmax", "components": ["z"]}
    tables["boundary"]["held"] |= {"value": [0.05], "law": law}
    found = []
    for small in (recorder._SMALL, -1):
        monkeypatch.setattr(recorder, "_SMALL", small)
        found.append(latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome.substructures)
    assert np.abs(found[1]["c"].displacement[-1]).max() > 0.05
    for name, bar in found[1].items():
        np.testing.assert_array_equal(found[0][name].time, bar.time)
        for field in ("displacement", "velocity", "stress"):
            expected = getattr(bar, field)
            assert len(expected) == 20
            close = 1e-13 * np.abs(expected).max()
            np.testing.assert_allclose(getattr(found[0][name], field), expected, rtol=0.0, atol=close)


def test_an_instant_that_needs_a_fall_back_is_solved_from_python(python_driver: Callable[[], None]) -> None:
    """A tolerance below round-off: nothing converges in the kernels, and the run still reports the fall-backs."""
    tables = stack(2, tolerance=1e-20, max_iterations=20)
    fast = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    python_driver()
    slow = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    assert [w.fallbacks for w in fast.windows] == [w.fallbacks for w in slow.windows]
    for name, history in fast.interfaces.items():
        np.testing.assert_array_equal(history.traction, slow.interfaces[name].traction)
    assert any(w.fallbacks for w in fast.windows)


@pytest.mark.parametrize(
    "change",
    [frictionless, mixed, apart, free_layers, damped_layers, massless_layers, landing, landing_layers, explicit_layers],
    ids=lambda change: change.__name__,
)
def test_no_interpreter_in_the_loop(change: Callable[[Tables], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no instant calls for a fall-back the window solver is never entered, whatever the interfaces are."""
    seen: list[int] = []
    monkeypatch.setattr(windows.Run, "advance", lambda *_: seen.append(1))
    tables = stack()
    change(tables)
    latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert not seen


@pytest.mark.parametrize("window", [1, 4])
def test_the_gap_follows_the_ground(window, blocks_scene):
    """A block at rest over ground that rises and slides below it: the gap shrinks by the rise of every point alone."""
    tables = blocks_scene(time={"end": 1.2, "instants": 12})
    del tables["interface"]["rub"], tables["substructure"]["high"]
    tables["substructure"]["low"]["box"]["origin"] = [0.0, 0.0, 1.0]
    rise = {"direction": [3.0, 1.0, 2.0], "amplitude": 0.1, "law": "constant"}
    tables["interface"]["floor"] |= {"gap": 1.0, "ground_velocity": rise}
    tables["solver"] = {"window": window}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    gap, time = solution.interfaces["floor"].gap, solution.time
    np.testing.assert_allclose(gap, (1.0 - 0.2 / np.sqrt(14.0) * time)[:, None] + 0.0 * gap, rtol=1e-12)
