"""Frequency responses: closed forms, reciprocity, a direct harmonic solution of all dofs, a base that shakes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg as spla

import latin_fmu
from latin_fmu.building import without_scheme
from latin_fmu.cli import main
from latin_fmu.joined.joined_assembly import JoinedAssembly
from latin_fmu.modal import frequency_response
from latin_fmu.stability.scenes import Box, Material, column, placed
from tests.scenes import MODELS

E, RHO, RATIO = 210e9, 7800.0, 0.02
STEEL = Material(E, RHO, 0.3, name="steel")


def lap(time: dict[str, Any] | None = None, **keys: float) -> dict[str, Any]:
    """Two boxes that overlap by their faces, pressed together by friction that holds; the lower one is held at one end.
    ``keys`` : of the material."""
    steel = Material(E, RHO, 0.3, name="steel", keys=keys)
    box = Box(steel, (0.08, 0.02, 0.01), (8, 2, 2), keys={"bending_modes": True})
    tables: dict[str, Any] = {
        "interface": {"lap": {"sides": ["low.zmax", "up.zmin"], "friction_coefficient": 10.0, "preload": 1e8}},
        "boundary": {"held": {"type": "fixed", "face": "low.xmin"}},
        "sensor": {"root": {"point": [0.03, 0.01, 0.0], "substructure": "low"}, "tip": {"face": "up.xmax"}},
        "load": {"push": {"face": "up.zmax", "pressure": 3e5}},
    }
    bodies = {"low": (box, (0.0, 0.0, 0.0)), "up": (box, (0.04, 0.0, 0.01))}
    return placed(bodies, time or {"end": 1e-3, "instants": 10}, **tables)


def read(data: dict[str, Any]) -> latin_fmu.Scene:
    return latin_fmu.scene_from_dict(data)


def oscillator(held: bool, **joint: float) -> latin_fmu.Scene:
    """A rigid block above the ground, or above another block, on a layer."""
    block = Box(Material(E, RHO, 0.3), (1.0, 0.8, 0.5), (1, 1, 1), keys={"rigid": True})
    bodies = {"up": block} if held else {"low": block, "up": block}
    layer = {"behaviour": "elastic_layer", "normal_stiffness": 1e9, "tangential_stiffness": 2e9}
    data = column(bodies, {} if held else {"joint": layer}, {"end": 1e-3, "instants": 10})
    if held:
        data["interface"]["joint"] = {"sides": ["up.zmin", "ground"], **layer}
    if joint:
        sides = data["interface"]["joint"]["sides"]
        data["interface"]["dashpot"] = {"sides": sides, "behaviour": "viscous_joint", **joint}
    data["sensor"] = {name: {"face": f"{name}.zmax"} for name in bodies}
    return read(data)


@pytest.mark.parametrize("dashpot", [False, True], ids=["ratio", "dashpot"])
def test_an_oscillator_on_a_base(dashpot: bool) -> None:
    """T = (k + i w c) / (k - m w^2 + i w c) along z with a dashpot, 1 + w^2 / (w_0^2 - w^2 + 2 i zeta w_0 w) in any
    case; receptance 1 / (k - m w^2 + i w c)."""
    k, m = 1e9 * 0.8, RHO * 0.4
    own = np.sqrt(k / m)
    c = 2 * RATIO * np.sqrt(k * m)
    keys = {"normal_viscosity": c / 0.8, "tangential_viscosity": 0.0} if dashpot else {}
    frequency = own / (2 * np.pi) * np.array([0.1, 0.7, 1.0, 1.4, 5.0])
    w, damping = 2 * np.pi * frequency, None if dashpot else RATIO
    made = latin_fmu.frf(
        oscillator(True, **keys), ["base.z", "up.z"], frequency, damping=damping, kind="receptance", joints="bonded"
    )
    dynamic = k - m * w**2 + 1j * w * c
    assert made.response["base.z"]["up"][:, 2] == pytest.approx((k + 1j * w * c) / dynamic, rel=1e-9)
    assert made.response["up.z"]["up"][:, 2] == pytest.approx(1 / dynamic, rel=1e-9)
    assert np.abs(made.response["base.z"]["up"][:, :2]).max() < 1e-9


@pytest.mark.parametrize(("kind", "power"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
def test_two_free_masses(kind: Any, power: int) -> None:
    """Receptance of two masses on a layer: -1 / (2 m w^2) +- 1 / (2 (2 k - m w^2 + 2 i zeta w sqrt(2 k m)))."""
    k, m = 1e9 * 0.8, RHO * 0.4
    w = np.sqrt(2 * k / m) * np.array([0.2, 1.0, 3.0])
    made = latin_fmu.frf(oscillator(False), ["up.z"], w / (2 * np.pi), damping=RATIO, kind=kind)
    rigid, elastic = -1 / (2 * m * w**2), 1 / (2 * (2 * k - m * w**2 + 2j * RATIO * w * np.sqrt(2 * k * m)))
    rate = (1j * w) ** power
    assert made.response["up.z"]["up"][:, 2] == pytest.approx(rate * (rigid + elastic), rel=1e-9)
    assert made.response["up.z"]["low"][:, 2] == pytest.approx(rate * (rigid - elastic), rel=1e-9)


def test_ratios_of_single_modes() -> None:
    """A peak is in inverse proportion to the ratio of its own mode: four times the damping in the second mode that
    bends along z leaves the others, and a quarter of its peak."""
    natural = latin_fmu.vibration_modes(read(lap()), count=8)
    bends = np.flatnonzero(natural.effective_mass[:, 2] > 0.05 * natural.mass)
    ratios = np.full(8, 0.001)
    ratios[bends[1]] = 0.004
    at = natural.frequency[bends[:2]]
    peaks = [
        np.abs(latin_fmu.frf(read(lap()), ["base.z"], at, damping=given).response["base.z"]["tip"][:, 2])
        for given in (0.001, ratios.tolist())
    ]
    assert peaks[0] / peaks[1] == pytest.approx([1.0, 4.0], rel=0.01)


def test_modal_damping_of_a_body_is_that_of_its_modes() -> None:
    """One body: the ratio of the scene is that of ``modes``, and of a response to a given ratio."""
    data = lap()
    del data["substructure"]["up"], data["sensor"]["tip"]
    data |= {"interface": {}, "load": {}}
    data["substructure"]["low"]["modal_damping"] = {"ratio": RATIO, "below": 1e6}
    damping = latin_fmu.vibration_modes(read(data), count=5).damping
    assert damping is not None
    assert damping.bodies == pytest.approx(RATIO, rel=1e-9)
    own, given = (latin_fmu.frf(read(data), ["base.z"], damping=ratio, points=50) for ratio in (None, RATIO))
    assert own.response["base.z"]["root"] == pytest.approx(given.response["base.z"]["root"], rel=1e-4, abs=1e-4)
    data["substructure"]["low"]["modal_damping"] = {"ratio": RATIO}
    data["solver"] = {"propagator": "reduced"}
    with pytest.raises(latin_fmu.InputError, match="without a limit is that of a reduced basis"):
        latin_fmu.frf(read(data), ["base.z"])


def test_reciprocity() -> None:
    """Receptance at B under a force at A is that at A under a force at B; a load of pressure is a force on its face."""
    made = latin_fmu.frf(read(lap()), ["tip.z", "root.x", "push"], damping=RATIO, kind="receptance", points=50)
    there, back = made.response["tip.z"]["root"][:, 0], made.response["root.x"]["tip"][:, 2]
    assert there == pytest.approx(back, rel=1e-9, abs=1e-12 * np.abs(there).max())
    assert np.abs(there).max() > 1e-9
    # the pressure pushes downwards
    slow = [made.response[drive]["tip"][0, 2].real for drive in ("push", "tip.z")]
    assert -1.0 < slow[0] / slow[1] < -0.1


def on_a_plate(**tables: Any) -> dict[str, Any]:
    """A rigid block on a layer above a rigid plate that is held, and what joins the block to the ground."""
    block = Box(Material(E, RHO, 0.3), (1.0, 0.8, 0.5), (1, 1, 1), keys={"rigid": True})
    layer = {"behaviour": "elastic_layer", "normal_stiffness": 1e9, "tangential_stiffness": 2e9}
    data = column({"low": block, "up": block}, {"joint": layer}, {"end": 1e-3, "instants": 10})
    data["boundary"] = {"held": {"type": "fixed", "face": "low.zmin"}}
    data["interface"] |= tables.pop("interface", {})
    data["sensor"] = {"up": {"face": "up.zmax"}}
    return data | tables


@pytest.mark.parametrize("way", ["spring", "dashpot", "interface"])
def test_springs_and_dashpots_to_a_ground_at_rest(way: str) -> None:
    """T = k / (k + k_g - m w^2 + i w c_g): what leads to the ground is moved by the block alone, whatever the base
    does."""
    k, m, k_g, c_g = 1e9 * 0.8, RHO * 0.4, 3e8, 2e5
    if way == "interface":
        layer = {"behaviour": "elastic_layer", "normal_stiffness": k_g / 0.8, "tangential_stiffness": 0.0}
        damper = {"behaviour": "viscous_joint", "normal_viscosity": c_g / 0.8, "tangential_viscosity": 0.0}
        sides = {"sides": ["up.zmax", "ground"]}
        scene = on_a_plate(interface={"layer": {**layer, **sides}, "damper": {**damper, **sides}})
    else:
        k_g = k_g if way == "spring" else 0.0
        stiffness = {"stiffness": k_g} if k_g else {}
        link = {"ends": ["up.zmax", "ground"], "direction": [0.0, 0.0, 1.0], "viscosity": c_g, **stiffness}
        scene = on_a_plate(spring={"link": link})
    frequency = np.sqrt((k + k_g) / m) / (2 * np.pi) * np.array([0.1, 0.7, 1.0, 1.4, 5.0])
    w = 2 * np.pi * frequency
    made = latin_fmu.frf(read(scene), ["base.z", "up.z"], frequency, kind="receptance")
    dynamic = k + k_g - m * w**2 + 1j * w * c_g
    assert made.response["base.z"]["up"][:, 2] == pytest.approx(k / dynamic, rel=1e-9)
    assert made.response["up.z"]["up"][:, 2] == pytest.approx(1 / dynamic, rel=1e-9)


def test_a_dashpot_to_ground_in_a_run() -> None:
    """The same block in a run whose plate is driven, when it has rung down: one definition of the ground."""
    k, m, c_g = 1e9 * 0.8, RHO * 0.4, 2e5
    own = np.sqrt(k / m)
    steps, periods = 200, 40
    link = {"ends": ["up.zmax", "ground"], "direction": [0.0, 0.0, 1.0], "viscosity": c_g, "stiffness": 1e8}
    scene = on_a_plate(spring={"link": link})
    w = 0.8 * own
    time = np.linspace(0.0, periods * 2 * np.pi / w, periods * steps + 1)
    history = np.sin(w * time) * np.minimum(time / time[-1] * 4.0, 1.0)
    law = {"type": "table", "times": time.tolist(), "values": history.tolist()}
    push = {"type": "acceleration", "face": "low.zmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 1.0]}
    scene["boundary"] = {"held": {**push, "law": law}}
    scene["time"] = {"end": float(time[-1]), "instants": len(time) - 1, "scheme": "newmark"}
    solution = latin_fmu.solve(read(scene))
    assert solution.converged
    last = slice(-4 * steps - 1, -1)
    carrier = np.exp(-1j * w * time[last])
    up = solution.sensors["up"].acceleration
    assert up is not None
    measured = (carrier @ up[last, 2]) / (carrier @ history[last])
    expected = latin_fmu.frf(read(scene), ["base.z"], [w / (2 * np.pi)]).response["base.z"]["up"][0, 2]
    assert abs(measured / expected - 1.0) < 5e-3


def test_an_absorbing_face_looks_at_a_medium_at_rest() -> None:
    """A bar whose end absorbs: the wave from its base arrives with its delay and never comes back,
    T = exp(-i w L / c)."""
    side, length = 0.1, 1.0
    bar = Box(Material(E, RHO, 0.0), (side, side, length), (1, 1, 60))
    data = column({"bar": bar}, {}, {"end": 1e-3, "instants": 10})
    faces = ("xmin", "xmax", "ymin", "ymax")
    data["boundary"] = {face: {"type": "symmetry", "face": f"bar.{face}"} for face in faces}
    data["boundary"] |= {
        "base": {"type": "fixed", "face": "bar.zmin"},
        "end": {"type": "absorbing", "face": "bar.zmax"},
    }
    data["sensor"] = {"top": {"face": "bar.zmax"}}
    c = np.sqrt(E / RHO)
    frequency = c / length * np.array([0.05, 0.25, 0.6, 1.0])
    made = latin_fmu.frf(read(data), ["base.z"], frequency)
    delay = np.exp(-2j * np.pi * frequency * length / c)
    assert made.response["base.z"]["top"][:, 2] == pytest.approx(delay, abs=5e-3)


def test_damping_by_the_mass_is_that_of_a_medium_at_rest() -> None:
    """A bar with Rayleigh's part of the mass, as in a run: T = 1 / cos(q L) at its end, q^2 = (w^2 - i w a) / c^2."""
    side, length, rate = 0.1, 1.0, 3000.0
    bar = Box(
        Material(E, RHO, 0.0, keys={"frame": "absolute", "rayleigh_mass": rate}), (side, side, length), (1, 1, 60)
    )
    data = column({"bar": bar}, {}, {"end": 1e-3, "instants": 10})
    faces = ("xmin", "xmax", "ymin", "ymax")
    data["boundary"] = {face: {"type": "symmetry", "face": f"bar.{face}"} for face in faces}
    data["boundary"]["base"] = {"type": "fixed", "face": "bar.zmin"}
    data["sensor"] = {"top": {"face": "bar.zmax"}}
    c = np.sqrt(E / RHO)
    frequency = c / length * np.array([0.05, 0.2, 0.3, 0.6])
    w = 2 * np.pi * frequency
    made = latin_fmu.frf(read(data), ["base.z"], frequency)
    exact = 1.0 / np.cos(np.sqrt(w**2 - 1j * w * rate) * length / c)
    assert made.response["base.z"]["top"][:, 2] == pytest.approx(exact, rel=1e-2)


