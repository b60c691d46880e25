"""Bases of random vibration in a scene: their durations, what they may drive, and what a check says of them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Problem
from ..shock.random_motion import RandomMotion
from ..shock.specification import HIGHEST_SHARE
from .boundaries import AXES, PrescribedAcceleration
from .histories import laws_of
from .laws import PsdLaw
from .raw_scene import given, named_tables, number, single_table
from .readable_numbers import readable

Array = NDArray[np.float64]
_LONGER = 1.0 + 1e-9  # round-off of a duration
_FEWEST = 2.0  # periods of the lowest frequency beside those in which the motion is faded in


@dataclass(frozen=True)
class RandomBase:
    """A boundary that a random vibration drives, and its law."""

    boundary: PrescribedAcceleration
    law: PsdLaw

    @property
    def motion(self) -> RandomMotion:
        """That of the law."""
        return self.law.motion

    @property
    def size(self) -> float:
        """Acceleration where the law is 1."""
        return float(np.linalg.norm(self.boundary.value))

    @property
    def direction(self) -> Array:
        """The same as a vector (3,) along the global axes."""
        of = dict(zip(self.boundary.components, self.boundary.value, strict=True))
        x, y, z = (of.get(axis, 0.0) for axis in AXES)
        if self.boundary.axes is None:
            return np.array([x, y, z])
        return np.array(self.boundary.axes.to_global((x, y, z)))

    def moves_like(self, other: "RandomBase") -> bool:
        """Whether both have the same motion."""
        return self.law == other.law and np.array_equal(self.direction, other.direction)


def random_bases(scene: Any) -> dict[str, RandomBase]:
    """Boundaries of a scene that random vibrations drive, by name."""
    return {
        name: RandomBase(boundary, boundary.law)
        for name, boundary in scene.boundary.items()
        if isinstance(boundary, PrescribedAcceleration) and isinstance(boundary.law, PsdLaw)
    }


def at_window(scene: Any, number: int) -> Any:
    """The scene with another window of its random vibrations."""
    moved = {}
    for name, base in random_bases(scene).items():
        moved[name] = base.boundary.model_copy(update={"law": base.law.model_copy(update={"window": number})})
    return scene.model_copy(update={"boundary": {**scene.boundary, **moved}})


def with_durations(raw: Any) -> Any:
    """The scene as written with the duration of its run in random vibrations that name none."""
    end = number(single_table(raw, "time"), "end")
    changed = {}
    for name, boundary in named_tables(raw, "boundary").items():
        law = boundary.get("law")
        if isinstance(law, Mapping) and law.get("type") == "psd" and not given(law, "duration") and end is not None:
            changed[name] = {**boundary, "law": {**law, "duration": end}}
    if not changed:
        return raw
    return {**raw, "boundary": {**raw["boundary"], **changed}}


def without_durations(data: dict[str, Any]) -> None:
    """Leave out, in place, the durations that follow from the run: it may be given another end."""
    for boundary in data["boundary"].values():
        law = boundary.get("law", {})
        if law.get("type") == "psd" and law.get("duration") == data["time"]["end"]:
            del law["duration"]


def random_problems(scene: Any) -> Iterator[Problem]:
    """Random vibrations that a run cannot have."""
    step, end = scene.time.time_step, scene.time.end
    driven = {f"boundary.{name}.law" for name in random_bases(scene)}
    for where, law, _, _ in laws_of(scene):
        if not isinstance(law, PsdLaw):
            continue
        if where not in driven:
            what = "a power spectral density is of the acceleration of a driven face"
            yield Problem(where, what, "psd", 'the law of a boundary of type = "acceleration"')
            continue
        first, last = law.frequency[0], law.frequency[-1]
        if last > HIGHEST_SHARE / step:
            allowed = f"up to {HIGHEST_SHARE:g} over the step, {HIGHEST_SHARE / step:.4g} Hz"
            remedy = f"shorter steps: time.step = {0.1 / last:.1g} has ten of them in the shortest period"
            yield Problem(where, "the specification goes beyond the steps of the run", f"{last:g} Hz", allowed, remedy)
        motion = law.motion
        shortest = motion.faded + _FEWEST / first
        if end < shortest:
            what = f"the run is too short for the lowest frequency of the specification, {first:g} Hz"
            yield Problem(where, what, f"time.end = {end:g} s", f"{shortest:.4g} s or more")
        if end > _LONGER * motion.period:
            what = "the run is longer than the motion, which would repeat itself"
            yield Problem(f"{where}.duration", what, f"{motion.period:g} s", f"time.end = {end:g} s or more, or none")


def random_lines(scene: Any) -> Iterator[str]:
    """A line for every base of random vibration: what is specified, and what this window has of it."""
    units, time = scene.unit_system, np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    for name, base in random_bases(scene).items():
        law, motion, size = base.law, base.motion, base.size
        stationary = time >= motion.faded
        of = ("acceleration", "velocity", "displacement")
        found = {key: size * float(np.std(getattr(motion, key)(time)[stationary])) for key in of}
        specified = readable(size * motion.density.rms, units.shown("m s-2"))
        levels = ", ".join(
            f"{key} {readable(found[key], units.shown(unit))}"
            for key, unit in zip(of, ("m s-2", "m s-1", "m"), strict=True)
        )
        first, last = motion.density.ends
        what = f"{first:g} to {last:g} Hz, {specified} rms, seed {law.seed}, window {law.window}"
        words = ", ".join(word for word in (law.read_as, what) if word)
        yield f"  random vibration boundary.{name}.law: {words}; rms from {motion.faded:.3g} s on: {levels}"
