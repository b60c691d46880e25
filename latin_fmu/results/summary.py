"""A run in words: what a person reads after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..latin.record import InterfaceHistory, Outcome
from .measures import InterfaceFields, first_contact_time, largest_slip_share, peak_force, separation_time
from .quantities import readable, readable_vector
from .report import cpu_seconds


def summary(outcome: Outcome, scene_name: str) -> str:
    """Text of some ten lines: status, cost, accuracy, and a table of the interfaces."""
    rows = [
        ("iterations", _iterations(outcome)),
        ("passes", f"{outcome.passes:.3g} (substructure-instants solved / substructures x instants)"),
        ("sqrt(eta)", f"{outcome.error_indicator:.2e} (largest over windows)"),
        ("penetration", readable(outcome.penetration(), "m", 3)),
    ]
    if outcome.energy is not None:
        rows.append(("energy", _energy(outcome)))
    rows.append(("CPU", _cpu(outcome)))
    width = max(len(label) for label, _ in rows)
    lines = [f"{scene_name}: {outcome.status}"]
    lines += [f"  {label:<{width}}  {text}" for label, text in rows]
    lines += [f"  warning: {warning}" for warning in outcome.warnings]
    if outcome.interfaces:
        lines += ["", *_table(outcome)]
    return "\n".join(lines)


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
    text += f"; {fallen} used a fall-back" if fallen else ""
    return text + (f"; {failed} not converged" if failed else "")


def _energy(outcome: Outcome) -> str:
    energy = outcome.energy or {}
    largest = max((float(np.abs(term).max(initial=0.0)) for term in energy.values()), default=0.0)
    left = float(np.abs(energy["balance"]).max(initial=0.0)) if "balance" in energy else 0.0
    share = f"{left / largest:.1e}" if largest > 0.0 else "0"
    text = f"balance closed to {share} of the largest term ({readable(largest, 'J')})"
    for key in ("friction_dissipation", "contact_dissipation", "scheme_dissipation"):
        if key in energy and energy[key][-1] != 0.0:
            text += f"; {key.replace('_', ' ')} {readable(float(energy[key][-1]), 'J', 3)}"
    return text


def _cpu(outcome: Outcome) -> str:
    seconds = {part: value or 0.0 for part, value in cpu_seconds(outcome.timings).items()}
    total = seconds.pop("total")
    parts = ", ".join(f"{part.replace('_', ' ')} {value:.3g}" for part, value in seconds.items())
    if outcome.timings.predicted:
        march = total - (seconds.get("set_up") or 0.0) - (seconds.get("output") or 0.0)
        parts += f"; march {march:.2g}, predicted {outcome.timings.predicted:.2g}"
    return f"{total:.3g} s ({parts}); peak memory {outcome.timings.peak_memory / 1e6:.0f} MB"


def _table(outcome: Outcome) -> list[str]:
    head = (
        "interface",
        "behaviour",
        "peak force",
        "impulse on side E (x, y, z)",
        "first contact",
        "last contact",
        "slipping area",
        "sqrt(eta)",
    )
    return _aligned([head, *(_row(outcome, history) for history in outcome.interfaces.values())])


def _row(outcome: Outcome, history: InterfaceHistory) -> tuple[str, ...]:
    fields = InterfaceFields.of_history(history, outcome.time)
    last = separation_time(fields)
    slip = largest_slip_share(fields) if history.friction_coefficient else None
    indicator = outcome.interface_indicator.get(history.name)
    return (
        history.name,
        history.behaviour,
        readable(peak_force(fields), "N"),
        readable_vector([float(value) for value in history.impulse(outcome.time)[-1]], "N s"),
        readable(first_contact_time(fields), "s"),
        "not yet" if last == outcome.time[-1] else readable(last, "s"),
        "-" if slip is None else f"max {100 * slip:.0f} %",
        "-" if indicator is None else f"{indicator:.1e}",
    )


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns two spaces apart; the first one to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    cells = [[row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))] for row in rows]
    return ["  " + "  ".join(row).rstrip() for row in cells]
