"""Bodies that land, with the default scheme: contact force, its limit under refinement, energy.

Unit bars (E, rho, length, nu = 0) of section 0.1 x 0.1 thrown at a wall or at each other with velocity 1: exact force
rho c v per area from the first contact to 2 L / c (equal bars: the same). The Courant number c dt / h is that of the
finer mesh, the phase the share of a step after which the faces touch.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import march
from latin_fmu.effects.explanation import explain
from latin_fmu.stability.scenes import Box, Material, placed

Array = np.ndarray
COURANT = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0)
PHASES = (0.02, 0.2, 0.4, 0.6, 0.9)
NO_DAMPING = {"type": "generalized_alpha", "landing_damping": 0.0}
GRAVITY = 0.3


@dataclass(frozen=True)
class Bars:
    """A bar thrown at a wall, or at a second bar of ``other`` elements, Young's modulus and density."""

    elements: int = 20
    courant: float = 0.5
    phase: float = 0.4
    nu: float = 0.0
    section: int = 2
    other: tuple[int, float, float] | None = None
    end: float = 2.6
    scheme: Any = None
    cell: str = "box"
    keys: tuple[tuple[str, Any], ...] = ()

    @property
    def step(self) -> float:
        """Time step for the finer mesh; wave speed 1 in both bars."""
        return self.courant / max(self.elements, 0 if self.other is None else self.other[0])

    def scene(self) -> dict[str, Any]:
        """Nested tables of the scene."""
        speeds = 1.0 if self.other is None else 2.0
        gap, n = speeds * self.phase * self.step, self.section

        def bar(elements: int, speed: float, material: Material, **keys: Any) -> Box:
            return Box(material, (0.1, 0.1, 1.0), (n, n, elements), (0.0, 0.0, speed), keys)

        unit = Material(poisson=self.nu, name="unit")
        bodies = {"bar": (bar(self.elements, -1.0, unit, **dict(self.keys)), (0.0, 0.0, gap))}
        if self.other is not None:
            elements, young, density = self.other
            bodies["low"] = (bar(elements, 1.0, Material(young, density, self.nu, "second")), (0.0, 0.0, -1.0))
        opposite = "ground" if self.other is None else "low.zmax"
        tables = placed(
            bodies,
            {"end": round(self.end / self.step) * self.step, "step": self.step},
            interface={"meet": {"sides": ["bar.zmin", opposite], "gap": gap}},
            output={"energy": True},
        )
        if self.scheme is not None:
            tables["time"]["scheme"] = self.scheme
        return tables


@dataclass(frozen=True)
class Landing:
    """Force over rho c v and the section at the times since the first contact; energies."""

    time: Array
    force: Array
    energy: dict[str, Array]

    def exact(self) -> Array:
        """Mean of the exact force over the step that ends at each instant."""
        step = self.time[1] - self.time[0]
        return np.clip((np.minimum(self.time, 2.0) - np.maximum(self.time - step, 0.0)) / step, 0.0, 1.0)

    def error(self) -> float:
        """L2 error of the force history."""
        exact = self.exact()
        return float(np.linalg.norm(self.force - exact) / np.linalg.norm(exact))

    def mean_peak(self, duration: float) -> float:
        """Largest mean of the force over a duration."""
        n = max(1, round(duration / (self.time[1] - self.time[0])))
        return float(np.convolve(self.force, np.ones(n) / n).max())


