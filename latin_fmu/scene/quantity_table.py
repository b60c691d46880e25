"""Quantities of a run: one row each, with name, unit, meaning, how it is computed, where it appears, error constants.

A quantity belongs to an interface, a sensor, a bolt, a support, to the energies or to the run as a whole, and is
computed by one function from the record of its owner: ``InterfaceRecord``, ``SensorRecord``, ``BoltRecord`` of
``results.owner_records``, a ``ReactionHistory``, the ``Outcome`` of the run. Reports, files, studies, derivatives,
bands and estimates go through the rows. The table stands here because a scene names quantities
(``accuracy.quantity``); it knows nothing of records but the names of their attributes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

Value = Callable[[Any], float | None]
"""A quantity from the record of its owner; None where this owner has none."""
Use = Literal["derivatives", "study", "estimate"]
"""What takes quantities by key: derivatives with their bands and samples, studies, estimates of errors."""
Distance = Literal["value", "vector", "history", "peak", "spectrum"]
"""How far two runs are apart in a quantity: by values, by vectors at the end, by the L2 norm of the difference of
histories, by values but in estimates by histories near the peak, by the largest relative difference of spectra."""
Doubt = Literal["events", "at_events", "at_peak", "near_instant", "closing", "sliding"]
"""When the derivative of a quantity is flagged (``results.sensitivities``): by the share of all change of force that
happens at events; where that outweighs the change of an integral, or of a mean about its peak; where an instant is one;
where no gap gives the instant; where many points change between stick and slip."""

INTERFACE: Final = "interface"
SENSOR: Final = "sensor"
BOLT: Final = "bolt"
BOUNDARY: Final = "boundary"
ENERGY: Final = "energy"
"""Owner of the terms of the energies of the assembly."""
RUN: Final = "run"
FLOOR: Final = 1e-3
"""Smallest relative error that is reported: smaller ones count as this."""
ITERATION_ERROR: Final = 0.5
"""Relative error of an impulse due to the iteration, over the tolerance on sqrt(eta): the largest of eight scenes at
two resolutions, tolerances 1e-1 to 1e-4. Instants less, friction work up to 2."""
LEAST_INSTANT: Final = 1e-2
"""Share of the interval that the scale of an instant is at least: one near 0 would have any relative error."""
LEAST_WORK: Final = 1e-3
"""Share of impulse x largest velocity that the scale of a work is at least: that of a joint that hardly slides would be
next to 0."""


@dataclass(frozen=True)
class EntryOf:
    """The value of a series at one place: its derivative is that of the series there.

    Attributes
    ----------
    series : array of a record. place : index in it.
    """

    series: Callable[[Any], Any]
    place: Callable[[Any], tuple[int, ...]]

    def __call__(self, record: Any) -> float:
        """The value."""
        return float(self.series(record)[self.place(record)])

    def change(self, record: Any, derivative: Any) -> float:
        """Derivative of the value, from the record of the derivatives."""
        return float(self.series(derivative)[self.place(record)])


@dataclass(frozen=True)
class RunScalar:
    """A scalar of a run: its row.

    Attributes
    ----------
    key : last part of the name of a quantity, ``interface.key``, ``sensor.key`` or ``bolt.key``. unit : UDUNITS.
    long_name : what it is. owner : kind of its owner. value : from the record of the owner.
    derivatives, study : attributes of the record, between spaces, without which it has no derivative, or is no variable
        of a study; None for never.
    report : name in the report of its owner, None where it is not there; the key where empty.
    stored : long name and, behind a bar, comment in the group of its owner in a file, None where it is not there; the
        long name where empty.
    doubt : when its derivative is flagged. last : instant, as a number, up to which the histories decide it; the end
        where None. points : whether it needs the fields at the points of an interface, of which very long runs have
        only blocks of instants. total : key of the quantity of interfaces that it is the sum of, else empty.
    """

    key: str
    unit: str
    long_name: str
    owner: str
    value: Value
    derivatives: str | None = ""
    study: str | None = ""
    report: str | None = ""
    stored: str | None = ""
    doubt: Doubt = "events"
    last: Callable[[Any], int] | None = None
    points: bool = False
    total: str = ""

    @property
    def estimate(self) -> str | None:
        """As ``study``, of estimates: it has none."""
        return None

    def serves(self, use: Use, record: Any) -> bool:
        """Whether it is for a use, of an owner with this record."""
        needs: str | None = getattr(self, use)
        return needs is not None and all(getattr(record, need) for need in needs.split())


@dataclass(frozen=True, kw_only=True)
class QuantityOfInterest(RunScalar):
    """A scalar with an estimated error: the constants of that (``accuracy.estimate.estimated_error``).

    The factors are chosen so that the estimates of 95 % (with a third run) and 96 % (without) of the cases of random
    chains of unlike bars with exact solutions are not below the true error (``tests/verification/strangers.py``, even
    seeds); those of friction work and tension of bolts with the same on random 3-D scenes
    (``tests/verification/solid_strangers.py``).

    Attributes
    ----------
    scale : what its error is divided by; ``size`` : that, from the record and the value; the value where None.
    safety : factor on the extrapolated changes, with a third run. alone : on the last one, without.
    share, of : without a third run so much of the relative change of another quantity of the owner is added, of a
        history, which is not small by chance; of none where empty.
    order : expected order of convergence when mesh and time step are refined together, with fronts: 1, but 1/2 for the
        L2 norm of a history that jumps. Up to twice that without fronts.
    iteration : error left by the iteration, over the tolerance on sqrt(eta); largest measured on eight scenes.
    distance : between two runs. history : signal of the record that the distance is of; it has no estimate where that
        is None.
    measured : as ``study``, of estimates. rank : place among the estimates of an owner.
    mean : a mean over a duration that the run compared with defines. instant : an instant, at the end of the run where
        it has none. unlimited : it grows without limit as the mesh is refined, where bodies land. steady : promised
        only where its changes decrease steadily. rests : key of the history that it is no more certain than.
    """

    scale: str
    safety: float
    alone: float
    order: float = 1.0
    share: float = 0.0
    of: str = ""
    iteration: float = ITERATION_ERROR
    distance: Distance = "value"
    history: Callable[[Any], Any] | None = None
    size: Callable[[Any, float], float] | None = None
    measured: str = ""
    rank: int = 100
    mean: bool = False
    instant: bool = False
    unlimited: bool = False
    steady: bool = False
    rests: str = ""
    headline: bool = False

    @property
    def estimate(self) -> str:
        """As ``study``, of estimates."""
        return self.measured

    @property
    def absolute(self) -> bool:
        """Whether its error is absolute, in its unit: nothing that a value near 0 could be divided by."""
        return self.scale.startswith("1:")

    @property
    def norm(self) -> bool:
        """Whether its change between two runs is a norm of a difference of histories, which is not small by chance."""
        return self.distance in ("history", "peak", "spectrum")

    def with_scale(self, record: Any) -> tuple[float, float] | None:
        """Value and what its error is divided by; None where the owner has none."""
        value = self.value(record)
        if value is None and self.instant:
            value = record.end
        if value is None:
            return None
        return value, value if self.size is None else self.size(record, value)


def _instant_size(record: Any, value: float) -> float:
    return max(value, LEAST_INSTANT * float(record.end))


def _first_contact(record: Any) -> float | None:
    """After a gap the instant at which it closes, else that at which the force begins."""
    if not record.loaded:
        return None
    instant: float = record.closing
    if record.closing is None:
        instant = record.force.begin()
    return instant


def _separation(record: Any) -> float | None:
    instant: float | None = None
    if record.loaded:
        instant = record.force.separation(record.duration)
    return instant


QUANTITIES: Final[tuple[RunScalar, ...]] = (
    QuantityOfInterest(
        "impulse",
        "N s",
        "normal force integrated over time",
        INTERFACE,
        lambda r: r.force.impulse(),
        derivatives="transient",
        report=None,  # that of the report and of the file is a vector
        stored=None,
        doubt="at_events",
        scale="integral of the magnitude of the force",
        size=lambda r, _: r.force.impulse_of_size(),  # forces of both signs may have no impulse at all
        safety=1.35,
        alone=2.7,
        share=0.05,
        of="force_rms",
        rank=0,
    ),
    QuantityOfInterest(
        "peak_force",
        "N",
        "largest mean of the normal force over the peak duration",
        INTERFACE,
        lambda r: r.force.largest_mean(r.duration),
        stored="largest mean of the normal resultant over the time of the attribute peak_duration (s)",
        doubt="at_peak",
        scale="itself",
        headline=True,
        safety=0.64,
        alone=0.79,
        distance="peak",
        mean=True,
        rank=3,
    ),
    QuantityOfInterest(
        "peak_force_raw",
        "N",
        "largest normal force of all instants; has no limit where bodies land",
        INTERFACE,
        lambda r: r.force.raw_peak(),
        derivatives=None,
        stored="largest normal resultant of all instants | has no limit where bodies land",
        scale="itself",
        safety=1.0,
        alone=0.6,
        share=0.8,
        of="force_rms",
        distance="peak",
        unlimited=True,
        rank=4,
    ),
    QuantityOfInterest(
        "first_contact",
        "s",
        "instant at which the normal force first exceeds 1 % of its peak (after a gap: at which the gap closes)",
        INTERFACE,
        _first_contact,
        derivatives="opens transient",
        study="opens",
        report="first_contact_time",
        stored=None,
        doubt="closing",
        scale="the instant itself, at least a hundredth of the interval",
        size=_instant_size,
        safety=1.15,
        alone=2.8,
        share=0.02,
        of="force_rms",
        iteration=0.15,
        measured="opens",
        rank=1,
        instant=True,
    ),
    QuantityOfInterest(
        "separation",
        "s",
        "instant from which on the mean of the normal force over the peak duration stays below a tenth of the peak "
        "force",
        INTERFACE,
        _separation,
        derivatives="opens transient",
        study="opens",
        report="separation_time",
        stored=None,
        doubt="near_instant",
        scale="the instant itself, at least a hundredth of the interval",
        size=_instant_size,
        safety=1.9,
        alone=2.8,
        share=0.05,
        of="force_rms",
        iteration=0.3,
        measured="opens",
        rank=2,
        mean=True,
        instant=True,
        rests="force_rms",
    ),
    QuantityOfInterest(
        "force_rms",
        "N",
        "root mean square of the normal force over the run; its error is that of the difference",
        INTERFACE,
        lambda r: r.force.root_mean_square(),
        derivatives=None,
        report=None,
        stored=None,
        scale="itself",
        safety=0.75,
        alone=0.8,
        order=0.5,
        iteration=1.0,
        distance="history",
        rank=5,
    ),
    QuantityOfInterest(
        "friction_work",
        "J",
        "work dissipated by friction",
        INTERFACE,
        lambda r: r.friction_work,
        derivatives="friction",
        study="may_slide",
        report=None,
        points=True,
        stored=None,
        doubt="sliding",
        scale="itself, a thousandth of impulse x largest velocity at least",
        size=lambda r, work: max(work, LEAST_WORK * r.force.impulse_of_size() * r.largest_velocity),  # N s m/s = J
        headline=True,
        safety=1.0,
        alone=4.3,
        iteration=2.0,
        measured="slides",
        rank=6,
        steady=True,
        rests="force_rms",
    ),
    RunScalar(
        "slip",
        "m",
        "distance that the points have slid in contact at the end of the run, mean over the area",
        INTERFACE,
        lambda r: float(r.way[-1] @ r.areas / r.areas.sum()),
        derivatives="friction",
        study=None,
        report=None,
        points=True,
        stored=None,
        doubt="sliding",
    ),
    RunScalar(
        "largest_slip",
        "m",
        "largest distance that a point has slid in contact at an instant",
        INTERFACE,
        lambda r: float(r.way.max(initial=0.0)),
        derivatives="friction",
        study="opens whole",
        report=None,
        points=True,
        stored=None,
        doubt="sliding",
    ),
    RunScalar(
        "largest_force",
        "N",
        "largest resultant of an interface that cannot open",
        INTERFACE,
        lambda r: r.largest_resultant,
        derivatives="bonded",
        study=None,
        report=None,
        points=True,
        stored=None,
    ),
    RunScalar(
        "slip_share",
        "1",
        "largest share of the area that slips at one instant",
        INTERFACE,
        lambda r: r.slip_share,
        derivatives=None,
        study="opens",
        report=None,
        points=True,
        stored=None,
    ),
    QuantityOfInterest(
        "displacement",
        "m",
        "displacement of a sensor at the end",
        SENSOR,
        lambda r: r.displacement.last(),
        report=None,
        stored=None,
        scale="largest displacement of the sensor",
        size=lambda r, _: r.displacement.peak(),
        safety=1.0,
        alone=2.4,
        share=0.5,
        of="displacement_rms",
        distance="vector",
    ),
    QuantityOfInterest(
        "displacement_peak",
        "m",
        "largest displacement of a sensor",
        SENSOR,
        lambda r: r.displacement.peak(),
        report="largest_displacement",
        stored=None,
        last=lambda r: r.displacement.peak_at(),
        scale="itself",
        headline=True,
        safety=1.15,
        alone=0.6,
        share=0.8,
        of="displacement_rms",
        distance="peak",
        history=lambda r: r.displacement,
    ),
    QuantityOfInterest(
        "displacement_rms",
        "m",
        "root mean square of the displacement of a sensor over the run; its error is that of the difference",
        SENSOR,
        lambda r: r.displacement.root_mean_square(),
        derivatives=None,
        study=None,
        report=None,
        stored=None,
        scale="itself",
        safety=1.25,
        alone=1.5,
        distance="history",
        history=lambda r: r.displacement,
    ),
    QuantityOfInterest(
        "velocity_rms",
        "m s-1",
        "root mean square of the velocity of a sensor over the run; its error is that of the difference",
        SENSOR,
        lambda r: r.velocity.root_mean_square(),
        derivatives=None,
        study=None,
        report=None,
        stored=None,
        measured="moves",
        scale="itself",
        safety=0.68,
        alone=0.78,
        order=0.5,
        iteration=1.0,
        distance="history",
        history=lambda r: r.velocity,
    ),
    QuantityOfInterest(
        "spectrum",
        "m s-2",
        "shock response spectrum (maximax) in the band of the mesh, largest relative difference over the frequencies",
        SENSOR,
        lambda r: float(r.maximax.values.max()),
        derivatives=None,
        study=None,
        report=None,
        stored=None,
        scale="itself, frequency by frequency",
        headline=True,
        safety=1.95,
        alone=1.5,
        share=0.8,
        of="velocity_rms",
        distance="spectrum",
        history=lambda r: r.maximax,
    ),
    QuantityOfInterest(
        "velocity_peak",
        "m s-1",
        "largest velocity of a sensor in the band of its filter, or of the mesh",
        SENSOR,
        lambda r: r.velocity_in_band.peak(),
        derivatives=None,
        study=None,
        report=None,
        stored=None,
        scale="itself",
        safety=0.68,
        alone=0.5,
        share=0.2,
        of="velocity_rms",
        distance="peak",
        history=lambda r: r.velocity_in_band,
    ),
    QuantityOfInterest(
        "acceleration_peak",
        "m s-2",
        "largest acceleration of a sensor in the band of its filter, or of the mesh",
        SENSOR,
        lambda r: r.acceleration_in_band.peak(),
        derivatives=None,
        study=None,
        report=None,
        stored=None,
        scale="itself",
        headline=True,
        safety=0.61,
        alone=0.67,
        distance="peak",
        history=lambda r: r.acceleration_in_band,
    ),
    RunScalar(
        "velocity_peak_unfiltered",
        "m s-1",
        "largest unfiltered velocity of a sensor",
        SENSOR,
        lambda r: None if r.velocity is None else r.velocity.peak(),
        derivatives="moves",
        study="moves",
        report="largest_unfiltered_velocity",
        stored=None,
        last=lambda r: r.velocity.peak_at(),
    ),
    RunScalar(
        "acceleration_peak_unfiltered",
        "m s-2",
        "largest unfiltered acceleration of a sensor",
        SENSOR,
        lambda r: None if r.acceleration is None else r.acceleration.peak(),
        derivatives="moves",
        study="moves",
        report="largest_unfiltered_acceleration",
        stored=None,
        last=lambda r: r.acceleration.peak_at(),
    ),
    RunScalar(
        "spectrum_peak",
        "m s-2",
        "largest value of the maximax spectrum of a sensor",
        SENSOR,
        EntryOf(lambda r: r.spectrum.acceleration[0], lambda r: r.largest_of_spectrum),
        derivatives="has_spectrum",
        study=None,
        report=None,
        stored=None,
    ),
    QuantityOfInterest(
        "largest_bolt_force",
        "N",
        "largest tension of a bolt",
        BOLT,
        EntryOf(lambda r: r.tension.values[:, 0], lambda r: (int(r.tension.values.argmax()),)),
        report="largest",
        stored=None,
        last=lambda r: int(r.tension.values.argmax()),
        scale="itself",
        headline=True,
        safety=0.5,
        alone=0.35,
        distance="peak",
        history=lambda r: r.tension,
    ),
    QuantityOfInterest(
        "margin",
        "1",
        "margin of a bolt: its smallest safety by VDI 2230-1 less 1, of all checks but separation",
        BOLT,
        lambda r: r.margin,
        derivatives=None,
        study="checked",
        report=None,
        stored=None,
        scale="1: its error is absolute",
        size=lambda *_: 1.0,
        headline=True,
        safety=1.35,
        alone=2.0,
        share=1.0,
        of="largest_bolt_force",
        measured="checked",
    ),
    RunScalar(
        "last_bolt_force",
        "N",
        "tension of a bolt at the last instant",
        BOLT,
        EntryOf(lambda r: r.tension.values[:, 0], lambda _: (-1,)),
        report="last",
        stored=None,
    ),
    RunScalar(
        "peak_reaction",
        "N",
        "largest force of a support on its body",
        BOUNDARY,
        lambda r: float(np.linalg.norm(r.force, axis=1).max(initial=0.0)),
        report="largest",
        stored=None,
    ),
    RunScalar(
        "friction_dissipation",
        "J",
        "energy that friction dissipates in all interfaces",
        ENERGY,
        lambda outcome: float(outcome.energy["friction_dissipation"][-1]),
        study=None,  # which has all terms of the energies
        report=None,
        stored=None,
        total="friction_work",
    ),
    RunScalar(
        "penetration",
        "m",
        "largest penetration of all interfaces",
        RUN,
        lambda outcome: outcome.penetration(),
        study="complete",
        report=None,  # as the next ones: the report has it in its place
    ),
    RunScalar(
        "iterations",
        "1",
        "iterations of all windows",
        RUN,
        lambda outcome: float(sum(window.iterations for window in outcome.windows)),
        report=None,
    ),
    RunScalar(
        "passes",
        "1",
        "substructure-instants solved over substructures x instants",
        RUN,
        lambda outcome: outcome.passes,
        report=None,
    ),
    RunScalar(
        "error_indicator",
        "1",
        "sqrt(eta) at the end of the windows, largest",
        RUN,
        lambda outcome: outcome.error_indicator,
        report=None,
    ),
    RunScalar(
        "cpu_set_up",
        "s",
        "CPU time of meshes, matrices, factors and tables",
        RUN,
        lambda outcome: outcome.timings.setup,
        report=None,
    ),
)
"""All scalars of a run, a row each, in the order of tables."""
QUANTITIES_OF_INTEREST: Final = tuple(
    sorted((q for q in QUANTITIES if isinstance(q, QuantityOfInterest)), key=lambda q: q.rank)
)
"""Those with an estimated error, in the order of estimates."""
RUN_SCALARS: Final[Mapping[str, RunScalar]] = MappingProxyType({row.key: row for row in QUANTITIES})
"""All scalars by key."""
QUANTITY_OWNERS: Final[Mapping[str, str]] = MappingProxyType({row.key: row.owner for row in QUANTITIES_OF_INTEREST})
"""Kinds of quantities with an estimated error, and the tables of the scene with their owners."""


def rows_of(owner: str) -> Iterator[RunScalar]:
    """Rows of one kind of owner."""
    return (row for row in QUANTITIES if row.owner == owner)


def values_of(use: Use, owner: str, record: Any) -> dict[str, float]:
    """Quantities of an owner by key, those that it has for a use."""
    values = {row.key: row.value(record) for row in rows_of(owner) if row.serves(use, record)}
    return {key: value for key, value in values.items() if value is not None}


def definition_of(quantity: str) -> QuantityOfInterest:
    """Definition of the quantity ``owner.key``.

    >>> definition_of("crush.impulse").unit
    'N s'
    """
    found = RUN_SCALARS[quantity.rpartition(".")[2]]
    assert isinstance(found, QuantityOfInterest), f"{quantity} has no estimated error"
    return found


def in_words(quantity: str) -> str:
    """Name of a quantity in words.

    >>> in_words("crush.peak_force")
    'crush peak force'
    """
    owner, _, key = quantity.rpartition(".")
    return f"{owner} {key.replace('_', ' ')}"


# what columns of measured data, sentences and panels are about
IMPULSE: Final = definition_of("impulse")
FIRST_CONTACT: Final = definition_of("first_contact")
SEPARATION: Final = definition_of("separation")
PEAK_FORCE: Final = definition_of("peak_force")
PEAK_FORCE_RAW: Final = definition_of("peak_force_raw")
FRICTION_WORK: Final = definition_of("friction_work")
FORCE_RMS: Final = definition_of("force_rms")
DISPLACEMENT: Final = definition_of("displacement")
DISPLACEMENT_PEAK: Final = definition_of("displacement_peak")
DISPLACEMENT_RMS: Final = definition_of("displacement_rms")
VELOCITY_PEAK: Final = definition_of("velocity_peak")
VELOCITY_RMS: Final = definition_of("velocity_rms")
VELOCITY_UNFILTERED: Final = RUN_SCALARS["velocity_peak_unfiltered"]
ACCELERATION_PEAK: Final = definition_of("acceleration_peak")
ACCELERATION_UNFILTERED: Final = RUN_SCALARS["acceleration_peak_unfiltered"]
SPECTRUM: Final = definition_of("spectrum")
LARGEST_BOLT_FORCE: Final = definition_of("largest_bolt_force")
MARGIN: Final = definition_of("margin")
