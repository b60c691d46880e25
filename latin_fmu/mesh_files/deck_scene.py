"""The tables that an Abaqus deck gives a scene: materials, ties, supports, rigid bodies, clearances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from ..errors import Problem
from ..scene.fields import FACE_PATTERN
from ..scene.raw_scene import given, named_tables
from ..scene.substructures import part_name
from ..scene.units import SI, system_named
from .content import NO_ROWS, Index, MeshContent
from .deck_model import KEYS, HeldSet

_UNITS: Final = {1.0: (1.0, 1.0), 1e-3: (1e6, 1e12)}
"""Factors of moduli and densities by the scale: units of the scene, and mm, t, s, MPa in a scene in SI."""
_OPENING: Final = ("contact", "no_slip", "soft_contact")
"""Behaviours of an interface with a gap."""


def with_deck(
    raw: Mapping[str, Any], content: MeshContent, parts: Mapping[str, str], scale: float, problems: list[Problem]
) -> dict[str, Any]:
    """The scene with what the deck says and the scene does not.

    A part without a material takes that of its section, completed by the table of its name in the scene. A tie becomes
    a perfect interface, unless the scene has one between these parts; a set held at zero becomes a fixed boundary,
    unless the scene has one on that face; a rigid body becomes a rigid substructure; a clearance becomes the gap of the
    interface between its surfaces.

    Parameters
    ----------
    parts : names of substructures by volume group. scale : length of a unit of the deck in that of the scene; where it
        is 1, materials are in the units of the scene, where it is 1e-3 of a metre, in mm, t, s, MPa. Else they are
        left out. problems : takes what the deck lacks.
    """
    whole = with_model(raw, content, parts, scale, problems)
    fixed = {str(table.get("face")) for table in named_tables(raw, "boundary").values()}
    supports = {name: table for name, table in _supports(content, parts) if table["face"] not in fixed}
    supports = {name: table for name, table in supports.items() if name not in named_tables(raw, "boundary")}
    if supports:
        whole["boundary"] = {**(raw.get("boundary") or {}), **supports}
    return whole


def with_model(
    raw: Mapping[str, Any], content: MeshContent, parts: Mapping[str, str], scale: float, problems: list[Problem]
) -> dict[str, Any]:
    """The scene with the materials, rigid bodies, ties and clearances of the deck, as ``with_deck`` adds them."""
    deck, whole = content.deck, dict(raw)
    assert deck is not None
    if scale in _UNITS and (scale == 1.0 or system_named(raw.get("units")) is SI):
        whole = _with_materials(whole, content, parts, _UNITS[scale], problems)
    whole = _with_rigid_bodies(whole, content, parts)
    interfaces = {part_name(name): table for name, table in _ties(content, parts, scale)}
    joined = [_parts_of(table) for table in named_tables(raw, "interface").values()]
    new = {
        n: t for n, t in interfaces.items() if _parts_of(t) not in joined and n not in named_tables(raw, "interface")
    }
    if new:
        whole["interface"] = {**(raw.get("interface") or {}), **new}
    return _with_clearances(whole, content, parts, scale)


def left_out(content: MeshContent, parts: Mapping[str, str], scene: Any) -> list[str]:
    """Keywords of a deck that a scene does not use, and its ties and supports that are in none of its tables.

    parts : names of substructures by volume group. scene : read (``Scene``).
    """
    deck = content.deck
    if deck is None:
        return []
    pairs = [frozenset(side.partition(".")[0] for side in i.sides) for i in scene.interface.values()]
    used = {name for name, table in _ties(content, parts, 1.0) if _parts_of(table) in pairs}
    lost = [f"*TIE {name}" for name in dict.fromkeys(tie.name for tie in deck.ties) if name not in used]
    faces = {b.face for b in scene.boundary.values() if hasattr(b, "face")}
    for support in deck.supports:
        tables = list(held_tables(content, parts, support))
        if not any(table["face"] in faces for _, table in tables):
            lost.append(f"*BOUNDARY {support.name}{_why_not(content, parts, support)}")
    lost += [f"*RIGID BODY {elset}" for elset in deck.rigid if not _groups(content, parts, elset)]
    return [*deck.unused_words(), *lost, *deck.dropped]


def _groups(content: MeshContent, parts: Mapping[str, str], elset: str) -> list[str]:
    """Parts all of whose cells are in an element set, in capitals, or are those of that solid section."""
    wanted = next((name for name in content.volumes if name.upper() == elset.rpartition(".")[2]), None)
    if wanted is None:
        return []
    owner = elset.rpartition(".")[0]
    chosen = content.volumes[wanted]
    return [
        part
        for group, part in parts.items()
        if (not owner or group.upper() == owner)
        and all(np.isin(rows, chosen.get(kind, NO_ROWS)).all() for kind, rows in content.volumes[group].items())
    ]


def _with_rigid_bodies(raw: dict[str, Any], content: MeshContent, parts: Mapping[str, str]) -> dict[str, Any]:
    """Parts that a *RIGID BODY holds all cells of are rigid, unless the scene says otherwise."""
    assert content.deck is not None
    bodies = dict(raw["substructure"])
    for elset in content.deck.rigid:
        for part in _groups(content, parts, elset):
            if isinstance(bodies.get(part), Mapping):
                bodies[part] = {"rigid": True, **bodies[part]}
    return {**raw, "substructure": bodies}


def _with_materials(
    raw: dict[str, Any],
    content: MeshContent,
    parts: Mapping[str, str],
    factors: tuple[float, float],
    problems: list[Problem],
) -> dict[str, Any]:
    assert content.deck is not None
    materials, bodies = dict(raw.get("material") or {}), dict(raw["substructure"])
    for group, part in parts.items():
        table, material = bodies.get(part), content.deck.material_of(content.sections.get(group, []))
        if material is None or not isinstance(table, Mapping) or given(table, "material"):
            continue
        stiffness, density = factors
        units = {"young_modulus": stiffness, "poisson_ratio": 1.0, "density": density}
        constants = {key: units[key] * value for key, value in material[1].items()}
        # names of a deck know no case
        name = next((key for key in materials if key.upper() == part_name(material[0]).upper()), part_name(material[0]))
        written = materials.get(name, {})
        if not isinstance(written, Mapping):
            continue
        needed = list(KEYS)
        if given(written, "orthotropic"):
            needed = ["density"]
            constants = {key: value for key, value in constants.items() if key == "density"}
        # what the scene says of that material counts, the deck gives the rest
        whole = {**constants, **{key: value for key, value in written.items() if value is not None}}
        if missing := [key for key in needed if key not in whole]:
            problem = Problem(
                f"material.{name}",
                f"the material {material[0]} of the deck lacks {' and '.join(missing)}, or depends on temperature",
                allowed=f"[material.{name}] with {' and '.join(f'{key} = ...' for key in missing)}",
                remedy="that table of the scene completes the one of the deck",
            )
            # parts of one material lack the same
            if problem not in problems:
                problems += [problem]
        materials[name] = whole
        # keys of the scene win
        bodies[part] = {"material": name, **table}
    if materials:
        return {**raw, "material": materials, "substructure": bodies}
    return raw


def _ties(content: MeshContent, parts: Mapping[str, str], scale: float) -> Iterator[tuple[str, dict[str, Any]]]:
    """Perfect interfaces between surfaces that belong to one part each; a position tolerance is how far they reach."""
    assert content.deck is not None
    for tie in content.deck.ties:
        sides = [faces_of(content, parts, surface) for surface in (tie.slave, tie.master)]
        if all(len(side) == 1 for side in sides) and sides[0][0].split(".")[0] != sides[1][0].split(".")[0]:
            table: dict[str, Any] = {"sides": [side[0] for side in sides], "behaviour": "perfect"}
            if tie.tolerance is not None and tie.tolerance > 0.0:
                table["search"] = scale * tie.tolerance
            yield tie.name, table


def _with_clearances(
    raw: dict[str, Any], content: MeshContent, parts: Mapping[str, str], scale: float
) -> dict[str, Any]:
    """Interfaces of the scene between the surfaces of a *CLEARANCE, which have no gap, with that of the deck."""
    assert content.deck is not None
    tables = dict(raw.get("interface") or {})
    for pair, value in content.deck.clearances.items():
        faces = frozenset(face for surface in pair for face in faces_of(content, parts, surface))
        for name, table in named_tables(raw, "interface").items():
            sides = table.get("sides")
            opens = table.get("behaviour", "contact") in _OPENING
            joins = isinstance(sides, list | tuple) and frozenset(map(str, sides)) == faces
            if joins and opens and not given(table, "gap"):
                tables[name] = {**table, "gap": scale * value}
    if tables:
        return {**raw, "interface": tables}
    return raw


def _supports(content: MeshContent, parts: Mapping[str, str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Fixed boundaries on the parts that a held set has nodes of, one for each set and part."""
    assert content.deck is not None
    merged: dict[tuple[str, str], dict[str, Any]] = {}
    for support in content.deck.supports:
        for name, table in held_tables(content, parts, support):
            before = merged.setdefault((table["face"], str(table.get("axes"))), {"name": name, **table})
            # a set that several lines hold is one boundary
            either = {*before["components"], *table["components"]}
            before["components"] = [axis for axis in "xyz" if axis in either]
    for table in merged.values():
        yield str(table.pop("name")), table


