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
from ..scene.limits import Limit
from ..scene.readable_numbers import aligned
from ..scene.sensors import Sensor
from ..scene.units import SI, UnitSystem
from .bolt_results import bolt_report, bolt_rows, margin_lines, margin_notes, margin_rows, section_rows
from .dataset import Recovered, datatree, result_blocks, result_groups, root_group
from .estimates import ErrorEstimate, TruncationError
from .files import write_groups
from .groups import StoredGroup, in_units
from .limits import LimitCheck, limit_checks, limit_groups, limit_rows
from .model import BodySize, model_group
from .prices import IN_SUMMARY
from .sensors import reaction_report, reaction_rows, sensor_report, sensor_rows, spectra_of, spectrum_rows
from .sentences import named_lines, sentence_rows, wrapped
from .spectra import ShockSpectrum
from .stresses import BodyStresses, body_stresses, largest_body, stress_rows
from .summary import course_rows, interface_rows, report, summary_group
from .summary import details as details_of

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
    limit_tables : limits of the scene, that the run is judged by.
    bodies : sizes of the bodies by name, stored in results files.
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
    limit_tables: Mapping[str, Limit] = field(default_factory=dict)
    bodies: Mapping[str, BodySize] = field(default_factory=dict)
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

    @cached_property
    def limits(self) -> dict[str, LimitCheck]:
        """Limits of the scene beside what the run has, by name."""
        return limit_checks(self.outcome, self.limit_tables)

    def to_datatree(self) -> xr.DataTree:
        """Everything as an xarray DataTree; the layout is in the docstring of ``results.dataset``."""
        return datatree(self._groups(), self.scene_name)

    def _groups(self, streamed: bool = False) -> dict[str, StoredGroup]:
        errors = None
        if self.estimate is not None:
            errors = self.estimate.spectra
        groups = {"/": root_group(self.outcome, self.scene_name, self.scene_text, self.provenance)}
        groups |= result_groups(self.outcome, self.recovered, self.sensor_tables, errors, self.surfaces, streamed)
        groups |= limit_groups(self.limits, self.units)
        if self.bodies:
            groups["/model"] = model_group(self.bodies)
        groups["/summary"] = summary_group(self._parts)
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
        """Text: status and remarks, a sentence on each interface, bolt, sensor, support and limit, cost.

        details : also the course of the iteration, energies, tables of the same, and all estimated errors.
        """
        lines = [f"{self.scene_name}: {self.status}", *(f"  warning: {warning}" for warning in self.warnings)]
        if said := self._sentences():
            lines += ["", *named_lines(said)]
        if self.limits:
            lines += ["", *named_lines(limit_rows(self.limits, self.units))]
        if margins := margin_lines(self.outcome, self.estimate):
            lines += ["", *margins]
        if self.stresses:
            lines += ["", *named_lines(stress_rows(self.stresses, self.units))]
        if self.sensitivities is not None and (self.bands is None or not self.bands.alone):
            lines += ["", *self.sensitivities.lines(self.units)]
        if self.bands is not None:
            lines += ["", *self.bands.lines(self.units)]
        lines += ["", *(line for row in self._cost() for line in wrapped(*row))]
        if self.estimate is not None and len(prices := self.estimate.price_rows(None if details else IN_SUMMARY)) > 1:
            lines += ["", *aligned(prices)]
        if details:
            lines += ["", *details_of(self.outcome, self.units)]
            lines += [line for rows in self._tables().values() if rows for line in ("", *aligned(rows))]
            if self.estimate is not None:
                lines += ["", *self.estimate.lines(self.units)]
        return "\n".join(lines)

    def _sentences(self) -> list[tuple[str, str]]:
        return sentence_rows(self.outcome, self.units, self.estimate, self.spectra, self.sensor_tables)

    def _tables(self) -> dict[str, list[tuple[str, ...]]]:
        """Tables of bolts, sensors and supports."""
        outcome, units = self.outcome, self.units
        return {
            "bolts": bolt_rows(outcome, units),
            "sections": section_rows(outcome, units),
            "sensors": sensor_rows(outcome, units),
            "spectra": spectrum_rows(self.spectra, units),
            "supports": reaction_rows(outcome, units),
        }

    @cached_property
    def _parts(self) -> dict[str, Any]:
        """Sentences and tables of the summary by name, for the file; once, as writing it adds to the cost."""
        outcome, units = self.outcome, self.units
        parts: dict[str, Any] = {
            "sentences": self._sentences(),
            "limits": limit_rows(self.limits, units),
            "margins": margin_rows(outcome, self.estimate),
            "margin_notes": margin_notes(outcome),
            "stresses": stress_rows(self.stresses, units),
            "course": course_rows(outcome, units),
            "largest_stress": largest_body(self.stresses),
            "cost": self._cost(),
            "interfaces": interface_rows(outcome, units),
        }
        if self.estimate is not None:
            parts["accuracy"] = self.estimate.rows(units)
            parts["prices"] = self.estimate.price_rows()
        if self.bands is not None:
            parts["bands"] = self.bands.lines(units)
        return parts | self._tables()

    def _repr_html_(self) -> str:
        """The summary, for notebooks."""
        return f"<pre>{html.escape(self.summary())}</pre>"

    def _cost(self) -> list[tuple[str, str]]:
        """CPU time and memory of the run and of its estimate, with what that does not cover: name and text."""
        text = f"{self.timings.total:.3g} s of CPU"
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
        text += f"; peak memory {self.timings.peak_memory / 1e6:.0f} MB"
        return [("cost", text), *(("note", remark) for remark in remarks)]

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
        if self.limits:
            sensors |= {"limits": {name: of.report() for name, of in self.limits.items()}}
        if self.sensitivities is not None:
            sensors |= {"sensitivities": self.sensitivities.report(self.units)}
        if self.bands is not None:
            sensors |= {"bands": self.bands.report(self.units)}
        return report(self.outcome) | {"units": self.units.name} | sensors | estimate
