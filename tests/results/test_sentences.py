"""The sentences of a summary: peaks, instants, slip, opening, bolts, sensors, with errors, and no number twice."""

from __future__ import annotations

import html
import re
from dataclasses import replace

import numpy as np
import pytest

import latin_fmu
from latin_fmu.latin.outcome import BoltHistory, InterfaceHistory, ReactionHistory, SensorHistory
from latin_fmu.results.bolt_results import bolt_report
from latin_fmu.results.estimates import ErrorEstimate, QuantityEstimate
from latin_fmu.results.sensors import TensionEnd
from latin_fmu.results.sentences import WIDTH, sentences
from latin_fmu.results.solution import Solution
from latin_fmu.results.spectra import ShockSpectrum
from latin_fmu.scene.units import UNIT_SYSTEMS

from . import synthetic

TIME = np.linspace(0.0, 10e-6, 101)


def said(solution: Solution, estimate: ErrorEstimate | None = None, **changes: object) -> str:
    """The sentences as one text, their lines joined."""
    lines = sentences(replace(solution.outcome, **changes), estimate=estimate)
    assert max(map(len, lines)) <= WIDTH
    return " ".join(" ".join(lines).split())


def one(history: InterfaceHistory) -> dict[str, object]:
    """What replaces the interfaces of an outcome by one of its own instants."""
    return {"interfaces": {history.name: history}, "time": TIME}


WELD = one(synthetic.joint("weld", TIME))
"""An outcome of one joint of its own instants."""


def test_a_contact_says_peak_instants_and_slip(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8)
    sliding = pulse.velocity.copy()
    sliding[:, 1, :, 0] += 0.5
    text = said(crushing, **one(replace(pulse, velocity=sliding, initial_gap=np.full(16, 1e-6))))
    assert text.startswith("crush peak ")
    assert "at 5.00 us" in text  # the pulse is symmetric about it
    assert "touches from 2.0" in text
    # friction grows outwards: of sixteen equal points only the one in the corner holds
    assert "slips on up to 94 % of the face" in text


def test_a_contact_under_load_all_the_time_says_so(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8, friction=0.5)
    steady = np.broadcast_to(pulse.traction[50], pulse.traction.shape)
    closed = np.ones_like(pulse.contact_status)
    text = said(crushing, **one(replace(pulse, traction=steady, contact_status=closed)))
    assert "in contact throughout; sticks throughout" in text
    assert "touches" not in text


def test_what_opens_counts_by_area(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, -5e-6, 15e-6, 1e8)
    status = np.ones_like(pulse.contact_status)
    status[40:, :4] = 0
    areas = pulse.areas * np.repeat([3.0, 1.0], [4, 12])  # four of sixteen points have half of the area
    text = said(crushing, **one(replace(pulse, contact_status=status, areas=areas)))
    assert "up to 50 % of the initially closed area opens" in text


def test_a_contact_never_touched_says_how_near_it_came(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8)
    still, gap = np.zeros_like(pulse.traction), np.full_like(pulse.gap, 3e-6)
    apart = replace(pulse, traction=still, gap=gap, initial_gap=gap[0])
    assert said(crushing, **one(apart)) == "crush never touches, smallest gap 3.00 um"


def test_a_joint_that_cannot_open_carries(crushing: Solution) -> None:
    joint = synthetic.joint("weld", TIME)
    assert said(crushing, **one(joint)).startswith("weld carries up to ")


def test_errors_and_instants_are_those_of_the_estimate(crushing: Solution) -> None:
    """Also where the run itself would give another value."""
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8)
    estimate = ErrorEstimate(
        (
            QuantityEstimate("crush.first_contact", 1.987e-6, 0.02, bound_only=False),
            QuantityEstimate("crush.peak_force", 1.0, 0.5),
            QuantityEstimate("crush.separation", 8e-6, np.inf, bound_only=False),
            QuantityEstimate("crush.impulse", 0.3, 1e-5, bound_only=False),
        )
    )
    text = said(crushing, estimate, **one(replace(pulse, initial_gap=np.full(16, 1e-6))))
    assert "touches from 1.99 us +- 2 % to 8.00 us (error unknown)" in text
    assert "kN (error at most 50 %)" in text
    assert "impulse 300.0 mN s +- 0.1 %" in text  # no error is printed below the floor