def held_tables(
    content: MeshContent, parts: Mapping[str, str], support: HeldSet
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and table of the boundary on each part that has nodes of a held set."""
    rows = rows_of_set(content, support.name)
    axes = axes_at(content, rows, support.components)
    if axes is None:
        return
    face = set_named(content, support.name)
    for part in parts_with(content, parts, support.name, rows):
        if FACE_PATTERN.fullmatch(f"{part}.{face}") is None:
            continue  # a name that a scene cannot hold
        table = {"type": "fixed", "face": f"{part}.{face}", "components": [*support.components], **axes}
        yield part_name(f"{face.lstrip('_')}_{part}"), table


def _why_not(content: MeshContent, parts: Mapping[str, str], support: HeldSet) -> str:
    rows = rows_of_set(content, support.name)
    if axes_at(content, rows, support.components) is None:
        return " (along axes of *TRANSFORM that differ from node to node)"
    if parts_with(content, parts, support.name, rows):
        return ""
    return " (it holds no node of a part)"


def axes_at(content: MeshContent, rows: Index, components: str) -> dict[str, Any] | None:
    """Axes that the components of nodes are counted along: empty for the global ones, None where they differ."""
    assert content.deck is not None
    if components == "xyz":
        return {}
    for name, axes in content.deck.transforms.items():
        turned = np.isin(rows, rows_of_set(content, name))
        if turned.all() and len(rows) and axes is not None:
            return {"axes": {"x": axes[0], "y": axes[1]}}
        if turned.any():
            return None
    return {}


def _owner(name: str, *tables: Mapping[str, Any]) -> tuple[str, str]:
    """Instance in capitals, empty where none is named, and the spelling of a set or surface; empty where it is not
    there. Names may have dots of their own."""
    owner, _, short = name.rpartition(".")
    # first as it is written: a deck may hold thousands of nodes one by one
    if short.isdigit() and any(f"NODE_{short}" in table for table in tables):
        return owner.upper(), f"NODE_{short}"
    if any(name in table for table in tables):
        return "", name
    wanted = {item.upper(): item for item in reversed([key for table in tables for key in table])}
    if name.upper() in wanted:
        return "", wanted[name.upper()]
    return owner.upper(), wanted.get(short.upper(), "")


def set_named(content: MeshContent, name: str) -> str:
    """Name in the content of a set, or of a node by its number; empty where there is none."""
    return _owner(name, content.node_sets)[1]


def rows_of_set(content: MeshContent, name: str) -> Index:
    """Rows of the nodes of a set, or of a node by its number; none where it is not there."""
    return content.node_sets.get(set_named(content, name), NO_ROWS)


def parts_with(content: MeshContent, parts: Mapping[str, str], name: str, rows: Index) -> list[str]:
    """Parts that have nodes of a set; ``INSTANCE.SET`` names one part."""
    owner = _owner(name, content.node_sets)[0]
    chosen = {group: part for group, part in parts.items() if not owner or group.upper() == owner}
    return [part for group, part in chosen.items() if np.isin(rows, content.nodes_of(group)).any()]


def faces_of(content: MeshContent, parts: Mapping[str, str], name: str) -> list[str]:
    """``part.face`` of the parts that a surface or node set of this name lies on; ``INSTANCE.SET`` names one part."""
    owner, spelled = _owner(name, content.facets, content.node_sets)
    if not spelled:
        return []
    chosen = {group: part for group, part in parts.items() if not owner or group.upper() == owner}
    return [f"{part}.{spelled}" for group, part in chosen.items() if content.touching(group, spelled)]


def _parts_of(table: Mapping[str, Any]) -> frozenset[str]:
    """Substructures that an interface joins."""
    sides: Sequence[Any] | None = table.get("sides")
    if isinstance(sides, list | tuple):
        return frozenset(str(side).partition(".")[0] for side in sides)
    return frozenset()