def landed(bars: Bars) -> Landing:
    """Solve; the energy balance closes."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(bars.scene()))
    assert solution.converged, solution.status
    energy = solution.energy
    assert energy is not None
    largest = max(float(np.abs(term).max()) for name, term in energy.items() if name != "balance")
    assert np.abs(energy["balance"]).max() <= 1e-10 * largest
    force = solution.interfaces["meet"].normal_resultant() / 0.01
    return Landing(solution.time - bars.phase * bars.step, force, energy)


def mean_error(elements: int, courant: float, phases: tuple[float, ...] = (0.1, 0.4, 0.9), section: int = 2) -> float:
    """L2 error, mean of landing phases."""
    return float(np.mean([landed(Bars(elements, courant, p, section=section)).error() for p in phases]))


@pytest.mark.parametrize(("courant", "phase"), [(0.1, 0.4), (0.5, 0.9), (1.0, 0.02), (4.0, 0.6)])
@pytest.mark.parametrize("other", [None, (20, 1.0, 1.0)], ids=["wall", "bar"])
def test_no_force_beyond_the_plateau(courant: float, phase: float, other: Any) -> None:
    """HHT: up to 5.3."""
    assert landed(Bars(20, courant, phase, other=other)).force.max() <= 1.10


@pytest.mark.slow
@pytest.mark.parametrize("elements", [20, 40])
@pytest.mark.parametrize("other", [False, True], ids=["wall", "bar"])
@pytest.mark.parametrize("nu", [0.0, 0.25])
def test_no_force_beyond_the_plateau_at_any_step_and_phase(elements: int, other: bool, nu: float) -> None:
    """With nu = 0.25 the exact force starts at rho c_p v = 1.095 of the bar's."""
    second = (elements, 1.0, 1.0) if other else None
    peaks = {
        (c, p): float(landed(Bars(elements, c, p, nu, 2, second, end=2.3)).force.max()) for c in COURANT for p in PHASES
    }
    assert max(peaks.values()) <= (1.15 if nu else 1.10), peaks


@pytest.mark.parametrize(
    ("courant", "other"), [(0.2, (10, 1.0, 1.0)), (1.0, (20, 10.0, 10.0)), (0.5, (20, 100.0, 100.0))]
)
def test_unequal_bars_stay_in_contact(courant: float, other: Any) -> None:
    """Mesh 4 : 1, impedance contrast 10 and 100; plateau 2 Z / (1 + Z), until the first reflection."""
    _contrast(40 if other[0] == 10 else 20, courant, other)


@pytest.mark.slow
@pytest.mark.parametrize("courant", COURANT[:-1])
@pytest.mark.parametrize("other", [(10, 1.0, 1.0), (40, 10.0, 10.0), (40, 100.0, 100.0)])
def test_unequal_bars_at_any_step(courant: float, other: Any) -> None:
    for phase in (0.02, 0.4, 0.9):
        _contrast(40, courant, other, phase)


def _contrast(elements: int, courant: float, other: Any, phase: float = 0.4) -> None:
    impedance = float(np.sqrt(other[1] * other[2]))
    bars = Bars(elements, courant, phase, other=other, end=1.9)
    found = landed(bars)
    force = found.force / (2 * impedance / (1 + impedance))
    assert force.max() <= 1.12
    inside = (found.time > 2 * bars.step) & (found.time < 1.8)
    assert force[inside].min() > 0.0  # no loss of contact


@pytest.mark.slow
@pytest.mark.parametrize(("elements", "limit"), [(20, 0.125), (40, 0.09), (80, 0.07)])
def test_error_of_the_force_history(elements: int, limit: float) -> None:
    """L2, mean of phases; halving the step alone adds at most 5 %."""
    errors = [mean_error(elements, c, section=1) for c in (1.0, 0.5, 0.25, 0.125, 0.0625)]
    assert max(errors) <= limit, errors
    assert all(finer <= 1.05 * coarser for coarser, finer in pairwise(errors)), errors


def test_error_of_the_force_history_falls_with_mesh_and_step() -> None:
    """Order at Courant number 1: 0.3 at least (third-order dispersion of the front after 2 L / c allows 1/3)."""
    errors = [mean_error(n, 1.0, section=1) for n in (20, 40, 80)]
    assert errors[0] <= 0.125
    assert np.log2(errors[0] / errors[2]) / 2 >= 0.30, errors


@pytest.mark.slow
def test_order_at_a_small_step() -> None:
    errors = [mean_error(n, 0.1, section=1) for n in (20, 40, 80)]
    assert np.log2(errors[0] / errors[2]) / 2 >= 0.40, errors


@pytest.mark.slow
def test_mean_of_the_force_over_a_fixed_time_converges() -> None:
    """0.1 L/c; the raw peak does not (Gibbs)."""
    for elements, limit in ((40, 1.07), (160, 1.02)):
        for courant in (0.2, 1.0):
            assert landed(Bars(elements, courant, section=1)).mean_peak(0.1) <= limit