def test_a_bolt_says_its_clamp_force_and_what_is_lost(crushing: Solution) -> None:
    force = 5e3 - 250.0 * np.linspace(0.0, 1.0, 101)
    bolt = BoltHistory("m6", "bolt", 1, 5e3, 20e-6, 1e-5, force, (1, 2), (5.1e3, 5e3))
    text = said(crushing, bolts={"m6": bolt}, **WELD)
    assert "bolt m6 tightened to 5.100 kN; 5.000 kN at the start, after all bolts are tightened" in text
    assert (
        "4.750 kN at the end (5 % lost); 4.750 kN to 5.000 kN during the run, at most 250 MPa over its meshed section"
        in text
    )
    loose = said(crushing, bolts={"m6": replace(bolt, force=np.linspace(10.0, 104.0, 101), tightening=(10.0,))}, **WELD)
    assert "104.0 N at the end (never tight)" in loose
    assert "gained" not in loose
    kept = replace(bolt, force=np.full(101, 5.1e3), plastic_elongation=np.full(101, 2e-6))
    assert "(nothing lost)" in said(crushing, bolts={"m6": kept}, **WELD)
    assert "yields by 2.00 um" in said(crushing, bolts={"m6": kept}, **WELD)


def test_a_bolt_that_oscillates_at_the_end_has_lost_what_its_mean_has(crushing: Solution) -> None:
    """A mean of 4.8 kN and a swing of 0.3 kN, at its largest at the last instant: 4 % are lost, not 2 % gained."""
    share = np.linspace(0.0, 1.0, 101)
    swing = 300.0 * np.minimum(share / 0.1, 1.0) * np.cos(2.0 * np.pi * 5.0 * (share - 1.0))
    force = 4.8e3 + 200.0 * (1.0 - np.minimum(share / 0.1, 1.0)) + swing
    bolt = BoltHistory("m6", "bolt", 1, 5e3, 20e-6, 1e-5, force, (1,), (5e3,))
    text = said(crushing, bolts={"m6": bolt}, **WELD)
    assert "still oscillates at the end: mean 4.800 kN over the last 3 periods (4 % lost), between 4.5" in text
    end = bolt_report(replace(crushing.outcome, bolts={"m6": bolt}, **WELD))["m6"]["end"]
    assert end["mean"] == pytest.approx(4.8e3, rel=1e-3)
    assert (end["half_periods"], end["high"]) == (6, pytest.approx(5.1e3))
    # it has come to rest before the end, or has turned once or not at all: the last value counts
    for still in (
        4.8e3 + 200.0 * np.exp(-30.0 * share) * np.cos(50.0 * share),
        4.8e3 + 200.0 * np.sin(40.0 * np.pi * share) * (share < 0.55),
        4.8e3 + 200.0 * np.abs(share - 0.6),
        4.8e3 - 200.0 * np.abs(share - 0.6),
        5e3 - 200.0 * share,
        5e3 + 0.0 * share,
    ):
        assert TensionEnd.of(still, TIME).half_periods == 0
        assert TensionEnd.of(still, TIME).mean == still[-1]
    assert TensionEnd.of(force, TIME, still=True).mean == force[-1]


