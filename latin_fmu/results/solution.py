"""The result of a run: fields, dataset, file, text and report."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..latin.outcome import (
    Array,
    BoltHistory,
    InterfaceHistory,
    Outcome,
    ReactionHistory,
    SensorHistory,
    SubstructureHistory,
    Timings,
    WindowRecord,
)
from ..machine import provenance
from ..scene.sensors import Sensor
from ..scene.units import SI, UnitSystem
from .dataset import Recovered, datatree, result_blocks, result_groups, root_group
from .estimates import ErrorEstimate
from .files import write_groups
from .groups import StoredGroup, in_units
from .sensors import (
    bolt_lines,
    bolt_report,
    reaction_lines,
    reaction_report,
    sensor_lines,
    sensor_report,
    spectra_of,
    spectrum_lines,
)
from .spectra import ShockSpectrum
from .summary import report, summary

if TYPE_CHECKING:
    import xarray as xr


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

    @property
    def status(self) -> str:
        """One sentence, with a remedy where the run did not converge."""
        return self.outcome.status

    @property
    def converged(self) -> bool:
        """Whether every window reached the tolerance; whether the end can be trusted, ``trustworthy`` says."""
        return self.outcome.converged

    @property
    def trustworthy(self) -> bool:
        """Whether the run has converged, its balance of energies closes, no closed point has sunk and no body has
        turned too far (``run_checks``); ``status`` says what does not hold."""
        return self.outcome.trustworthy

    @property
    def complete(self) -> bool:
        """Whether the run reached the end of its interval."""
        return self.outcome.complete

    @property
    def interrupted(self) -> str:
        """What stopped the run before its end, a signal or its limit of CPU time; empty where nothing did."""
        return self.outcome.interrupted

    @property
    def time(self) -> Array:
        """Instants of the run, (n_time,), s."""
        return self.outcome.time

    @property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Local-stage fields by interface name."""
        return self.outcome.interfaces

    @property
    def substructures(self) -> dict[str, SubstructureHistory]:
        """Linear-stage fields by substructure name; those not requested are None."""
        return self.outcome.substructures

    @property
    def sensors(self) -> dict[str, SensorHistory]:
        """Displacement, velocity and acceleration of the sensors by name."""
        return self.outcome.sensors

    @property
    def reactions(self) -> dict[str, ReactionHistory]:
        """Forces of the supports on their bodies by boundary, where the scene requests them."""
        return self.outcome.reactions

    @property
    def bolts(self) -> dict[str, BoltHistory]:
        """Tensions of the bolts by name."""
        return self.outcome.bolts

    @cached_property
    def spectra(self) -> dict[str, ShockSpectrum]:
        """Shock response spectra of the sensors that request one, by name."""
        return spectra_of(self.outcome, self.sensor_tables)

    @property
    def windows(self) -> Sequence[WindowRecord]:
        """Record of the iteration of each window."""
        return self.outcome.windows

    @property
    def error_indicator(self) -> float:
        """The amplitude sqrt(eta) at the end of the windows, the largest of them."""
        return self.outcome.error_indicator

    @property
    def passes(self) -> float:
        """Substructure-instants solved / (substructures x instants)."""
        return self.outcome.passes

    @property
    def energy(self) -> dict[str, Array] | None:
        """Energy terms of the assembly, each (n_time,), J; None unless requested."""
        return self.outcome.energy

    @property
    def timings(self) -> Timings:
        """CPU seconds by part and peak memory."""
        return self.outcome.timings

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks about the scene and the run."""
        return self.outcome.warnings

    def to_datatree(self) -> xr.DataTree:
        """Everything as an xarray DataTree; the layout is in the docstring of ``results.dataset``."""
        return datatree(self._groups(), self.scene_name)

    def _groups(self, streamed: bool = False) -> dict[str, StoredGroup]:
        errors = None if self.estimate is None else self.estimate.spectra
        groups = {"/": root_group(self.outcome, self.scene_name, self.scene_text, self.provenance)}
        groups |= result_groups(self.outcome, self.recovered, self.sensor_tables, errors, self.surfaces, streamed)
        if self.estimate is not None and self.estimate.quantities:
            groups["/accuracy"] = self.estimate.group(self.units)
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
        blocks = None if self.outcome.stream is None else self._blocks
        write_groups(self._groups(blocks is not None), path, blocks)
        self.timings.output += clock.process_time() - start

    def summary(self) -> str:
        """Text: status, cost, tables of the interfaces and sensors, estimated errors."""
        text = "\n".join([summary(self.outcome, self.scene_name, self.units), *self._sensor_lines()])
        return text if self.estimate is None else "\n".join([text, "", *self.estimate.lines(self.units)])

    def _sensor_lines(self) -> list[str]:
        outcome, units = self.outcome, self.units
        sensors = sensor_lines(outcome, units), spectrum_lines(self.spectra, units)
        tables = bolt_lines(outcome, units), *sensors, reaction_lines(outcome, units)
        return [line for table in tables if table for line in ("", *table)]

    def report(self) -> dict[str, Any]:
        """Plain data for programs, fit for strict JSON; its keys are in ``results.summary.report``, those of
        ``sensors``, ``reactions`` and ``bolts`` in ``results.sensors``; ``units``: system of units of the scene."""
        estimate = {} if self.estimate is None else {"error_estimate": self.estimate.report(self.units)}
        sensors = {"sensors": sensor_report(self.outcome)} if self.sensors else {}
        sensors |= {"reactions": reaction_report(self.outcome)} if self.reactions else {}
        sensors |= {"bolts": bolt_report(self.outcome)} if self.bolts else {}
        return report(self.outcome) | {"units": self.units.name} | sensors | estimate
