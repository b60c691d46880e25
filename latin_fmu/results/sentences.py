"""Summary of a run in sentences, one for each interface, bolt, sensor and support, with errors and instants."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from ..latin.outcome import Array, BoltHistory, InterfaceHistory, Outcome, ReactionHistory, SensorHistory
from ..scene.quantity_table import (
    ACCELERATION_PEAK,
    DISPLACEMENT_PEAK,
    FIRST_CONTACT,
    FLOOR,
    FRICTION_WORK,
    IMPULSE,
    LARGEST_BOLT_FORCE,
    PEAK_FORCE,
    PEAK_FORCE_RAW,
    SEPARATION,
    VELOCITY_PEAK,
    QuantityOfInterest,
)
from ..scene.readable_numbers import percent, readable
from ..scene.sensors import ChannelClass, LowPass, Sensor
from ..scene.unit_texts import GRAVITY
from ..scene.units import SI, UnitSystem
from .bolt_margins import SectionStresses
from .estimates import ErrorEstimate, QuantityEstimate, error_text
from .interface_fields import (
    AS_A_WHOLE,
    CONTACT_SHARE,
    Force,
    InterfaceFields,
    friction_used,
    slip_in_contact,
    status_shares,
    sticks,
)
from .owner_records import InterfaceRecord
from .sensors import TensionEnd, bolt_ends, filter_of, filtered_motions, largest_of, loss_text
from .spectra import ShockSpectrum

_OPEN, _SLIP = 0, 2
_LITTLE: Final = 5e-3  # of an area or a force: smaller shares are left out
_APART: Final = 0.1  # of a force: two values are given apart, however large their errors are
WIDTH: Final = 110
"""Columns of the text."""


def sentences(
    outcome: Outcome,
    units: UnitSystem = SI,
    estimate: ErrorEstimate | None = None,
    spectra: Mapping[str, ShockSpectrum] | None = None,
    requests: Mapping[str, Sensor] | None = None,
) -> list[str]:
    """Lines of text on each interface, bolt, sensor and support of a run, beginning with its name: ``sentence_rows``
    below each other."""
    return named_lines(sentence_rows(outcome, units, estimate, spectra, requests))


def sentence_rows(
    outcome: Outcome,
    units: UnitSystem = SI,
    estimate: ErrorEstimate | None = None,
    spectra: Mapping[str, ShockSpectrum] | None = None,
    requests: Mapping[str, Sensor] | None = None,
) -> list[tuple[str, str]]:
    """Name and text of each interface, bolt, sensor and support of a run.

    Errors are relative estimates; ``at most`` where they are only a bound. Instants are those of the estimate where
    there is one, so that one instant has one value everywhere. requests : tables of the sensors in the scene, whose
    filters the largest motions are behind.
    """
    errors = {}
    if estimate is not None:
        errors = estimate.by_quantity
    time = outcome.interface_time
    lines = [(name, _interface(h, time, units, errors)) for name, h in outcome.interfaces.items()]
    ends = bolt_ends(outcome)
    lines += [(f"bolt {name}", _bolt(h, ends[name], units, errors)) for name, h in outcome.bolts.items()]
    for name, history in outcome.sensors.items():
        spectrum = (spectra or {}).get(name)
        error = None
        if estimate is not None:
            error = estimate.spectra.get(name)
        more = []
        if spectrum is not None:
            more = [_spectrum(spectrum, error, units)]
        chosen = filter_of(requests or {}, name)
        lines.append((f"sensor {name}", _sensor(history, outcome.time, units, errors, chosen) + more))
    static = any(h.quasi_static for h in outcome.interfaces.values())
    static |= any(h.acceleration is None for h in outcome.sensors.values())
    lines += [(f"support {name}", _support(h, outcome.time, units, static)) for name, h in outcome.reactions.items()]
    return [(name, "; ".join(clauses)) for name, clauses in lines]


def named_lines(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Lines of texts behind their names, the texts below each other."""
    width = max((len(name) for name, _ in rows), default=0)
    return [line for name, text in rows for line in wrapped(name.ljust(width), text)]


def wrapped(name: str, text: str) -> list[str]:
    """Lines of a text behind a name, none of them longer than ``WIDTH``."""
    head = f"  {name}  "
    # a number stays with its unit, an error with its sign: textwrap does not break at this space
    joined = re.sub(r"(?<=\d) | (?=\+-)|(?<=\+-) ", "\N{NO-BREAK SPACE}", text)
    lines = textwrap.wrap(joined, WIDTH, initial_indent=head, subsequent_indent=" " * len(head), break_on_hyphens=False)
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]


