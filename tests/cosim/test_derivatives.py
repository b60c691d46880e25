"""Directional derivatives of a step against differences of sessions, whose iteration is converged to 1e-13."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import InputError, SolverError
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, column

from .scenes import blocks
from .test_driven import bars
from .test_ports import Z, bar

PRECISE = Settings(tolerance=1e-13, keep=False)
EXACT, SLIP = 1e-8, 1e-5  # of the largest derivative of a quantity
COUNTED = ("solver", "closed", "sticking", "slipping")


def sliding(**changes: Any) -> Scene:
    """The upper block held by friction, and pushed until it slides."""
    tables = blocks().tables()
    push = {"face": "upper.xmin", "traction": [10e6, 0.0, 0.0], "law": {"type": "input", "start_value": 0.0}}
    tables["load"] = {"press": tables["load"]["press"], "push": push}
    return blocks(load=tables["load"], **changes)


SOFT = {"crush": {"sides": ["lower.zmax", "upper.zmin"], "behaviour": "soft_contact", "friction_coefficient": 0.2}}
SOFT["crush"]["normal_stiffness"] = 1e14
OPEN = {"crush": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.2, "gap": 3e-6}}
LARGE = {"end": 3e-6, "step": 1.5e-7, "scheme": "hht"}
STATIC = {"end": 6e-6, "step": 1e-6, "quasi_static": True}
SCENES = {
    "stick": (sliding, {"press": 2.0, "push": 0.3}, 3e-6, EXACT),
    "slip": (sliding, {"press": 0.5, "push": 20.0}, 1e-6, SLIP),
    "energy off": (lambda: sliding(output={"energy": False}), {"press": 2.0, "push": 0.3}, 1e-6, EXACT),
    "layer": (lambda: sliding(interface=SOFT), {"press": 2.0, "push": 0.3}, 1e-6, EXACT),
    "landing": (lambda: sliding(interface=OPEN), {"press": 2.0, "push": 0.3}, 1e-6, EXACT),
    "static": (lambda: sliding(time=STATIC), {"press": 2.0, "push": 0.3}, 1e-6, EXACT),
    "static slip": (lambda: sliding(time=STATIC), {"press": 0.5, "push": 0.6}, 2e-6, SLIP),
    "velocity": (lambda: bars({"type": "input"}), {"boundary.end": 3.0}, 0.25, EXACT),
    "displacement": (lambda: bars({"type": "input"}, "displacement"), {"boundary.end": 0.2}, 0.25, EXACT),
    "ground": (lambda: bars({"type": "input"}, "ground"), {"ground.wall": 3.0}, 0.25, EXACT),
    **{
        kind: (lambda kind=kind: sliding(solver={"propagator": kind}), {"press": 2.0, "push": 0.3}, 1e-6, EXACT)
        for kind in ("explicit", "reduced")
    },
}


def stepped(
    scene: Scene, loads: dict[str, float], h: float, steps: int = 3, growth: float = 0.1
) -> tuple[Session, bytes]:
    """A session after equal steps with growing loads, and its state before the last one; ``growth`` in a step by the
    rate, relative."""
    session = Session(scene, PRECISE)
    session.initialize()
    before = b""
    for i in range(steps):
        before = session.snapshot()
        for name, value in loads.items():
            session.set_load(name, value * (i + 1) / steps, growth * value / h)
        report = session.step(i * h, h)
        assert report.accepted, report.message
    return session, before


def derivatives(session: Session, knowns: list[str], seed: list[float]) -> np.ndarray:
    """Of all outputs, in their order; 0 of the instants of events, which have none."""
    names = [name for name in session.outputs if ".last" not in name]
    computed = dict(zip(names, session.derivative(names, knowns, seed), strict=True))
    return np.array([computed.get(name, 0.0) for name in session.outputs])


def difference(session: Session, scene: Scene, before: bytes, h: float, name: str, what: str, small: float) -> Any:
    """Central difference of the outputs by sessions of their own, and whether the contact state stayed."""
    value, rate = session.load(name)
    rows = []
    t = session.time - h
    for sign in (1.0, -1.0):
        other = Session(scene, PRECISE)
        other.initialize()
        other.restore(before)
        for given in session.loads:
            other.set_load(given, *session.load(given))
        other.set_load(name, value + sign * small * (what == "value"), rate + sign * small * (what == "rate"))
        assert other.step(t, h)
        rows.append(other.row.copy())
    counted = [i for i, output in enumerate(session.outputs) if output.rpartition(".")[2] in COUNTED]
    alike = np.array_equal(rows[0][counted], rows[1][counted])
    return (rows[0] - rows[1]) / (2.0 * small), alike


@pytest.mark.parametrize("case", SCENES)
def test_derivatives_are_those_of_differences(case):
    make, loads, h, limit = SCENES[case]
    scene = make()
    session, before = stepped(scene, loads, h)
    after = session.snapshot()
    if case == "landing":
        assert session.value("interface.crush.closed") == 1.0  # 0 before the last step
    if case == "slip":
        assert session.value("interface.crush.slipping") > 0.5
    if case == "stick":
        assert session.value("interface.crush.sticking") > 0.5
    for name, value in loads.items():
        # without inertia a value moves both ends of an increment: the velocity over it does not change
        for what in ("rate",) if case.startswith("static") else ("value", "rate"):
            size = abs(value) / (1.0 if what == "value" else h)
            computed = derivatives(session, [f"{_stem(name)}.{what}"], [1.0])
            small = {"slip": 1e-4, "static slip": 1e-4, "layer": 1e-3, "landing": 1e-4, "explicit": 1e-3}.get(
                case, 1e-2
            )  # some points slip there
            known, alike = difference(session, scene, before, h, name, what, small * size)
            assert alike, "the contact state changes: choose another case"
            _compare(session, size * computed, size * known, limit)
    assert session.snapshot() == after


def _stem(name: str) -> str:
    return name if "." in name else f"load.{name}"


def _compare(session: Session, computed: np.ndarray, known: np.ndarray, limit: float) -> None:
    """Derivatives of all quantities of one unit, relative to the largest."""
    units = {v.name: v.unit for v in session.table}
    for unit in ("N", "N s", "m s-1", "m", "J", "1"):
        left_out = ("solver", "largest")  # derivatives are 0
        own = [i for i, o in enumerate(session.outputs) if units[o] == unit and not any(w in o for w in left_out)]
        size = np.abs(known[own]).max(initial=0.0)
        if unit == "m":  # gaps of closed points change by round-off of the coordinates alone
            size = max(size, 1e-5 * (10.0 if session.scene.name == "driven" else 0.02))
        assert np.abs(computed[own] - known[own]).max(initial=0.0) <= limit * size, (unit, computed[own], known[own])


@pytest.mark.parametrize("what", ["value", "rate"])
def test_without_rates_a_value_turns_the_causal_line(what):
    scene, h = sliding(), 3e-6
    session, before = stepped(scene, {"press": 2.0, "push": 0.3}, h, growth=0.0)
    computed = derivatives(session, [f"load.press.{what}"], [1.0])
    line = derivatives(session, ["load.press.rate"], [1.0]) / h
    if what == "rate":  # a rate of its own takes the place of that of the line: the jump is no derivative
        rows, rate = [], (2.0 - 4.0 / 3.0) / h
        for sign in (1.0, -1.0):
            other = Session(scene, PRECISE)
            other.initialize()
            other.restore(before)
            other.set_load("press", 2.0, rate * (1.0 + sign * 1e-2))
            other.set_load("push", 0.3, 0.1 / h)
            assert other.step(session.time - h, h)
            rows.append(other.row.copy())
        known = (rows[0] - rows[1]) / (2e-2 * rate)
        _compare(session, computed / h, known / h, EXACT)
        return
    known, alike = difference(session, scene, before, h, "press", what, 1e-2)
    assert alike
    _compare(session, computed, known, EXACT)
    assert np.abs(line).max() > 0.1 * np.abs(computed).max()


@pytest.mark.parametrize("rate", [0.0, 2.0], ids=["causal line", "first rate"])
def test_a_variant_whose_rate_would_be_zero(rate):
    """The slope over the step, x length 1 and 2, is as large as a change of the variants by the value, or by itself."""
    scene, h = sliding(), 1e-6
    session = Session(scene, PRECISE)
    session.initialize()
    session.set_load("press", 4.0)
    assert session.step(0.0, h)
    before = session.snapshot()
    session.set_load("push", 1.0, rate / h)
    assert session.step(h, h)
    computed = derivatives(session, ["load.push.rate"], [1.0])
    session.set_load("push", 1.0, max(rate, 1.0) / h)  # with it set, a line of the same slope
    known, alike = difference(session, scene, before, h, "push", "rate", 1e-2 / h)
    assert alike
    _compare(session, computed / h, known / h, SLIP)  # some points slip


@pytest.mark.parametrize("ruled", [False, True])
def test_a_wave_whose_rate_would_be_zero(ruled):
    cut = {"face": "bar.zmax", "causality": "wave", "components": ["z"], "impedance": [Z]}
    scene = bar(10, 20, port={"cut": cut})
    dt, name = scene.time.time_step, "port.cut.incident[3]"
    session = Session(scene, PRECISE)
    session.initialize()
    session.set_load(name, 0.0, 100.0 / dt if ruled else 0.0)
    assert session.step(0.0, dt)
    before = session.snapshot()
    session.set_load(name, 100.0, 500.0 / (2.0 * dt))
    assert session.step(dt, 2.0 * dt)
    computed = derivatives(session, ["port.cut.incidentRate[3]"], [1.0])
    known, _ = difference(session, scene, before, 2.0 * dt, name, "rate", 1.0 / dt)
    _compare(session, computed / dt, known / dt, EXACT)


def test_with_tables_of_large_interfaces_they_are_those_of_the_exact_operator():
    """The exact motion corrects what the tables of Y leave, in the instants of the variants too."""
    names, found = ["interface.crush.force[3]", "interface.crush.velocityEp[3]", "interface.crush.impulse[3]"], []
    block = Box(STEEL, (0.01, 0.01, 0.002), (10, 10, 2))
    for form in ("sparse", "exact"):
        tables = column({"lower": block, "upper": block}, {"crush": {"friction_coefficient": 5.0}}, dict(LARGE))
        tables["boundary"] = {"base": {"type": "symmetry", "face": "lower.zmin"}}
        load = {"face": "upper.zmax", "pressure": 2e8, "law": {"type": "input", "start_value": 0.2}}
        tables |= {"load": {"press": load}, "solver": {"interface_operator": form, "share_identical": False}}
        session = Session(latin_fmu.scene_from_dict(tables), Settings(keep=False))
        session.initialize()
        for i in range(3):
            session.set_load("press", 0.3 + 0.2 * i, 1e4)
            assert session.step(i * 4.5e-7, 4.5e-7)
        assert session._solver.run.image.run[0]["sparse"] == (form == "sparse")  # type: ignore[union-attr]
        found.append(session.derivative(names, ["load.press.value"], [1.0]))
        assert session.step(session.time, 4.5e-7)
    assert np.abs(found[0] / found[1] - 1.0).max() < 1e-7


def test_derivatives_leave_the_simulation_as_it_is():
    rows = []
    for derived in (False, True):
        session, _ = stepped(sliding(), {"press": 0.5, "push": 20.0}, 1e-6)
        if derived:
            session.derivative(["interface.crush.force[1]"], ["load.push.value", "load.press.rate"], [1.0, 2.0])
        assert session.step(session.time, 1e-6)
        rows.append(session.row.copy())
    np.testing.assert_array_equal(*rows)


def test_a_seed_sums_the_inputs():
    session, _ = stepped(sliding(), {"press": 2.0, "push": 0.3}, 1e-6)
    names = ["interface.crush.force[1]", "interface.crush.force[3]"]
    inputs = ["load.press.value", "load.push.rate"]
    one, two = (session.derivative(names, [name], [1.0]) for name in inputs)
    np.testing.assert_array_equal(session.derivative(names, inputs, [2.0, 3e5]), 2.0 * one + 3e5 * two)
    assert np.abs(one).max() > 0.0
    assert np.abs(two).max() > 0.0


def test_after_the_next_step_the_derivatives_are_its_own():
    session, _ = stepped(sliding(), {"press": 2.0, "push": 0.3}, 1e-6, steps=1)
    first = session.derivative(["sensor.head.velocity[3]"], ["load.press.value"], [1.0])
    session.set_load("press", 2.0)
    assert session.step(session.time, 3e-6)
    assert session.derivative(["sensor.head.velocity[3]"], ["load.press.value"], [1.0]) != first


def test_forces_of_moved_faces_in_an_explicit_march():
    """They are means over two time steps, of which the one before does not change; from the second step on."""
    port = {"foot": {"face": "bar.zmax", "causality": "motion_in", "components": ["z"]}}
    scene = bar(10, 20, propagator="explicit", port=port, output={"energy": True})
    dt, given = scene.time.time_step, "port.foot.velocity[3]"
    names = ["port.foot.force[3]", "energy.kinetic"]

    def stepped_by(last: float) -> Session:
        session = Session(scene, PRECISE)
        session.initialize()
        for i, rate in enumerate((0.1 / dt, 0.1 / dt, last)):
            session.set_load(given, 0.1 * i, rate)
            assert session.step(i * dt, dt)
        return session

    rate, small = 0.3 / dt, 1e-3 / dt
    computed = stepped_by(rate).derivative(names, ["port.foot.velocityRate[3]"], [1.0])
    rows = [stepped_by(rate + sign * small).values(names) for sign in (1.0, -1.0)]
    assert np.abs(computed).min() > 0.0
    assert computed == pytest.approx((rows[0] - rows[1]) / (2.0 * small), rel=1e-6)


def test_a_law_written_in_python_is_refused():
    """Its tangents are not in the kernels."""
    session, _ = stepped(sliding(), {"press": 2.0, "push": 0.3}, 1e-6)
    run = session._solver.run
    assert run is not None
    run.image.groups[0]["law"] = -1
    with pytest.raises(SolverError, match="an interface has a user-defined law in Python"):
        session.derivative(["interface.crush.force[1]"], ["load.press.value"], [1.0])


def test_refusals():
    session = Session(sliding(), PRECISE)
    asked = (["interface.crush.force[3]"], ["load.press.value"], [1.0])
    with pytest.raises(InputError, match="before initialization"):
        session.derivative(*asked)
    session.initialize()
    with pytest.raises(InputError, match="no step was made"):
        session.derivative(*asked)
    kept = session.snapshot()
    assert session.step(0.0, 1e-6)
    for unknown, known, words in (
        ("interface.none.force", "load.press.value", "no variable of this name"),
        ("load.push.value", "load.press.value", "not an output"),
        ("interface.crush.lastTouch", "load.press.value", "instant of an event"),
        ("interface.crush.force[3]", "load.none.value", "no variable of this name"),
        ("interface.crush.force[3]", "endTime", "not an input"),
    ):
        with pytest.raises(InputError, match=words):
            session.derivative([unknown], [known], [1.0])
    session.restore(kept)
    with pytest.raises(InputError, match="no step was made"):
        session.derivative(*asked)
    played = Session(sliding(), Settings(mode=1))
    played.initialize()
    with pytest.raises(InputError, match="prescribed"):
        played.derivative(*asked)