def bouncing(elements: int, courant: float, bounces: float, scheme: Any = None) -> tuple[Array, float]:
    """Energy above that of the bar at rest on the ground, over that at t = 0, of a bar that bounces under gravity on a
    wall; and the energy at t = 0."""
    height, keys = 0.15, (("body_force", [0.0, 0.0, -GRAVITY]), ("initial_velocity", [0.0, 0.0, 0.0]))
    period = 2 * np.sqrt(2 * height / GRAVITY) + 2.0
    tables = Bars(elements, courant, 0.0, section=1, end=bounces * period, scheme=scheme, keys=keys).scene()
    tables["interface"]["meet"]["gap"] = height
    tables["substructure"]["bar"]["box"]["origin"][2] = height
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    energy = solution.energy
    assert energy is not None
    assert solution.converged, solution.status
    start = 0.01 * GRAVITY * height
    return (energy["kinetic"] + energy["elastic"] - energy["work_of_loads"]) / start + 1.0, start


@pytest.mark.parametrize("courant", [0.5, 30.0])
def test_a_bouncing_bar_never_gains_energy(courant: float) -> None:
    """massless_contact: 89 times its energy at Courant number 30."""
    energy, _ = bouncing(20, courant, 5.0)
    assert energy.max() <= 1.0 + 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("courant", [0.1, 1.0, 10.0, 30.0, 100.0])
@pytest.mark.parametrize("scheme", [None, NO_DAMPING], ids=["default", "undamped"])
def test_a_bouncing_bar_never_gains_energy_in_twenty_periods(courant: float, scheme: Any) -> None:
    energy, _ = bouncing(20, courant, 20.0, scheme)
    assert energy.max() <= 1.0 + 1e-4


@pytest.mark.slow
def test_energy_kept_over_four_bounces() -> None:
    """Without viscosity 99.5 %; with it at most 1.35 h/L lost per impact up to Courant number 1, 2.6 at 4."""
    energy, _ = bouncing(40, 0.1, 4.0, NO_DAMPING)
    assert energy[-1] >= 0.995
    for courant, limit in ((0.1, 1.35), (1.0, 1.35), (4.0, 2.6)):
        energy = landed(Bars(40, courant, section=1)).energy
        stored = energy["kinetic"] + energy["elastic"]
        assert 1.0 - stored[-1] / stored[0] <= limit / 40


def test_energy_of_the_contact_layer_is_a_term_of_its_own() -> None:
    energy = landed(Bars(20, 0.5)).energy
    assert energy["landing_dissipation"][-1] > 0.01 * energy["kinetic"][0]
    assert (np.diff(energy["landing_dissipation"]) >= -1e-6 * energy["kinetic"][0]).all()
    assert energy["damping_dissipation"].max() == 0.0
    assert landed(Bars(20, 0.5, scheme=NO_DAMPING)).energy["landing_dissipation"].max() == 0.0


@pytest.mark.parametrize("scheme", ["generalized_alpha", "massless_contact", "hht", "newmark"])
def test_balance_closes_with_a_body_force_on_a_body_in_contact(scheme: str) -> None:
    """From the first step on, loads on contact nodes and dampers included."""
    tables = Bars(6, 0.5, 0.0, nu=0.25, scheme=scheme, keys=(("body_force", [0.1, 0.0, -1.0]),), end=1.0).scene()
    tables["interface"]["meet"] |= {"gap": 0.0, "friction_coefficient": 0.3}
    tables["substructure"]["bar"]["initial_velocity"] = [0.0, 0.0, 0.0]
    tables["material"]["unit"] |= {"frame": "absolute", "rayleigh_mass": 0.1, "rayleigh_stiffness": 0.01}
    tables["load"] = {"side": {"face": "bar.xmin", "pressure": 0.2, "law": "constant"}}
    tables["solver"] = {"tolerance": 1e-8}
    energy = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).energy
    assert energy is not None
    largest = max(float(np.abs(term).max()) for name, term in energy.items() if name != "balance")
    assert np.abs(energy["balance"]).max() <= 1e-10 * largest


