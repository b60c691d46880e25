"""Scenes whose quantities are known in closed form (travelling waves), for the study of error estimates."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

import latin_fmu
from latin_fmu.accuracy.runs import in_short_windows
from latin_fmu.latin.outcome import SensorHistory
from latin_fmu.results.interface_fields import Force
from latin_fmu.run_quantities import Quantities, add_sensor, band_of, of_force
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import Box, Material, bar, column, thrown, two_boxes

from .oracles import cases
from .oracles.bars import Bar, Waves
from .oracles.cases import Solved
from .oracles.connections import Contact, Joint, PrescribedStress
from .oracles.piecewise import PiecewiseLinear

MODELS = Path(__file__).parents[2] / "models"


@dataclass(frozen=True)
class Known:
    """A scene, the exact values of its quantities, and quantities left out (trivially exact)."""

    name: str
    scene: Scene
    exact: Quantities
    trivial: frozenset[str] = field(default_factory=frozenset)

    @property
    def quantities(self) -> list[str]:
        """What is judged."""
        return [q for q in self.exact.values if q not in self.trivial]


def exact_of(
    interface: str, solved: Solved, area: float, end: float, sensors: dict[str, tuple[int, int]] | None = None
) -> Quantities:
    """Exact quantities of one contact; ``sensors``: connection and side of bar ends by name, for their displacement."""
    exact = Quantities()
    knots: list[float] = []
    values: list[float] = []
    for start, stop, first, last in solved.pressure.pieces(0.0, end):
        knots += [start, stop]
        values += [area * first, area * last]
    force = Force(np.array(knots), np.array(values))
    exact.forces[interface] = force
    exact.add(interface, of_force(force, end, opens=True))
    for name, place in (sensors or {}).items():
        path = _path(solved.waves, place, np.linspace(0.0, end, 2001))
        exact.vectors[name] = np.array([0.0, 0.0, path[-1]])
        exact.add(name, {"displacement": (abs(path[-1]), float(np.abs(path).max()))})
    return exact


def add_exact_sensor(exact: Quantities, name: str, waves: Waves, place: tuple[int, int], scene: Scene) -> None:
    """Add all quantities of a sensor on the end of a bar (connection and side).

    Its motion is sampled sixteen times as often as that of the run, the acceleration as the second difference of the
    exact displacement: what it integrates to over a sample is exact, jumps of the velocity included.
    """
    step = scene.time.time_step / 16
    time = step * np.arange(int(scene.time.end / step + 1e-6) + 1)
    path = _path(waves, place, time)
    motions = np.zeros((3, len(time), 3))
    motions[0, :, 2] = path
    motions[1, :, 2] = np.gradient(path, step)
    motions[2, 1:-1, 2] = np.diff(path, 2) / step**2
    history = SensorHistory(name, scene.sensor[name].body, None, np.zeros(3), *motions)
    add_sensor(exact, time, history, scene.time.end, band_of(scene, scene.sensor[name]))


def _path(waves: Waves, place: tuple[int, int], time: np.ndarray) -> np.ndarray:
    """Displacement (n,) of the end of a bar at instants (n,) from 0 on, exact."""
    connection, side = place
    pieces = list(waves.velocity[connection][side].pieces(0.0, float(time[-1])))
    knots = np.array([piece[0] for piece in pieces] + [pieces[-1][1]])
    steps, first, last = (np.array(column) for column in zip(*((b - a, u, v) for a, b, u, v in pieces), strict=True))
    way = np.concatenate([[0.0], np.cumsum(0.5 * steps * (first + last))])
    i = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(pieces) - 1)
    passed = time - knots[i]
    return way[i] + passed * (first[i] + 0.5 * passed / steps[i] * (last[i] - first[i]))


def _with_sensors(scene: Scene, **places: tuple[str, float]) -> Scene:
    """The scene with sensors on its axis: substructure and height by name."""
    data = tomllib.loads(scene.text())
    data["sensor"] = {n: {"substructure": b, "point": [0.0, 0.0, z]} for n, (b, z) in places.items()}
    return latin_fmu.scene_from_dict(data, scene.base_dir)


def shipped(model: str) -> Scene:
    """A shipped scene."""
    return latin_fmu.load_scene(MODELS / model / "scene.toml")


def beam_in_traction() -> Known:
    scene = in_short_windows(_with_sensors(shipped("beam_in_traction"), far=("bar2", 1.5001428571428571)))
    exact = exact_of("contact", cases.beam_in_traction(), 4e-4, scene.time.end, {"far": (3, 0)})
    return Known("beam_in_traction", scene, exact)


def impact_bar() -> Known:
    scene = _with_sensors(shipped("impact_bar"), top=("bar", 15.0))
    return Known("impact_bar", scene, exact_of("wall", cases.impact_bar(), 1.0, 2.0, {"top": (1, 0)}))


def bouncing_bar() -> Known:
    scene = _with_sensors(shipped("bouncing_bar"), foot=("bar", 5.0))
    return Known("bouncing_bar", scene, exact_of("wall", cases.bouncing_bar(5.5), 1.0, 5.5, {"foot": (0, 1)}))


def shear_interface() -> Known:
    """Dissipation mu sigma0 per unit slip, slip rate 2 (tau_i - mu sigma0) / (rho c_s) while tau_i > mu sigma0."""
    strength, area, duration, impedance = 3e6, 4e-6, 3.0472470011002204e-05, 7800 * np.sqrt(84e9 / 7800)
    slip = 2 * strength / impedance * duration / np.pi * (2 * np.sqrt(3) - 2 * np.pi / 3)
    exact = Quantities({"fault.friction_work": area * strength * slip}, {"fault.friction_work": area * strength * slip})
    return Known("shear_interface", shipped("shear_interface"), exact)


def two_bars_on_a_wall() -> Known:
    """Steel bars, gap 10 um, constant pressure; pressed to the end of the run."""
    steel = Material(210e9, 7800.0)
    scene = two_boxes(_thin(steel, 0.1), _thin(steel, 0.1), 0.4e-6, 250, gap=1e-5)
    scene["load"] = {"push": {"face": "low.zmin", "pressure": 100e6, "law": "step"}}
    scene["boundary"] = {"wall": {"type": "fixed", "face": "up.zmax", "components": ["z"]}}
    exact = exact_of("meet", cases.two_bars_on_a_wall(), 1e-4, 100e-6)
    return Known("two_bars_on_a_wall", latin_fmu.scene_from_dict(scene), exact, frozenset({"meet.separation"}))


def _thin(material: Material, length: float) -> Box:
    return Box(material, (0.01, 0.01, length), (1, 1, 50))


SOFT, HARD = Material(1.0, 1.0), Material(4.0, 2.25)  # speeds 1 and 4/3, impedances 1 and 3


def colliding_bars() -> Known:
    """Unequal bars thrown at each other; the gap closes between two instants."""
    scene = two_boxes(bar(SOFT, 1.0, 40, 1.0), bar(HARD, 1.5, 45, -0.5), 0.02, 300, gap=0.31)
    exact = cases.colliding_bars(Bar(1, 1, 1, velocity=1.0), Bar(1.5, 4, 2.25, velocity=-0.5), 0.31, 6.0)
    sensors = {"tail": (0, 1)}
    made = _with_sensors(latin_fmu.scene_from_dict(scene), tail=("low", 0.0))
    return Known("colliding_bars", made, exact_of("meet", exact, 1.0, 6.0, sensors))


def smooth_pulse(gap: float) -> Known:
    """Half-sine pulse through a contact of unequal bars that touch, or are ``gap`` apart."""
    scene = two_boxes(bar(SOFT, 1.0, 40), bar(HARD, 1.5, 45), 0.02, 300, gap=gap)
    scene["load"] = {"push": {"face": "low.zmin", "pressure": 0.1, "law": {"type": "half_sine", "duration": 2.0}}}
    free = PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, 6.0))
    rows = [PrescribedStress(_half_sine(2.0, 6.0)), Contact(gap), free]
    solved = Solved(Waves([Bar(1, 1, 1), Bar(1.5, 4, 2.25)], rows, 6.0), 1, gap)
    made = _with_sensors(latin_fmu.scene_from_dict(scene), head=("up", 2.5 + gap), foot=("low", 0.0))
    exact = exact_of("meet", solved, 1.0, 6.0, {"head": (2, 0), "foot": (0, 1)})
    return Known(f"smooth_pulse_gap_{gap:g}", made, exact)


def contrast() -> Known:
    """A triangular pulse from a bar ten times faster and stiffer in impedance into a slow one on a wall."""
    scene = two_boxes(bar(Material(100.0, 1.0), 1.0, 20), bar(Material(), 1.0, 40), 0.01, 600)
    law = {"type": "table", "times": [0.0, 0.5, 1.0], "values": [0.0, 1.0, 0.0]}
    scene["load"] = {"push": {"face": "low.zmin", "pressure": 0.1, "law": law}}
    scene["boundary"] = {"wall": {"type": "fixed", "face": "up.zmax", "components": ["z"]}}
    pulse = PiecewiseLinear.through([0.0, 0.5, 1.0, 6.0], [0.0, -0.1, 0.0, 0.0])
    rows = [PrescribedStress(pulse), Contact(0.0), Joint()]
    solved = Solved(Waves([Bar(1, 100, 1), Bar(1, 1, 1)], rows, 6.0), 1)
    return Known("contrast", latin_fmu.scene_from_dict(scene), exact_of("meet", solved, 1.0, 6.0))


def squeeze() -> Known:
    """Two equal bars on a wall squeezed slowly: half-sine of five transits."""
    scene = two_boxes(bar(Material(), 1.0, 32), bar(Material(), 1.0, 32), 0.025, 320)
    scene["load"] = {"push": {"face": "up.zmax", "pressure": 0.1, "law": {"type": "half_sine", "duration": 5.0}}}
    scene["boundary"] = {"wall": {"type": "fixed", "face": "low.zmin", "components": ["z"]}}
    rows = [Joint(), Contact(0.0), PrescribedStress(_half_sine(5.0, 8.0))]
    solved = Solved(Waves([Bar(1, 1, 1), Bar(1, 1, 1)], rows, 8.0), 1)
    made = _with_sensors(latin_fmu.scene_from_dict(scene), head=("up", 2.0))
    return Known("squeeze", made, exact_of("meet", solved, 1.0, 8.0, {"head": (2, 0)}))


def _landing(
    name: str, first: Bar, second: Bar, elements: tuple[int, int], courant: float, gap: float, across: int = 1
) -> Known:
    """Bars thrown at each other until after they part; ``courant`` : c dt / h of the finer bar."""
    sizes = [bar.length / n for bar, n in zip((first, second), elements, strict=True)]
    end = gap / (first.velocity - second.velocity) + 3.0 * max(first.transit, second.transit)
    step = courant * min(size / bar.speed for size, bar in zip(sizes, (first, second), strict=True))
    side, boxes = 0.1 * first.length, []
    for bar_, n in zip((first, second), elements, strict=True):
        material, shape = Material(bar_.modulus, bar_.density), (side, side, bar_.length)
        boxes.append(Box(material, shape, (across, across, n), (0.0, 0.0, bar_.velocity)))
    scene = latin_fmu.scene_from_dict(two_boxes(*boxes, step, int(end / step) + 1, gap=gap))
    made = _with_sensors(scene, tail=("low", 0.0))
    solved = cases.colliding_bars(first, second, gap, scene.time.end)
    return Known(name, made, exact_of("meet", solved, side**2, scene.time.end, {"tail": (0, 1)}))


def thrown_bars(courant: float = 0.5, across: int = 2, gap: float = 2e-4) -> Known:
    """Equal bars of 1.0 x 0.1 x 0.1 mm, 20 elements each, at +-100 m/s: exactly 1 N for 2 us."""
    first, second = (Bar(1e-3, 1e9, 1000.0, velocity=v) for v in (100.0, -100.0))
    return _landing(f"thrown_bars_{courant:g}_{gap:g}", first, second, (20, 20), courant, gap, across)


def thrown_bars_of_unequal_impedance() -> Known:
    """Impedance 1:10, the soft bar with twice as many elements."""
    first, second = Bar(1, 1, 1, velocity=0.1), Bar(1, 10, 10, velocity=-0.1)
    return _landing("thrown_bars_unlike", first, second, (40, 20), 0.5, 0.0437, 1)


def thrown_on_wall(courant: float, gap: float) -> Known:
    """A bar of 30 elements thrown at a wall."""
    bar_ = Bar(10.0, 900.0, 1.0, velocity=-10.0)
    end = gap / 10.0 + 1.0
    scene = thrown(30, int(end * 90.0 / courant) + 1, end, gap, -10.0, 0.0)
    free = PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, end))
    solved = Solved(Waves([bar_], [Contact(gap), free], end), 0, gap)
    made = _with_sensors(latin_fmu.scene_from_dict(scene), top=("bar", 10.0 + gap))
    return Known(f"thrown_on_wall_{courant:g}", made, exact_of("wall", solved, 1.0, end, {"top": (1, 0)}))


def row_of_three() -> Known:
    """A bar thrown at two that touch: the last one flies off with the momentum."""
    bodies = {n: bar(Material(), 1.0, 30, v) for n, v in (("one", 1.0), ("two", 0.0), ("three", 0.0))}
    scene = column(bodies, {"hit": {"gap": 0.21}, "push": {}}, {"end": 5.0, "instants": 250})
    scene["substructure"]["one"]["box"]["origin"][2] = -0.21
    free = PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, 5.0))
    rows = [free, Contact(0.21), Contact(0.0), free]
    waves = Waves([Bar(1, 1, 1, velocity=1.0), Bar(1, 1, 1), Bar(1, 1, 1)], rows, 5.0)
    exact = exact_of("hit", Solved(waves, 1, 0.21), 1.0, 5.0)
    other = exact_of("push", Solved(waves, 2), 1.0, 5.0)
    for mine, theirs in ((exact.values, other.values), (exact.scales, other.scales), (exact.forces, other.forces)):
        mine.update(theirs)
    # the first bar comes to rest beside the second one: any small force afterwards counts as a later separation
    return Known("row_of_three", latin_fmu.scene_from_dict(scene), exact, frozenset({"hit.separation"}))


def released() -> Known:
    """A bar pressed on a wall at rest, released at t = 0: the wall carries it until the wave arrives, L/c later."""
    law = {"type": "rectangular_pulse", "start": -1.0, "duration": 1.0}
    load = {"push": {"face": "bar.zmax", "pressure": 0.1, "law": law}}
    scene = column({"bar": bar(Material(), 1.0, 30)}, {}, {"end": 2.0, "instants": 100, "start": "static"}, load=load)
    scene["interface"]["wall"] = {"sides": ["bar.zmin", "ground"]}
    scene["boundary"]["guide"] = {"type": "fixed", "face": "bar.zmax", "components": ["x", "y"]}
    free = PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, 2.0))
    solved = Solved(Waves([Bar(1, 1, 1, stress=-0.1)], [Contact(0.0), free], 2.0), 0)
    return Known("released", latin_fmu.scene_from_dict(scene), exact_of("wall", solved, 1.0, 2.0))


def _half_sine(duration: float, end: float) -> PiecewiseLinear:
    times = [*np.linspace(0.0, duration, 401), end]
    return PiecewiseLinear.through(times, [-0.1 * np.sin(np.pi * min(t / duration, 1.0)) for t in times])


MAKERS: tuple[Callable[[], Known], ...] = (
    beam_in_traction,
    impact_bar,
    bouncing_bar,
    shear_interface,
    two_bars_on_a_wall,
    colliding_bars,
    lambda: smooth_pulse(0.0),
    lambda: smooth_pulse(0.05),
    contrast,
    squeeze,
    thrown_bars,
    lambda: thrown_bars(0.2, 1),
    lambda: thrown_bars(1.0, 1, 0.0),
    thrown_bars_of_unequal_impedance,
    lambda: thrown_on_wall(0.2, 2.37),
    lambda: thrown_on_wall(1.0, 1.13),
    row_of_three,
    released,
)


@cache
def known() -> tuple[Known, ...]:
    """All of them."""
    return tuple(make() for make in MAKERS)
