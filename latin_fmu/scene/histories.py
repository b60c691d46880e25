"""Histories from files in a scene: what each does inside the run, and what speaks against its times."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..errors import Problem
from .body_loads import body_loads_of
from .boundaries import Driven
from .laws import CsvLaw, SrsLaw
from .number_files import factor
from .ports import INPUT_UNITS, TRANSLATIONS
from .records import FEWEST_SAMPLES, inside_run, misfits, peak_of
from .unit_texts import names_for, si_unit, words_for
from .units import UnitSystem

_INTEGRALS: Final = {"m s-1": "m", "m s-2": "m s-1", "N m-3": "N s m-3", "rad s-1": "rad"}
"""Units of integrals over time that are not those of the quantity times s, by that of the quantity; UDUNITS."""
_FIRST_SAMPLES: Final = 2  # inside the run, of a record


@dataclass(frozen=True)
class SceneHistory:
    """A history from a file and what it multiplies.

    Attributes
    ----------
    where : place of the law in the scene. law : of the file or of a specification. unit : UDUNITS, SI, of what the law
    multiplies. size : of that where the law is 1, in the units of the scene. end : of the run, s.
    """

    where: str
    law: CsvLaw | SrsLaw
    unit: str
    size: float
    end: float

    def report(self) -> dict[str, Any]:
        """Plain data: peak (in the units of the scene) and its time, integral, span and samples inside the run."""
        peak, at = peak_of(self.law, self.end)
        first, last, count = inside_run(self.law.times, self.end)
        return {
            "law": self.where,
            "file": self.law.file or None,
            "read_as": self.law.read_as,
            "peak": self.size * peak,
            "peak_time": at,
            "integral": self.size * self.law.impulse(0.0, self.end),
            "span": [first, last],
            "samples": count,
        }

    def line(self, units: UnitSystem) -> str:
        """Peak, integral and span inside the run, in words."""
        found = self.report()
        peak = f"{found['peak']:.4g} {units[self.unit]}"
        named = self.law.units[1]
        if isinstance(named, str) and si_unit(named) == self.unit and factor(named, units) != 1.0:
            peak = f"{found['peak'] / factor(named, units):.4g} {named} ({peak})"
        integral = f"{found['integral']:.4g} {units[_INTEGRALS.get(self.unit, f'{self.unit} s')]}"
        first, last = found["span"]
        inside = f"from {first:.4g} to {last:.4g} s of 0 to {self.end:.4g} s, {found['samples']} samples"
        words = ", ".join(word for word in (self.law.file, self.law.read_as) if word)
        return f"  history {self.where}: {words}; in the run {inside}, peak {peak} at {found['peak_time']:.4g} s, " + (
            f"integral {integral}"
        )

    def remarks(self) -> Iterator[str]:
        """What speaks against its times."""
        return (f"{self.where}: {text}" for text in misfits(self.law, self.end))

    def problems(self) -> Iterator[Problem]:
        """A record without content in the run, or of another quantity than the law multiplies."""
        law, end = self.law, self.end
        if isinstance(law, SrsLaw) and self.unit != "m s-2":
            what = f"a shock response spectrum is of an acceleration, but the law multiplies {words_for(self.unit)}"
            remedy = 'drive the face by type = "acceleration", or use accelerations of the base'
            yield Problem(self.where, what, "srs", "laws of accelerations", remedy)
        unit = law.units[1]
        name = None
        if isinstance(unit, str):
            name = si_unit(unit)
        if name not in (None, "1", self.unit):
            what = f"the header says {words_for(str(name))}, but the law multiplies {words_for(self.unit)}"
            allowed = names_for(self.unit)
            yield Problem(f"{self.where}.value_unit", what, str(unit), allowed, "name another column")
        count = inside_run(law.times, end)[2]
        outside = law.times[0] >= end or law.times[-1] <= 0.0
        if outside or (len(law.times) >= FEWEST_SAMPLES and count < _FIRST_SAMPLES):
            what = f"nothing of the record is inside the run: {count} of {len(law.times)} samples"
            span = f"{law.times[0]:.6g} to {law.times[-1]:.6g} s"
            remedy = 'check time_unit and time.end; start = "record" moves t = 0 to the first sample, shift moves all'
            yield Problem(self.where, what, span, f"samples from 0 to {end:.6g} s", remedy)


def histories_of(scene: Any) -> list[SceneHistory]:
    """Histories from files and specifications of a scene."""
    acting = ((where, law, unit, size) for where, law, unit, size in laws_of(scene) if isinstance(law, CsvLaw | SrsLaw))
    return [SceneHistory(*of, scene.time.end) for of in acting]


def history_problems(scene: Any) -> list[Problem]:
    """Histories from files that do not fit the run of a scene."""
    return [problem for history in histories_of(scene) for problem in history.problems()]


def _norm(values: Any) -> float:
    return float(np.linalg.norm(np.atleast_1d(values)))


_DRIVEN: Final = {"velocity": "m s-1", "displacement": "m", "acceleration": "m s-2"}


def laws_of(scene: Any) -> Iterator[tuple[str, Any, str, float]]:
    """Place of every law, the law, unit and size of what it multiplies."""
    for name, load in scene.load.items():
        yield f"load.{name}.law", load.law, load.unit, abs(load.amount)
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, Driven):
            yield f"boundary.{name}.law", boundary.law, _DRIVEN[boundary.type], _norm(boundary.value)
    for name, port in scene.port.items():
        along, about = INPUT_UNITS[port.causality == "motion_in"]
        for component, law in port.laws.items():
            yield f"port.{name}.laws.{component}", law, along if component in TRANSLATIONS else about, 1.0
    for name, interface in scene.interface.items():
        if (ground := interface.ground_velocity) is not None:
            yield f"interface.{name}.ground_velocity.law", ground.law, "m s-1", abs(ground.amplitude)
    for acting in body_loads_of(scene):
        yield acting.kind.place(acting.of), acting.law, acting.kind.unit, acting.amount


def history_lines(scene: Any) -> list[str]:
    """A line for every history from a file."""
    return [history.line(scene.unit_system) for history in histories_of(scene)]


def history_remarks(scene: Any) -> list[str]:
    """What speaks against the times of histories from files."""
    return [text for history in histories_of(scene) for text in history.remarks()]