def test_against_a_direct_harmonic_solution() -> None:
    """(K - w^2 M + i w C) of all dofs, 2 % at two frequencies: 1 % away from peaks, 3 % at them."""
    first = float(latin_fmu.vibration_modes(read(lap()), count=1).frequency[0])
    ratios = {"frequencies": [first, 8 * first], "ratios": [RATIO, RATIO]}
    scene = read(lap(damping_ratios=ratios))  # type: ignore[arg-type]
    made = latin_fmu.frf(scene, ["tip.z", "base.z"], lowest=0.1 * first, highest=12 * first, points=60)
    assert made.natural_frequency[-1] > 12 * first
    joined = JoinedAssembly.of(without_scheme(scene), "sticking", {})
    mass, stiffness = joined.vibration.mass, joined.vibration.stiffness
    full = joined.expansion
    damping = full.T @ (joined.damping @ full)
    where = joined.parts.where["up"]
    tip = joined.discretised.sensors["tip"].rows @ full[where]
    along = joined.parts.translations[:, 2]
    pulled, drag = full.T @ (joined.parts.mass @ along), full.T @ (joined.damping @ along)
    near = np.abs(made.frequency[:, None] / made.natural_frequency - 1.0).min(axis=1) < 2 * RATIO
    assert near.any()
    assert not near.all()
    force = tip[[2]].toarray()[0]
    for drive in ("tip.z", "base.z"):
        exact = []
        for f in made.frequency:
            w = 2 * np.pi * f
            by = w**2 * pulled - 1j * w * drag if drive == "base.z" else -(w**2) * force
            dynamic = stiffness - w**2 * mass + 1j * w * damping
            for part in joined.strained:
                dynamic = dynamic + (part.branches.modulus(1j * w) - 1.0) * (full.T @ part.stiffness @ full)
            solved = tip @ spla.spsolve(dynamic.tocsc(), by)
            exact.append(np.add(solved, [0.0, 0.0, float(drive == "base.z")]))
        error = np.abs(made.response[drive]["tip"][:, 2] / np.array(exact)[:, 2] - 1.0)
        assert error[~near].max() < 0.01, drive
        assert error[near].max() < 0.03, drive