Errors = dict[str, QuantityEstimate]


def _error(errors: Errors, owner: str, definition: QuantityOfInterest) -> str:
    """`` +- 0.7 %`` behind a value, or nothing without an estimate."""
    found = errors.get(f"{owner}.{definition.key}")
    if found is None:
        return ""
    return _error_of(found.error, found.bound_only)


def _error_of(error: float, bound_only: bool = False) -> str:
    """A relative error behind a value; ``bound_only``: it is no more than a bound."""
    if not np.isfinite(error):
        return " (error unknown)"
    if error >= 1.0:
        return " (error as large as the value)"
    if bound_only and error > FLOOR:
        return f" (error at most {error_text(error)})"
    return f" +- {percent(max(error, FLOOR))}"


def _instant(errors: Errors, owner: str, definition: QuantityOfInterest, value: float | None) -> str:
    """An instant, of the estimate where there is one, with its error."""
    found = errors.get(f"{owner}.{definition.key}")
    if found is not None:
        value = found.value
    return readable(value, "s", 3) + _error(errors, owner, definition)


def _interface(history: InterfaceHistory, time: Array, units: UnitSystem, errors: Errors) -> list[str]:
    """Peak and when, contact from when to when, slip, what opens, what friction takes, the impulse."""
    fields = InterfaceFields.of_history(history, time)
    # no points, no gap: infinite
    joined = float(history.initial_gap.min(initial=np.inf)) <= 0.0
    name, force = history.name, Force(time, history.normal_resultant())
    record = InterfaceRecord.of(history, time)
    first = FIRST_CONTACT.value(record)
    if history.contact_status is None:
        return [f"carries up to {_up_to(history.force(), time, units, history.quasi_static)}"]
    if first is None:
        apart = f"never touches, smallest gap {readable(_nearest(history), units.label('m'), 3)}"
        if joined:
            return ["carries no force"]
        return [apart]
    clauses = list(_peak(history, force, units, errors))
    clauses.append(_contact(history, time, first, SEPARATION.value(record), errors, joined))
    clauses += [*_slipping(history, fields, time, units), *_opening(history)]
    if history.friction_power is not None and history.has_friction and f"{name}.{FRICTION_WORK.key}" in errors:
        work = errors[f"{name}.{FRICTION_WORK.key}"].value
        if work > 0.0:
            taken = readable(work, units.label("J"), 3)
            clauses.append(f"friction dissipates {taken}{_error(errors, name, FRICTION_WORK)}")
    # the impulse of what stays pressed is that of the clamping, and grows with the run
    transient = not history.quasi_static and not _pressed(history)
    if transient and (found := errors.get(f"{name}.{IMPULSE.key}")) is not None:
        clauses.append(f"impulse {readable(found.value, units.label('N s'))}{_error(errors, name, IMPULSE)}")
    return clauses


def _peak(history: InterfaceHistory, force: Force, units: UnitSystem, errors: Errors) -> Iterator[str]:
    """The largest mean of the normal force and when, and the largest value where it is another; without inertia, whose
    time only orders the increments, the largest value."""
    name, normal = history.name, units.label("N")
    if history.quasi_static:
        size = np.abs(force.value)
        when = _at(float(force.time[size.argmax()]), force.time, True)
        yield f"peak {readable(float(size.max()), normal)}{_error(errors, name, PEAK_FORCE_RAW)}{when}"
        return
    duration = force.peak_duration(history.peak_duration)
    peak, begin = force.peak_mean(duration)
    text = f"peak {readable(peak, normal)}{_error(errors, name, PEAK_FORCE)}"
    # the middle of the interval of the largest mean
    text += f" at {readable(begin + 0.5 * duration, 's', 3)}"
    if duration > 0.0:
        text += f" (mean of {readable(duration, 's', 3)})"
    yield text
    yield from _raw_peak(name, peak, force.raw_peak(), units, errors)


def _at(when: float, time: Array, static: bool) -> str:
    """An instant behind a value; of an equilibrium that of the end, where loads are whole, goes without saying."""
    if static and when >= time[-1]:
        return ""
    return f" at {readable(when, 's', 3)}"


