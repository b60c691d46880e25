"""What ``latin-fmu mesh`` and ``scene`` print: what was read, used and named, screws, neighbours, the mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .facts import CadAssembly, CadPart
from .neighbours import overlaps_and_gaps
from .scene_text import patterns

_MOST = 12  # lines of one kind


def report_lines(assembly: CadAssembly) -> list[str]:
    """Lines for a user."""
    screwed = [frozenset({s.part, other}) for s in assembly.screws if s.used for other in (*s.threads, *s.clamped)]
    beside = list(overlaps_and_gaps(assembly.pairs, screwed))
    return [*_parts(assembly), *_limited(beside), *_screws(assembly), *_mesh(assembly)]


def _parts(assembly: CadAssembly) -> Iterator[str]:
    low = np.min([part.low for part in assembly.parts], axis=0)
    high = np.max([part.high for part in assembly.parts], axis=0)
    mm = " x ".join(f"{x * assembly.scale * 1e3:.4g}" for x in high - low)
    count = len(assembly.parts)
    yield f"{assembly.file}: {count} part{'s' * (count > 1)} in {assembly.unit}, {mm} mm over all"
    by_name = assembly.by_name
    rows = [("read", "used", "named")]
    for pattern, names in patterns([part.name for part in assembly.parts]).items():
        part = by_name[names[0]]
        label = part.path[-1] if part.path else "without a name"
        kinds = {f"solid{'s' * (len(names) > 1)}"}
        rows.append((f"{len(names)} x {label}", f"{len(names)} {kinds.pop()}{_properties(part)}", pattern))
    yield from _aligned(rows)
    yield from (f"left out: {text}" for text in assembly.left_out)
    yield from _limited([*_of_several_solids(assembly), *assembly.remarks])


def _of_several_solids(assembly: CadAssembly) -> Iterator[str]:
    """Products that are solids of different shapes: instances of one solid have one shape."""
    by_path: dict[tuple[str, ...], list[CadPart]] = {}
    for part in assembly.parts:
        by_path.setdefault(part.path, []).append(part)
    for path, parts in by_path.items():
        if path and not all(part.same_shape(parts[0]) for part in parts):
            names = ", ".join(part.name for part in parts[:4]) + ", ..." * (len(parts) > 4)
            yield f"{path[-1]} has solids of different shapes, each of which is a part: {names}"


def _properties(part: CadPart) -> str:
    """Material, density and colour of a part that its file names."""
    said = [part.material] if part.material else []
    if part.density is not None:
        said.append(f"{part.density:.4g} kg/m3")
    if part.colour is not None:
        said.append("colour " + " ".join(map(str, part.colour)))
    return "".join(f", {text}" for text in said)


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        yield "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


def _limited(lines: Sequence[str]) -> Iterator[str]:
    yield from (f"note: {line}" for line in lines[:_MOST])
    if len(lines) > _MOST:
        yield f"note: ... {len(lines)} such lines in all"


def _screws(assembly: CadAssembly) -> Iterator[str]:
    if not assembly.screws:
        yield "screws: none found"
        return
    used = sum(screw.used for screw in assembly.screws)
    yield f"screws: {used}, and {len(assembly.screws) - used} possible"
    rows = [("part", "kind", "thread", "in", "clamps")]
    for screw in assembly.screws:
        size = screw.size or f"{screw.diameter:.4g} mm"
        if screw.used:
            rows.append((screw.part, screw.kind, size, ", ".join(screw.threads), ", ".join(screw.clamped)))
        else:
            rows.append((screw.part, f"possible: {screw.kind}", "-", "-", f"not used: {screw.why}"))
    yield from _aligned(rows)


def _mesh(assembly: CadAssembly) -> Iterator[str]:
    if "contact unknowns" not in assembly.counts:  # a mesh from elsewhere
        yield f"mesh: {assembly.counts['cells']:,.0f} cells, {assembly.counts['nodes']:,.0f} nodes"
        return
    counts, touching = assembly.counts, sum(bool(pair.faces[0]) for pair in assembly.pairs)
    yield (
        f"mesh: {counts['cells']:,.0f} tetrahedra of 10 nodes, {counts['nodes']:,.0f} nodes, {touching} pairs of parts "
        f"that touch, some {counts['contact unknowns']:,.0f} unknowns of contacts"
    )
    yield "processor time: " + ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in assembly.seconds.items())
