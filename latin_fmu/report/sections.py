"""The sections of a report, in the order in which they are read: numbers of the results file, words of the summary."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from ..effects.explanation import Explanation
from ..pictures.body_fields import Look
from ..pictures.load_picture import limit_figure, loads_figure
from ..pictures.result_picture import result_figure
from ..pictures.summary_picture import part_figure, spectra_figure
from ..results.bolt_margins import CHECKS
from ..results.bolt_results import safety_text
from ..results.groups import children_of, datasets_of, unit_of, units_of
from ..results.limits import EXCEEDED, MET
from ..results.spectra import shock_axis, stored_spectra
from ..scene.describe import unit_of as unit_of_field
from ..scene.fields import SceneTable
from ..scene.readable_numbers import readable
from ..scene.schema import Scene, toml_value
from ..scene.units import UnitSystem
from .loads import acting, load_rows, support_rows, varies
from .markup import Html, PageSection, heading, items, named_texts, paragraph, picture, table

_SEPARATION: Final = "separation"
_MOST_ACTING: Final = 8
"""Histories that are drawn; the table has all of them."""
METHOD: Final = (
    "Displacements, rotations and strains are small: points of contact keep their partners and their normals; the run "
    "has a remark where bodies turn or strain too far for that.",
    "Materials are linear elastic, with the damping of the scene; only shanks of bolts yield, where the scene says so. "
    "No plasticity, no damage, no rate or temperature dependence of materials elsewhere.",
    "Contact is unilateral, without adhesion, with Coulomb friction of one coefficient an interface: no wear, no "
    "lubrication, no heat.",
    "Threads are bonded or touching faces of the mesh, without a helix: a bolt does not turn loose. Its margins are "
    "those of VDI 2230-1 with the computed forces.",
    "Spectra and accelerations are as good as mesh and time step: beyond the band that the notes give they are not "
    "estimated.",
)
"""Limits of the method, in words."""


@dataclass(frozen=True)
class RunContent:
    """A results file as the sections read it.

    Attributes
    ----------
    tree : of the file. summary : its sentences and tables (``results.summary.stored_summary``). scene : as stored; None
    where it cannot be read, and ``unread`` says why. explanation : of the scene; None where its meshes cannot be read,
    and ``unbuilt`` says why. picture : of the assembly.
    """

    tree: xr.DataTree
    summary: Mapping[str, Any]
    scene: Scene | None
    unread: str = ""
    explanation: Explanation | None = None
    unbuilt: str = ""
    picture: Html | None = None

    @property
    def units(self) -> UnitSystem:
        """System of units of the scene."""
        return units_of(self.tree.attrs)

    def rows(self, part: str) -> list[list[str]]:
        """A table or named texts of the summary; none where the file has none."""
        found: list[list[str]] = self.summary.get(part) or []
        return found

    def sentences(self, begin: str) -> list[list[str]]:
        """Sentences of the summary on bolts, sensors or supports: those whose names begin like this."""
        return [row for row in self.rows("sentences") if row[0].startswith(begin)]

    @property
    def limits(self) -> dict[str, xr.Dataset]:
        """Limits of the scene beside what the run has."""
        return datasets_of(self.tree, "limits")

    def is_exceeded(self, row: Sequence[str]) -> bool:
        """Whether a row of ``limits`` of the summary is of one that is exceeded."""
        return str(self.limits[row[0].removeprefix("limit ")].attrs["state"]) == EXCEEDED


def sections(of: RunContent) -> Iterator[PageSection]:
    """All sections in their order."""
    for title, content in _SECTIONS.items():
        section = PageSection(title)
        section.add(*content(of))
        yield section


def _verdict(of: RunContent) -> Iterator[Html]:
    attrs = of.tree.attrs
    good = bool(attrs.get("trustworthy", attrs.get("converged", 0)))
    words, look = "The results can be trusted", "verdict"
    if not good:
        words, look = "The results are NOT trustworthy", "verdict bad"
    yield paragraph(f"{words}: {attrs['status']}", look)
    yield named_texts([*_decisive(of)], lambda row: row[0].startswith("limit exceeded: "))
    text = str(attrs.get("scene", ""))
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    rows = [("scene", f"{attrs.get('scene_name', '-')}, SHA-256 of its effective text {digest}")]
    if of.scene is not None and of.scene.description:
        rows.append(("description", of.scene.description))
    rows += [("run", str(attrs.get("history", "-"))), ("program", str(attrs.get("source", "-")))]
    rows.append(("units", f"system {of.units.name}; numbers here have their units with them"))
    yield named_texts(rows)


def _decisive(of: RunContent) -> Iterator[tuple[str, str]]:
    """Smallest margin, clamp that is left, largest stress, limits."""
    safeties = [*_safeties(of.tree)]
    for name, chosen in (("smallest margin", False), ("smallest clamp left", True)):
        found = [s for s in safeties if (s[1] == _SEPARATION) is chosen]
        if found:
            bolt, check, clause, safety = min(found, key=lambda s: s[3])
            text = safety_text(check, safety)
            yield name, f"{text}, bolt {bolt}, {CHECKS.get(check, ('', check))[1]} ({check}, VDI 2230-1 {clause})"
        elif children_of(of.tree, "bolts"):
            yield name, "not known: no bolt has such a check"
        else:
            yield name, "the run has no bolts"
    largest = of.summary.get("largest_stress")
    stress = {row[0]: row[1] for row in of.rows("stresses")}.get(f"body {largest}")
    missing = "not stored: output.nodal_stress = true in the scene keeps it"
    yield "largest stress", f"body {largest}: {stress}" if stress else missing
    groups = of.limits
    over = [(name, str(d.attrs["sentence"])) for name, d in groups.items() if d.attrs["state"] == EXCEEDED]
    if not groups:
        yield "limits", "none given: [limit.NAME] in the scene"
        return
    for name, sentence in over:
        yield f"limit exceeded: {name}", sentence
    if not over:
        yield "limit exceeded", "none"
    unknown = [name for name, d in groups.items() if d.attrs["state"] not in (EXCEEDED, MET)]
    if unknown:
        yield "limits not judged", ", ".join(unknown)


def _safeties(tree: xr.DataTree) -> Iterator[tuple[str, str, str, float]]:
    """Bolt, check, clause and safety of every stored margin that is a number."""
    for name, bolt in datasets_of(tree, "bolts").items():
        if "safety" in bolt:
            stored = zip(bolt["check"].values, bolt["clause"].values, bolt["safety"].values, strict=True)
            yield from ((name, str(c), str(clause), float(s)) for c, clause, s in stored if np.isfinite(s))


def _model(of: RunContent) -> Iterator[Html]:
    if "model" in of.tree.children:
        yield heading("Bodies")
        yield table([*_body_rows(of)])
    if of.scene is not None:
        yield heading("Materials")
        yield named_texts([(name, _keys(m, of.units)) for name, m in of.scene.material.items()])
    yield heading("Joints")
    yield table([*_joint_rows(of)])
    if of.scene is not None:
        yield heading("Supports")
        yield table([*support_rows(of.scene)])
    if of.picture is not None:
        yield of.picture
    else:
        yield paragraph(f"No picture of the assembly: {of.unbuilt or of.unread}", "note")


def _body_rows(of: RunContent) -> Iterator[tuple[str, ...]]:
    model, label = of.tree["model"].to_dataset(), of.units.label
    yield "body", "material", "mass", "size (x, y, z)", "elements", "nodes"
    described = of.scene.substructure if of.scene is not None else {}
    for i, name in enumerate(model["substructure"].values):
        material = described[name].material if name in described else "-"
        extent = " x ".join(readable(float(x), label("m"), 3) for x in model["extent"].values[i])
        mass = readable(float(model["mass"].values[i]), label("kg"))
        cells, nodes = str(model["cell_types"].values[i]), str(int(model["node_count"].values[i]))
        yield str(name), str(material), mass, extent, cells, nodes
    sums = [int(model[key].values.sum()) for key in ("cell_count", "node_count")]
    yield "all", "", readable(float(model["mass"].values.sum()), label("kg")), "", str(sums[0]), str(sums[1])


def _keys(table_of: SceneTable, units: UnitSystem) -> str:
    """Keys of a table that are written or differ from their defaults, with units."""
    words = []
    for key, about in type(table_of).model_fields.items():
        value = getattr(table_of, key)
        if value is None or value == about.default:
            continue
        unit = unit_of_field(about)
        if isinstance(value, float) and unit is not None:
            words.append(f"{key} {readable(value, units.label(unit))}")
        elif isinstance(value, SceneTable):
            words.append(f"{key} {toml_value(value.model_dump(exclude_none=True))}")
        else:
            words.append(f"{key} {toml_value(value)}")
    return "; ".join(words)


def _joint_rows(of: RunContent) -> Iterator[tuple[str, ...]]:
    yield "joint", "law", "between", "friction", "area", "points"
    for name, group in datasets_of(of.tree, "interfaces").items():
        area = "-"
        if "area" in group:
            area = readable(float(group["area"].values.sum()), unit_of(group["area"], "m2"))
        friction = group.attrs.get("friction_coefficient")
        faces = f"{group.attrs.get('face_E', '-')}, {group.attrs.get('face_Ep', '-')}"
        rubs = "-" if friction is None else f"{float(friction):g}"
        yield name, str(group.attrs.get("behaviour", "-")), faces, rubs, area, str(group.sizes.get("point", "-"))


def _loads(of: RunContent) -> Iterator[Html]:
    if of.scene is None:
        yield paragraph(of.unread, "note")
        return
    histories = acting(of.scene)
    yield table(load_rows(of.scene, histories))
    moving = [history for history in histories if varies(history)]
    if standing := of.scene.standing:
        yield paragraph(f"Beside these act: {', '.join(standing)}.")
    if moving:
        caption = "What acts over time, as the instants of the run have it; maximax spectrum of what is an acceleration"
        yield picture(loads_figure(moving[:_MOST_ACTING]), caption)
    if len(moving) > _MOST_ACTING:
        yield paragraph(f"{len(moving) - _MOST_ACTING} more are not drawn.", "note")
    yield named_texts(of.sentences("support "))
    yield table(of.rows("supports"))


def _bolts(of: RunContent) -> Iterator[Html]:
    if not children_of(of.tree, "bolts"):
        return
    yield named_texts(of.sentences("bolt "))
    yield heading("Preload and tension")
    yield table(of.rows("bolts"))
    yield heading("Sections of the shanks: largest forces, moments and stresses of the run")
    yield table(of.rows("sections"))
    if margins := of.rows("margins"):
        yield heading("Safeties by VDI 2230-1:2015: what is allowed over what acts")
        yield table(margins, 2)
    yield named_texts(of.rows("margin_notes"))
    yield named_texts(_limit_rows(of, "safety"), of.is_exceeded)
    if (figure := part_figure(of.tree, "bolts")) is not None:
        yield picture(figure, "Tension of the bolts")


def _limit_rows(of: RunContent, holds: str) -> list[list[str]]:
    """Sentences on limits of bolts (``holds`` a safety) or sensors (a spectrum)."""
    names = {f"limit {name}" for name, d in of.limits.items() if holds in d}
    return [row for row in of.rows("limits") if row[0] in names]


def _sensors(of: RunContent) -> Iterator[Html]:
    if not children_of(of.tree, "sensors"):
        return
    yield named_texts(of.sentences("sensor "))
    yield heading("Peaks")
    yield table(of.rows("sensors"))
    yield table(of.rows("spectra"))
    if limits := _limit_rows(of, "spectrum"):
        yield heading("Spectra against their limits")
        yield named_texts(limits, of.is_exceeded)
    for name, stored in of.limits.items():
        if "spectrum" in stored and stored.sizes["frequency"]:
            unit = unit_of(stored["spectrum"], "m s-2")
            yield picture(limit_figure(stored, name, unit), f"Limit {name}: {stored.attrs['state']}")
    if spectra := stored_spectra(of.tree):
        axis = shock_axis(of.tree)
        along = None if axis is None else "xyz"[axis]
        drawn = spectra_figure(spectra, along, of.units)
        yield picture(drawn, "Shock response spectra of the sensors")
    if (figure := part_figure(of.tree, "sensors")) is not None:
        yield picture(figure, "Motions of the sensors")


def _interfaces(of: RunContent) -> Iterator[Html]:
    names = children_of(of.tree, "interfaces")
    if not names:
        return
    yield named_texts([row for row in of.rows("sentences") if row[0] in names])
    yield table(of.rows("interfaces"))
    if (figure := part_figure(of.tree, "interfaces")) is not None:
        yield picture(figure, "Forces of the interfaces, and shares of their areas that stick, slip and are open")
    if any("displacement" in body for body in datasets_of(of.tree, "substructures").values()):
        yield heading("Bodies")
        yield picture(result_figure(of.tree), "Deformed bodies at the instant of the largest force on an interface")
        if of.rows("stresses"):
            yield named_texts(of.rows("stresses"))
            look = Look(stress="von_mises")
            yield picture(result_figure(of.tree, look=look), "Von Mises stress at the instant of its largest value")


def _accuracy(of: RunContent) -> Iterator[Html]:
    attrs = of.tree.attrs
    asked = []
    if of.scene is not None:
        asked.append(("iteration", f"sqrt(eta) <= {of.scene.solver.tolerance:g} in every window"))
        target = of.scene.accuracy.target
        if target is None:
            asked.append(("results", "no target: mesh and time step are those of the scene"))
        else:
            asked.append(("results", f"{100 * target:g} % of {of.scene.accuracy.quantity}"))
    yield heading("Asked")
    yield named_texts(asked)
    yield heading("Reached")
    good = bool(attrs.get("converged", 0))
    yield paragraph(str(attrs.get("status", "-")), "" if good else "bad")
    yield named_texts(of.rows("course"))
    if (figure := part_figure(of.tree, "convergence")) is not None:
        yield picture(figure, "Iterations")
    if (figure := part_figure(of.tree, "energy")) is not None:
        yield picture(figure, "Energies")
    yield heading("Estimated errors")
    if estimated := of.rows("accuracy"):
        yield table(estimated)
    else:
        yield paragraph("None: the error of this run was not estimated.", "note")
    if prices := of.rows("prices")[1:]:
        yield heading("Price of smaller errors")
        yield table([of.rows("prices")[0], *prices])
    if bands := of.summary.get("bands"):
        yield heading("Bands")
        yield items([line.strip() for line in bands if line.strip()])
    yield heading("Cost and notes")
    yield named_texts(of.rows("cost"))


def _simulated(of: RunContent) -> Iterator[Html]:
    yield heading("Remarks of the run")
    remarks = [line for line in str(of.tree.attrs.get("warnings", "")).splitlines() if line]
    yield items(remarks, "bad") or paragraph("None.")
    if of.explanation is not None:
        effects = of.explanation.effects
        yield heading("Simulated")
        yield named_texts([(e.name, e.reason) for e in effects if e.on])
        yield heading("Not simulated, or not requested")
        yield named_texts([(e.name, f"{e.reason}; to switch it on: {e.switch}") for e in effects if not e.on])
    else:
        yield heading("Simulated")
        yield paragraph(f"The effects cannot be listed: {of.unbuilt or of.unread}", "note")
    yield heading("Settings of the solver")
    yield named_texts([*_settings(of.tree)])
    yield heading("Limits of the method")
    yield items(METHOD)


def _settings(tree: xr.DataTree) -> Iterator[tuple[str, str]]:
    """What the solver chose, from the attributes of the iteration."""
    if "convergence" in tree.children:
        for key, value in tree["convergence"].attrs.items():
            if str(key).startswith("setting_"):
                yield str(key).removeprefix("setting_").replace("_", " "), str(value)


_SECTIONS: Final = {
    "Verdict": _verdict,
    "Model and mesh": _model,
    "Loads and base motion": _loads,
    "Bolts": _bolts,
    "Sensors": _sensors,
    "Interfaces": _interfaces,
    "Accuracy": _accuracy,
    "What was simulated, and what was not": _simulated,
}