@pytest.mark.parametrize("cut", ["along", "across"])
def test_a_cut_bar_lands_like_a_whole_one(cut: str) -> None:
    """Oblique, with friction: perfect interfaces along and across the bar change nothing."""
    gap = 0.01

    def part(size: tuple[float, float, float], elements: tuple[int, int, int]) -> Box:
        return Box(Material(poisson=0.25), size, elements, (0.3, 0.0, -1.0))

    def force(parts: dict[str, tuple[Box, tuple[float, float, float]]], bond: list[str] | None) -> Array:
        contact = {"gap": gap, "friction_coefficient": 0.3}
        lowest = [name for name, (_, origin) in parts.items() if origin[2] == gap]
        interfaces = {name: contact | {"sides": [f"{name}.zmin", "ground"]} for name in lowest}
        if bond is not None:
            interfaces["bond"] = {"sides": bond, "behaviour": "perfect"}
        time = {"end": 1.2, "instants": 30, "scheme": "generalized_alpha"}
        solver = {"tolerance": 1e-8, "max_iterations": 400}
        tables = placed(parts, time, interface=interfaces, solver=solver)
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
        return np.sum([solution.interfaces[name].force() for name in lowest], axis=0)

    whole = force({"a": (part((0.2, 0.1, 1.0), (4, 2, 10)), (0.0, 0.0, gap))}, None)
    if cut == "along":
        half = part((0.1, 0.1, 1.0), (2, 2, 10))
        parts = force({"a": (half, (0.0, 0.0, gap)), "b": (half, (0.1, 0.0, gap))}, ["a.xmax", "b.xmin"])
    else:
        half = part((0.2, 0.1, 0.5), (4, 2, 5))
        parts = force({"a": (half, (0.0, 0.0, gap)), "b": (half, (0.0, 0.0, gap + 0.5))}, ["a.zmax", "b.zmin"])
    assert np.abs(parts - whole).max() <= 1e-6 * np.abs(whole).max()


def test_a_run_that_gains_energy_is_not_called_converged() -> None:
    """massless_contact at Courant number 30, where the iteration converges at every instant."""
    keys = (("body_force", [0.0, 0.0, -GRAVITY]),)
    tables = Bars(20, 30.0, 0.1, section=1, end=200.0, scheme="massless_contact", keys=keys).scene()
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert not solution.converged
    assert "gains energy" in solution.status
    assert any("massless_contact at Courant number 30" in warning for warning in solution.warnings)


@pytest.mark.parametrize(
    ("scheme", "courant", "words"),
    [
        ("newmark", 1.0, "gains energy"),
        ("hht", 0.2, "grows without limit"),
        ("hht", 1.0, None),
        ("massless_contact", 2.0, "stable up to 1"),
        ("massless_contact", 0.5, None),
        ("generalized_alpha", 0.2, None),
        (None, 0.2, None),
    ],
)
def test_unfit_schemes_are_told_when_chosen(scheme: str | None, courant: float, words: str | None) -> None:
    lines = latin_fmu.check(latin_fmu.scene_from_dict(Bars(20, courant, scheme=scheme).scene()))
    remarks = [line for line in lines if "time.scheme" in line]
    assert bool(remarks) == (words is not None)
    assert words is None or words in remarks[0]


@pytest.mark.parametrize(
    ("elements", "keys", "propagator", "first"),
    [
        (20, (), "direct", ""),
        (3, (), "direct", "refine the mesh of substructure bar, 33 % of whose elements touch a face that may open"),
        (20, (), "reduced", 'choose solver.propagator = "direct", and then'),
    ],
)
@pytest.mark.parametrize("scheme", [None, "hht", {"type": "newmark", "beta": 0.3025, "gamma": 0.6}])
def test_there_is_one_advice_on_the_scheme(
    elements: int, keys: tuple[tuple[str, Any], ...], propagator: str, first: str, scheme: Any
) -> None:
    """The automatic choice and the remark agree: what the choice found in the way of generalized_alpha comes first."""
    tables = Bars(elements, 0.2, scheme=scheme, keys=keys).scene() | {"solver": {"propagator": propagator}}
    told = explain(latin_fmu.scene_from_dict(tables))
    remarks = [str(remark) for remark in told.warnings if remark.code == "scheme"]
    if scheme is None and not first:
        assert not remarks  # it is chosen
        return
    assert len(remarks) == 1
    assert first in remarks[0]
    assert remarks[0].endswith('choose time.scheme = "generalized_alpha" (--set time.scheme=generalized_alpha)')


