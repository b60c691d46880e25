"""Tables of a scene from an Abaqus deck with several parts: its materials, ties and supports; what is left unused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from ..scene.raw_scene import given, named_tables
from ..scene.substructures import part_name
from ..scene.units import SI, system_named
from .content import MeshContent

_UNITS: Final = {1.0: (1.0, 1.0), 1e-3: (1e6, 1e12)}
"""Factors of moduli and densities by the scale: units of the scene, and mm, t, s, MPa in a scene in SI."""


def with_deck(raw: Mapping[str, Any], content: MeshContent, parts: Mapping[str, str], scale: float) -> dict[str, Any]:
    """The scene with what the deck says and the scene does not.

    A part without a material takes that of its section. A tie becomes a perfect interface, unless the scene has one
    between these parts; a set held at zero becomes a fixed boundary, unless the scene has one on that face.

    Parameters
    ----------
    parts : names of substructures by volume group. scale : length of a unit of the deck in that of the scene; where it
        is 1, materials are in the units of the scene, where it is 1e-3 of a metre, in mm, t, s, MPa. Else they are
        left out.
    """
    deck, whole = content.deck, dict(raw)
    assert deck is not None
    if scale in _UNITS and (scale == 1.0 or system_named(raw.get("units")) is SI):
        whole = _with_materials(whole, content, parts, _UNITS[scale])
    interfaces = {part_name(name): table for name, table in _ties(content, parts)}
    joined = [_parts_of(table) for table in named_tables(raw, "interface").values()]
    new = {
        n: t for n, t in interfaces.items() if _parts_of(t) not in joined and n not in named_tables(raw, "interface")
    }
    if new:
        whole["interface"] = {**(raw.get("interface") or {}), **new}
    held = {str(table.get("face")) for table in named_tables(raw, "boundary").values()}
    supports = {part_name(name): table for name, table in _supports(content, parts) if table["face"] not in held}
    supports = {name: table for name, table in supports.items() if name not in named_tables(raw, "boundary")}
    if supports:
        whole["boundary"] = {**(raw.get("boundary") or {}), **supports}
    return whole


def left_out(content: MeshContent, parts: Mapping[str, str], scene: Any) -> list[str]:
    """Keywords of a deck that a scene does not use, and its ties and supports that are in none of its tables.

    parts : names of substructures by volume group. scene : read (``Scene``).
    """
    deck = content.deck
    if deck is None:
        return []
    pairs = [frozenset(side.partition(".")[0] for side in i.sides) for i in scene.interface.values()]
    made = {name for name, table in _ties(content, parts) if _parts_of(table) in pairs}
    lost = [f"*TIE {name}" for name in dict.fromkeys(name for name, *_ in deck.ties) if name not in made]
    held = {b.face for b in scene.boundary.values() if hasattr(b, "face")}
    used = {name for name, table in _supports(content, parts) if table["face"] in held}
    lost += [f"*BOUNDARY {name}" for name, _ in deck.fixed if not any(u.startswith(_short(name)) for u in used)]
    return [*deck.unused_words(), *lost]


def _with_materials(
    raw: dict[str, Any], content: MeshContent, parts: Mapping[str, str], factors: tuple[float, float]
) -> dict[str, Any]:
    assert content.deck is not None
    materials, bodies = dict(raw.get("material") or {}), dict(raw["substructure"])
    for group, part in parts.items():
        table, known = bodies.get(part), content.deck.material_of(content.sections.get(group, []))
        if known is None or not isinstance(table, Mapping) or given(table, "material"):
            continue
        name, values = part_name(known[0]), known[1]
        stiffness, density = factors
        constants = {**values, "young_modulus": stiffness * values["young_modulus"]}
        materials.setdefault(name, {**constants, "density": density * values["density"]})
        bodies[part] = {"material": name, **table}
    return {**raw, "material": materials, "substructure": bodies} if materials else raw


def _ties(content: MeshContent, parts: Mapping[str, str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Perfect interfaces between surfaces that belong to one part each."""
    assert content.deck is not None
    for name, *surfaces in content.deck.ties:
        sides = [_faces(content, parts, surface) for surface in surfaces]
        if all(len(side) == 1 for side in sides) and sides[0][0].split(".")[0] != sides[1][0].split(".")[0]:
            yield name, {"sides": [side[0] for side in sides], "behaviour": "perfect"}


def _supports(content: MeshContent, parts: Mapping[str, str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Fixed faces of the parts that a held set has whole facets of."""
    assert content.deck is not None
    for name, components in content.deck.fixed:
        for face in _faces(content, parts, name):
            yield f"{_short(name)}_{face.split('.')[0]}", {"type": "fixed", "face": face, "components": [*components]}


def _faces(content: MeshContent, parts: Mapping[str, str], name: str) -> list[str]:
    """``part.face`` of the parts that a surface or node set of this name lies on; ``INSTANCE.SET`` names one part."""
    owner, short = name.rpartition(".")[0].upper(), _short(name).upper()
    spelled = next((n for n in (*content.facets, *content.node_sets) if n.upper() == short), None)
    if spelled is None:
        return []
    chosen = {group: part for group, part in parts.items() if not owner or group.upper() == owner}
    return [f"{part}.{spelled}" for group, part in chosen.items() if content.touching(group, spelled)]


def _short(name: str) -> str:
    return name.rpartition(".")[2]


def _parts_of(table: Mapping[str, Any]) -> frozenset[str]:
    """Substructures that an interface joins."""
    sides = table.get("sides")
    return frozenset(str(side).partition(".")[0] for side in sides) if isinstance(sides, list | tuple) else frozenset()