def test_the_largest_instant_stands_beside_the_mean_where_it_is_another(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8)
    spiked = np.array(pulse.traction)
    spiked[50] *= 2.0
    text = said(crushing, **one(replace(pulse, traction=spiked)))
    raw = 2.0 * float(np.abs(pulse.normal_resultant()).max())
    assert f"raw peak {raw / 1e3:.2f} kN (at a single instant)" in text
    assert "raw peak" not in said(crushing, **one(pulse))

    def known(error: float) -> ErrorEstimate:
        return ErrorEstimate((QuantityEstimate("crush.peak_force_raw", raw, error, bound_only=False),))

    assert "kN (error as large as the value) (at a single instant)" in said(
        crushing, known(2.0), **one(replace(pulse, traction=spiked))
    )
    higher = np.array(pulse.traction)
    higher[50] *= 1.05
    assert "raw peak" in said(crushing, known(0.01), **one(replace(pulse, traction=higher)))
    assert "raw peak" not in said(crushing, known(0.2), **one(replace(pulse, traction=higher)))
    assert "raw peak" not in said(crushing, **one(replace(pulse, traction=higher)))  # no error is known: a tenth


def test_the_largest_value_of_a_spectrum_has_its_error(crushing: Solution) -> None:
    """That of its frequency and axis, not the largest one of the spectrum."""
    values = np.ones((3, 4, 3))
    values[0, 2, 1] = 5.0
    spectrum = ShockSpectrum(np.array([1e3, 2e3, 3e3, 4e3]), 10.0, values, values)
    error = np.full((3, 4, 3), 0.5)
    error[0, 2, 1] = 0.07
    motion = np.zeros((101, 3))
    sensor = SensorHistory("tip", "beam", None, np.zeros(3), motion, motion, motion)
    outcome = replace(crushing.outcome, sensors={"tip": sensor}, **WELD)
    for estimate, words in ((ErrorEstimate((), spectra={"tip": error}), " +- 7 %"), (ErrorEstimate(()), "")):
        text = " ".join(" ".join(sentences(outcome, estimate=estimate, spectra={"tip": spectrum})).split())
        assert f"up to 5 m/s2 (0.51 g){words} at 3.00 kHz" in text


def test_a_sensor_says_its_acceleration_in_g(crushing: Solution) -> None:
    motion = np.zeros((101, 3))
    motion[30] = [0.0, 3.0, 4.0]
    sensor = SensorHistory("tip", "beam", None, np.zeros(3), 1e-6 * motion, motion, 9806.65 * motion)
    changes = one(synthetic.joint("weld", TIME)) | {"sensors": {"tip": sensor}}
    assert "acceleration up to 4.9e+04 m/s2 (5e+03 g) at 3.00 us" in said(crushing, **changes)
    lines = sentences(replace(crushing.outcome, **changes), UNIT_SYSTEMS["mm-t-s-MPa"])
    assert "m/s2 (5 g)" in " ".join(lines)


def test_a_support_says_its_largest_reaction(crushing: Solution) -> None:
    force = np.zeros((101, 3))
    force[20] = [3.0, 0.0, -4.0]
    reaction = {"wall": ReactionHistory("wall", "beam", "beam.xmin", force)}
    changes = one(synthetic.joint("weld", TIME)) | {"reactions": reaction}
    assert "support wall reaction up to 5.000 N at 2.00 us" in said(crushing, **changes)


def test_details_are_on_request(crushing: Solution) -> None:
    assert "sqrt(eta) " not in crushing.summary()
    assert "sqrt(eta) " in crushing.summary(details=True)
    for text in (crushing.summary(), crushing.summary(details=True)):
        assert crushing.status in text
        assert "impulse 0.2 % too small" in text
    assert crushing._repr_html_() == f"<pre>{html.escape(crushing.summary())}</pre>"


def test_statics_have_no_mean_no_impulse_and_no_velocity() -> None:
    """A ramp to 20 kN: the peak is the last force, not a mean over the time that orders the increments."""
    box = {"size": [2e-2, 2e-2, 2e-2], "elements": [2, 2, 2]}
    scene = latin_fmu.scene_from_dict(
        {
            "name": "ramp",
            "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.0, "density": 7800.0}},
            "substructure": {
                "low": {"material": "steel", "box": box | {"origin": [0.0, 0.0, 0.0]}},
                "high": {"material": "steel", "box": box | {"origin": [0.0, 0.0, 2e-2]}},
            },
            "interface": {
                "meet": {"sides": ["low.zmax", "high.zmin"], "behaviour": "contact", "friction_coefficient": 0.2}
            },
            "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
            "load": {
                "press": {
                    "face": "high.zmax",
                    "pressure": 50e6,
                    "law": {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]},
                }
            },
            "sensor": {"top": {"face": "high.zmax"}},
            "time": {"quasi_static": True, "end": 1.0, "instants": 40},
        }
    )
    solution = latin_fmu.solve(scene)
    text = replace(solution, estimate=latin_fmu.estimate_error(scene, solution)).summary()
    assert "peak 20.00 kN +- 0.1 %; carries a force from " in text
    for word in ("mean of", "impulse", "velocity", "touches", "opens"):
        assert word not in text, word
    assert solution.report()["interfaces"]["meet"]["peak_force"] == pytest.approx(20e3, rel=1e-3)