def test_the_advice_without_landings_is_the_automatic_choice() -> None:
    gains = {"type": "newmark", "beta": 0.25, "gamma": 0.5}
    told = explain(latin_fmu.scene_from_dict(slammed(0.2, 1.0, gains)))
    (text,) = [str(remark) for remark in told.warnings if remark.code == "scheme"]
    assert text.endswith('gains energy at contacts that open and close: choose time.scheme = "hht"')


def slammed(courant: float, pulled: float, scheme: Any = None) -> dict[str, Any]:
    """Two bars that touch and are at rest: one is pulled off the other, which is held, and pushed back."""
    tables = Bars(10, courant, phase=0.0, section=1, other=(10, 1.0, 1.0), end=12.0, scheme=scheme).scene()
    for body in tables["substructure"].values():
        body["initial_velocity"] = [0.0, 0.0, 0.0]
    law = {"type": "table", "times": [0.0, 1.5, 3.0, 4.5, 6.0, 20.0], "values": [0.0, -pulled, 0.0, 1.0, 1.0, 1.0]}
    tables["load"] = {"move": {"face": "bar.zmax", "pressure": 1e-3, "law": law}}
    tables["boundary"] = {"hold": {"type": "fixed", "face": "low.zmin"}}
    return tables


@pytest.mark.parametrize(
    ("courant", "pulled", "scheme", "told"),
    [
        (0.2, 1.0, None, True),
        (0.2, 1.0, "hht", True),
        (0.2, 1.0, "generalized_alpha", False),
        (1.0, 1.0, None, False),  # steps that are long for the elements resolve the force
        (0.2, 0.0, None, False),  # nothing opens
    ],
)
def test_a_face_that_slams_shut_is_told_after_the_run(courant: float, pulled: float, scheme: Any, told: bool) -> None:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(slammed(courant, pulled, scheme)))
    assert solution.converged
    remarks = [str(w) for w in solution.warnings if w.code == "scheme"]
    assert bool(remarks) == told
    if told:
        assert "interface meet closes by an impact at " in remarks[0]
        assert "(100 % of it at " in remarks[0]
        assert "--set time.scheme=generalized_alpha" in remarks[0]
        assert ("chosen before the run because no body lands" in remarks[0]) == (scheme is None)


@pytest.mark.parametrize("rigid", [False, True])
def test_an_impact_is_told_of_thinned_histories_and_on_a_rigid_body(
    rigid: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """At the same instant, to the step in which they are kept; a rigid body that is held has no impedance."""
    tables = slammed(0.2, 1.0)
    tables["substructure"]["low"]["rigid"] = rigid
    tables["output"] = {}
    told = []
    for stream in (None, tmp_path):
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables), stream=stream)
        (text,) = [str(w) for w in solution.warnings if w.code == "scheme"]
        found = re.search(r"closes by an impact at (\S+) s \(100 % of it", text)
        assert found is not None, text
        told.append(float(found[1]))
        monkeypatch.setattr(march, "STREAMED", 0.0)
        monkeypatch.setattr(march, "IN_MEMORY", 60)
    assert solution.outcome.stream is not None
    solution.outcome.stream.close()
    assert solution.outcome.interfaces_every == 11
    assert told[1] == pytest.approx(told[0], abs=11 * tables["time"]["step"])


def test_the_scheme_is_chosen_by_the_bodies() -> None:
    def chosen(tables: dict[str, Any]) -> str:
        return explain(latin_fmu.scene_from_dict(tables)).choices["propagator"]

    assert "generalized_alpha (bodies land: meet)" in chosen(Bars(20).scene())
    assert "hht (substructure bar is thin" in chosen(Bars(3).scene())
    assert "hht (substructure bar is rigid)" in chosen(Bars(20, other=(20, 1.0, 1.0), keys=(("rigid", True),)).scene())
    closed = Bars(20, phase=0.0, other=(20, 1.0, 1.0), keys=(("initial_velocity", [0.0, 0.0, 0.0]),)).scene()
    assert "generalized_alpha" in chosen(closed)  # the lower bar moves up
    closed["substructure"]["low"]["initial_velocity"] = [0.0, 0.0, -1.0]
    assert "hht (no body lands" in chosen(closed)
    reduced = Bars(20).scene() | {"solver": {"propagator": "reduced"}}
    assert "hht (reduced bodies" in chosen(reduced)
