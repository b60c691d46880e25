"""The scene of a mesh as a file that the user goes on with: materials by pattern, contacts, screws, a support.

Numbers that no file tells are marked as such: materials, friction, torques, the support. The scene loads, and runs to
the tightened state, as it is written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Final

from ..scene.bolts import NUT_FACTOR
from ..scene.schema import toml_value
from ..scene.substructures import part_name
from ..scene.threads import class_yield, tensile_stress_area, thread_named
from .facts import CadAssembly, CadPart, Screw

_CLASS: Final = "8.8"
_SHARE: Final = 0.7  # of its yield stress that is proposed
_WIDTH: Final = 118
_FRICTION: Final = 0.2
MATERIALS: Final = MappingProxyType(
    {
        "steel": (210e9, 0.3, 7850.0),
        "stainless_steel": (200e9, 0.3, 7900.0),
        "aluminium": (70e9, 0.33, 2700.0),
        "titanium": (114e9, 0.33, 4430.0),
        "brass": (100e9, 0.35, 8500.0),
        "copper": (120e9, 0.34, 8940.0),
        "cast_iron": (110e9, 0.26, 7200.0),
        "polyamide": (3e9, 0.39, 1140.0),
    }
)
"""Young's modulus, Pa, Poisson's ratio and density, kg/m3, of what a part may be made of."""
_WORDS: Final = (
    ("stainless_steel", ("stainless", "inox", "a2", "a4", "304", "316", "1.4301")),
    ("aluminium", ("alumin", "alu", "alsi", "6061", "6082", "7075", "5083")),
    ("titanium", ("titan", "ti6al4v")),
    ("brass", ("brass", "messing", "cuzn")),
    ("copper", ("copper", "kupfer")),
    ("cast_iron", ("cast iron", "gjl", "gjs", "grauguss")),
    ("polyamide", ("polyamid", "nylon", "pa6")),
    ("steel", ("steel", "stahl", "acier", "s235", "s355", "42crmo", "8.8", "10.9", "12.9")),
)  # words of names of materials, the first that fits


@dataclass(frozen=True)
class SceneSketch:
    """What a scene is written from.

    Attributes
    ----------
    name : of the scene, and of its mesh table. file : mesh, relative to the scene. scale : m for a unit of it. source :
        sentence on where it comes from. parts : names. made_of : material by part, as its file says, and density.
        faces : names of faces by part. support : face that is proposed to be held, "part.face". search : m. screws :
        that are used. possible : others of the table. colours : of parts. guessed : whether the scale is.
        lines : further ones of the mesh table. symmetry : part and face of those on planes of symmetry.
    """

    name: str
    file: str
    scale: float
    source: str
    parts: Sequence[str]
    support: str | None
    search: float
    faces: Mapping[str, Sequence[str]] = field(default_factory=dict)
    made_of: Mapping[str, tuple[str | None, float | None]] = field(default_factory=dict)
    screws: Sequence[Screw] = ()
    possible: Sequence[Screw] = ()
    colours: Mapping[str, tuple[int, int, int]] = field(default_factory=dict)
    guessed: bool = False
    lines: Sequence[str] = ()
    symmetry: Sequence[tuple[str, str]] = ()


def sketch_of(assembly: CadAssembly, name: str, file: str, touch: float) -> SceneSketch:
    """The scene of a CAD assembly; ``touch`` : distance up to which faces touch, mm."""
    return SceneSketch(
        name,
        file,
        assembly.scale,
        f"{assembly.file} (in {assembly.unit})",
        [part.name for part in assembly.parts],
        proposed_support(assembly),
        float(f"{2.0 * touch * assembly.scale:.3g}"),
        assembly.faces,
        {part.name: (part.material, part.density) for part in assembly.parts},
        [screw for screw in assembly.screws if screw.used],
        [screw for screw in assembly.screws if not screw.used],
        {part.name: part.colour for part in assembly.parts if part.colour is not None},
        assembly.guessed,
        symmetry=assembly.symmetry,
    )


def proposed_support(assembly: CadAssembly) -> str | None:
    """The largest end face of the largest part that nothing touches, none on a plane of symmetry."""
    cut = {f"{part}.{face}" for part, face in assembly.symmetry}
    parts: list[CadPart] = sorted(assembly.parts, key=lambda part: (-part.volume, part.name))
    for part in parts:
        free = {
            face: area for face, area in assembly.ends.items() if face.startswith(f"{part.name}.") and face not in cut
        }
        if free:
            return min(free, key=lambda face: (-round(free[face], 6), face))
    return None


def scene_text(sketch: SceneSketch) -> str:
    """The scene as TOML."""
    blocks = [_head(sketch), *_materials(sketch), _mesh(sketch), _contact(sketch), *_bolts(sketch), *_support(sketch)]
    return "\n\n".join(blocks) + "\n"


def _head(sketch: SceneSketch) -> str:
    lines = [
        f"# Of {sketch.source}. What is marked with (?) is a proposal: the file does not tell it.",
        f"name = {toml_value(part_name(sketch.name))}",
    ]
    return "\n\n".join(lines)


def material_named(text: str | None) -> str | None:
    """The material of ``MATERIALS`` that a name means.

    >>> material_named("EN AW-6082 (AlSi1MgMn)"), material_named("Stainless Steel 304"), material_named("unobtainium")
    ('aluminium', 'stainless_steel', None)
    """
    if not text:
        return None
    lowered = text.lower()
    return next((name for name, words in _WORDS if any(word in lowered for word in words)), None)


def _material_of(sketch: SceneSketch, part: str) -> tuple[str, str]:
    """Material of a part, and where it is from in words."""
    text, density = sketch.made_of.get(part, (None, None))
    known = material_named(text)
    if known is not None:
        return known, f"{text} in the file"
    if density is not None:
        nearest = min(MATERIALS, key=lambda name: abs(math.log(MATERIALS[name][2] / density)))
        return nearest, f"{density:.4g} kg/m3 in the file"
    return "steel", "(?)"


def _materials(sketch: SceneSketch) -> Iterator[str]:
    """A table for each material that a part has."""
    used = dict.fromkeys(_material_of(sketch, part)[0] for part in sketch.parts)
    for name in used:
        modulus, ratio, density = MATERIALS[name]
        yield (f"[material.{name}]\nyoung_modulus = {modulus:g}\npoisson_ratio = {ratio:g}\ndensity = {density:.1f}")
    others = [name for name in ("steel", "aluminium") if name not in used]
    for name in others:
        modulus, ratio, density = MATERIALS[name]
        yield f"[material.{name}]\nyoung_modulus = {modulus:g}\npoisson_ratio = {ratio:g}\ndensity = {density:.1f}"


def _mesh(sketch: SceneSketch) -> str:
    """The mesh and the materials of its parts, a line for each product."""
    table = part_name(sketch.name)
    scale = f"scale = {sketch.scale:g}"
    if sketch.guessed:
        scale = f"{scale.ljust(40)}# (?) m for a unit of the file, which names none"
    lines = [
        f"[mesh.{table}]",
        f"file = {toml_value(sketch.file)}",
        scale,
        *sketch.lines,
        "",
        f"[mesh.{table}.material]".ljust(40) + "# by names of parts, the first that fits",
    ]
    for pattern, members in patterns(sketch.parts).items():
        material, why = _material_of(sketch, members[0])
        said = [f"{len(members)} parts"] if len(members) > 1 else []
        colours = {sketch.colours[m] for m in members if m in sketch.colours}
        if len(colours) == 1:
            said.append("colour " + " ".join(str(c) for c in next(iter(colours))))
        lines.append(f'"{pattern}" = "{material}"'.ljust(40) + f"# {', '.join([why, *said])}")
    return "\n".join(lines)


def patterns(names: Sequence[str]) -> dict[str, list[str]]:
    """Patterns that share names out, with their names: several of one stem have "stem_*", if it fits no other.

    >>> patterns(["bolt_1", "bolt_2", "plate"])
    {'bolt_*': ['bolt_1', 'bolt_2'], 'plate': ['plate']}
    """
    stems: dict[str, list[str]] = {}
    for name in names:
        stems.setdefault(re.sub(r"_\d+$", "", name), []).append(name)
    found: dict[str, list[str]] = {}
    for stem, members in stems.items():
        pattern = f"{stem}_*"
        if len(members) > 1 and [n for n in names if fnmatchcase(n, pattern)] == members:
            found[pattern] = members
        else:
            found |= {name: [name] for name in members}
    return found


def _contact(sketch: SceneSketch) -> str:
    lines = (
        ("[contact.all]", "every pair of parts whose faces are nearer than this, m"),
        (f"search = {sketch.search:g}", ""),
        ('points_at = "corners"', 'pressures linear over facets; "nodes" has four times the points'),
        ('overlap = "ignore"', "facets of a shaft and those of its hole cross each other"),
        (f"friction_coefficient = {_FRICTION:g}", "(?)"),
    )
    return "\n".join(f"{line.ljust(40)}# {said}" if said else line for line, said in lines)


# -- screws --------------------------------------------------------------------------------------------------------
def _bolts(sketch: SceneSketch) -> Iterator[str]:
    """A table for the screws of one size whose threads are in parts of one pattern."""
    groups: dict[tuple[str | None, float, str], list[Screw]] = {}
    for screw in sketch.screws:
        diameter = 0.0 if screw.size else round(screw.diameter, 2)
        groups.setdefault((screw.size, diameter, _thread_part(screw, sketch)), []).append(screw)
    taken: set[str] = set()
    for (size, _, thread), screws in groups.items():
        names = [screw.part for screw in screws]
        stem = _table_name(size, taken)
        yield "\n".join(
            [f"[bolt.{stem}]", f"parts = {_listed(names, sketch.parts)}", *_tightened(size, thread, screws)]
        )
    if sketch.possible:
        how = "a table like those above tightens one all the same"
        if not sketch.screws:
            how = "a table like the one below tightens one"
        lines = [f"# Not taken for screws ({how}):"]
        lines += [f"#   {screw.part}: {screw.kind}, {screw.why}" for screw in sketch.possible]
        if not sketch.screws:
            part = toml_value(sketch.possible[0].part)
            lines += ["# [bolt.m6]", f"# parts = {part}", '# thread = {size = "M6", part = "nut"}', "# torque = 10"]
        yield "\n".join(lines)


def _thread_part(screw: Screw, sketch: SceneSketch) -> str:
    """Pattern of the parts with the thread of a screw: none of what it clamps may fit it."""
    stems = {re.sub(r"_\d+$", "", name) for name in screw.threads}
    if len(stems) == 1:
        stem = next(iter(stems))
        many = [name for name in sketch.parts if fnmatchcase(name, f"{stem}_*")]
        alone = len(screw.threads) == 1 and len(many) < 2
        clamped = any(fnmatchcase(name, f"{stem}_*") for name in screw.clamped)
        if not alone and not clamped and all(name in many for name in screw.threads):
            return f"{stem}_*"
    if len(screw.threads) == 1:
        return screw.threads[0]
    # a pattern of the scene: alternatives are not in its language, the longest common beginning is
    common = screw.threads[0]
    while common and not all(name.startswith(common) for name in screw.threads):
        common = common[:-1]
    return f"{common}*"


def _table_name(size: str | None, taken: set[str]) -> str:
    stem = part_name((size or "screw").lower().replace("/", "_").replace(" ", "_").replace("#", "no"))
    stem = re.sub("_+", "_", stem)
    name, number = stem, 1
    while name in taken:
        number += 1
        name = f"{stem}_{number}"
    taken.add(name)
    return name


def _listed(names: Sequence[str], parts: Sequence[str]) -> str:
    """Names as a pattern where one fits them alone, else one by one."""
    found = patterns(parts)
    for pattern, members in found.items():
        if members == list(names):
            return toml_value(pattern)
    return toml_value(list(names) if len(names) > 1 else names[0])


def _tightened(size: str | None, thread: str, screws: Sequence[Screw]) -> Iterator[str]:
    """Thread and tightening of screws of one size."""
    yield_stress = class_yield(_CLASS) or 0.0
    if size is None:
        area = math.pi / 4.0 * (0.9 * screws[0].diameter) ** 2
        force = float(f"{_SHARE * yield_stress * area:.2g}")
        yield (
            f"thread = {{part = {toml_value(thread)}}}".ljust(40)
            + f"# no standard size has {screws[0].diameter:.4g} mm"
        )
        yield f"force = {force:g}".ljust(40) + f"# N (?): {_SHARE:.0%} of the yield of class {_CLASS}"
        return
    named = thread_named(size)
    assert named is not None
    torque = NUT_FACTOR * 1e-3 * named.diameter * _SHARE * yield_stress * tensile_stress_area(size)
    yield f"thread = {{size = {toml_value(size)}, part = {toml_value(thread)}}}"
    yield f"torque = {float(f'{torque:.2g}'):g}".ljust(40) + f"# N m (?): {_SHARE:.0%} of the yield of class {_CLASS}"
    yield f"property_class = {toml_value(_CLASS)}".ljust(40) + "# (?)"


# -- supports and time ------------------------------------------------------------------------------------------------
def _support(sketch: SceneSketch) -> Iterator[str]:
    """A support, a shock in its place as a comment, and the time."""
    face = sketch.support
    if face is None:
        yield '# [boundary.base]\n# type = "fixed"\n# face = "part.face"'
    else:
        part = face.partition(".")[0]
        names = f"# faces of {part}: {', '.join(sketch.faces.get(part, ()))}"
        if len(names) > _WIDTH:
            names = names[: names.rindex(",", 0, _WIDTH - 4)] + ", ..."
        yield "\n".join(
            [
                f"{'[boundary.base]'.ljust(40)}# (?) what holds the assembly",
                'type = "fixed"',
                f"face = {toml_value(face)}",
                names,
            ]
        )
    for part, plane in sketch.symmetry:
        yield f'[boundary.{part_name(f"symmetry_{plane[0]}_{part}")}]\ntype = "symmetry"\nface = "{part}.{plane}"'
    yield "\n".join(
        [
            "# A shock in the place of this support, with the second [time]:",
            '# type = "acceleration"',
            '# components = ["x", "y", "z"]',
            '# value = [0.0, 0.0, "100 g"]',
            '# law = {type = "half_sine", duration = "6 ms"}',
        ]
    )
    yield "\n".join(
        [
            f"{'[time]'.ljust(40)}# the tightening alone",
            "quasi_static = true",
            "end = 1.0",
            "instants = 1",
            "# [time]",
            '# end = "20 ms"',
            '# step = "20 us"',
        ]
    )
