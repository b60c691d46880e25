"""Details of a run as text, its report as JSON data, and the format of numbers with SI prefixes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..latin.outcome import Array, InterfaceHistory, Outcome, Resultants, Timings
from ..scene.quantity_table import FIRST_CONTACT, INTERFACE, PEAK_FORCE, PEAK_FORCE_RAW, RUN, SEPARATION
from ..scene.readable_numbers import aligned, readable, readable_vector
from ..scene.units import SI, UnitSystem
from .groups import StoredGroup, finite
from .interface_fields import InterfaceFields, largest_slip_share, sticks
from .owner_records import InterfaceRecord, reported

if TYPE_CHECKING:
    import xarray as xr


def report(outcome: Outcome) -> dict[str, Any]:
    """Plain data that strict JSON can hold (a number that is not finite becomes None).

    Keys: ``status``, ``converged``, ``trustworthy`` (converged, and nothing at the end speaks against it), ``complete``
    (whether the run reached its end), ``interrupted`` (what stopped it before, or empty), ``iterations`` and
    ``newton_steps`` (one count per window), ``passes``,
    ``error_indicator`` (the amplitude sqrt(eta), largest over windows), ``defect`` (likewise, 0 without truncated
    tables of large interfaces), ``cpu_seconds`` by part, ``peak_memory_bytes``,
    ``penetration`` (m; ``penetration_landed`` of landings, ``penetration_closed`` what points that stayed closed
    have approached by since), ``resultants`` (of bodies in equilibrium, by part: force and moment, N and N m),
    ``warnings``, ``warning_codes`` (of ``remarks.REMARKS``, one each), and ``interfaces``:
    per name ``impulse`` (vector, N s) and its scalars (rows of ``scene.quantity_table``): ``peak_force`` (N, largest
    mean of the normal resultant over ``peak_duration``, s), ``peak_force_raw`` (N, its largest value, which has no
    limit where bodies land), ``first_contact_time`` (s; at which the normal resultant exceeds 1 % of its peak, or a gap
    closes), ``separation_time`` (s; from which on its mean over ``peak_duration`` stays below a tenth of
    ``peak_force``; None of both if never) and ``error_indicator``. A solution with an error estimate adds
    ``error_estimate``, see ``results.estimates``.
    """
    return {
        "status": outcome.status,
        "converged": bool(outcome.converged),
        "trustworthy": bool(outcome.trustworthy),
        "complete": bool(outcome.complete),
        "interrupted": outcome.interrupted,
        "iterations": [window.iterations for window in outcome.windows],
        "newton_steps": [window.newton_steps for window in outcome.windows],
        "passes": finite(outcome.passes),
        "error_indicator": finite(outcome.error_indicator),
        "defect": finite(max((window.defect for window in outcome.windows), default=0.0)),
        "cpu_seconds": cpu_seconds(outcome.timings),
        "peak_memory_bytes": int(outcome.timings.peak_memory),
        "penetration": finite(outcome.penetration()),
        "penetration_landed": finite(outcome.landed()),
        "penetration_closed": finite(outcome.sunk()),
        "resultants": {name: _resultants(r) for name, r in outcome.resultants.items()},
        "warnings": list(outcome.warnings),
        "warning_codes": [getattr(warning, "code", "") for warning in outcome.warnings],
        **reported(RUN, outcome),
        "interfaces": {name: _interface(outcome, history) for name, history in outcome.interfaces.items()},
    }


def cpu_seconds(timings: Timings) -> dict[str, float | None]:
    """CPU seconds of the process by part, and their sum."""
    parts = {"set_up": "setup"} | {name: name for name in ("march", "other", "output", "total")}
    return {part: finite(getattr(timings, name)) for part, name in parts.items()}


def _interface(outcome: Outcome, history: InterfaceHistory) -> dict[str, Any]:
    record = InterfaceRecord.of(history, outcome.interface_time)
    entries: dict[str, Any] = {"impulse": [finite(value) for value in history.impulse(outcome.interface_time)[-1]]}
    for name, value in reported(INTERFACE, record).items():
        entries[name] = value
        if name == PEAK_FORCE.key:
            entries["peak_duration"] = finite(record.duration)
    return entries | {"error_indicator": finite(outcome.interface_indicator.get(history.name))}


def details(outcome: Outcome, units: UnitSystem = SI) -> list[str]:
    """Lines on the course of the iteration, penetration, energy, balance and cost, and a table of the interfaces."""
    rows = [*course_rows(outcome, units), ("CPU", _cpu(outcome))]
    width = max(len(label) for label, _ in rows)
    lines = [f"  {label:<{width}}  {text}" for label, text in rows]
    if outcome.interfaces:
        lines += ["", *aligned(interface_rows(outcome, units))]
    return lines


def course_rows(outcome: Outcome, units: UnitSystem = SI) -> list[tuple[str, str]]:
    """Name and text of the course of the iteration, penetration, energy and balance: nothing that is measured."""
    rows = [
        ("iterations", _iterations(outcome)),
        ("passes", f"{outcome.passes:.3g} (substructure-instants solved / substructures x instants)"),
        ("sqrt(eta)", f"{outcome.error_indicator:.2e} (largest over windows)"),
        ("penetration", _penetration(outcome, units)),
    ]
    if outcome.energy is not None:
        rows.append(("energy", _energy(outcome, units)))
    if outcome.resultants:
        rows.append(("balance", _balance(outcome.resultants, units)))
    # what is marched, where it is not the bodies; what is read from a folder
    rows += [
        (name, outcome.settings[name]) for name in ("propagator", "bonds", "operators") if name in outcome.settings
    ]
    return rows


def _penetration(outcome: Outcome, units: UnitSystem) -> str:
    landed, sunk = (readable(value, units.label("m"), 3) for value in (outcome.landed(), outcome.sunk()))
    if outcome.sunk() > 0.0:
        closed = f", in addition {sunk} at points that stayed closed"
    else:
        closed = ""
    return f"{landed} at points after impact{closed}"


def _iterations(outcome: Outcome) -> str:
    counts = [window.iterations for window in outcome.windows]
    if not counts:
        return "none"
    if len(counts) == 1:
        text = f"{counts[0]} in one window"
    else:
        text = f"min {min(counts)}, mean {np.mean(counts):.3g}, max {max(counts)} over {len(counts)} windows"
    fallen = sum(bool(window.fallbacks) for window in outcome.windows)
    failed = sum(not window.converged for window in outcome.windows)
    if fallen:
        text += f"; {fallen} used a fall-back"
    if failed:
        text += f"; {failed} not converged"
    return text


def _energy(outcome: Outcome, units: UnitSystem) -> str:
    energy = outcome.energy or {}
    largest = max((float(np.abs(term).max(initial=0.0)) for term in energy.values()), default=0.0)
    if "balance" in energy:
        imbalance = float(np.abs(energy["balance"]).max(initial=0.0))
    else:
        imbalance = 0.0
    if largest > 0.0:
        share = f"{imbalance / largest:.1e}"
    else:
        share = "0"
    text = f"balance closed to {share} of the largest term ({readable(largest, units.label('J'))})"
    dissipations = "friction_dissipation", "contact_dissipation", "landing_dissipation", "scheme_dissipation"
    for key in ("prestress", *dissipations):
        if key in energy and energy[key][-1] != 0.0:
            text += f"; {key.replace('_', ' ')} {readable(float(energy[key][-1]), units.label('J'), 3)}"
    return text


def _resultants(of: Resultants) -> dict[str, list[float | None]]:
    """Forces and moments of a body, for JSON."""
    names = "loads", "interfaces", "reactions", "unbalanced"
    return {name: [finite(value) for value in getattr(of, name)] for name in names}


def _balance(resultants: Mapping[str, Resultants], units: UnitSystem) -> str:
    """The worst balance of forces of a body in equilibrium."""
    largest = max(r.largest for r in resultants.values())
    off = {name: float(np.linalg.norm(r.unbalanced[:3])) for name, r in resultants.items()}
    worst = max(off, key=lambda name: off[name])
    if all(r.vanishes for r in resultants.values()):
        return f"no force beyond round-off ({readable(largest, units.label('N'), 2)})"
    if largest > 0.0:
        share = f"{off[worst] / largest:.1e}"
    else:
        share = "0"
    size = readable(largest, units.label("N"))
    return f"forces on every body closed to {share} of the largest ({size}), worst {worst}"


def _cpu(outcome: Outcome) -> str:
    seconds = {part: value or 0.0 for part, value in cpu_seconds(outcome.timings).items()}
    total = seconds.pop("total")
    parts = ", ".join(f"{part.replace('_', ' ')} {value:.3g}" for part, value in seconds.items())
    if outcome.timings.predicted:
        # the prediction is of march and other together
        march = total - (seconds.get("set_up") or 0.0) - (seconds.get("output") or 0.0)
        parts += f"; march + other {march:.2g}, predicted {outcome.timings.predicted:.2g}"
    return f"{total:.3g} s ({parts}); peak memory {outcome.timings.peak_memory / 1e6:.0f} MB"


def interface_rows(outcome: Outcome, units: UnitSystem = SI) -> list[tuple[str, ...]]:
    """Table of the interfaces, of its head alone where there are none."""
    head = ("interface", "behaviour", "peak force", "mean over", "raw peak", "impulse on side E (x, y, z)")
    more = ("first contact", "separation", "slipping area", "sqrt(eta)")
    return [(*head, *more), *(_row(outcome, history, units) for history in outcome.interfaces.values())]


def summary_group(parts: Mapping[str, Any]) -> StoredGroup:
    """Group ``summary``: sentences and tables of the summary, each as JSON."""
    return StoredGroup({}, attrs={name: json.dumps(part) for name, part in parts.items()})


def stored_summary(tree: xr.DataTree) -> dict[str, Any]:
    """Sentences and tables of the summary of a results file; none of a file of an earlier version."""
    if "summary" not in tree.children:
        return {}
    return {str(name): json.loads(text) for name, text in tree["summary"].attrs.items()}


def _row(outcome: Outcome, history: InterfaceHistory, units: UnitSystem) -> tuple[str, ...]:
    record = InterfaceRecord.of(history, outcome.interface_time)
    peak, last = PEAK_FORCE.value(record), SEPARATION.value(record)
    slip = _slip_text(history, InterfaceFields.of_history(history, outcome.interface_time), outcome.interface_time)
    # a bond holds by forces of all directions: those of a thread along its flanks, say
    bonded = history.contact_status is None
    mean = readable(record.duration, "s", 3)
    impulse = "-"
    raw = PEAK_FORCE_RAW.value(record)
    if bonded or history.quasi_static:
        if bonded:
            whole = np.linalg.norm(history.force(), axis=1)
        else:
            whole = np.abs(history.normal_resultant())
        peak = float(whole.max(initial=0.0))
        mean = "-"
        raw = None
    if not history.quasi_static:
        total = history.impulse(outcome.interface_time)[-1]
        impulse = readable_vector([float(x) for x in total], units.label("N s"))
    indicator = outcome.interface_indicator.get(history.name)
    opened = "not yet"
    if last != outcome.interface_time[-1]:
        opened = readable(last, "s")
    return (
        history.name,
        history.behaviour,
        readable(peak, units.label("N")),
        mean,
        readable(raw, units.label("N")),
        impulse,
        readable(FIRST_CONTACT.value(record), "s"),
        opened,
        slip,
        "-" if indicator is None else f"{indicator:.1e}",
    )


def _slip_text(history: InterfaceHistory, fields: InterfaceFields, time: Array) -> str:
    """Largest share of the area that slips at one instant, where a joint with friction does not stick."""
    slip = None
    if history.has_friction:
        slip = largest_slip_share(fields)
    if slip is None:
        return "-"
    if sticks(history, fields, time):
        return "sticks"
    return f"max {100 * slip:.0f} %"
