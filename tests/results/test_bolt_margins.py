"""Margins of screws: tables and a worked calculation by VDI 2230-1, and what they take from histories.

The tables are the approximate values of Bossard for metric fine threads by VDI 2230, editions of 2001 and later, of
which preloads and torques are given to three or four digits. The calculation is an exercise of Hochschule Anhalt
(S. Voigt), a piston of a hydraulic cylinder on one screw M12, 10.9, with friction 0.10; its preload of 61 kN is that of
the edition of 1986. Pressure: VDI 2230-1, annex B, example 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from latin_fmu.latin.bolt_sections import ClampedFace, ScrewData, ShankSections
from latin_fmu.latin.outcome import BoltHistory, InterfaceHistory
from latin_fmu.results import bolt_results
from latin_fmu.results.bolt_margins import BoltMargin, BoltMargins, SectionStresses
from latin_fmu.results.bolt_results import safety_text
from latin_fmu.results.bolt_strength import (
    endurance,
    endurance_limit,
    permissible_preload,
    service_stress,
    stress_area,
    thread_torque,
)
from latin_fmu.scene.bolts import Bolt
from latin_fmu.scene.threads import class_minimum, thread_named

Array = np.ndarray
CLASSES = ("8.8", "10.9", "12.9")
PRELOADS = {  # kN, by friction 0.10, 0.12, 0.14 and class
    "M8x1": ((20.7, 30.4, 35.6), (20.2, 29.7, 34.7), (19.7, 28.9, 33.9)),
    "M10x1.25": ((32.4, 47.5, 55.6), (31.6, 46.4, 54.3), (30.8, 45.2, 52.9)),
    "M12x1.25": ((49.1, 72.1, 84.4), (48.0, 70.5, 82.5), (46.8, 68.7, 80.4)),
    "M14x1.5": ((66.4, 97.5, 114.1), (64.8, 95.2, 111.4), (63.2, 92.9, 108.7)),
    "M16x1.5": ((89.6, 131.6, 154.0), (87.6, 128.7, 150.6), (85.5, 125.5, 146.9)),
}
TORQUES = {  # N m, at 0.12, of class 8.8; bearing surfaces by ISO 4014 and ISO 273, mm
    "M8x1": (26.1, (9.0, 11.63)),
    "M10x1.25": (51.0, (11.0, 14.63)),
    "M12x1.25": (90.0, (13.5, 16.63)),
}


def screw(size: str, name: str = "10.9", **changes: Any) -> ScrewData:
    """A screw in N, mm and MPa."""
    thread = thread_named(size)
    assert thread is not None
    made = ScrewData(
        thread.pitch,
        thread.flank_diameter,
        thread.stress_diameter,
        class_minimum(name, thread.diameter),
        name,
        endurance_limit(thread.diameter),
        "before",
        0.1,
        None,
        None,
        None,
        None,
    )
    return replace(made, **changes)


# -- formulas ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("size", PRELOADS)
def test_assembly_preloads_are_those_of_the_table(size: str) -> None:
    """R7/2, 90 % of the yield stress: every one within 0.3 %; the table was rounded down, and on its way there, too."""
    for friction, row in zip((0.10, 0.12, 0.14), PRELOADS[size], strict=True):
        for name, told in zip(CLASSES, row, strict=True):
            data = screw(size, name)
            assert data.yield_stress is not None
            found = permissible_preload(data, data.yield_stress, friction) / 1e3
            assert found == pytest.approx(told, rel=3e-3)


@pytest.mark.parametrize("size", TORQUES)
def test_torques_of_the_table_give_their_preloads(size: str) -> None:
    """R13/1, in a scene in mm: the preload by the torque and the frictions."""
    torque, bearing = TORQUES[size]
    thread = thread_named(size)
    assert thread is not None
    bolt = Bolt(
        substructure="screw",
        torque=torque,
        diameter=thread.diameter,
        thread=size,  # type: ignore[arg-type]
        thread_friction=0.12,
        head_bearing=bearing,
    )
    preload = bolt.tension(1.0)
    assert preload is not None
    # the torque is rounded, by 0.05 or 0.5 N m
    rounding = 0.05 / 26.0 if size == "M8x1" else 0.5 / torque
    assert preload == pytest.approx(PRELOADS[size][1][0], rel=rounding + 0.002)


def test_nut_factor_means_a_friction() -> None:
    """The torque that a nut factor gives a preload by is that of R13/1 with the friction that it means."""
    plain = Bolt(substructure="s", torque=40.0, diameter=10.0, thread="M10", nut_factor=0.2)  # type: ignore[arg-type]
    friction = plain.friction_of_thread()
    assert friction == pytest.approx(0.15, abs=0.01)
    same = plain.model_copy(update={"nut_factor": None, "thread_friction": friction})
    assert same.tension(1.0) == pytest.approx(plain.tension(1.0), rel=1e-12)
    assert Bolt(substructure="s", force=1.0, thread="M10").friction_of_thread() is None  # type: ignore[arg-type]


def test_worked_calculation() -> None:
    """M_G, W_P, F_Smax, sigma_z, sigma_red,B, S_F and sigma_ASV of the exercise, each within its rounding."""
    m12 = screw("M12")
    torsion = thread_torque(m12, 61e3, 0.10)
    assert torsion == pytest.approx(55260.0, abs=5.1)
    assert math.pi / 16.0 * m12.stressed**3 == pytest.approx(218.0, abs=0.51)
    largest = 61e3 + 0.033 * 24900.0
    assert largest == pytest.approx(61800.0, abs=51.0)
    assert largest / stress_area(m12) == pytest.approx(733.0, abs=1.0)
    stress = service_stress(m12, largest, torsion)
    assert stress == pytest.approx(766.0, abs=0.51)
    assert endurance_limit(12.0) == pytest.approx(48.9, abs=0.051)
    assert class_minimum("10.9", 12.0) == 940.0


def test_endurance_of_threads_rolled_after_heat_treatment() -> None:
    """(2 - F_Sm / F_0.2min) sigma_ASV, within the range of the formula."""
    rolled = screw("M12", rolled="after")
    assert rolled.yield_stress is not None
    load = rolled.yield_stress * stress_area(rolled)
    assert endurance(rolled, 0.5 * load) == pytest.approx(1.5 * 48.875)
    assert endurance(rolled, 0.1 * load) == endurance(rolled, 0.3 * load)
    assert endurance(rolled, 1.5 * load) == pytest.approx(48.875)
    assert endurance(screw("M12"), 0.5 * load) == 48.875


# -- from histories ---------------------------------------------------------------------------------------------------
def history(force: Sequence[float], bending: Sequence[tuple[float, float]], **changes: Any) -> BoltHistory:
    """A bolt M12 with one section, N and N mm."""
    tension = np.asarray(force)
    sections = ShankSections(("cut",), np.array([0]), np.zeros((1, 3)), np.array([84.3]), np.eye(3))
    forces, moments = np.zeros((len(tension), 1, 3)), np.zeros((len(tension), 1, 3))
    forces[:, 0, 0], moments[:, 0, 1:] = tension, np.asarray(bending)
    made = BoltHistory(
        "b", "screw", 1, tension[0], 113.0, 0.01, tension, (1,), (float(tension[0]),), thread="M12",
        thread_area=stress_area(screw("M12")), sections=sections, section_force=forces, section_moment=moments,
        screw=screw("M12"),
    )  # fmt: skip
    return replace(made, **changes)


def face(normal: Sequence[float], shear: Sequence[float], friction: float = 0.2) -> InterfaceHistory:
    """Two points of 1 mm2 that carry a normal and a tangential force each, the second one of another bolt."""
    traction = np.zeros((len(normal), 2, 3))
    traction[:, 0, 2], traction[:, 0, 0] = -np.asarray(normal), shear
    traction[:, 1, 2] = -1e6
    n = np.tile([0.0, 0.0, 1.0], (2, 1))
    nothing = np.zeros((len(normal), 2))
    return InterfaceHistory(
        "lap", "contact", ("a.top", "b.bottom"), np.zeros((2, 3)), np.ones(2), n, np.zeros(2), friction, traction,
        np.zeros((len(normal), 2, 2, 3)), nothing, nothing.astype(np.int8), None,
    )  # fmt: skip


def test_clamp_force_and_slip_of_the_own_points() -> None:
    """R12: the smallest ratio of friction to shear, the smallest clamp force over that at the start."""
    bolt = history([1e3, 1e3, 1e3], [(0, 0)] * 3, clamped=(ClampedFace("lap", np.array([0]), 0.2),))
    margins = BoltMargins.of(bolt, {"lap": face([1000.0, 400.0, 800.0], [0.0, 50.0, 150.0])}).margins
    assert margins["slip"].safety == pytest.approx(0.2 * 800.0 / 150.0)
    assert margins["separation"].safety == pytest.approx(0.4)
    # the smallest friction of all faces that the bolt clamps
    both = replace(bolt, clamped=(*bolt.clamped, ClampedFace("other", np.array([0]), 0.1)))
    slip = BoltMargins.of(both, {"lap": face([1000.0, 400.0, 800.0], [0.0, 50.0, 150.0])}).margins["slip"]
    assert slip.safety == pytest.approx(0.1 * 800.0 / 150.0)
    alone = BoltMargins.of(replace(bolt, clamped=()), {})
    assert "slip" not in alone.margins
    assert any("no slip" in sentence for sentence in alone.missing)


def test_fatigue_takes_the_point_of_the_edge_with_the_largest_range() -> None:
    """A moment that turns by a right angle: half the range at the point where it comes and goes; a constant moment has
    none."""
    w = math.pi / 32.0 * screw("M12").stressed ** 3
    assert SectionStresses(history([1e4, 1e4], [(50 * w, 0), (50 * w, 0)])).amplitude(0) == pytest.approx(0.0, abs=1e-9)
    assert SectionStresses(history([1e4, 1e4], [(50 * w, 0), (-50 * w, 0)])).amplitude(0) == pytest.approx(50.0)
    turning = SectionStresses(history([1e4, 1e4], [(50 * w, 0), (0, 50 * w)])).amplitude(0)
    assert turning == pytest.approx(25.0 * math.sqrt(2.0), rel=1e-3)
    margins = BoltMargins.of(history([1e4, 2e4], [(0, 0), (0, 0)]), {}).margins
    amplitude = 0.5e4 / stress_area(screw("M12"))
    assert margins["fatigue"].safety == pytest.approx(48.875 / amplitude)


def test_yield_with_and_without_bending() -> None:
    """The largest force with half the torsion of assembly; the edge of the section adds its bending."""
    w = math.pi / 32.0 * screw("M12").stressed ** 3
    margins = BoltMargins.of(history([61e3, 61821.7], [(0, 0), (0, 100 * w)]), {}).margins
    assert 940.0 / margins["service_yield"].safety == pytest.approx(766.0, abs=0.51)
    bent = service_stress(screw("M12"), 61821.7, thread_torque(screw("M12"), 61e3, 0.1), 100.0)
    assert margins["edge_yield"].safety == pytest.approx(940.0 / bent)
    assert margins["assembly_yield"].limit == pytest.approx(permissible_preload(screw("M12"), 940.0, 0.1))
    unknown = BoltMargins.of(history([1e3], [(0, 0)], screw=screw("M12", yield_stress=None)), {})
    assert "service_yield" not in unknown.margins
    assert any("property_class" in sentence for sentence in unknown.missing)


def test_pressure_under_head_and_nut() -> None:
    """R10 of example 3: 140.3 kN on 36 mm over a hole of 29 mm make 393 MPa; without a permissible one no safety."""
    area = 0.25 * math.pi * (36.0**2 - 29.0**2)
    assert area == pytest.approx(357.4, abs=0.1)
    data = screw("M12", head=area, permissible_pressure=900.0)
    margins = BoltMargins.of(history([140.3e3], [(0, 0)], screw=data), {}).margins
    assert margins["pressure_head"].value == pytest.approx(392.6, abs=0.1)
    assert margins["pressure_head"].safety == pytest.approx(900.0 / 392.6, rel=1e-3)
    plain = BoltMargins.of(history([140.3e3], [(0, 0)], screw=replace(data, permissible_pressure=None)), {})
    assert math.isnan(plain.margins["pressure_head"].safety)


def test_safeties_are_printed_with_three_digits() -> None:
    """Nearly all of a clamp force is 100 %, not a power of ten."""
    assert safety_text("separation", 0.9996) == "100 %"
    assert safety_text("separation", 0.8512) == "85.1 %"
    assert safety_text("slip", 0.97912) == "0.979"
    assert safety_text("slip", math.nan) == "-"


def test_safeties_below_one_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for shares, which are below 1 as a rule."""
    margins = {
        check: BoltMargin(check, 1.0, safety, safety)
        for check, safety in (("service_yield", 2.42), ("edge_yield", 0.9791), ("separation", 0.85))
    }
    monkeypatch.setattr(bolt_results, "_margins", lambda _: {"m6": SimpleNamespace(margins=margins, missing=[])})
    outcome = SimpleNamespace(bolts={"m6": SimpleNamespace(sections=None)})
    below = [line for line in bolt_results.margin_lines(outcome) if "below" in line]  # type: ignore[arg-type]
    assert below == ["  below 1: m6, R8/5-2 and bending: 0.979"]
