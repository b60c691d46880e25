"""Communication steps in kernels: the rows of a session, states and files bit for bit, refusals by name.

Limit, set before the runs: 1e-12 of the peak of the outputs of the same unit; of the gaps, of the distance that the
sides have moved; of the error indicator, a share of the fields, 1e-10. Without inertia 1e-10: there a first guess that
differs by round-off ends in another iterate within the tolerance of 1e-5.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.interfaces import completed
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.communication import PLANE, CommunicationRun, _from_planes, _planes, read, write
from latin_fmu.cosim.variable import Variable
from latin_fmu.cosim.variables import CAUSAL, HOLD, LINE, RATE, scalar_table
from latin_fmu.errors import InputError
from latin_fmu.kernels import entries
from latin_fmu.kernels.communication import BEYOND_LAWS
from latin_fmu.kernels.inputs import CARRIED, N_MEMORY
from latin_fmu.scene.schema import Scene

from . import test_driven as driven
from . import test_ports as ports
from .scenes import bar, blocks
from .segments import Segments

LIMIT, WITHOUT_INERTIA = 1e-12, 1e-10
RULES = (HOLD, RATE, LINE, CAUSAL)
Give = Mapping[str, Callable[[float], float]]


def push(t: float) -> float:
    """An amplitude that rises, falls and pulls."""
    return 0.25 + 0.5 * float(np.sin(2e6 * t))


PRESS: Give = {"press": push}


def peaks_apart(table: Sequence[Variable], known: np.ndarray, got: np.ndarray, duration: float) -> dict[str, float]:
    """Largest difference of every output over the peak of its kind, over rows of outputs during a time, s."""
    outputs = [v for v in table if v.causality == "output"]
    kinds = ["gap" if "ap" in v.name.rpartition(".")[2] else v.unit for v in outputs]
    known = np.where(np.isnan(known), got, known)  # what is not known is not compared
    peaks: dict[Any, float] = {}
    for k, kind in enumerate(kinds):
        peaks[kind] = max(peaks.get(kind, 0.0), float(np.abs(known[:, k]).max()), 1.0 if kind == "1" else 1e-300)
    kinds[[v.name for v in outputs].index("solver.errorIndicator")] = "indicator"
    peaks["indicator"] = 1e-10 / LIMIT
    peaks["gap"] = max(peaks.get("gap", 0.0), peaks.get("m s-1", 0.0) * duration)
    largest = np.abs(known - got).max(axis=0)
    return {v.name: float(largest[k] / peaks[kinds[k]]) for k, v in enumerate(outputs)}


class Both:
    """Segments of a run, and a session of one scene, with the same inputs, step by step."""

    def __init__(self, scene: Scene, n: int = 1, rule: int = CAUSAL, give: Give | None = None) -> None:
        self.scene, self.n, self.rule, self.give = completed(scene), n, rule, give or {}
        self.known = Segments(self.scene, rule)
        self.session = Session(self.scene, Settings(interpolation=rule))
        self.h = n * self.scene.time.time_step
        self._set(0.0)
        self.session.initialize()
        self.known.initialize()
        self.rows = [(self.known.row.copy(), self.session.row.copy())]

    def _set(self, t: float) -> None:
        for name, law in self.give.items():
            value = law(t)
            rate = (law(t + self.h) - value) / self.h if self.rule == RATE else 0.0
            self.session.set_load(name, value, rate)
            self.known.loads.set(name, value, rate)

    def step(self, count: int) -> Both:
        for i in range(len(self.rows) - 1, len(self.rows) - 1 + count):
            self._set((i + (self.rule == LINE)) * self.h)
            assert not (trouble := self.known.step(i * self.h, self.h)), trouble
            report = self.session.step(i * self.h, self.h)
            assert report, report.message
            self.rows.append((self.known.row.copy(), self.session.row.copy()))
        return self

    def apart(self) -> dict[str, float]:
        """Largest difference of every output over the peak of its kind."""
        known, got = (np.array([pair[i] for pair in self.rows]) for i in (0, 1))
        return peaks_apart(self.session.table, known, got, self.h * (len(self.rows) - 1))


def assert_agree(both: Both, limit: float = LIMIT) -> None:
    apart = both.apart()
    worst = max(apart, key=lambda name: apart[name])
    assert apart[worst] <= limit, (worst, apart[worst])


# -- rows ---------------------------------------------------------------------------------------------------------
def test_more_time_steps_than_there_are_rows_are_not_made():
    run = CommunicationRun(completed(bar()))
    assert run.image.call(entries.COMMUNICATE, run.steps + 1, CAUSAL, 0, run.steps + 1) == 0
    assert run.image.call(entries.COMMUNICATE, 0, CAUSAL, 0, 1) == 0


MODELS = {
    "two_specimen_crushing/scene": LIMIT,
    "two_specimen_crushing/ground": LIMIT,
    "two_specimen_crushing/soft": LIMIT,
    "impact_bar/scene": LIMIT,
    "bouncing_bar/scene": LIMIT,
    "shear_interface/scene": LIMIT,
    "stacked_blocks/n04": LIMIT,
    "hammer_on_plate/scene": LIMIT,
    "beam_in_traction/scene": LIMIT,
}
LONG = {"punched_plates/scene": LIMIT, "lap_joint/shock": LIMIT, "pressed_plates/scene": WITHOUT_INERTIA}
LONG |= {"lap_joint/scene": WITHOUT_INERTIA, "gripped_bar/scene": WITHOUT_INERTIA}


def model(name: str) -> Scene:
    """A shipped model in windows of one instant, with energies where it has inertia."""
    scene = latin_fmu.load_scene(f"models/{name}.toml")
    output = scene.output.model_copy(update={"energy": not scene.time.quasi_static})
    return scene.model_copy(update={"output": output, "solver": scene.solver.model_copy(update={"window": 1})})


@pytest.mark.parametrize("n", [1, 5])
@pytest.mark.parametrize("name", [*MODELS, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_models(name, n):
    scene = model(name)
    assert_agree(Both(scene, n).step(min(60, scene.time.n_step) // n), (MODELS | LONG)[name])


@pytest.mark.parametrize("name", [*MODELS, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_models_to_their_end_are_the_run(name):
    """Fields are those of a run bit for bit: scenes that amplify round-off agree, too. Without inertia they agree
    within ten times the tolerance: communication steps begin with a first guess of their own."""
    scene = completed(model(name))
    known, run, rows = latin_fmu.solve(scene).interfaces, CommunicationRun(scene), list[np.ndarray]()
    rows.append(run.outputs().copy())
    while len(rows) <= scene.time.n_step:
        n = min(run.steps, scene.time.n_step + 1 - len(rows))
        assert run.image.call(entries.COMMUNICATE, n, CAUSAL, 0, n) == n
        rows += [run.outputs(row).copy() for row in range(1, n + 1)]
    names = [v.name for v in scalar_table(scene) if v.causality == "output"]
    for interface, history in known.items():
        at, force = names.index(f"interface.{interface}.force[1]"), history.force()
        limit = 10.0 * scene.solver.tolerance if scene.time.quasi_static else LIMIT
        assert np.abs(np.array(rows)[:, at : at + 3] - force).max() <= limit * np.abs(force).max()


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("n", [1, 5])
def test_loads(rule, n):
    assert_agree(Both(blocks(), n, rule, PRESS).step(30 // n))


@pytest.mark.parametrize("n", [1, 5])
def test_without_inertia(n):
    """Increments of a load from outside that turns, and of a law of the scene."""
    held = {"type": "fixed", "face": "upper.xmax", "components": ["x", "y"]}
    base = {"type": "fixed", "face": "lower.zmin"}
    time = {"end": 1.0, "instants": 30, "quasi_static": True}
    scene = blocks(time=time, boundary={"base": base, "held": held}, output={})
    assert_agree(Both(scene, n, RATE, {"press": lambda t: 0.3 + t - t * t}).step(30 // n), WITHOUT_INERTIA)


@pytest.mark.parametrize("propagator", ["explicit", "reduced"])
def test_propagators(propagator):
    kind = {"type": "reduced", "modes": 20} if propagator == "reduced" else propagator
    scene = blocks(solver={"propagator": kind}, time={"end": 6e-6, "step": 0.1e-6})
    assert_agree(Both(scene, 3, RATE, {"press": lambda t: 0.25 + 1e5 * t}).step(10))


@pytest.mark.parametrize("kind", [*driven.KINDS, "acceleration"])
@pytest.mark.parametrize("rule", RULES)
def test_motions(kind, rule):
    """Driven faces and ground, until the wave has reached the joint."""
    give = {driven.name_of(kind): lambda t: float(driven.amplitude(kind, t))}
    assert_agree(Both(driven.bars({"type": "input"}, kind), 4, rule, give).step(15))


@pytest.mark.parametrize("kind", driven.KINDS)
def test_motions_by_laws_of_the_scene(kind):
    law = {"type": "table", "times": [0.0, 0.1, 0.3], "values": [0.0, 1.0, -1.0]}
    assert_agree(Both(driven.bars(law, kind), 3).step(20))


@pytest.mark.parametrize("causality", ["force_in", "motion_in", "wave"])
@pytest.mark.parametrize("rule", [RATE, LINE])
def test_ports(causality, rule):
    port: dict[str, Any] = {"face": "bar.zmax", "causality": causality, "components": ["z"]}
    port |= {"impedance": [0.7 * ports.Z]} if causality == "wave" else {}
    name = {"force_in": "force", "motion_in": "velocity", "wave": "incident"}[causality]
    scene = ports.bar(20, 60, port={"foot": port}, output={"energy": True})
    assert_agree(Both(scene, 3, rule, {f"port.foot.{name}[3]": ports.smooth}).step(20))


def test_contact_events():
    """Touch, slip and separation are counted, and lie at the instants that the session finds."""
    both = Both(bar(time={"end": 2.0, "instants": 100})).step(100)
    assert_agree(both)
    assert both.session.values(["interface.wall.touches", "interface.wall.separations"]).min() > 0
    slid = Both(blocks(time={"end": 20e-6, "step": 0.2e-6}), 2, RATE, {"press": lambda t: 0.3 - 2e4 * t}).step(50)
    assert_agree(slid)


def test_fields_of_the_points():
    both = Both(blocks(), 2, RATE, PRESS).step(10)
    known, own = both.known.histories["crush"], both.session.window()[1]["crush"]
    for field in ("traction", "velocity", "gap", "contact_status"):
        values = np.asarray(getattr(known, field), dtype=float)
        assert np.abs(np.asarray(getattr(own, field), dtype=float) - values).max() <= LIMIT * np.abs(values).max()


# -- states and files ---------------------------------------------------------------------------------------------
def rows_of(run: CommunicationRun, steps: int) -> np.ndarray:
    """Outputs of steps of two time steps with a load that changes."""
    rows = []
    for i in range(steps):
        run.set("press", 0.3 + 0.05 * i, 0.0)
        assert run.image.call(entries.COMMUNICATE, 2, CAUSAL, 0, 2) == 2
        rows.append(run.outputs(2).copy())
    return np.array(rows)


@pytest.mark.parametrize("kind", ["load", "displacement", "ground"])
def test_a_state_is_its_range_bit_for_bit(kind):
    """Steps after the state was put back give the same rows, and so does a step made in two calls."""
    scene = blocks() if kind == "load" else driven.bars({"type": "input"}, kind)
    run, name = CommunicationRun(completed(scene)), "press" if kind == "load" else driven.name_of(kind)
    image = run.image
    run.set(name, 0.0, 0.0)
    image.call(entries.PRESENT)

    def steps(pieces: tuple[int, ...]) -> np.ndarray:
        rows = []
        for i in range(4):
            run.set(name, 0.02 * i * i, 0.0)
            before = 0
            for piece in pieces:
                assert image.call(entries.COMMUNICATE, piece, LINE, before, sum(pieces)) == piece
                before += piece
            rows.append(run.outputs(pieces[-1]).copy())
        return np.array(rows)

    steps((2,))
    kept, fresh = image.state.copy(), CommunicationRun(completed(scene)).image.moving
    first = steps((5,))
    image.moving[:] = fresh  # nothing else counts
    image.state[:] = kept
    assert (steps((5,)) == first).all()
    image.state[:] = kept
    assert (steps((2, 3)) == first).all()
    image.state[:] = kept
    image.call(entries.PRESENT)
    assert (run.outputs() == kept[image.run[0]["present"] :][: len(run.outputs())]).all()


def test_a_file_gives_the_same_rows():
    run = CommunicationRun(completed(blocks()))
    content = write(run)
    known = rows_of(run, 5)
    words, numbers, pools = read(content)
    assert numbers["dt"] == pytest.approx(0.2e-6)
    for i, row in enumerate(known):
        pools.moving[words["input_value"]] = 0.3 + 0.05 * i
        assert entries.call(pools, words["communicate"], 2, CAUSAL, 0, 2) == 2
        at = words["output"] + 2 * words["n_output"]
        assert (pools.moving[at : at + words["n_output"]] == row).all()


def test_the_fixed_block_is_kept_by_planes_without_its_room():
    """Numbers over several planes, and over none, come back; the room for further search directions is left out."""
    numbers = np.random.default_rng(3).standard_normal(2 * PLANE + 5)
    for n in (0, 1, PLANE, len(numbers)):
        kept = b"".join(_planes(numbers[:n]))
        assert (_from_planes(np.frombuffer(kept)) == numbers[:n]).all()
    assert kept[:3] == numbers[:3].tobytes()[::8]
    run = CommunicationRun(completed(blocks()))
    words, _, pools = read(write(run))
    assert words["n_fixed"] == run.image.n_fixed < len(run.image.fixed)
    assert (pools.fixed == run.image.fixed[: run.image.n_fixed]).all()


@pytest.mark.parametrize("spoil", [lambda c: c[:-8], lambda c: b"X" + c[1:], lambda c: c[:8] + b"\x07" + c[9:]])
def test_a_damaged_file_is_refused(spoil):
    content = write(CommunicationRun(completed(bar())))
    with pytest.raises(InputError, match="image of a run"):
        read(spoil(content))


# -- communication steps of any length --------------------------------------------------------------------------------
def placed(run: CommunicationRun, end: float, length: float) -> int:
    """Time steps that end in the communication step with this end and length, in time steps."""
    run.image.field("place", 3)[:] = end, length, 1e-15 * end
    return run.image.call(entries.PLACE)


@pytest.mark.parametrize("rule", [HOLD, CAUSAL])
def test_the_integral_of_the_input_is_kept(rule):
    """Held values over random steps: what has driven the time steps, and what is carried, are what was set."""
    run, generator = CommunicationRun(completed(blocks())), np.random.default_rng(5)
    image, dt, n_source = run.image, float(run.image.run[0]["dt"]), int(run.image.run[0]["n_source"])
    run.set("press", 0.0, 0.0)
    image.call(entries.PRESENT)
    given = driven_by = t = 0.0
    while t < 25.0:
        length = generator.choice([0.05, 0.37, 0.999, 1.0, 2.6]) * generator.uniform(0.5, 1.0)
        value = generator.uniform()
        run.set("press", value, 1e-300 if rule == CAUSAL else 0.0)  # a rate: no causal line
        n = placed(run, t + length, length)
        assert image.call(entries.COMMUNICATE, n, rule, 0, n) == n
        width = int(image.run[0]["n_drive"])
        rows = image.field("drive", image.rows, width)[1 : n + 1]
        driven_by += dt * rows[:, width - 1 - n_source].sum()
        given += value * length * dt
        t += length
        carried = image.field("inputs", N_MEMORY, 1)[CARRIED, 0]
        assert abs(driven_by + carried - given) <= 1e-12 * given


# -- refusals -----------------------------------------------------------------------------------------------------
def test_steps_beyond_the_laws_of_the_scene_are_refused():
    run = CommunicationRun(completed(blocks()))
    n = run.scene.time.n_step
    for _ in range(n // 5):
        assert run.image.call(entries.COMMUNICATE, 5, CAUSAL, 0, 5) == 5
    kept = run.image.state.copy()
    assert run.image.call(entries.COMMUNICATE, n % 5 + 1, CAUSAL, 0, n % 5 + 1) == BEYOND_LAWS
    assert (run.image.state == kept).all()


def test_an_initial_value_that_the_state_does_not_hold_for_is_refused():
    """The initial displacement of a face is a part of the geometry."""
    run = CommunicationRun(completed(driven.bars({"type": "input"}, "displacement")))
    run.set("boundary.end", 0.1, 0.0)
    assert run.image.call(entries.PRESENT) == -2
    run.set("boundary.end", 0.0, 0.0)
    assert run.image.call(entries.PRESENT) == 0


def test_what_python_solves_is_refused_by_name():
    with pytest.raises(InputError, match=r"substructure\.lower.*propagator"):
        CommunicationRun(completed(blocks(solver={"propagator": "cg"}, time={"end": 6e-6, "step": 0.1e-6})))