def _raw_peak(name: str, peak: float, raw: float, units: UnitSystem, errors: Errors) -> Iterator[str]:
    """The largest force of a single instant, where it is above the largest mean by more than its error or a tenth."""
    found = errors.get(f"{name}.{PEAK_FORCE_RAW.key}")
    if found is None or not np.isfinite(found.error):
        error = _APART
    else:
        error = min(found.relative_error, _APART)
    if raw - peak > error * raw:
        yield f"raw peak {readable(raw, units.label('N'))}{_error(errors, name, PEAK_FORCE_RAW)} (at a single instant)"


def _up_to(forces: Array, time: Array, units: UnitSystem, static: bool) -> str:
    """The largest of forces (n_time, 3), and when."""
    largest, when = largest_of(forces, time)
    return f"{readable(largest, units.label('N'))}{_at(when, time, static)}"


def _nearest(history: InterfaceHistory) -> float | None:
    """Smallest gap, m."""
    if history.gap is None:
        return None
    return float(max(history.gap.min(), 0.0))


def _pressed(history: InterfaceHistory) -> bool:
    """Whether the normal resultant stays above 1 % of its peak."""
    size = np.abs(history.normal_resultant())
    return bool(size.min() > CONTACT_SHARE * size.max())


def _contact(
    history: InterfaceHistory, time: Array, first: float, last: float | None, errors: Errors, joined: bool
) -> str:
    """From when to when it carries a force; ``joined``: its sides touch at the start, loaded or not."""
    if _pressed(history):
        return "in contact throughout"
    if joined:
        does = "carries a force"
    else:
        does = "touches"
    if first <= time[0]:
        begin = f"{does} from the start"
    else:
        begin = f"{does} from "
    if not (first <= time[0]):
        begin += _instant(errors, history.name, FIRST_CONTACT, first)
    if last is None or last >= time[-1]:
        return f"{begin}, still at the end"
    return f"{begin} to {_instant(errors, history.name, SEPARATION, last)}"


def _slipping(history: InterfaceHistory, fields: InterfaceFields, time: Array, units: UnitSystem) -> Iterator[str]:
    """On how much of the face it slips, how far, and the largest ratio of the resultants."""
    if not history.has_friction:
        return
    if sticks(history, fields, time):
        yield "sticks throughout"
        return
    share = status_shares(fields)[:, _SLIP]
    far = float(np.linalg.norm(slip_in_contact(history, time), axis=2).max())
    text = f"slips on up to {100 * share.max():.0f} % of the face, by up to {readable(far, units.label('m'), 3)}"
    used = friction_used(history, fields)
    if used < 0.01:  # the friction forces of the points cancel
        yield text
    elif used > AS_A_WHOLE:
        yield f"{text}, as a whole"
    else:
        yield f"{text}, at {100 * used:.0f} % of the friction limit"


def _opening(history: InterfaceHistory) -> Iterator[str]:
    """Share of the area that is closed at the start and opens later."""
    status = np.asarray(history.contact_status)
    closed = status[0] != _OPEN
    if not closed.any():  # faces that touch without a force have the status of separation
        closed = (history.initial_gap <= 0.0) & (status != _OPEN).any(axis=0)
    carried = np.maximum.accumulate(status != _OPEN, axis=0)  # it opens after it has carried something
    area = float(history.areas[closed].sum())
    if area > 0.0:
        opened = float((((status == _OPEN) & carried)[:, closed] @ history.areas[closed]).max()) / area
        if opened > _LITTLE:
            yield f"up to {100 * opened:.0f} % of the initially closed area opens"


