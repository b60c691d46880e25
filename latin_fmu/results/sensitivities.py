"""Derivatives of the results of a run by parameters of its scene: data, groups of the file, sentences.

A derivative is stored as the change for a change of the parameter by its own value (by 1 where that is 0), so that it
has the unit of its quantity. Histories are those of ``kernels.tangent_march``. Scalar quantities follow from them by
the rows of ``scene.quantity_table``: a central difference along the derivatives, which gives the mean peak
with the place of its window. The first contact is that of the implicit function of gap and velocity.

The derivative is one-sided where a point is about to open, close, stick or slip. ``changing`` is the share of the area
whose state would change within a change of the parameter by ``WITHIN``, as the derivatives of gap, pressure, shear and
sliding predict. An instant with a share above ``MANY`` is an event. A front that a parameter shifts in time changes the
force at its event by its height times the shift, which the steps resolve to some per cent. So a quantity is flagged

* impulse, peak: where the change at events up to its instant is above ``AT_EVENTS`` times its own, and times a tenth of
  its value,
* first contact without a gap: where the force rises from nothing within a step,
* separation: where its instant is an event, and it changes by more than a tenth of its value,
* slip, work of friction: where ``changing`` is above ``OFTEN`` in the mean over time,
* sensors, bolts, forces of other interfaces: where more than ``SHARE`` of all change of force happens at events,
* all of these but impulses and spectra: where the scalar, taken from histories that are moved along the derivatives for
  ``CHECKED`` of the parameter, is further than ``BENT`` from the linear change. Another
  peak that becomes the largest, a wave that arrives at another instant and slip that turns bend it without any change
  of state.

Every parameter has a run in which it is larger by ``CHECKED`` (``output.check_sensitivities``: none has, or those have
by which a quantity is flagged): its secant takes the place of a change that is flagged, or
further from it than ``APART`` of the secant and ``NOTHING`` of the value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..interface.laws import SEPARATION, SLIP, STICK
from ..latin.outcome import Array, BoltHistory, InterfaceHistory, Outcome, SensorHistory
from ..scene.quantity_table import BOLT, ENERGY, INTERFACE, SENSOR, Doubt, EntryOf, RunScalar, rows_of, values_of
from ..scene.quantity_table import in_words as quantity_in_words
from ..scene.units import SI, UnitSystem
from ..shock.oscillators import RESPONSES
from .groups import StoredGroup, finite
from .interface_fields import CONTACT_SHARE
from .owner_records import BoltRecord, InterfaceRecord, SensorRecord
from .quantities import AXES, LABELS, SPECTRUM, ByQuantity, named, rows
from .sentences import named_lines
from .spectra import ShockSpectrum, spectrum_changes

WITHIN: Final = 0.01
"""Change of a parameter, over its value, within which a state that would change counts as changing."""
MANY: Final = 0.1
"""Share of the area in contact whose state changes at an event, at least."""
AT_EVENTS: Final = 2.0
"""Change of the force at events over that of a quantity from which on this is flagged."""
SHARE: Final = 0.2
"""Share of the change of force that happens at events from which on what depends on all of it is flagged."""
OFTEN: Final = 0.02
"""Mean over time of the share that changes its state from which on slip and work of friction are flagged."""
BENT: Final = 0.05
"""Distance of the change along the histories from the linear one, over the larger of both, and at least over a tenth of
the value, from which on a quantity is flagged."""
_LITTLE = 0.1  # change of a quantity over its value, for the whole parameter, below which its error does not count
_NEAR = 2  # instants around an event that belong to it
_STEP: Final = 1e-6
"""Change of a parameter, over its value, in the differences of scalar quantities."""
CHECKED: Final = 0.05
"""Change of a parameter, over its value, in the run that checks derivatives."""
_ENDS: Final = (_STEP, -_STEP, CHECKED)
APART, NOTHING = 0.1, 0.01
"""Share of the secant and of the value of a quantity within which a derivative agrees with it."""
PART: Final = 0.1
"""Change of a parameter, over its value, that the sentences are for."""
_SAID, _SMALL = 3, 1e-3
DOUBT: Final = " (uncertain: contact states or instants of peaks change)"
"""Behind a flagged quantity: its derivative does not hold for large changes."""
_AXES: Final = {"0": "x", "1": "y", "2": "z"}


def in_words(parameter: str) -> str:
    """A dotted name in words.

    >>> in_words("interface.crush.friction_coefficient"), in_words("substructure.bar.initial_velocity.2")
    ('friction coefficient of crush', 'initial velocity z of bar')
    """
    parts = parameter.split(".")
    if len(parts) > 2:
        owner = f" of {parts[1]}"
    else:
        owner = ""
    if len(parts) > 2:
        keys = parts[2:]
    else:
        keys = parts
    return " ".join(_AXES.get(key, key.replace("_", " ")) for key in keys) + owner


@dataclass(frozen=True)
class HistoryChanges:
    """Derivatives of the histories of a run by one parameter: the changes for its ``scale``.

    Attributes
    ----------
    name, value : of the parameter. interfaces, sensors, bolts : by name; of the fields that are linear in traction,
    motion and gap alone. friction : of the friction coefficients, by interface.
    """

    name: str
    value: float
    interfaces: Mapping[str, InterfaceHistory]
    sensors: Mapping[str, SensorHistory]
    bolts: Mapping[str, BoltHistory]
    friction: Mapping[str, float]

    @property
    def scale(self) -> float:
        """Change of the parameter that derivatives are stored for."""
        return self.value or 1.0


@dataclass(frozen=True)
class QuantitySensitivity:
    """A scalar quantity, ``owner.key``, with its changes by the parameters (n,) for their scales, and whether each is
    flagged."""

    quantity: str
    unit: str
    value: float
    changes: Array
    flagged: NDArray[np.bool_]


@dataclass(frozen=True)
class Sensitivities(ByQuantity[QuantitySensitivity]):
    """Derivatives of a run.

    Attributes
    ----------
    derivatives : by parameter. changing : (n, n_time) by interface (module docstring). quantities : scalars.
    time : (n_time,) instants of the run, s.
    spectra : derivatives of the spectra of the sensors by name, arrays (n, 3, n_frequency, 3)
        (``spectra.spectrum_changes``). secants : (n,) by quantity, whether the change is that of a run with a larger
        parameter (module docstring); empty where no run was made. tried : parameters that have such a run.
    """

    derivatives: Sequence[HistoryChanges]
    changing: Mapping[str, Array]
    quantities: Sequence[QuantitySensitivity]
    time: Array
    spectra: Mapping[str, ShockSpectrum]
    secants: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    tried: tuple[str, ...] = ()

    @property
    def flagged(self) -> NDArray[np.bool_]:
        """Whether any quantity is flagged (n,), by parameter."""
        flags = np.array([q.flagged for q in self.quantities], dtype=bool).reshape(-1, len(self.derivatives))
        return np.asarray(flags.any(axis=0))

    @staticmethod
    def of(
        outcome: Outcome,
        derivatives: Sequence[HistoryChanges],
        responses: Mapping[str, ShockSpectrum] = MappingProxyType({}),
    ) -> Sensitivities:
        """Those of a finished run; ``responses`` : spectra of its sensors."""
        changing = {
            name: np.stack([_changing(h, d.interfaces[name], d.friction[name]) for d in derivatives])
            for name, h in outcome.interfaces.items()
        }
        spectra = {
            name: spectrum_changes(
                spectrum,
                outcome.sensors[name],
                outcome.time,
                np.stack([np.asarray(d.sensors[name].acceleration) for d in derivatives]),
            )
            for name, spectrum in responses.items()
        }
        scalars = list(_quantities(outcome, derivatives, changing, {n: (responses[n], spectra[n]) for n in spectra}))
        scalars += _energies(outcome, scalars)
        return Sensitivities(derivatives, changing, scalars, outcome.time, spectra)

    def checked(self, runs: Sequence[Mapping[str, float] | None]) -> Sensitivities:
        """With secants in the place of changes that are flagged or contradicted (module docstring). runs : by parameter
        the scalars with the parameter larger by CHECKED, None where there is no such run: its flags stay."""
        quantities, secants = [], {}
        for q in self.quantities:
            more = np.array([np.nan if run is None else run.get(q.quantity, np.nan) for run in runs])
            slopes = (more - q.value) / CHECKED
            apart = np.abs(slopes - q.changes) > np.maximum(APART * np.abs(slopes), NOTHING * abs(q.value))
            taken = np.isfinite(slopes) & (q.flagged | apart)
            secants[q.quantity] = taken
            quantities.append(
                replace(q, changes=np.where(taken, slopes, q.changes), flagged=np.asarray(q.flagged & ~taken))
            )
        tried = tuple(d.name for d, run in zip(self.derivatives, runs, strict=True) if run is not None)
        if not tried:
            secants = {}
        return replace(self, quantities=quantities, secants=secants, tried=tried)

    def is_secant(self, q: QuantitySensitivity) -> NDArray[np.bool_]:
        """Whether each change of a quantity is that of a run with a larger parameter."""
        return self.secants.get(q.quantity, np.zeros(len(q.changes), dtype=bool))

    def groups(self, units: UnitSystem = SI) -> dict[str, StoredGroup]:
        """Groups of the results file by path."""
        names = np.array([d.name for d in self.derivatives], dtype=np.str_)
        label = named(_ROWS, {"parameter": names})
        scalars: dict[str, object] = {
            "parameter_scale": np.array([d.scale for d in self.derivatives]),
            "quantity_unit": np.array([units.label(q.unit) for q in self.quantities], dtype=np.str_),
            "value": np.array([q.value for q in self.quantities]),
            "change": np.array([q.changes for q in self.quantities]).reshape(-1, len(names)),
            "flagged": np.array([q.flagged for q in self.quantities], dtype=np.int8).reshape(-1, len(names)),
            "secant": np.array([self.is_secant(q) for q in self.quantities], dtype=np.int8).reshape(-1, len(names)),
        }
        quantities = np.array([q.quantity for q in self.quantities], dtype=np.str_)
        groups = {
            "/sensitivities": StoredGroup.of(named(_ROWS, scalars), [*label, *named(_ROWS, {"quantity": quantities})])
        }
        along = [*label, *named(LABELS, {"time": self.time, "component": AXES})]

        def stacked(values: Sequence[Array | None]) -> Array | None:
            stored = [v for v in values if v is not None]
            if len(stored) == len(names):
                return np.stack(stored)
            return None

        for name, share in self.changing.items():
            histories = [d.interfaces[name] for d in self.derivatives]
            fields = {
                "force": stacked([h.force() for h in histories]),
                "impulse": stacked([h.impulse(self.time) for h in histories]),
                "changing": share,
            }
            groups[f"/sensitivities/interfaces/{name}"] = StoredGroup.of(named(_ROWS, fields), along)
        for name in self.derivatives[0].sensors:
            motions = ("displacement", "velocity", "acceleration")
            fields = {key: stacked([getattr(d.sensors[name], key) for d in self.derivatives]) for key in motions}
            groups[f"/sensitivities/sensors/{name}"] = StoredGroup.of(named(_ROWS, fields), along)
        for name, s in self.spectra.items():
            fields = {"acceleration": s.acceleration, "pseudo_velocity": s.pseudo_velocity}
            places = named(LABELS, {"response": list(RESPONSES), "frequency": s.frequency, "component": AXES})
            group = StoredGroup.of(named(_SPECTRUM_ROWS, fields), [*label, *places])
            groups[f"/sensitivities/sensors/{name}/spectrum"] = group
        for name in self.derivatives[0].bolts:
            tension = stacked([d.bolts[name].force for d in self.derivatives])
            group = StoredGroup.of(named(_ROWS, {"tension": tension}), [*label, *named(LABELS, {"time": self.time})])
            groups[f"/sensitivities/bolts/{name}"] = group
        return groups

    def lines(self, units: UnitSystem = SI) -> list[str]:
        """The three largest changes of each quantity for parameters larger by PART, one line a quantity."""
        lines = []
        for q in self.quantities:
            clauses = []
            for i in np.argsort(-np.abs(q.changes), kind="stable")[:_SAID]:
                change, of = PART * float(q.changes[i]), self.derivatives[i]
                if change == 0.0 or abs(change) < _SMALL * abs(q.value):
                    continue
                if q.value:
                    much = f"{100 * change / abs(q.value):+.2g} %"
                else:
                    much = f"{change:+.3g} {units.label(q.unit)}"
                if q.flagged[i]:
                    doubt = DOUBT
                else:
                    doubt = ""
                if self.is_secant(q)[i]:
                    doubt = f" (by a run with {100 * CHECKED:g} % more)"
                clauses.append(f"{much} for {100 * PART:g} % more {in_words(of.name)}{doubt}")
            text = "; ".join(clauses) or f"less than {100 * _SMALL:g} % for {100 * PART:g} % more of any parameter"
            lines.append((quantity_in_words(q.quantity), text))
        if self.tried:
            checked = f"by runs with {100 * CHECKED:g} % more {', '.join(map(in_words, self.tried))}"
        else:
            checked = "no"
        if len(self.tried) < len(self.derivatives):
            checked += '; output.check_sensitivities = "all" checks every parameter that has a value 5 % larger'
        lines.append(("checked", checked))
        return named_lines(lines)

    def report(self, units: UnitSystem = SI) -> dict[str, Any]:
        """Plain data for strict JSON: per quantity its value, unit, and by parameter the change and whether it is
        flagged; ``scales`` of the parameters."""
        names = [d.name for d in self.derivatives]
        quantities = {
            q.quantity: {
                "unit": units.label(q.unit),
                "value": finite(q.value),
                "changes": dict(zip(names, map(finite, q.changes.tolist()), strict=True)),
                "flagged": dict(zip(names, q.flagged.tolist(), strict=True)),
                "secant": dict(zip(names, self.is_secant(q).tolist(), strict=True)),
            }
            for q in self.quantities
        }
        return {"scales": {d.name: d.scale for d in self.derivatives}, "quantities": quantities}


_ROWS: Final = rows(
    """
    parameter | - | parameter | dotted name of a number of the scene
    quantity  | - | quantity  | name of the quantity
    parameter_scale | 1 | parameter | change of the parameter that the others are for: its value, or 1 | over its unit
    quantity_unit | - | quantity | unit of the quantity
    value     | 1 | quantity           | value of the quantity, over its unit
    change    | 1 | quantity parameter | change of the quantity, over its unit, to first order
    flagged   | - | quantity parameter | whether states change at instants that the quantity depends on | | no yes
    secant    | - | quantity parameter | whether it is the change of a run with the parameter 5 % larger | | no yes
    force     | N | parameter time component | change of the resultant force on side E
    impulse   | N s | parameter time component | change of the force integrated over time
    changing  | 1 | parameter time | share of the area whose state would change within 1 per cent of the parameter
    displacement | m | parameter time component | change of the displacement of the sensor
    velocity  | m s-1 | parameter time component | change of the velocity of the sensor
    acceleration | m s-2 | parameter time component | change of the acceleration of the sensor
    tension   | N | parameter time | change of the tension of the shank
    """
)
_SPECTRUM_ROWS: Final = {
    name: replace(row, dims=("parameter", *row.dims), meaning=f"change of the {row.meaning}")
    for name, row in SPECTRUM.items()
}


# -- states that change -----------------------------------------------------------------------------------------------
def _changing(history: InterfaceHistory, change: InterfaceHistory, friction: float) -> Array:
    """Share (n_time,) of the area in contact whose state would change within WITHIN."""
    status = history.contact_status
    if status is None or history.gap is None or change.gap is None:
        return np.zeros(len(history.traction))
    step, n = WITHIN, history.normals

    def leaves(value: Array, slope: Array) -> NDArray[np.bool_]:
        return np.asarray(value < step * np.abs(slope))

    def parts(h: InterfaceHistory) -> tuple[Array, Array, Array]:
        pressure, jump = h.pressure(), h.velocity[:, 1] - h.velocity[:, 0]
        shear = h.traction + pressure[..., None] * n
        return pressure, shear, jump - np.einsum("tpc,pc,pd->tpd", jump, n, n)

    (pressure, shear, sliding), (d_pressure, d_shear, d_sliding) = parts(history), parts(change)
    size, speed = np.linalg.norm(shear, axis=2), np.linalg.norm(sliding, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        d_size = np.nan_to_num(np.einsum("tpc,tpc->tp", shear, d_shear) / size)
        d_speed = np.nan_to_num(np.einsum("tpc,tpc->tp", sliding, d_sliding) / speed)
    closed = status != SEPARATION
    turns = closed & leaves(pressure, d_pressure)
    turns |= (status == SEPARATION) & leaves(history.gap, change.gap) & (np.abs(change.gap) > 0.0)
    if history.has_friction:
        margin, slope = history.mu * pressure - size, history.mu * d_pressure + friction * pressure - d_size
        turns |= (status == STICK) & leaves(margin, slope)
        turns |= (status == SLIP) & leaves(speed, d_speed)
    ever = float(history.areas[closed.any(axis=0)].sum())
    if ever > 0.0:
        return np.asarray((turns @ history.areas) / ever)
    return np.zeros(len(turns))


# -- scalar quantities ------------------------------------------------------------------------------------------------
def _moved(history: InterfaceHistory, change: InterfaceHistory, by: float) -> InterfaceHistory:
    """A history moved along its derivative."""
    gap = None
    if history.gap is not None and change.gap is not None:
        gap = history.gap + by * change.gap
    traction, velocity = history.traction + by * change.traction, history.velocity + by * change.velocity
    return replace(history, traction=traction, velocity=velocity, gap=gap)


def scalars_of(outcome: Outcome, spectra: Mapping[str, ShockSpectrum]) -> dict[str, float]:
    """Scalar quantities of a run that has derivatives, ``owner.key``, those that it has; ``spectra`` : of its
    sensors."""
    time = outcome.time
    records: list[tuple[str, str, Any]] = [
        *((INTERFACE, name, InterfaceRecord.of(h, time)) for name, h in outcome.interfaces.items()),
        *((SENSOR, name, SensorRecord.of(h, time, spectrum=spectra.get(name))) for name, h in outcome.sensors.items()),
        *((BOLT, name, BoltRecord.of(h, time)) for name, h in outcome.bolts.items()),
    ]
    found = {f"{name}.{key}": value for kind, name, record in records for key, value in _values(kind, record).items()}
    if outcome.energy is not None:
        for row in rows_of(ENERGY):
            works = (found.get(f"{name}.{row.total}", 0.0) for name in outcome.interfaces)
            found[f"{ENERGY}.{row.key}"] = float(sum(works))
    return found


def _values(kind: str, record: Any) -> dict[str, float]:
    """Scalars of an owner that have derivatives, by key."""
    return values_of("derivatives", kind, record)


def _sensor_moved(history: SensorHistory, change: SensorHistory, by: float) -> SensorHistory:
    acceleration = None
    if history.acceleration is not None and change.acceleration is not None:
        acceleration = history.acceleration + by * change.acceleration
    displacement, velocity = history.displacement + by * change.displacement, history.velocity + by * change.velocity
    return replace(history, displacement=displacement, velocity=velocity, acceleration=acceleration)


@dataclass(frozen=True)
class _Activity:
    """Change of the force of an interface, in magnitude, summed over time up to each instant, (n, n_time), N s.

    at_events : at events, and around them. whole : at all instants. events : (n, n_time) whether an instant is one.
    """

    at_events: Array
    whole: Array
    events: NDArray[np.bool_]

    @staticmethod
    def of(time: Array, changing: Array, forces: Sequence[Array]) -> _Activity:
        """From the share that changes (n, n_time) and the changes of force (n_time, 3)."""
        size, step = np.stack([np.linalg.norm(f, axis=1) for f in forces]), np.gradient(time)
        events = changing > MANY
        near = events.copy()
        for k in range(1, _NEAR + 1):
            near[:, k:] |= events[:, :-k]
            near[:, :-k] |= events[:, k:]
        return _Activity(np.cumsum(size * near * step, axis=1), np.cumsum(size * step, axis=1), near)

    def outweighs(self, i: int, q: QuantitySensitivity, over: float) -> NDArray[np.bool_]:
        """Whether the change at events up to the instant i, ``over`` a time, s, is above AT_EVENTS times that of a
        quantity, and times a tenth of its value."""
        least = np.maximum(np.abs(q.changes), _LITTLE * abs(q.value))
        return np.asarray(self.at_events[:, i] > AT_EVENTS * over * least)

    def shares(self, i: int) -> NDArray[np.bool_]:
        """Whether more than SHARE of the change up to the instant i happens at events."""
        return np.asarray(self.at_events[:, i] > SHARE * self.whole[:, i])


@dataclass(frozen=True)
class _Owner:
    """An owner of quantities: name, record, by parameter the record of its derivatives, and by parameter its scalars
    with histories moved along these by _STEP, back, and by CHECKED."""

    name: str
    record: Any
    derivatives: Sequence[Any]
    ends: Sequence[Sequence[Mapping[str, float]]]

    def quantities(self, kind: str) -> Iterator[tuple[RunScalar, QuantitySensitivity]]:
        """Its quantities with their changes: those of a series at a place, else central differences along each
        parameter, flagged where they bend."""
        for row in (row for row in rows_of(kind) if row.serves("derivatives", self.record)):
            value, quantity = row.value(self.record), f"{self.name}.{row.key}"
            if isinstance(row.value, EntryOf):
                derivatives = np.array([row.value.change(self.record, d) for d in self.derivatives])
                sharp = np.zeros(len(derivatives), dtype=bool)
                yield row, QuantitySensitivity(quantity, row.unit, row.value(self.record), derivatives, sharp)
                continue
            moved = np.array([[end.get(row.key, np.nan) for end in along] for along in self.ends])
            if value is None or np.isnan(moved[:, :2]).any():
                continue
            changes, far = (moved[:, 0] - moved[:, 1]) / (2.0 * _STEP), (moved[:, 2] - value) / CHECKED
            largest = np.maximum(np.maximum(np.abs(changes), np.abs(far)), _LITTLE * abs(value))
            bent = ~(np.abs(far - changes) <= BENT * largest)  # NaN, of a contact that is lost, counts as bent
            yield row, QuantitySensitivity(quantity, row.unit, value, changes, bent)


def _quantities(
    outcome: Outcome,
    derivatives: Sequence[HistoryChanges],
    changing: Mapping[str, Array],
    spectra: Mapping[str, tuple[ShockSpectrum, ShockSpectrum]],
) -> Iterator[QuantitySensitivity]:
    """Scalar quantities with their changes; ``spectra`` of the sensors, with their derivatives."""
    time = outcome.time
    n = len(derivatives)
    activities = list[_Activity]()
    for name, history in outcome.interfaces.items():
        changes = [d.interfaces[name] for d in derivatives]
        ends = [[_values(INTERFACE, InterfaceRecord.of(_moved(history, d, by), time)) for by in _ENDS] for d in changes]
        activities.append(activity := _Activity.of(time, changing[name], [d.force() for d in changes]))
        record = InterfaceRecord.of(history, time)
        owner = _Owner(name, record, [InterfaceRecord.of(d, time) for d in changes], ends)
        at = _Place(record, history, changes, changing[name], activity)
        for row, q in owner.quantities(INTERFACE):
            yield _RULES[row.doubt](q, at)
    every = _Activity(
        np.sum([a.at_events for a in activities] or [np.zeros((n, len(time)))], axis=0),
        np.sum([a.whole for a in activities] or [np.zeros((n, len(time)))], axis=0),
        np.any([a.events for a in activities] or [np.zeros((n, len(time)), dtype=bool)], axis=0),
    )
    end = len(time) - 1
    for kind, owner in _other_owners(outcome, derivatives, spectra):
        for row, q in owner.quantities(kind):
            if row.last is None:
                last = end
            else:
                last = row.last(owner.record)
            yield replace(q, flagged=q.flagged | every.shares(last))


def _other_owners(
    outcome: Outcome, derivatives: Sequence[HistoryChanges], spectra: Mapping[str, tuple[ShockSpectrum, ShockSpectrum]]
) -> Iterator[tuple[str, _Owner]]:
    """Sensors and bolts with the kind of owner that they are."""
    time = outcome.time
    for name, sensor in outcome.sensors.items():
        spectrum, changed = spectra.get(name, (None, None))
        slopes = [None if changed is None else _of_parameter(changed, i) for i in range(len(derivatives))]
        changes = [d.sensors[name] for d in derivatives]
        ends = [[_values(SENSOR, SensorRecord.of(_sensor_moved(sensor, d, by), time)) for by in _ENDS] for d in changes]
        rates = [SensorRecord.of(d, time, spectrum=slope) for d, slope in zip(changes, slopes, strict=True)]
        yield SENSOR, _Owner(name, SensorRecord.of(sensor, time, spectrum=spectrum), rates, ends)
    for name, bolt in outcome.bolts.items():
        tensions = [d.bolts[name] for d in derivatives]
        moved = [[replace(bolt, force=bolt.force + by * d.force) for by in _ENDS] for d in tensions]
        ends = [[_values(BOLT, BoltRecord.of(b, time)) for b in along] for along in moved]
        yield BOLT, _Owner(name, BoltRecord.of(bolt, time), [BoltRecord.of(d, time) for d in tensions], ends)


def _of_parameter(changes: ShockSpectrum, i: int) -> ShockSpectrum:
    """Derivative of a spectrum by one parameter from those by all."""
    return replace(changes, acceleration=changes.acceleration[i], pseudo_velocity=changes.pseudo_velocity[i])


def _energies(outcome: Outcome, quantities: Sequence[QuantitySensitivity]) -> list[QuantitySensitivity]:
    """Energies that are sums over the interfaces, where the run has energies."""
    sums = []
    for row in rows_of(ENERGY):
        parts = [q for q in quantities if q.quantity.rpartition(".")[2] == row.total]
        if outcome.energy is None or not parts:
            continue
        changes, flagged = np.sum([q.changes for q in parts], axis=0), np.any([q.flagged for q in parts], axis=0)
        value = row.value(outcome)
        assert value is not None
        sums.append(QuantitySensitivity(f"{ENERGY}.{row.key}", row.unit, value, changes, flagged))
    return sums


def _contact_change(history: InterfaceHistory, change: InterfaceHistory) -> float:
    """Derivative of the instant at which a gap closes, s: that of gap over closing speed at the last instant before, by
    the implicit function; 0 where no gap closes."""
    loaded = history.pressure() > CONTACT_SHARE * float(history.pressure().max(initial=0.0))
    i = int(np.argmax(loaded.any(axis=1)))
    if history.gap is None or change.gap is None or i == 0:
        return 0.0
    # the gap is closed at an instant already where it ends there
    i = int(np.flatnonzero((history.gap[:i, loaded[i]] > 1e-9 * history.gap.max()).all(axis=1))[-1:].sum())
    gap, d_gap = history.gap[i], change.gap[i]
    speed, d_speed = (h.velocity[i, 0] - h.velocity[i, 1] for h in (history, change))
    speed, d_speed = (np.einsum("pc,pc->p", v, history.normals) for v in (speed, d_speed))
    with np.errstate(divide="ignore", invalid="ignore"):
        wait = np.where(loaded.any(axis=0) & (speed > 0.0), gap / speed, np.inf)
        p = int(np.argmin(wait))
        if np.isfinite(wait[p]):
            return float(d_gap[p] / speed[p] - gap[p] * d_speed[p] / speed[p] ** 2)
        return 0.0


# -- when a quantity of an interface is flagged (module docstring) ----------------------------------------------------
@dataclass(frozen=True)
class _Place:
    """An interface where its quantities are judged: record, history, by parameter derivatives, the share of its area
    that changes its state (n, n_time), and the change of its force at events."""

    record: InterfaceRecord
    history: InterfaceHistory
    changes: Sequence[InterfaceHistory]
    changing: Array
    activity: _Activity

    @property
    def time(self) -> Array:
        """Instants of the run, s."""
        return self.record.force.time

    @property
    def end(self) -> int:
        """Number of the last instant."""
        return len(self.time) - 1


def _by_events(q: QuantitySensitivity, at: _Place) -> QuantitySensitivity:
    """What all of the history decides."""
    return replace(q, flagged=at.activity.shares(at.end) | q.flagged)


def _by_its_sum(q: QuantitySensitivity, at: _Place) -> QuantitySensitivity:
    """An integral of the force."""
    return replace(q, flagged=at.activity.outweighs(at.end, q, 1.0))


def _by_its_peak(q: QuantitySensitivity, at: _Place) -> QuantitySensitivity:
    """A mean of the force about its peak."""
    duration, time = at.record.duration, at.time
    last = min(int(np.searchsorted(time, at.record.force.peak_mean(duration)[1] + duration)), at.end)
    over = max(duration, float(time[1] - time[0]))
    return replace(q, flagged=at.activity.outweighs(last, q, over) | q.flagged)


def _by_its_instant(q: QuantitySensitivity, at: _Place) -> QuantitySensitivity:
    """An instant that is an event, where it shifts."""
    first, last = np.searchsorted(at.time, [q.value, q.value + at.record.duration])
    shifted = np.abs(q.changes) > _LITTLE * abs(q.value)
    there = np.asarray(at.activity.events[:, first - 1 : last + 1].any(axis=1))
    return replace(q, flagged=(there & shifted) | q.flagged)


def _by_sliding(q: QuantitySensitivity, at: _Place) -> QuantitySensitivity:
    """What points that stick or slip decide."""
    return replace(q, flagged=q.flagged | (at.changing.mean(axis=1) > OFTEN))


def _by_closing(q: QuantitySensitivity, at: _Place) -> QuantitySensitivity:
    """The instant at which a gap closes, by the implicit function of gap and velocity before; without a gap flagged
    where the force rises from nothing within a step."""
    calm = np.zeros(len(q.changes), dtype=bool)
    if at.history.initial_gap.min() > 0.0:
        moved = np.array([_contact_change(at.history, d) for d in at.changes])
        return replace(q, changes=moved, flagged=calm)
    return replace(q, flagged=calm | _rises_in_a_step(at.history))


_RULES: Final[Mapping[Doubt, Callable[[QuantitySensitivity, _Place], QuantitySensitivity]]] = MappingProxyType(
    {
        "events": _by_events,
        "at_events": _by_its_sum,
        "at_peak": _by_its_peak,
        "near_instant": _by_its_instant,
        "closing": _by_closing,
        "sliding": _by_sliding,
    }
)


def _rises_in_a_step(history: InterfaceHistory) -> bool:
    """Whether the force rises from nothing within a step: the instant between both follows a front only while this
    arrives in the same step."""
    size = np.abs(history.normal_resultant())
    level = CONTACT_SHARE * float(size.max())
    i = int(np.argmax(size > level))
    return i > 0 and bool(size[i - 1] < _LITTLE * level)