def test_against_a_base_that_shakes() -> None:
    """A run with contact and friction, its base shaken at three frequencies until the start has rung down."""
    first = float(latin_fmu.vibration_modes(read(lap()), count=1).frequency[0])
    shares, periods, steps = np.array([0.5, 1.0, 1.5]), 60, 160
    time = np.linspace(0.0, periods / first, periods * steps + 1)
    rise = np.minimum(time / (10 / first), 1.0)  # over ten periods
    history = np.sin(2 * np.pi * first * shares[:, None] * time).sum(axis=0) * rise
    # HHT shifts a frequency by (omega dt)^2 / 12, which is phase at a peak
    marched = {"end": float(time[-1]), "instants": len(time) - 1, "scheme": "hht"}
    data = lap(marched, rayleigh_stiffness=RATIO / (np.pi * first)) | {"load": {}, "solver": {"tolerance": 1e-5}}
    law = {"type": "table", "times": time.tolist(), "values": history.tolist()}
    data["boundary"]["held"] = {
        "type": "acceleration", "face": "low.xmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 1.0], "law": law
    }  # fmt: skip
    solution = latin_fmu.solve(read(data))
    assert solution.converged
    assert (solution.interfaces["lap"].contact_status[-1] != 2).all()  # type: ignore[index]
    last = slice(-4 * steps - 1, -1)
    carrier = np.exp(-2j * np.pi * first * shares[:, None] * time[last])
    tip = solution.sensors["tip"].acceleration
    assert tip is not None
    measured = (carrier @ tip[last, 2]) / (carrier @ history[last])
    made = latin_fmu.frf(read(data), ["base.z"], first * shares)
    error = np.abs(measured / made.response["base.z"]["tip"][:, 2] - 1.0)
    assert (error < [0.01, 0.03, 0.01]).all(), error


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    scene, stem = tmp_path / "lap.toml", tmp_path / "out"
    scene.write_text(read(lap() | {"name": "lap"}).text())
    words = ["frf", str(scene), "-o", str(stem), "--points", "20"]
    assert main([*words, "--damping", "0.02", "--drive", "base.z", "--drive", "push", "--kind", "mobility"]) == 0
    printed = capsys.readouterr().out
    assert "damping: 2 % of critical in each mode" in printed
    assert "transmissibility" in printed
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    assert tree["drives/push/tip/mobility"].attrs["units"] == "m s-1 N-1"
    assert tree["drives/base.z/root/phase"].dims == ("frequency", "component")
    table = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["frequency_Hz"], tree["frequency"].values, rtol=1e-8)
    size = tree["drives/push/tip/mobility"].values[:, 2]
    np.testing.assert_allclose(table["tipz__push_mobility_m_s1_N1"], size, rtol=1e-8)
    assert (tmp_path / "out.png").stat().st_size > 10_000
    short = ["--damping", "0.02", "--drive", "base.z", "--drive", "push", "--kind", "mobility", "--json"]
    assert main([*words, *short]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["frequency"]["values"] == tree["frequency"].values.tolist()
    assert report["drives"]["push"]["tip"]["mobility"]["values"] == tree["drives/push/tip/mobility"].values.tolist()
    assert report["drives"]["base.z"]["root"]["phase"]["units"] == "rad"
    tree.close()
    for options, message in (
        ([], "damping: the scene has none, and without it the peaks are infinite"),
        (["--damping", "2"], "damping: out of range"),
        (["--damping", "0.02", "--drive", "tip.q"], "drive: neither the base nor a sensor with an axis nor a load"),
        (["--damping", "0.02", "--sensor", "tap"], "sensor: no sensor of this name (value: tap)"),
        (["--damping", "0.02", "--lowest", "9", "--highest", "5"], "lowest: not below the highest frequency"),
    ):
        assert main([*words, *options]) == 2
        assert message in capsys.readouterr().err
    monkeypatch.setattr(frequency_response, "clamped", lambda *_: pytest.fail("refused after the tightening"))
    assert main(words) == 2
    monkeypatch.undo()
    data = lap()
    del data["boundary"]
    with pytest.raises(latin_fmu.InputError, match="nothing holds the assembly"):
        latin_fmu.frf(read(data), damping=RATIO)
    data["load"] = {"couple": {"face": "up.zmax", "force": [0.0, 0.0, 0.0], "moment": [0.0, 1.0, 0.0]}}
    with pytest.raises(latin_fmu.InputError, match="no resultant"):
        latin_fmu.frf(read(data), ["couple"], damping=RATIO)
    with pytest.raises(latin_fmu.InputError, match="all that can move has no mass"):
        latin_fmu.frf(latin_fmu.load_scene(MODELS / "gripped_bar/scene.toml"), damping=RATIO)