def _bolt(bolt: BoltHistory, end: TensionEnd, units: UnitSystem, errors: Errors) -> list[str]:
    """Clamp force when tight, what is lost of it, the range, the stress, the plastic elongation."""
    unit = units.label("N")
    first, low, high = (float(x) for x in (bolt.force[0], bolt.force.min(), bolt.force.max()))
    clauses = [f"tightened to {readable(bolt.tight, unit)}"]
    if bolt.share != 1.0:
        clauses[0] += f", {bolt.share:.4g} of the screw ({readable(bolt.tight / bolt.share, unit)} as a whole)"
    if abs(first - bolt.tight) > _LITTLE * abs(bolt.tight):
        clauses.append(f"{readable(first, unit)} at the start, after all bolts are tightened")
    last, lost = readable(end.mean, unit), loss_text(bolt.force, end.mean)
    if end.half_periods:
        span = f"between {readable(end.low, unit)} and {readable(end.high, unit)}"
        clauses.append(f"still oscillates at the end: mean {last} over the {end.periods} ({lost}), {span}")
    else:
        clauses.append(f"{last} at the end ({lost})")
    text = f"{readable(low, unit)} to {readable(high, unit)}{_error(errors, bolt.name, LARGEST_BOLT_FORCE)}"
    if bolt.thread is None:
        section = "its meshed section"
    else:
        section = f"the stress area of {bolt.thread}"
    if bolt.thread is not None and bolt.share != 1.0:
        section = f"{bolt.share:.4g} of {section}"
    stress = readable(high / bolt.stress_area, units.label("Pa"), 3)
    clauses.append(f"{text} during the run, at most {stress} over {section}{_bent(bolt, units)}")
    if bolt.plastic_elongation is not None and (plastic := float(bolt.plastic_elongation[-1])) > 0.0:
        clauses.append(f"yields by {readable(plastic, units.label('m'), 3)}")
    return clauses


def _bent(bolt: BoltHistory, units: UnitSystem) -> str:
    """The largest stress at the edge of a section, and which, where bending counts."""
    stresses = SectionStresses(bolt)
    if stresses.edge is None or stresses.bending is None or bolt.sections is None:
        return ""
    instant, section = np.unravel_index(int(np.argmax(stresses.edge)), stresses.edge.shape)
    edge = float(stresses.edge[instant, section])
    if float(stresses.bending[instant, section]) <= _LITTLE * edge:
        return ""
    return f", with bending {readable(edge, units.label('Pa'), 3)} at its edge ({bolt.sections.names[section]})"


def _sensor(
    history: SensorHistory, time: Array, units: UnitSystem, errors: Errors, chosen: ChannelClass | LowPass | None
) -> list[str]:
    """Largest acceleration, velocity and displacement: in the band of the estimate where there is one, else behind the
    filter of the sensor."""
    clauses, behind = [], filtered_motions(history, time, chosen)
    motions = (
        ("acceleration", history.acceleration, ACCELERATION_PEAK),
        ("velocity", history.velocity, VELOCITY_PEAK),
        ("displacement", history.displacement, DISPLACEMENT_PEAK),
    )
    for motion, values, definition in motions:
        if values is None or (motion == "velocity" and history.acceleration is None):
            continue
        largest, when = largest_of(behind.get(motion, values), time)
        found = errors.get(f"{history.name}.{definition.key}")
        if found is None:
            value = largest
        else:
            value = found.value
        text = f"{motion} up to {readable(value, units.shown(definition.unit), 3)}"
        if definition is ACCELERATION_PEAK:
            text += _in_g(value, units)
        text += _error(errors, history.name, definition)
        # with an estimate in the band of the filter or of the mesh, which a note gives in hertz
        if chosen is None or motion not in behind:
            unfiltered = " (unfiltered)"
        else:
            unfiltered = f" ({chosen.label})"
        if definition is DISPLACEMENT_PEAK:
            limited = ""
        else:
            if found is not None:
                limited = " (band-limited)"
            else:
                limited = unfiltered
        if found is not None:
            seen = ""
        else:
            seen = _at(when, time, history.acceleration is None)
        clauses.append(f"{text}{seen}{limited}")
    return clauses


def _in_g(acceleration: float, units: UnitSystem) -> str:
    if not units.measurable or units.in_g:
        return ""
    return f" ({acceleration * units.size('m s-2') / GRAVITY:.3g} g)"


def _spectrum(spectrum: ShockSpectrum, error: Array | None, units: UnitSystem) -> str:
    """Largest value of a shock response spectrum; ``error`` as from ``spectra.spectrum_error``, None if not known."""
    maximax = spectrum.acceleration[0]
    i, axis = (int(k) for k in np.unravel_index(int(np.argmax(maximax)), maximax.shape))
    largest = readable(float(maximax.max()), units.shown("m s-2"), 3)
    if error is None:
        off = ""
    else:
        off = _error_of(float(error[0, i, axis]))
    text = f"spectrum (Q {spectrum.quality:g}) up to {largest}{_in_g(float(maximax.max()), units)}{off}"
    return f"{text} at {readable(spectrum.frequency[i], 'Hz', 3)}"


def _support(history: ReactionHistory, time: Array, units: UnitSystem, static: bool) -> list[str]:
    return [f"reaction up to {_up_to(history.force, time, units, static)}"]
