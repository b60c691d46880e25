"""The result of a run: fields, dataset, file, text and report."""

from __future__ import annotations

import html
import time as clock
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

from ..latin.outcome import Outcome
from ..machine import provenance
from ..scene.sensors import Sensor
from ..scene.units import SI, UnitSystem
from .bolt_results import bolt_lines, bolt_report, margin_lines
from .dataset import Recovered, datatree, result_blocks, result_groups, root_group
from .estimates import ErrorEstimate, TruncationError
from .files import write_groups
from .groups import StoredGroup, in_units
from .sensors import reaction_lines, reaction_report, sensor_lines, sensor_report, spectra_of, spectrum_lines
from .sentences import named_lines, sentences, wrapped
from .spectra import ShockSpectrum
from .stresses import BodyStresses, body_stresses, stress_rows
from .summary import details as details_of
from .summary import report

if TYPE_CHECKING:
    import xarray as xr

    from .sensitivities import Sensitivities
    from .spread import Bands

T = TypeVar("T", covariant=True)


class _Part(Protocol[T]):
    """A property whose values have the type T."""

    def __get__(self, instance: Any, owner: type | None = None, /) -> T: ...


def _of(read: Callable[[Outcome], T], doc: str) -> _Part[T]:
    """Property of a solution that reads its outcome."""
    return cast("_Part[T]", property(lambda solution: read(solution.outcome), doc=doc))


