"""Names of parts, units and materials of a STEP file, screws among parts, changes: without a library of CAD."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex

from latin_fmu.cad.facts import CadAssembly, CadCylinder, CadPart, Screw, merged
from latin_fmu.cad.geometry import ALONG
from latin_fmu.cad.labels import named, path_of
from latin_fmu.cad.record import changes, read_record, record_text
from latin_fmu.cad.report import report_lines
from latin_fmu.cad.scene_text import patterns, proposed_support, scene_text, sketch_of
from latin_fmu.cad.screws import find_screws, size_of
from latin_fmu.cad.step_text import read_step_text
from latin_fmu.errors import MeshError
from latin_fmu.pictures.screw_picture import screw_figure
from latin_fmu.pictures.style import BAD, DISTINCT


def part(path: Sequence[str], at: tuple[float, float, float] = (0.0, 0.0, 0.0), size: float = 10.0) -> CadPart:
    """A cube."""
    high = (at[0] + size, at[1] + size, at[2] + size)
    middle = (at[0] + size / 2, at[1] + size / 2, at[2] + size / 2)
    corners = np.array([[x, y, z] for x in (at[0], high[0]) for y in (at[1], high[1]) for z in (at[2], high[2])])
    return CadPart("", tuple(path), 1, size**3, 6 * size**2, middle, at, high, None, (), corners, size)


def tube(radius: float, low: float, high: float, outward: bool, turn: float = 1.0) -> CadCylinder:
    """A round face about the z axis."""
    return CadCylinder((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), radius, low, high, outward, turn, (1,))


def turned(name: str, rounds: Sequence[CadCylinder], wide: float | None = None) -> CadPart:
    """A part about the z axis from its round faces; ``wide`` : distance from the axis of corners that it has."""
    low, high = min(c.low for c in rounds), max(c.high for c in rounds)
    radius = wide or max(c.radius for c in rounds)
    angles = np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False)
    circles = [(c.radius, z) for c in rounds for z in (c.low, c.high)]
    if wide is not None:
        circles += [(wide, low), (wide, high)]
    outline = np.array([[r * np.cos(a), r * np.sin(a), z] for r, z in circles for a in angles])
    solid = [c for c in rounds if c.outward] or [tube(radius, low, high, True)]
    volume = sum(np.pi * c.radius**2 * c.length for c in solid)
    box = (-radius, -radius, low), (radius, radius, high)
    return CadPart(name, (name,), 1, volume, 1.0, (0, 0, 0), *box, None, tuple(rounds), outline, 1.0)


def plate(name: str, low: float, high: float, hole: float) -> CadPart:
    """A plate with a hole about the z axis."""
    return turned(name, [tube(hole, low, high, False)], wide=40.0)


def hex_nut(name: str, low: float, hole: float) -> CadPart:
    """A nut about the z axis."""
    return turned(name, [tube(hole, low, low + 1.6 * hole, False)], wide=1.9 * hole)


def bolt(name: str, low: float = -30.0, radius: float = 3.0) -> CadPart:
    """A bolt about the z axis with its head above z = 0."""
    return turned(name, [tube(radius, low, 0.0, True), tube(1.5 * radius, 0.0, 2 * radius, True)])


def test_marks_of_programs_are_left_out_of_paths_and_numbers_of_standards_are_not() -> None:
    assert path_of("Shapes/as1/nut_1/nut & & 256") == ("as1", "nut_1", "nut")
    assert path_of("Shapes/ASM/BOLT/=>[0:1:1:11]/SOLID") == ("ASM", "BOLT")
    assert path_of("Shapes/DIN 912") == ("DIN 912",)


def test_six_parts_of_one_name_are_counted_by_path_and_keep_their_names() -> None:
    bolts = [
        part(("asm", f"group_{g}", f"bolt_{i}", "bolt"), (20.0 * g, 15.0 * i, 0)) for g in (10, 2) for i in (1, 2, 3)
    ]
    names = named(bolts)
    # group_2 comes before group_10
    assert names == ["bolt_4", "bolt_5", "bolt_6", "bolt_1", "bolt_2", "bolt_3"]
    before = [replace(one, name=name) for one, name in zip(bolts, names, strict=True)]
    # read again without the second one, in another order, and with one more before all others
    rest = [part(("asm", "group_1", "bolt_1", "bolt"), (-50.0, 0, 0)), *bolts[:0:-1]]
    assert named(rest, before) == ["bolt_4", *names[:0:-1]]
    assert named(rest[1:], before) == names[:0:-1]


def test_parts_of_one_path_are_told_apart_by_place() -> None:
    nuts = [part(("asm", "NUT"), (x, 0.0, 0.0)) for x in (40.0, 0.0, 20.0)]
    names = named(nuts)
    assert names == ["nut_3", "nut_1", "nut_2"]
    before = [replace(one, name=name) for one, name in zip(nuts, names, strict=True)]
    assert named([nuts[2], nuts[0]], before) == ["nut_2", "nut_3"]


def test_halves_of_a_hole_are_one_and_a_stepped_hole_is_two() -> None:
    halves = [replace(tube(3.0, 0.0, 8.0, False, 0.5), faces=(i,)) for i in (1, 2)]
    (whole,) = merged(halves)
    assert whole.turn == pytest.approx(1.0)
    assert whole.faces == (1, 2)
    assert len(merged([tube(3.0, 0.0, 8.0, False), tube(5.0, 8.0, 12.0, False)])) == 2
    assert len(merged([tube(3.0, 0.0, 8.0, False), tube(3.0, 20.0, 28.0, False)])) == 2


def test_a_bolt_with_a_nut_a_screw_in_a_tapped_hole_and_a_stud() -> None:
    stack = [plate("upper", -10.0, 0.0, 3.3), plate("lower", -20.0, -10.0, 3.3)]
    (found,) = find_screws([bolt("body"), *stack, hex_nut("ring", -25.0, 3.0)])
    assert (found.used, found.kind, found.size, found.threads) == (True, "bolt with nut", "M6", ("ring",))
    assert found.clamped == ("upper", "lower")

    (found,) = find_screws([bolt("body"), *stack, hex_nut("ring", -25.0, 3.0)], scale=2e-3)
    assert found.size == "M12"

    tapped = [plate("upper", -10.0, 0.0, 3.3), plate("lower", -40.0, -10.0, 2.5)]
    (found,) = find_screws([bolt("body"), *tapped])
    assert (found.used, found.kind, found.threads, found.clamped) == (True, "screw", ("lower",), ("upper",))

    rod = turned("rod", [tube(5.0, -60.0, 60.0, True)])
    ends = [plate("left", -50.0, -40.0, 5.5), plate("right", 40.0, 50.0, 5.5)]
    (found,) = find_screws([rod, *ends, hex_nut("nut_1", -58.0, 5.0), hex_nut("nut_2", 50.0, 5.0)])
    assert (found.used, found.kind, found.threads) == (True, "stud", ("nut_1", "nut_2"))


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (turned("peg", [tube(3.0, -15.0, 5.0, True)]), "pin"),
        (turned("dowel pin", [tube(3.0, -15.0, 5.0, True)]), "pin"),
        (turned("standoff", [tube(3.0, -15.0, 0.0, True), tube(2.4, 2.0, 12.0, False)], wide=5.0), "standoff"),
        (turned("shoulder pin", [tube(3.0, -15.0, 0.0, True), tube(4.5, 0.0, 5.0, True)]), "pin"),
        (
            turned("hollow bolt", [tube(3.0, -15.0, 0.0, True), tube(4.5, 0.0, 5.0, True), tube(2, -15, 5, False)]),
            "no screw",
        ),
    ],
)
def test_pins_standoffs_and_hollow_parts_are_possible_and_not_used(body: CadPart, kind: str) -> None:
    (found,) = find_screws([body, plate("upper", -10.0, 0.0, 3.0), plate("lower", -40.0, -10.0, 3.0)])
    assert (found.used, found.kind) == (False, kind)


def test_a_lever_on_a_spigot_is_no_screw_and_a_name_without_a_hole_is_told() -> None:
    lever = turned("lever", [tube(3.0, -15.0, 0.0, True), tube(4.5, 0.0, 5.0, True)], wide=40.0)
    assert not find_screws([lever, plate("upper", -10.0, 0.0, 3.0), plate("lower", -40.0, -10.0, 3.0)])
    (found,) = find_screws([bolt("ISO 4014 M6x30"), plate("upper", -10.0, 0.0, 9.0)])
    assert (found.used, found.kind) == (False, "no hole")


def test_a_washer_is_clamped_and_no_nut() -> None:
    washer = turned("disc", [tube(3.0, -22.0, -20.5, False), tube(5.9, -22.0, -20.5, True)])
    stack = [plate("upper", -10.0, 0.0, 3.3), plate("lower", -20.5, -10.0, 3.3)]
    (found,) = find_screws([bolt("body"), *stack, washer, hex_nut("ring", -27.0, 3.0)])
    assert found.threads == ("ring",)
    assert set(found.clamped) == {"upper", "lower", "disc"}


def test_sizes_of_threads() -> None:
    plain = part(("bolt",))
    assert [size_of(plain, d) for d in (10.0, 3.0, 8.16, 7.3)] == ["M10", "M3", "M10", None]
    assert [size_of(plain, d, inch=True) for d in (6.35, 9.525, 10.0)] == ["1/4 UNC", "3/8 UNC", "M10"]
    # drawn at the core, and named
    assert size_of(part(("ISO 4762 M8x30",)), 6.6) == "M8"
    assert size_of(part(("ISO 4762 M8x30",)), 12.0) == "M12"


def test_unit_material_and_density_from_the_text_of_a_step_file(tmp_path: Path) -> None:
    file = tmp_path / "one.step"
    file.write_text(
        "#1=PRODUCT('lid','lid','',(#9));\n#2=PRODUCT_DEFINITION_FORMATION('','',#1);\n"
        "#3=PRODUCT_DEFINITION('d','',#2,#8);\n#4=PROPERTY_DEFINITION('material property','',#3);\n"
        "#5=REPRESENTATION('material',(#6,#7),#8);\n#6=DESCRIPTIVE_REPRESENTATION_ITEM('material name','AlSi10Mg');\n"
        "#7=MEASURE_REPRESENTATION_ITEM('density measure',POSITIVE_RATIO_MEASURE(2.7E-6),#8);\n"
        "#10=PROPERTY_DEFINITION_REPRESENTATION(#4,#5);\n"
        "#20=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n"
        "#21=(CONVERSION_BASED_UNIT('INCH',#30)LENGTH_UNIT()NAMED_UNIT(#31));\n"
        "#22=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#21,#23))REPRESENTATION_CONTEXT('',''));\n",
        encoding="utf-8",
    )
    found = read_step_text(file)
    assert (found.unit, found.materials) == ("in", {"lid": "AlSi10Mg"})
    assert found.densities["lid"] == pytest.approx(2700.0)


def test_patterns_share_names_out_and_fit_no_other() -> None:
    names = ["bolt_1", "bolt_2", "bolt_long_1", "plate"]
    assert patterns(names) == {n: [n] for n in names}
    assert patterns(["bolt_1", "bolt_2", "plate"]) == {"bolt_*": ["bolt_1", "bolt_2"], "plate": ["plate"]}


def assembly(parts: Sequence[CadPart], names: Sequence[str]) -> CadAssembly:
    """An assembly with faces."""
    made = CadAssembly("a.step", "mm", 1e-3, [replace(p, name=n) for p, n in zip(parts, names, strict=True)])
    made.faces = {name: ["xmin", f"on_{name}"] for name in names}
    return made


def test_a_mirror_image_is_of_the_other_hand_wherever_it_is() -> None:
    places = np.random.default_rng(5).uniform(0.0, 1.0, (40, 3)) ** [1.0, 2.0, 3.0] * [30.0, 20.0, 10.0]
    one = replace(part(["clip"]), outline=places)
    turn = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = replace(one, outline=places @ turn.T + [5.0, -80.0, 3.0])
    image = replace(one, outline=moved.outline * [-1.0, 1.0, 1.0])
    assert abs(one.handedness) == 1
    assert (moved.handedness, image.handedness) == (one.handedness, -one.handedness)
    assert part(["cube"]).handedness == 0
    # a prism that is its own mirror image, though its ends differ
    flat = np.concatenate([places, places * [1.0, -1.0, 1.0]])
    assert replace(one, outline=flat).handedness == 0


def test_an_edge_that_winds_around_a_part_is_counted() -> None:
    """Six turns of a helix about a shank of 6 mm with a head of 10 mm."""
    shank = replace(bolt("screw"), low=(-5.0, -5.0, -20.0), high=(5.0, 5.0, 0.0))
    assert replace(shank, longest=6 * np.pi * 6.0).turns == pytest.approx(3.6)
    assert replace(shank, longest=np.pi * 10.0).turns == pytest.approx(1.0)


def test_screws_are_drawn_in_the_colour_of_their_thread_with_their_names() -> None:
    """Edges are lines of as many places as the outline has of each; a pin that is not tightened is dashed."""
    stack = [plate("upper", -10.0, 0.0, 3.3), plate("lower", -20.0, -10.0, 3.3)]
    made = CadAssembly("a.step", "mm", 1e-3, [bolt("bolt"), *stack, hex_nut("nut", -25.0, 3.0)])
    made.parts.append(turned("pin", [tube(3.0, -16.0, -4.0, True)]))
    angles = np.linspace(0.0, 2.0 * np.pi, ALONG)
    circle = np.stack([3.0 * np.cos(angles), 3.0 * np.sin(angles), np.zeros(ALONG)], axis=1)
    edges = np.concatenate([circle, circle + np.array([0.0, 0.0, 4.0])])
    made.parts = [replace(p, outline=edges) for p in made.parts]
    screw = Screw("bolt", True, "bolt with nut", "", 6.0, "M6", ("nut",), ("upper", "lower"))
    made.screws = [screw, Screw("pin", False, "pin", "", 6.0)]
    figure = screw_figure(made)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["1 x M6 in nut", "1 x not used: pin"]
    for axes in figure.axes:
        assert [text.get_text() for text in axes.texts] == ["bolt", "pin"]
        lines = cast(list[LineCollection], list(axes.collections))
        assert [len(drawn.get_segments()) for drawn in lines] == [2] * 5
        # the screws come last, over the others
        colours = [to_hex(drawn.get_colors()[0]) for drawn in lines]  # type: ignore[index]
        assert colours == [to_hex("0.78")] * 3 + [DISTINCT[0].lower(), BAD.lower()]
    # along z a circle is a circle
    (x, y) = np.array(figure.axes[1].collections[0].get_segments()[0]).T  # type: ignore[attr-defined]
    np.testing.assert_allclose(np.hypot(x, y), 3.0, rtol=1e-12)


def test_changes_name_what_came_went_moved_and_was_renamed(tmp_path: Path) -> None:
    parts = [part(("a",)), part(("b",), (20.0, 0, 0)), part(("c",), (40.0, 0, 0)), part(("d",), (60.0, 0, 0))]
    old = assembly(parts, ["a", "b", "c", "d"])
    moved = replace(parts[0], centre=(5.0, 6.0, 5.0))
    new = assembly([moved, parts[1], part(("e",), (90.0, 0, 0), 7.0), parts[3]], ["a", "beam", "e", "d"])
    new.faces["d"] = ["xmin"]
    file = tmp_path / "a.parts.json"
    file.write_text(record_text(old), encoding="utf-8")
    before = read_record(file)
    assert before is not None
    assert list(changes(before, new)) == [
        "renamed: b is now beam (same place and shape)",
        "gone: c",
        "new: e",
        "changed: a, something in it has moved (its centre of mass by 1 mm)",
        "gone: face d.on_d",
    ]
    assert not list(changes(before, old))
    file.write_text("{}", encoding="utf-8")
    with pytest.raises(MeshError, match="not a record"):
        read_record(file)


def test_a_scene_has_what_its_parts_are_made_of_and_a_table_for_each_kind_of_screw() -> None:
    stack = [plate("upper", -10.0, 0.0, 3.3), plate("lower", -20.0, -10.0, 3.3)]
    made = CadAssembly("a.step", "mm", 1e-3, [bolt("bolt"), *stack, hex_nut("nut", -25.0, 3.0)])
    made.parts[1] = replace(made.parts[1], material="EN AW-6082", colour=(1, 2, 3))
    made.screws = find_screws(made.parts)
    made.ends = {"lower.xmin": 5.0, "lower.ymax": 7.0}
    text = scene_text(sketch_of(made, "a-2.b", "a.msh", 0.02))
    assert '\nname = "a_2_b"\n' in text
    ends = {"lower.xmin": 50.0, "lower.ymin": 30.0}
    half = replace(made, ends=ends, symmetry=[("lower", "xmin")])
    assert [proposed_support(a) for a in (half, replace(half, symmetry=[]))] == ["lower.ymin", "lower.xmin"]
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert '"upper" = "aluminium" # EN AW-6082 in the file, colour 1 2 3' in lines
    assert '"lower" = "steel" # (?)' in lines
    assert 'thread = {size = "M6", part = "nut"}' in lines
    # 0.2 x 6 mm x 0.7 x 640 MPa x 20.1 mm2
    assert "torque = 11 # N m (?): 70% of the yield of class 8.8" in lines
    assert 'face = "lower.ymax"' in lines


def test_a_product_of_several_solids_is_told_and_instances_of_one_are_not() -> None:
    twice, paths = (20.0, 0.0, 0.0), (("asm", "foot"), ("asm", "frame"))
    parts = [part(paths[0]), part(paths[0], twice), part(paths[1]), part(paths[1], twice, size=4.0)]
    made = assembly(parts, ["foot_1", "foot_2", "frame_1", "frame_2"])
    made.counts = {"cells": 4, "nodes": 8}
    notes = [line for line in report_lines(made) if line.startswith("note")]
    assert notes == ["note: frame has solids of different shapes, each of which is a part: frame_1, frame_2"]
