"""Bolts in the results: groups of the file, tables of the summary, report."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

import numpy as np

from ..latin.outcome import BoltHistory, Outcome
from ..scene.quantity_table import BOLT as OF_BOLT
from ..scene.quantity_table import MARGIN
from ..scene.readable_numbers import aligned, readable
from ..scene.units import SI, UnitSystem
from .bolt_margins import CHECKS, BoltMargin, BoltMargins, SectionStresses
from .estimates import ErrorEstimate
from .groups import StoredGroup, finite
from .owner_records import BoltRecord, reported, stored_scalars
from .quantities import (
    AXES,
    BOLT,
    BOLT_END,
    LABELS,
    MARGINS,
    SECTION_PLACES,
    SECTION_STRESSES,
    SECTIONS,
    columns,
    named,
)
from .sensors import bolt_ends

DIRECTIONS: Final = ["axial", "across_1", "across_2"]
"""Labels of the directions of sections."""
_LARGE: Final = 100.0  # safeties above it are printed as such


def bolt_groups(outcome: Outcome) -> dict[str, StoredGroup]:
    """Groups ``bolts/<name>`` of the bolts of a run by path."""
    groups, ends = {}, bolt_ends(outcome)
    for name, bolt in outcome.bolts.items():
        along = named(LABELS, {"time": outcome.time, "order": np.array(bolt.orders, dtype=np.int32)})
        attrs: dict[str, object] = {"substructure": bolt.substructure, "order": bolt.order}
        if bolt.target is not None:
            attrs |= {"target_force": bolt.target}
        if bolt.thread is not None:
            attrs |= {"thread": bolt.thread}
        stored = [*columns(BOLT, bolt), *named(BOLT_END, {"end_force": ends[name].mean})]
        stored += stored_scalars(OF_BOLT, BoltRecord.of(bolt, outcome.time))
        if bolt.sections is not None:
            stored += [*columns(SECTION_STRESSES, SectionStresses(bolt)), *columns(SECTIONS, bolt.sections)]
            labels = {"section": [*bolt.sections.names], "direction": DIRECTIONS, "component": AXES}
            along = [*along, *named(LABELS, labels), *columns(SECTION_PLACES, bolt.sections)]
        margins = BoltMargins.of(bolt, outcome.interfaces)
        if margins.margins:
            found = margins.margins.values()
            stored += named(MARGINS, {"safety": np.array([m.safety for m in found])})
            along = [*along, *named(LABELS, {"check": [*margins.margins]})]
            along += named(MARGINS, {"clause": np.array([m.clause for m in found], dtype=object)})
        if told := _not_told(bolt, margins):
            attrs |= {"not_found": "; ".join(told)}
        groups[f"/bolts/{name}"] = StoredGroup.of(stored, along, attrs)
    return groups


def _not_told(bolt: BoltHistory, margins: BoltMargins) -> list[str]:
    """Sections that were not found and checks that could not be made, a sentence each."""
    if bolt.sections is None:
        return [*margins.missing]
    return [*bolt.sections.missing, *margins.missing]


def margin_lines(outcome: Outcome, estimate: ErrorEstimate | None = None) -> list[str]:
    """Table of the safeties of the bolts, with the estimated error of the smallest of each, and what was not found;
    none where there is no margin."""
    if rows := margin_rows(outcome, estimate):
        below = [f"  below 1: {text}" for text in _below_one(outcome)]
        return aligned(rows) + below + [f"  {name}: {sentence}" for name, sentence in margin_notes(outcome)]
    return []


def _below_one(outcome: Outcome) -> list[str]:
    """Safeties below 1 that are no shares, in words."""
    return [
        f"{name}, {CHECKS[margin.check][0]}: {margin.safety:.3g}"
        for name, of in _margins(outcome).items()
        for margin in of.margins.values()
        if margin.check != "separation" and margin.safety < 1.0
    ]


def margin_rows(outcome: Outcome, estimate: ErrorEstimate | None = None) -> list[tuple[str, ...]]:
    """Rows of that table, the first two its head; none where there is no margin."""
    errors: dict[str, str] = {}
    if estimate is not None:
        names = {f"{name}.{MARGIN.key}": name for name in outcome.bolts}
        errors = {names[q.quantity]: f"+- {q.error_text}" for q in estimate.quantities if q.quantity in names}
    found = _margins(outcome)
    checks = [check for check in CHECKS if any(check in of.margins for of in found.values())]
    if not checks:
        return []
    # clauses below the heads of the columns
    rows: list[tuple[str, ...]] = [("bolt, safety of", *(CHECKS[check][1] for check in checks))]
    rows.append(("VDI 2230-1", *(CHECKS[check][0].partition(" ")[0] for check in checks)))
    for name, of in found.items():
        rows.append((name, *(_safety(of.margins.get(check)) for check in checks)))
    if errors:
        # the share of the clamp force that is left is no safety
        last = [
            "smallest",
            "",
            *(f"{_safety(of.smallest)} {errors.get(name, '')}".strip() for name, of in found.items()),
        ]
        rows = [(*row, cell) for row, cell in zip(rows, last, strict=True)]
    return rows


def margin_notes(outcome: Outcome) -> list[tuple[str, str]]:
    """What was not found: names of bolts, and a sentence."""
    told: dict[str, list[str]] = {}
    for name, of in _margins(outcome).items():
        for sentence in _not_told(outcome.bolts[name], of):
            told.setdefault(sentence, []).append(name)
    return [(", ".join(names), sentence) for sentence, names in told.items()]


def _margins(outcome: Outcome) -> dict[str, BoltMargins]:
    return {name: BoltMargins.of(bolt, outcome.interfaces) for name, bolt in outcome.bolts.items()}


def _safety(margin: BoltMargin | None) -> str:
    if margin is None:
        return "-"
    return safety_text(margin.check, margin.safety)


def safety_text(check: str, safety: float) -> str:
    """A safety as printed, of separation as a share; of what is never asked for a dash."""
    if np.isnan(safety):
        return "-"
    if not np.isfinite(safety) or safety > _LARGE:
        return f"> {_LARGE:g}"
    if check == "separation":
        return f"{100.0 * safety:.3g} %"  # three digits: a joint keeps all of its clamp force but a little
    return f"{safety:.3g}"


def section_report(bolt: BoltHistory) -> dict[str, Any]:
    """Per section of a shank its ``centre`` (m), largest ``axial`` and ``shear`` force (N), ``bending`` and ``torsion``
    moment (N m), and largest stress at its edge (``edge_stress``, Pa)."""
    of, stresses = bolt.sections, SectionStresses(bolt)
    if of is None or bolt.section_force is None or bolt.section_moment is None or stresses.edge is None:
        return {}
    sizes = {
        "axial": bolt.section_force[..., 0],
        "shear": np.linalg.norm(bolt.section_force[..., 1:], axis=-1),
        "bending": np.linalg.norm(bolt.section_moment[..., 1:], axis=-1),
        "torsion": np.abs(bolt.section_moment[..., 0]),
        "edge_stress": stresses.edge,
    }
    return {
        name: {"centre": [finite(float(x)) for x in of.centres[i]]}
        | {key: finite(float(values[:, i].max())) for key, values in sizes.items()}
        for i, name in enumerate(of.names)
    }


_SECTION_HEADS: Final = {
    "axial": ("largest tension", "N"),
    "shear": ("shear", "N"),
    "bending": ("bending", "N m"),
    "torsion": ("torsion", "N m"),
    "edge_stress": ("stress at the edge", "Pa"),
}


def section_rows(outcome: Outcome, units: UnitSystem = SI) -> list[tuple[str, ...]]:
    """Table of the sections of the shanks with their largest forces, moments and stresses; none where there is none."""
    rows: list[tuple[str, ...]] = [("bolt", "section", *(head for head, _ in _SECTION_HEADS.values()))]
    for name, bolt in outcome.bolts.items():
        for section, of in section_report(bolt).items():
            sizes = (readable(of[key], units.label(unit)) for key, (_, unit) in _SECTION_HEADS.items())
            rows.append((name, section, *sizes))
    return rows if len(rows) > 1 else []


def bolt_rows(outcome: Outcome, units: UnitSystem = SI) -> list[tuple[str, ...]]:
    """Table of the bolts: tension when tightened, at the start, smallest and largest, largest stress and the section
    that it is of, shortening."""
    head = "bolt", "in", "order", "tightened to", "at the start", "smallest", "largest", "stress", "over", "shortening"
    rows: list[tuple[str, ...]] = [head]
    for name, bolt in outcome.bolts.items():
        forces = bolt.tight, float(bolt.force[0]), float(bolt.force.min()), float(bolt.force.max())
        stress, shortening = forces[-1] / bolt.stress_area, readable(bolt.shortening, units.label("m"))
        tensions = (readable(force, units.label("N")) for force in forces)
        numbers = (*tensions, readable(stress, units.label("Pa")), bolt.thread or "mesh", shortening)
        rows.append((name, bolt.substructure, str(bolt.order), *numbers))
    return rows if len(rows) > 1 else []


def bolt_report(outcome: Outcome) -> dict[str, Any]:
    """Per bolt ``substructure``, ``order``, ``target_force`` (N, None where the shortening is given), ``section_area``
    (m2), ``thread`` and ``thread_area`` (m2, None where the scene names none), ``share`` of the whole screw that is
    modelled, ``largest_stress`` (Pa, over the tensile stress area of the thread, else over the section), ``shortening``
    (m), ``tightening_force`` (N, when the bolts of each order were tight), ``first`` and ``smallest`` tension of the
    run, N, its scalars, ``largest`` and ``last`` tension, N; ``end`` : ``mean``, ``low`` and ``high``, N, from
    ``begin``, s, ``half_periods`` (``TensionEnd``)."""
    ends = bolt_ends(outcome)
    return {
        name: {
            "substructure": bolt.substructure,
            "order": bolt.order,
            "target_force": bolt.target,
            "section_area": finite(bolt.area),
            "thread": bolt.thread,
            "thread_area": finite(bolt.thread_area),
            "share": bolt.share,
            "largest_stress": finite(float(bolt.force.max()) / bolt.stress_area),
            "shortening": finite(bolt.shortening),
            "tightening_force": [finite(force) for force in bolt.tightening],
            "first": finite(float(bolt.force[0])),
            "smallest": finite(float(bolt.force.min())),
        }
        | reported(OF_BOLT, BoltRecord.of(bolt, outcome.time))
        | {"end": {key: finite(value) for key, value in asdict(ends[name]).items()}}
        | _strength_report(bolt, outcome)
        for name, bolt in outcome.bolts.items()
    }


def _strength_report(bolt: BoltHistory, outcome: Outcome) -> dict[str, Any]:
    """``sections``, ``margins`` by check with clause, value, limit, safety and note, and what was ``not_found``."""
    of = BoltMargins.of(bolt, outcome.interfaces)
    margins = {check: margin.report() for check, margin in of.margins.items()}
    numbers = {key: finite(BOLT[key].of(bolt)) for key in ("clamp_length", "assembly_torsion")}
    return numbers | {"sections": section_report(bolt), "margins": margins, "not_found": _not_told(bolt, of)}