def test_faces_that_touch_without_a_force_carry_none(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8)
    idle = replace(pulse, traction=np.zeros_like(pulse.traction))
    assert said(crushing, **one(idle)) == "crush carries no force"


def test_an_error_beyond_the_value_is_no_number(crushing: Solution) -> None:
    pulse = synthetic.contact("crush", TIME, 2e-6, 8e-6, 1e8)
    estimate = ErrorEstimate((QuantityEstimate("crush.peak_force", 1.0, 11.0, bound_only=False),))
    assert "kN (error as large as the value)" in said(crushing, estimate, **one(pulse))


def _rubbing(slip: float, elastic: float, friction: float, spin: float = 0.0) -> InterfaceHistory:
    """A pressed joint all of whose points count as slipping: they slide by ``slip`` (m), while both faces bulge by
    ``elastic`` (m) in the middle and turn by ``spin`` about the normal; ``friction`` over its limit as a whole."""
    made = synthetic.contact("lap", TIME, 0.0, TIME[-1], 1e8, friction=0.2)
    steady = np.zeros_like(made.traction)
    steady[:, :, 0], steady[:, :, 2] = -friction * 0.2 * 1e8, -1e8
    x = made.points - made.points.mean(axis=0)
    rate = 1.0 / TIME[-1]
    velocity = np.zeros_like(made.velocity)
    bulge = np.abs(x[:, 0]) - np.abs(x[:, 0]).mean()
    velocity[:, :, :, 1] = elastic * rate * bulge / np.abs(bulge).max()
    velocity[:, :, :, 0] -= spin * rate * x[:, 1]
    velocity[:, :, :, 1] += spin * rate * x[:, 0]
    velocity[:, 1, :, 0] += slip * rate
    status = np.full(made.contact_status.shape, 2, dtype=np.int8)  # type: ignore[union-attr]
    return replace(made, traction=steady, velocity=velocity, contact_status=status)


@pytest.mark.parametrize(
    ("slip", "elastic", "friction", "spin", "words"),
    [
        (164e-12, 1e-6, 0.5, 0.0, "sticks throughout"),
        (0.9e-9, 1e-6, 0.5, 0.0, "sticks throughout"),
        (1.1e-9, 1e-6, 0.5, 0.0, "slips on up to 100 % of the face, by up to 1.10 nm, at 50 % of the friction limit"),
        (164e-12, 1e-6, 1.0, 0.0, "slips on up to 100 % of the face, by up to 164 pm, as a whole"),
        # a rigid rotation is no elastic motion
        (164e-12, 0.0, 0.5, 1e-3, "slips on up to 100 % of the face, by up to 164 pm, at 50 %"),
    ],
)
def test_a_joint_sticks_where_its_slip_is_none_beside_its_elastic_motion(
    crushing: Solution, slip: float, elastic: float, friction: float, spin: float, words: str
) -> None:
    """Limits: 1e-3 of the largest elastic relative motion, and friction below its limit at every instant."""
    lap = _rubbing(slip, elastic, friction, spin)
    assert words in said(crushing, **one(lap))
    table = replace(crushing, outcome=replace(crushing.outcome, **one(lap))).summary(details=True)
    row = next(line for line in table.splitlines() if line.split()[:2] == ["lap", "contact"])
    assert ("sticks" in row) == words.startswith("sticks")


