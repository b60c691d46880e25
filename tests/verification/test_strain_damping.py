"""Damping by strain: ratios of modes whatever they are cut into, momenta, energies; one answer of every way to it."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.cosim import Session
from latin_fmu.errors import SceneError
from latin_fmu.scene.strain_damping import PRECISION, fitted
from latin_fmu.time_scheme import HHT, CentralDifference, MaxwellBranches, Newmark

Tables = dict[str, Any]
STEP = 1e-5
BAND = (100.0, 2000.0)
BANDED = {"frequencies": list(BAND), "ratios": [0.02, 0.02]}


def material(ratio: float = 0.02, band: tuple[float, float] = BAND, modulus: float = 70e9) -> Tables:
    ratios = {"frequencies": list(band), "ratios": [ratio, ratio]}
    return {"young_modulus": modulus, "poisson_ratio": 0.33, "density": 2700.0, "damping_ratios": ratios}


def beam(
    parts: int = 1, held: bool = True, materials: tuple[Tables, ...] = (), joint: str = "perfect", **tables: Any
) -> Tables:
    """A beam of 0.2 x 0.01 x 0.01 m along x, cut into equal parts of the given materials in turn."""
    materials = materials or (material(),)
    made: Tables = {
        "name": "beam",
        "material": {f"m{i}": table for i, table in enumerate(materials)},
        "substructure": {},
        "interface": {},
        "sensor": {"tip": {"face": f"b{parts - 1}.xmax"}},
        "time": {"end": 0.05, "step": STEP, "scheme": "newmark"},
        "solver": {"tolerance": 1e-9},
        "output": {"energy": True},
    }
    length, elements = 0.2 / parts, max(16 // parts, 2)
    for i in range(parts):
        box = {"origin": [i * length, 0.0, 0.0], "size": [length, 0.01, 0.01], "elements": [elements, 1, 1]}
        made["substructure"][f"b{i}"] = {"material": f"m{i % len(materials)}", "bending_modes": True, "box": box}
        if i:
            sides = [f"b{i - 1}.xmax", f"b{i}.xmin"]
            pressed = {"friction_coefficient": 0.9, "preload": 50e6} if joint == "contact" else {}
            made["interface"][f"i{i}"] = {"sides": sides, "behaviour": joint, **pressed}
    if held:
        made["boundary"] = {"foot": {"type": "fixed", "face": "b0.xmin"}}
    return made | tables


TAP: Tables = {"tap": {"face": "b0.xmax", "force": [0.0, 0.0, 0.1], "law": {"type": "half_sine", "duration": 1e-3}}}


def run(tables: Tables) -> latin_fmu.Solution:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert solution.converged
    return solution


def decays(signal: np.ndarray, step: float, count: int = 8) -> np.ndarray:
    """Complex frequencies, s-1, in a signal that is a sum of decaying oscillations (matrix pencil), ascending."""
    n = len(signal) // 2
    rows = np.array([signal[i : i + n] for i in range(len(signal) - n + 1)])
    basis = np.linalg.svd(rows, full_matrices=False)[2][:count]
    found = np.log(np.linalg.eigvals(np.linalg.pinv(basis[:, :-1].T) @ basis[:, 1:].T).astype(complex)) / step
    swinging = found[found.imag > 60.0]  # not the parts of a rigid motion
    return swinging[np.argsort(swinging.imag)]


def first_decay(tables: Tables, start: float, every: int) -> tuple[float, float]:
    """Natural frequency, Hz, and damping ratio of the lowest mode at the tip along z after a tap."""
    tip = run(tables).sensors["tip"]
    after = slice(int(start / STEP), None, every)
    s = decays(tip.displacement[after, 2], every * STEP)[0]
    return abs(s) / (2 * np.pi), -s.real / abs(s)


# -- the material -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("ratio", [0.005, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("width", [10.0, 100.0, 1000.0])
def test_ratios_over_a_band(ratio: float, width: float) -> None:
    damping = fitted(20.0, 20.0 * width, ratio, ratio)
    f = np.geomspace(20.0, 20.0 * width, 500)
    turns = 2j * np.pi * f
    complex_modulus = 1.0 + damping.viscosity * turns
    for strength, time in zip(damping.strengths, damping.times, strict=True):
        complex_modulus += strength * turns * time / (1.0 + turns * time)
    assert np.abs(complex_modulus.imag / (2 * complex_modulus.real) / ratio - 1.0).max() < 1.05 * PRECISION
    assert len(damping.times) <= 5
    assert min(damping.strengths) > 0.0
    # Kramers and Kronig: the modulus rises by about 4 zeta / pi over a factor e
    rise = complex_modulus.real[-1] / complex_modulus.real[0] - 1.0
    assert rise == pytest.approx((np.exp(4 * ratio / np.pi * np.log(width)) - 1.0), rel=0.25)


def test_ratios_on_a_line() -> None:
    damping = fitted(50.0, 2000.0, 0.03, 0.008)
    f = np.geomspace(50.0, 2000.0, 50)
    line = 0.03 * (f / 50.0) ** (np.log(0.008 / 0.03) / np.log(40.0))
    assert np.abs(damping.ratio(f) / line - 1.0).max() < 1.05 * PRECISION


@pytest.mark.parametrize(("ratios", "words"), [([0.02, 0.0005], "falls faster"), ([0.01, 0.3], "rises faster")])
def test_ratios_that_strain_cannot_have(ratios: list[float], words: str) -> None:
    with pytest.raises(SceneError, match=words) as refused:
        latin_fmu.scene_from_dict(
            beam(materials=(material() | {"damping_ratios": {"frequencies": BAND, "ratios": ratios}},))
        )
    nearest = float(str(refused.value).rpartition("ratios = [")[2].split(", ")[1].split("]")[0])
    allowed = {"frequencies": BAND, "ratios": [ratios[0], nearest * (1.001 if "falls" in words else 0.999)]}
    latin_fmu.scene_from_dict(beam(materials=(material() | {"damping_ratios": allowed},)))


@pytest.mark.parametrize("scheme", [Newmark(), HHT(), CentralDifference()])
def test_weights_follow_the_elongation(scheme: Any) -> None:
    """e' = u' - e / tau for u = t: e = tau (1 - exp(-t / tau)), to the second order of the step."""
    tau, errors = 0.1, []
    for dt in (0.01, 0.005):
        _, kept, moved, _ = MaxwellBranches((1.0,), (tau,)).weights(scheme, dt)[:, 0]
        part = 0.5 * dt if scheme.explicit else dt
        e = 0.0
        for _ in range(round(0.2 / part)):
            e = kept * e + moved * part
        errors.append(abs(e - tau * (1 - np.exp(-0.2 / tau))))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


# -- rigid motion is not damped ---------------------------------------------------------------------------------------
COASTING: Tables = {
    "name": "coasting",
    "material": {"m": material(0.01, (200.0, 2000.0))},
    "substructure": {"block": {"material": "m", "box": {"size": [0.05, 0.05, 0.05], "elements": [2, 2, 2]}}},
    "boundary": {
        "base": {
            "type": "acceleration",
            "face": "block.zmin",
            "components": ["x", "y", "z"],
            "value": [981.0, 0.0, 0.0],
            "law": {"type": "half_sine", "duration": 6e-3},
        }
    },
    "time": {"end": 20e-3, "step": 5e-5, "scheme": "hht"},
    "output": {"reactions": True, "energy": True},
}
WAYS: dict[str, Tables] = {
    "hht": {},
    "generalized_alpha": {"time": COASTING["time"] | {"scheme": "generalized_alpha"}},
    "reduced": {"solver": {"propagator": "reduced"}},
    "cg": {"solver": {"propagator": "cg"}},
    "windows": {"solver": {"window": 10}},
    "explicit": {
        "solver": {"propagator": "explicit"},
        "time": {"end": 9e-3, "step": 8e-7, "scheme": "central_difference"},
    },
}


@pytest.mark.parametrize("way", WAYS)
def test_a_coasting_base_feels_nothing(way: str) -> None:
    """After a pulse of 100 g a block moves on at constant speed: its reaction is zero, and was m a before."""
    solution = run(COASTING | WAYS[way])
    force, late = solution.reactions["base"].force[:, 0], solution.time > 7e-3
    assert np.abs(force).max() == pytest.approx(0.3375 * 981.0, rel=1e-3)
    # what is left rings, undamped but for the strain
    assert abs(force[late].mean()) < 5e-3
    assert solution.energy is not None
    moved = np.abs(solution.energy["work_of_loads"]).max()
    assert np.abs(solution.energy["balance"]).max() < 1e-8 * moved


def test_six_momenta_and_energy_in_flight() -> None:
    """A bent beam that flies and turns while it vibrates."""
    tables = beam(held=False)
    for body in tables["substructure"].values():
        body["initial_velocity"] = [1.0, -2.0, 5.0]
        body["initial_velocity_gradient"] = [[0.0, -3.0, 0.0], [3.0, 0.0, 0.0], [20.0, 0.0, 0.0]]
    tables["time"]["end"] = 1e-3  # round-off grows with the path
    tables["output"] = {"energy": True, "fields": True}
    solution = run(tables)
    momenta = np.zeros((len(solution.time), 6))
    bodies = discretise(latin_fmu.scene_from_dict(tables)).bodies
    for name, body in solution.substructures.items():
        mass = bodies[name].mass
        places = body.nodes
        impulses = np.stack([(mass @ v.ravel()).reshape(-1, 3) for v in body.velocity])
        momenta[:, :3] += impulses.sum(axis=1)
        momenta[:, 3:] += np.cross(places[None], impulses).sum(axis=1)
    size = np.abs(momenta).max(axis=0).max()
    assert np.abs(momenta - momenta[0]).max() < 1e-9 * size
    assert solution.energy is not None
    total = solution.energy["kinetic"] + solution.energy["elastic"] + solution.energy["damping_dissipation"]
    assert np.abs(total - total[0]).max() < 1e-10 * total[0]
    assert (np.diff(solution.energy["damping_dissipation"]) >= -1e-16 * total[0]).all()
    assert solution.energy["damping_dissipation"][-1] > 1e-5 * total[0]


PLAIN = {k: v for k, v in material().items() if k != "damping_ratios"}
SPRING = {"k": {"ends": [{"face": "b1.xmin"}, {"face": "b1.xmax"}], "stiffness": 1e6, "damping_ratios": BANDED}}
LAYER = {"behaviour": "elastic_layer", "normal_stiffness": 1e12, "tangential_stiffness": 5e11}
DAMPINGS: dict[str, Tables] = {
    "ratios": {},
    "every material": {"materials": (PLAIN,), "damping": {"ratio": 0.02, "band": BAND}},
    "loss factor": {"materials": (PLAIN | {"loss_factor": 0.04, "at_frequency": 500.0},)},
    "stiffness": {"materials": (PLAIN | {"rayleigh_stiffness": 1e-6},)},
    "layer": {"materials": (PLAIN,), "layer": LAYER | {"damping_ratios": BANDED}},
    "spring": {"materials": (PLAIN,), "spring": SPRING},
    "modal": {"materials": (PLAIN,), "modal": {"ratio": 0.02, "below": 2e4}},
}


def damped(kind: str, drive: Tables | None = None, **tables: Any) -> Tables:
    """A beam of two parts on a base, with one kind of damping."""
    keys = DAMPINGS[kind]
    made = beam(2, drive is None, keys.get("materials", ()), **tables)
    made |= {key: keys[key] for key in ("damping", "spring") if key in keys}
    made["interface"]["i1"] |= keys.get("layer", {})
    if "modal" in keys:
        made["substructure"]["b0"]["modal_damping"] = keys["modal"]
    if drive is not None:
        made["boundary"] = {"foot": {"face": "b0.xmin", "components": ["x", "y", "z"]} | drive}
    made["time"]["end"] = 5e-3
    return made


@pytest.mark.parametrize("kind", DAMPINGS)
def test_a_moving_frame_changes_nothing(kind: str) -> None:
    """A beam on a base that moves at constant speed is the beam on a base at rest (Galilei)."""
    speed = [0.01, -0.02, 0.03]
    still, moving = damped(kind, load=TAP), damped(kind, {"type": "velocity", "value": speed}, load=TAP)
    for body in moving["substructure"].values():
        body["initial_velocity"] = speed
    at_rest, carried = run(still), run(moving)
    travel = at_rest.time[:, None] * np.array(speed)
    relative = carried.sensors["tip"].displacement - travel
    size = np.abs(at_rest.sensors["tip"].displacement).max()
    assert np.abs(relative - at_rest.sensors["tip"].displacement).max() < 1e-8 * size


@pytest.mark.parametrize("kind", DAMPINGS)
def test_an_accelerated_base_is_gravity_in_its_frame(kind: str) -> None:
    """On a base with the acceleration a the motion relative to it is that under the gravity -a."""
    gain, law = np.array([500.0, -300.0, 800.0]), {"type": "half_sine", "duration": 2e-3}
    places = {"sensor": {"tip": {"face": "b1.xmax"}, "foot": {"face": "b0.xmin"}}}
    driven = run(damped(kind, {"type": "acceleration", "value": gain.tolist(), "law": law}, **places))
    under = run(damped(kind, gravity={"acceleration": (-gain).tolist(), "law": law}, **places))
    base = driven.sensors["foot"].displacement
    relative = driven.sensors["tip"].displacement - base
    size = np.abs(under.sensors["tip"].displacement).max()
    assert np.abs(base).max() > 3.0 * size
    assert np.abs(relative - under.sensors["tip"].displacement).max() < 1e-8 * size


# -- the ratio of a mode ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("held", [True, False])
def test_a_mode_has_the_ratio_whatever_it_is_cut_into(parts: int, held: bool) -> None:
    tables = beam(parts, held, load=TAP)
    tables["load"]["tap"]["face"] = f"b{parts - 1}.xmax"
    frequency, ratio = first_decay(tables, 2e-3, 40 if held else 10)
    modes = latin_fmu.vibration_modes(latin_fmu.scene_from_dict(tables), count=2)
    first = modes.n_rigid
    assert modes.damping is not None
    assert ratio == pytest.approx(0.02, rel=PRECISION)
    assert frequency == pytest.approx(modes.frequency[first], rel=1e-3)
    assert ratio == pytest.approx(modes.damping.bodies[first], rel=2e-3)
    assert modes.frequency[first] > 1.01 * modes.static_frequency[first]


def bolted(tables: Tables) -> Tables:
    """Such a beam of contacts without preload, tightened by two bolts along it, above and below, between lugs."""
    last = f"b{len(tables['substructure']) - 1}"
    made = deepcopy(tables)
    for interface in made["interface"].values():
        interface.pop("preload", None)
    made["bolt"] = {}
    # 1e-9 of a motion that has died away is below the round-off of the clamp force
    made["solver"] = {"tolerance": 1e-7}
    for where, z, seat in (("top", 0.01, "zmax"), ("low", -0.002, "zmin")):
        foot = "zmin" if seat == "zmax" else "zmax"
        pieces = {"near": (0.0, 0.02, 1), "shank": (0.02, 0.16, 8), "far": (0.18, 0.02, 1)}
        for piece, (x, length, elements) in pieces.items():
            box = {"origin": [x, 0.0, z], "size": [length, 0.01, 0.002], "elements": [elements, 1, 1]}
            made["substructure"][f"{where}_{piece}"] = {"material": "m0", "bending_modes": True, "box": box}
        sides = [
            [f"{where}_near.{foot}", f"b0.{seat}"],
            [f"{where}_far.{foot}", f"{last}.{seat}"],
            [f"{where}_near.xmax", f"{where}_shank.xmin"],
            [f"{where}_shank.xmax", f"{where}_far.xmin"],
        ]
        made["interface"] |= {f"{where}{i}": {"sides": pair, "behaviour": "perfect"} for i, pair in enumerate(sides)}
        made["bolt"][where] = {"substructure": f"{where}_shank", "axis": [1.0, 0.0, 0.0], "force": 1500.0}
    return made


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False], ids=["clamped", "free"])
@pytest.mark.parametrize("joint", ["perfect", "contact", "bolted"])
@pytest.mark.parametrize("parts", [1, 2, 4, 8])
@pytest.mark.parametrize("width", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("ratio", [0.005, 0.02, 0.05, 0.1])
def test_decays_of_many_beams(ratio: float, width: float, parts: int, joint: str, held: bool) -> None:
    """Bonded, pressed and bolted bodies of two materials: the sum over the parts of curve times share of strain
    energy."""
    if joint != "perfect" and parts == 1:
        pytest.skip("one part has no joint")
    if joint == "bolted" and held and ratio == 0.1 and width < 1000.0:
        pytest.xfail("bonds of thin bodies of unlike damping, 10 % of critical, do not converge, as the run says")
    middle = 250.0 if held else 1400.0
    band = (middle / np.sqrt(width), middle * np.sqrt(width))
    materials = material(ratio, band), material(0.5 * ratio, band, 40e9)
    tables = beam(parts, held, materials, "perfect" if joint == "perfect" else "contact", load=deepcopy(TAP))
    tables["load"]["tap"]["face"] = f"b{parts - 1}.xmax"
    if joint == "bolted":
        tables = bolted(tables)
    frequency, measured = first_decay(tables, 2e-3, 40 if held else 10)
    scene = latin_fmu.scene_from_dict(tables)
    modes = latin_fmu.vibration_modes(scene, count=2)
    shares = np.zeros(2)
    # along z, the way of the tap: bolts above and below make bending along y another mode
    along = [np.abs(modes.shapes[f"b{parts - 1}"][modes.n_rigid + k, :, 2]).max() for k in (0, 1)]
    first = modes.n_rigid + int(np.argmax(along))
    models = {m.name: m for c in discretise(scene).classes for m in c.members}
    for name, shape in modes.shapes.items():
        u = shape[first].ravel()
        shares[int(scene.substructure[name].material[1:])] += u @ (models[name].stiffness @ u)
    f = np.array([modes.frequency[first]])
    curves = [float(scene.material[f"m{i}"].damping.ratio(f)[0]) for i in (0, 1)]
    assert measured == pytest.approx(shares @ curves / shares.sum(), rel=0.1)
    assert frequency == pytest.approx(f[0], rel=1e-3 + 0.6 * ratio**2)


def test_materials_that_differ_couple_their_modes() -> None:
    """Run, modes and response of a beam of two materials of unlike ratios and moduli."""
    tables = beam(2, True, (material(0.01), material(0.08, BAND, 10e9)), load=TAP)
    tables["load"]["tap"]["face"] = "b1.xmax"
    frequency, ratio = first_decay(tables, 2e-3, 40)
    scene = latin_fmu.scene_from_dict(tables)
    modes = latin_fmu.vibration_modes(scene, count=4)
    assert modes.damping is not None
    assert frequency == pytest.approx(modes.frequency[0], rel=1e-3)
    assert ratio == pytest.approx(modes.damping.bodies[0], rel=1e-3)
    peak = latin_fmu.frf(scene, ["tip.z"], kind="receptance").response["tip.z"]["tip"][:, 2]
    # of one mode: half of the peak on both sides is 2 zeta f wide
    response = latin_fmu.frf(scene, ["tip.z"], np.linspace(0.9, 1.1, 401) * frequency, kind="receptance")
    size = np.abs(response.response["tip.z"]["tip"][:, 2])
    assert size.max() == pytest.approx(np.abs(peak).max(), rel=1e-2)
    above = response.frequency[size > size.max() / np.sqrt(2)]
    assert (above[-1] - above[0]) / (2 * frequency) == pytest.approx(ratio, rel=2e-2)


def test_a_run_is_its_frequency_response() -> None:
    """A base that shakes at half of the first frequency, steady state: amplitude and phase of the tip."""
    first = 205.0
    time = np.arange(0.0, 0.2 + STEP / 2, 2e-5)
    law = np.sin(np.pi * first * time) * np.minimum(1.0, time / 0.03)
    tables = beam()
    drive = {"type": "table", "times": time.tolist(), "values": law.tolist()}
    axes = ["x", "y", "z"]
    foot = {"type": "acceleration", "face": "b0.xmin", "components": axes, "value": [0.0, 0.0, 1.0], "law": drive}
    tables["boundary"]["foot"] = foot
    tables["sensor"]["foot"] = {"face": "b0.xmin"}
    tables["time"] = {"end": 0.2, "step": 2e-5, "scheme": "newmark"}
    expected = latin_fmu.frf(latin_fmu.scene_from_dict(tables), ["base.z"], [first / 2]).response["base.z"]["tip"][0, 2]
    sensors = run(tables).sensors
    last = time > 0.2 - 8 / first
    waves = np.exp(1j * np.pi * first * time[last])

    def amplitude(signal: np.ndarray) -> complex:
        cosine, sine = np.linalg.lstsq(np.column_stack([waves.real, waves.imag]), signal[last], rcond=None)[0]
        return complex(cosine, -sine)

    assert sensors["tip"].acceleration is not None
    assert sensors["foot"].acceleration is not None
    measured = amplitude(sensors["tip"].acceleration[:, 2]) / amplitude(sensors["foot"].acceleration[:, 2])
    assert abs(measured - expected) < 1e-3 * abs(expected)
    assert abs(expected.imag) > 0.01


# -- every way to the answer ------------------------------------------------------------------------------------------
def test_reduced_and_direct_march_agree() -> None:
    tables = beam(2, True, (material(0.03), material(0.01)), "contact", load=TAP)
    tables["time"] = {"end": 5e-3, "step": 2e-5, "scheme": "hht"}
    direct = run(tables).sensors["tip"].displacement
    reduced = run(tables | {"solver": {"tolerance": 1e-9, "propagator": {"type": "reduced", "modes": 30}}})
    assert np.abs(reduced.sensors["tip"].displacement - direct).max() < 1e-4 * np.abs(direct).max()


@pytest.mark.parametrize("rate", [1e-4, 5e-4])
def test_a_session_is_the_run(rate: float) -> None:
    """Communication steps, a state restored in between: driven face and elongations go on from where they were."""
    tables = COASTING | {
        "time": {"end": 2e-3, "step": 5e-5, "scheme": "hht"},
        "sensor": {"top": {"face": "block.zmax"}},
        "output": {},
    }
    session = Session(latin_fmu.scene_from_dict(tables))
    session.initialize()
    for i in range(round(2e-3 / rate)):
        if i == 2:
            state = session.snapshot()
            assert session.step(i * rate, rate)
            session.restore(state)
        assert session.step(i * rate, rate)
    names = [f"sensor.top.displacement[{axis}]" for axis in (1, 2, 3)]
    final = run(tables).sensors["top"].displacement[-1]
    assert session.values(names) == pytest.approx(final, rel=1e-12, abs=1e-12 * np.abs(final).max())


def test_a_moved_port_feels_what_a_support_does() -> None:
    """The force that a body exerts through a port whose motion is set has the branches in it, as the reaction has."""
    ramp = {"type": "table", "times": [0.0, 1e-3, 4e-3], "values": [0.0, 1.0, 1.0]}
    box = COASTING["substructure"]["block"]
    common: Tables = {
        "name": "port",
        "material": {"m": material(0.1, (200.0, 2000.0))},
        "substructure": {"block": box},
        "time": {"end": 4e-3, "step": 5e-5, "scheme": "hht"},
    }
    foot = {"type": "fixed", "face": "block.zmin"}
    moved = {
        "type": "velocity",
        "face": "block.zmax",
        "components": ["x", "y", "z"],
        "value": [1e-3, 0.0, 0.0],
        "law": ramp,
    }
    tables = common | {"boundary": {"foot": foot, "top": moved}, "output": {"reactions": True}}
    solution = run(tables)
    force = solution.reactions["foot"].force + solution.reactions["top"].force
    # in balance but for the inertia of the block
    assert np.abs(force[-1]).max() < 1e-3 * np.abs(solution.reactions["top"].force).max()
    static = run(tables | {"material": {"m": {k: v for k, v in material().items() if k != "damping_ratios"}}})
    ratio = solution.reactions["top"].force[-1, 0] / static.reactions["top"].force[-1, 0]
    # a steady rate of strain for 3 ms: springs of the branches are stretched by rate times their times
    damping = fitted(200.0, 2000.0, 0.1, 0.1)
    weights = zip(damping.strengths, damping.times, strict=True)
    rate, strain = 1e-3, 1e-3 * (0.5e-3 + 3e-3)
    stretched = sum(g * rate * tau * (1 - np.exp(-3e-3 / tau)) for g, tau in weights) + damping.viscosity * rate
    assert ratio - 1.0 == pytest.approx(stretched / strain, rel=0.1)


# -- springs, layers, one ratio for all --------------------------------------------------------------------------------
def hung(**keys: Any) -> Tables:
    """A rigid block on a spring along x, or on an elastic layer of the same stiffness."""
    made: Tables = {
        "name": "hung",
        "material": {"m": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"a": {"material": "m", "rigid": True, "box": {"size": [0.02] * 3, "elements": [1, 1, 1]}}},
        "boundary": {"guide": {"type": "fixed", "face": "a.xmax", "components": ["y", "z"]}},
        "load": {"tap": {"face": "a.xmax", "force": [10.0, 0.0, 0.0], "law": {"type": "half_sine", "duration": 2e-4}}},
        "sensor": {"tip": {"face": "a.xmax"}},
        "time": {"end": 0.05, "step": STEP, "scheme": "newmark"},
        "solver": {"tolerance": 1e-9},
        "output": {"energy": True},
    }
    return made | keys


SPRING: Tables = {"ends": ["a.xmin", "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": 1e5}
LAYER: Tables = {
    "sides": ["a.xmin", "ground"],
    "behaviour": "elastic_layer",
    "normal_stiffness": 1e5 / 4e-4,
    "tangential_stiffness": 0.0,
}
RATIOS: Tables = {"frequencies": list(BAND), "ratios": [0.05, 0.05]}


@pytest.mark.parametrize("joint", ["spring", "interface"])
@pytest.mark.parametrize("by", ["damping_ratios", "damping"])
@pytest.mark.parametrize("scheme", ["newmark", "generalized_alpha"])
def test_springs_and_layers_have_the_ratio(joint: str, by: str, scheme: str) -> None:
    own = {"damping_ratios": RATIOS} if by == "damping_ratios" else {}
    tables = hung(**{joint: {"k": (SPRING if joint == "spring" else LAYER) | own}})
    tables |= {} if own else {"damping": {"ratio": 0.05, "band": list(BAND)}}
    tables["time"]["scheme"] = scheme
    solution = run(tables)
    s = decays(solution.sensors["tip"].displacement[100::10, 0], 10 * STEP, 4)[0]
    frequency, ratio = abs(s) / (2 * np.pi), -s.real / abs(s)
    scene = latin_fmu.scene_from_dict(tables)
    modes = latin_fmu.vibration_modes(scene, count=3)
    assert modes.damping is not None
    assert ratio == pytest.approx(0.05, rel=PRECISION)
    along = int(np.argmax(modes.effective_mass[:, 0]))
    assert frequency == pytest.approx(modes.frequency[along], rel=1e-3)
    assert ratio == pytest.approx(modes.damping.bodies[along], rel=2e-3)
    assert modes.static_frequency[along] == pytest.approx(np.sqrt(1e5 / 0.0624) / (2 * np.pi), rel=1e-6)
    # what the joint has lost is what it took from the block
    energy = solution.energy
    assert energy is not None
    taken = -energy["interface_work"] - energy["layer_energy"]
    assert energy["joint_dissipation"][-1] == pytest.approx(taken[-1], rel=1e-2)


def test_a_maxwell_joint_creeps() -> None:
    """A spring and a dashpot in series under a constant force: u = F / k + F t / (k tau)."""
    keys = {"behaviour": "maxwell_joint", "normal_stiffness": 1e9, "tangential_stiffness": 0.0, "relaxation_time": 1e-3}
    tables = hung(interface={"k": {"sides": ["a.xmin", "ground"], **keys}})
    tables["load"] = {"pull": {"face": "a.xmax", "force": [4.0, 0.0, 0.0]}}
    tables["time"] = {"end": 0.05, "step": STEP, "scheme": "hht"}
    moved = run(tables).sensors["tip"].displacement[:, 0]
    stretch = 4.0 / (1e9 * 4e-4)
    time = np.linspace(0.0, 0.05, len(moved))
    late = time > 0.04
    assert np.polyfit(time[late], moved[late], 1)[0] == pytest.approx(stretch / 1e-3, rel=1e-3)


def test_what_has_damping_of_its_own_keeps_it() -> None:
    scene = latin_fmu.scene_from_dict(
        beam(
            2,
            materials=(
                material(0.03),
                material(0.01) | {"damping_ratios": None, "loss_factor": 0.1, "at_frequency": 300.0},
            ),
        )
        | {"damping": {"ratio": 0.02, "band": list(BAND)}}
    )
    found = discretise(scene).scene.material
    assert found["m0"].damping_ratios is not None
    assert found["m0"].damping_ratios.ratios == (0.03, 0.03)
    assert found["m1"].damping_ratios is None


def test_windows_of_several_instants_refuse_springs_that_relax() -> None:
    tables = hung(spring={"k": SPRING | {"damping_ratios": RATIOS}})
    with pytest.raises(SceneError, match=r"solver\.window"):
        latin_fmu.solve(latin_fmu.scene_from_dict(tables | {"solver": {"window": 4}}))


# -- drag -------------------------------------------------------------------------------------------------------------
def dragged(**more: Any) -> Tables:
    plain = {"young_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0, "rayleigh_mass": 22.848}
    return COASTING | {"material": {"m": plain | more}}


def test_drag_is_refused_unless_it_is_meant() -> None:
    """A half sine of duration T: a max|s'| / max|s''| = 2 a T / pi = 8.73 %."""
    with pytest.raises(SceneError, match=r"rayleigh_mass: brakes what boundary.base moves .*8\.73 %"):
        latin_fmu.solve(latin_fmu.scene_from_dict(dragged()))
    solution = run(dragged(frame="absolute"))
    speed = 2 * 981.0 * 6e-3 / np.pi
    assert solution.reactions["base"].force[-1, 0] == pytest.approx(22.848 * 0.3375 * speed, rel=1e-3)