@dataclass(frozen=True)
class Solution:
    """A finished run, converged or not (``status``).

    Attributes
    ----------
    outcome : arrays and records of the solver.
    scene_text : text of the effective scene, stored in results files.
    scene_name : name of the scene.
    provenance : versions and time of creation, root attributes of results files.
    estimate : estimated error of each quantity; None where it was not computed.
    recovered : requests for more fields of substructures, computed when the results are written.
    sensor_tables : tables of the sensors in the scene, with their filters and spectra.
    surfaces : whether results hold pressure and slip of the interfaces.
    units : system of units of the scene, which labels the results.
    sensitivities : derivatives by parameters of the scene; None where none are requested.
    bands : bands of results from parameters that scatter; None where none do.
    truncation : error of a march by modes that the program has chosen; None where the bodies were marched, or the scene
        asks for modes.

    Examples
    --------
    >>> solution = latin_fmu.solve(latin_fmu.load_scene("models/impact_bar/scene.toml"))
    >>> solution.save(folder / "bar.nc")
    >>> print(solution.summary().splitlines()[0])
    impact_bar: converged: 400 window(s), at most 3 iteration(s) to sqrt(eta) <= 0.001
    """

    outcome: Outcome
    scene_text: str
    scene_name: str
    provenance: dict[str, str] = field(default_factory=provenance)
    estimate: ErrorEstimate | None = None
    recovered: Mapping[str, Recovered] = field(default_factory=dict)
    sensor_tables: Mapping[str, Sensor] = field(default_factory=dict)
    surfaces: bool = False
    units: UnitSystem = SI
    sensitivities: Sensitivities | None = None
    bands: Bands | None = None
    truncation: TruncationError | None = None

    status = _of(lambda o: o.status, "One sentence, with a remedy where the run did not converge.")
    converged = _of(
        lambda o: o.converged,
        "Whether every window reached the tolerance; whether the end can be trusted, ``trustworthy`` says.",
    )
    trustworthy = _of(
        lambda o: o.trustworthy,
        "Whether the run has converged, its balance of energies closes, no closed point has sunk and no body has "
        "turned too far (``checks.run_checks``); ``status`` says what does not hold.",
    )
    complete = _of(lambda o: o.complete, "Whether the run reached the end of its interval.")
    interrupted = _of(
        lambda o: o.interrupted,
        "What stopped the run before its end, a signal or its limit of CPU time; empty where nothing did.",
    )
    time = _of(lambda o: o.time, "Instants of the run, (n_time,), s.")
    interfaces = _of(lambda o: o.interfaces, "Local-stage fields by interface name.")
    substructures = _of(
        lambda o: o.substructures, "Linear-stage fields by substructure name; those not requested are None."
    )
    sensors = _of(lambda o: o.sensors, "Displacement, velocity and acceleration of the sensors by name.")
    reactions = _of(
        lambda o: o.reactions, "Forces of the supports on their bodies by boundary, where the scene requests them."
    )
    bolts = _of(lambda o: o.bolts, "Tensions of the bolts by name.")
    windows = _of(lambda o: o.windows, "Record of the iteration of each window.")
    error_indicator = _of(
        lambda o: o.error_indicator, "The amplitude sqrt(eta) at the end of the windows, the largest of them."
    )
    passes = _of(lambda o: o.passes, "Substructure-instants solved / (substructures x instants).")
    energy = _of(lambda o: o.energy, "Energy terms of the assembly, each (n_time,), J; None unless requested.")
    timings = _of(lambda o: o.timings, "CPU seconds by part and peak memory.")
    warnings = _of(lambda o: o.warnings, "Remarks about the scene and the run.")

    @cached_property
    def spectra(self) -> dict[str, ShockSpectrum]:
        """Shock response spectra of the sensors that request one, by name."""
        return spectra_of(self.outcome, self.sensor_tables)

    @cached_property
    def stresses(self) -> dict[str, BodyStresses]:
        """Largest stresses at the nodes by body, where the scene requests them (``output.nodal_stress``)."""
        return body_stresses(self.outcome, self.recovered)

    def to_datatree(self) -> xr.DataTree:
        """Everything as an xarray DataTree; the layout is in the docstring of ``results.dataset``."""
        return datatree(self._groups(), self.scene_name)

    def _groups(self, streamed: bool = False) -> dict[str, StoredGroup]:
        errors = None
        if self.estimate is not None:
            errors = self.estimate.spectra
        groups = {"/": root_group(self.outcome, self.scene_name, self.scene_text, self.provenance)}
        groups |= result_groups(self.outcome, self.recovered, self.sensor_tables, errors, self.surfaces, streamed)
        if self.estimate is not None and self.estimate.quantities:
            groups["/accuracy"] = self.estimate.group(self.units)
        if self.sensitivities is not None:
            groups |= self.sensitivities.groups(self.units)
        if self.bands is not None:
            groups |= self.bands.groups(self.units)
        return in_units(groups, self.units)

    def _blocks(self) -> Iterator[dict[str, StoredGroup]]:
        """Groups of a streamed run, block by block."""
        return (in_units(block, self.units) for block in result_blocks(self.outcome, self.surfaces))

    def save(self, path: str | Path) -> None:
        """Write a netCDF-4 file, complete or not at all; its CPU time is added to ``timings.output``.

        Raises
        ------
        ResultsError : the file cannot be written.
        """
        start = clock.process_time()
        blocks = None
        if self.outcome.stream is not None:
            blocks = self._blocks
        write_groups(self._groups(blocks is not None), path, blocks)
        self.timings.output += clock.process_time() - start

    def summary(self, details: bool = False) -> str:
        """Text: status and remarks, a sentence on each interface, bolt, sensor and support, cost.

        details : also the course of the iteration, energies, tables of the same, and all estimated errors.
        """
        lines = [f"{self.scene_name}: {self.status}", *(f"  warning: {warning}" for warning in self.warnings)]
        if said := sentences(self.outcome, self.units, self.estimate, self.spectra, self.sensor_tables):
            lines += ["", *said]
        if margins := margin_lines(self.outcome):
            lines += ["", *margins]
        if self.stresses:
            lines += ["", *named_lines(stress_rows(self.stresses, self.units))]
        if self.sensitivities is not None and (self.bands is None or not self.bands.alone):
            lines += ["", *self.sensitivities.lines(self.units)]
        if self.bands is not None:
            lines += ["", *self.bands.lines(self.units)]
        lines += ["", *self._cost()]
        if details:
            lines += ["", *details_of(self.outcome, self.units), *self._sensor_lines()]
            if self.estimate is not None:
                lines += ["", *self.estimate.lines(self.units)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The summary, for notebooks."""
        return f"<pre>{html.escape(self.summary())}</pre>"

    def _cost(self) -> list[str]:
        """CPU time and memory of the run and of its estimate, with what that does not cover."""
        text = f"  cost  {self.timings.total:.3g} s of CPU"
        if self.estimate is not None and self.estimate.quantities:
            text += f", error estimate by coarser runs {self.estimate.cpu:.2g} s"
        remarks = []
        if self.estimate is not None:
            remarks = [*self.estimate.remarks]
        if self.truncation is not None:
            marched = self.outcome.settings["propagator"]
            remarks.append(
                f"time integration by {marched}; its error, estimated from fewer modes: {self.truncation.in_words()}"
            )
        notes = (line for remark in remarks for line in wrapped("note", remark))
        return [f"{text}; peak memory {self.timings.peak_memory / 1e6:.0f} MB", *notes]

    def _sensor_lines(self) -> list[str]:
        outcome, units = self.outcome, self.units
        sensors = sensor_lines(outcome, units), spectrum_lines(self.spectra, units)
        tables = bolt_lines(outcome, units), *sensors, reaction_lines(outcome, units)
        return [line for table in tables if table for line in ("", *table)]

    def report(self) -> dict[str, Any]:
        """Plain data for programs, fit for strict JSON; its keys are in ``results.summary.report``, those of
        ``sensors``, ``reactions`` and ``bolts`` in ``results.sensors``; ``units``: system of units of the scene."""
        estimate = {}
        if self.estimate is not None:
            estimate = {"error_estimate": self.estimate.report(self.units)}
        sensors = {}
        if self.sensors:
            sensors = {"sensors": sensor_report(self.outcome)}
        if self.reactions:
            sensors |= {"reactions": reaction_report(self.outcome)}
        if self.bolts:
            sensors |= {"bolts": bolt_report(self.outcome)}
        if self.stresses:
            sensors |= {"stresses": {name: found.report() for name, found in self.stresses.items()}}
        if self.sensitivities is not None:
            sensors |= {"sensitivities": self.sensitivities.report(self.units)}
        if self.bands is not None:
            sensors |= {"bands": self.bands.report(self.units)}
        return report(self.outcome) | {"units": self.units.name} | sensors | estimate