def test_an_equilibrium_has_no_instant_and_no_impulse() -> None:
    """Two blocks pressed together: the load is whole at the end, whose instant orders the increments only."""
    steel = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    block = {"size": [0.01] * 3, "elements": [1, 1, 1]}
    tables = {
        "name": "pressed",
        "material": {"steel": steel},
        "substructure": {
            "low": {"material": "steel", "box": block},
            "high": {"material": "steel", "box": block | {"origin": [0.0, 0.0, 0.01]}},
        },
        "interface": {"joint": {"sides": ["low.zmax", "high.zmin"], "friction_coefficient": 0.2}},
        "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
        "load": {
            "push": {
                "face": "high.zmax",
                "pressure": 1e6,
                "law": {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]},
            }
        },
        "sensor": {"top": {"face": "high.zmax"}},
        "output": {"reactions": True},
        "time": {"end": 1.0, "instants": 10, "quasi_static": True},
    }
    text = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).summary(details=True)
    assert "joint         peak 100.0 N; " in text
    assert "reaction up to 100.0 N\n" in text
    assert "1.00 s" not in text
    assert "N s" not in text
    row = next(line for line in text.splitlines() if line.split()[:2] == ["joint", "contact"])
    assert row.split()[2:7] == ["100.0", "N", "-", "-", "-"]
    # a law that falls again has its peak before the end, which is said
    tables["load"]["push"]["law"] |= {"times": [0.0, 0.5, 1.0], "values": [0.0, 1.0, 0.2]}  # type: ignore[index]
    text = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).summary()
    assert "peak 100.0 N at 500 ms;" in text


def test_a_thread_has_one_number(crushing: Solution) -> None:
    """A bond whose normals stand across its force, as those of the flanks of a thread on a cylinder."""
    weld = synthetic.joint("thread", TIME)
    inclined = np.tile([np.cos(0.18), 0.0, np.sin(0.18)], (len(weld.areas), 1))
    outcome = replace(crushing.outcome, **one(replace(weld, normals=inclined)))
    found = replace(crushing, outcome=outcome)
    (largest,) = re.findall(r"carries up to (\S+ kN) at", found.summary())
    row = next(line for line in found.summary(details=True).splitlines() if line.split()[:2] == ["thread", "perfect"])
    assert largest == " ".join(row.split()[2:4])
    assert row.split()[4:6] == ["-", "-"]


def test_a_sensor_with_a_filter_says_the_peak_behind_it() -> None:
    """A ripple of 200 kHz on a slow half sine: its filter takes the ripple off, and the sentence has what is left."""
    from latin_fmu.results.filters import low_pass
    from latin_fmu.scene.sensors import LowPass, Sensor

    time = np.linspace(0.0, 2e-3, 4001)
    slow = 100.0 * np.sin(np.pi * time / 2e-3)
    motion = np.zeros((time.size, 3))
    motion[:, 2] = slow + 50.0 * np.sin(2 * np.pi * 200e3 * time)
    chosen = LowPass(cutoff=10e3)
    history = SensorHistory("tip", "beam", None, np.zeros(3), 1e-6 * motion, 1e-3 * motion, motion)
    outcome = replace(synthetic.crushing(), sensors={"tip": history}, time=time, interfaces={}, bolts={}, reactions={})
    requests = {"tip": Sensor(face="beam.xmax", filter=chosen)}
    text = " ".join(" ".join(sentences(outcome, requests=requests)).split())
    largest = np.abs(low_pass(motion, chosen, time[1])).max()
    assert largest == pytest.approx(100.0, rel=1e-3)
    assert f"acceleration up to {largest:.3g} m/s2 ({largest / 9.80665:.3g} g) at 1.00 ms ({chosen.label})" in text
    assert "unfiltered" not in text
    raw = " ".join(" ".join(sentences(outcome)).split())
    assert f"acceleration up to {motion.max():.3g} m/s2" in raw
    assert motion.max() > 140.0
    assert "(unfiltered)" in raw