def test_drag_on_free_bodies_is_refused() -> None:
    """1 - exp(-a t) of the momentum, by formula."""
    flight = deepcopy(dragged()) | {"boundary": {}, "output": {}}
    flight["substructure"]["block"] = flight["substructure"]["block"] | {"initial_velocity": [5.0, 0.0, 0.0]}
    with pytest.raises(SceneError, match=r"36\.7 % of the momentum in 0\.02 s"):
        latin_fmu.solve(latin_fmu.scene_from_dict(flight))


def test_ratios_in_an_absolute_frame_are_rayleigh_damping() -> None:
    a, b = 2 * 0.01 * 2 * np.pi * 200 * 2000 / 2200, 0.01 / (np.pi * 2200)
    ratios = COASTING["material"]["m"] | {"frame": "absolute"}
    both = dragged(rayleigh_mass=a, rayleigh_stiffness=b, frame="absolute")
    first = run(COASTING | {"material": {"m": ratios}}).reactions["base"].force
    assert np.abs(first - run(both).reactions["base"].force).max() < 1e-9 * np.abs(first).max()


def test_the_band_where_none_is_named() -> None:
    """From a third of the lowest mode of the undamped assembly to the corner of a filter, and in a remark."""
    plain = {key: value for key, value in material().items() if key != "damping_ratios"}
    tables = beam(2, materials=(plain,))
    first = float(latin_fmu.vibration_modes(latin_fmu.scene_from_dict(tables), count=1).frequency[0])
    tables["sensor"]["tip"]["filter"] = {"type": "low_pass", "cutoff": 4000.0}
    tables["damping"] = {"ratio": 0.02}
    problem = discretise(latin_fmu.scene_from_dict(tables))
    ratios = problem.scene.material["m0"].damping_ratios
    assert ratios is not None
    assert ratios.frequencies == pytest.approx((first / 3, 4000.0))
    assert [r for r in problem.remarks if r.code == "damping" and "filter of sensor tip" in r]
