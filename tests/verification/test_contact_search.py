"""Interfaces found between boundaries: which pairs, where, what is printed; refusals with numbers."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.body import build_bodies
from latin_fmu.assembly.interfaces import completed, with_found
from latin_fmu.building import discretise
from latin_fmu.cosim.session import Session
from latin_fmu.errors import Problems, SceneError
from latin_fmu.remarks import Remark
from latin_fmu.stability.scenes import STEEL, Box, placed

PLATE = (0.04, 0.04, 0.01)
BLOCKS = {  # a plate, a block on it, a lid 2e-5 above the block, a lid out of reach
    "plate": (Box(STEEL, PLATE, (4, 4, 1)), (0.0, 0.0, 0.0)),
    "block": (Box(STEEL, (0.02, 0.02, 0.02), (3, 3, 2)), (0.01, 0.01, 0.01)),
    "lid": (Box(STEEL, PLATE, (5, 5, 1)), (0.0, 0.0, 0.03002)),
    "far": (Box(STEEL, PLATE, (2, 2, 1)), (0.0, 0.0, 0.06)),
}


def tables(**search: Any) -> dict[str, Any]:
    contact = {"all": {"search": 1e-4, "friction_coefficient": 0.15, **search}}
    return placed(BLOCKS, {"end": 1e-6, "instants": 2}, contact=contact)


def units(data: dict[str, Any]) -> dict[str, Any]:
    return {u.name: u for u in discretise(latin_fmu.scene_from_dict(data)).units}


def test_pairs_within_reach() -> None:
    """Area, gap and owner of each pair; the block is wholly covered on both ends."""
    interfaces = units(tables())
    assert list(interfaces) == ["plate_block", "block_lid"]
    for name, gap in (("plate_block", 0.0), ("block_lid", 2e-5)):
        unit = interfaces[name]
        assert unit.geometry.areas.sum() == pytest.approx(4e-4)
        assert unit.geometry.gap == pytest.approx(gap, abs=1e-15)
        assert unit.sides[unit.geometry.owner] == "block.*"
        assert unit.geometry.n_point == 16
        assert unit.behaviour.friction_coefficient == 0.15
    assert interfaces["plate_block"].geometry.frames[:, 0] == pytest.approx(np.tile([0.0, 0.0, 1.0], (16, 1)))


def test_check_prints_the_pairs_and_parts_that_touch_nothing() -> None:
    text = "\n".join(latin_fmu.check(latin_fmu.scene_from_dict(tables())))
    assert "interface plate_block: contact, 16 points, area 0.0004 m2, gap 0 m, points of block.*, found" in text
    assert "interface block_lid: contact, 16 points, area 0.0004 m2, gap 2e-05 m, points of block.*, found" in text
    assert "warning: substructure far touches nothing" in text
    assert "lid is the nearest, 0.01998 m" in text


def test_a_pair_named_by_hand_wins() -> None:
    data = tables()
    data["interface"] = {"mine": {"sides": ["plate.zmax", "block.zmin"], "behaviour": "perfect"}}
    assert list(units(data)) == ["mine", "block_lid"]


def test_faces_that_interfaces_by_hand_leave_open_are_told() -> None:
    """The search leaves plate and block as they are: their seat, 4e-4 m2, is in no interface but the one that has it,
    and parts that are bonded somewhere cannot move into each other."""
    texts = []
    for sides, behaviour in (
        (["plate.zmax", "block.zmin"], "contact"),
        (["plate.xmax", "block.xmin"], "perfect"),
        (["plate.xmax", "block.xmin"], "contact"),
    ):
        scene = latin_fmu.scene_from_dict(tables() | {"interface": {"mine": {"sides": sides, "behaviour": behaviour}}})
        remarks: list[Remark] = []
        with_found(scene, build_bodies(scene, Problems()), Problems(), remarks)
        texts.append([r for r in remarks if r.code == "unjoined"])
    assert texts[:2] == [[], []]
    assert len(texts[2]) == 1
    for word in ("plate and block", "0.0004 m2", "(mine)", "add an [interface.NAME]"):
        assert word in texts[2][0]


def test_exceptions_and_parts() -> None:
    assert list(units(tables(**{"except": [["block", "plate"]]}))) == ["block_lid"]
    assert list(units(tables(parts=["plate", "block", "far"]))) == ["plate_block"]


def test_searches_in_turn() -> None:
    """The first table that finds a pair has it."""
    data = tables(parts=["plate", "block"])
    data["contact"]["rest"] = {"search": 1e-4, "behaviour": "no_slip", "gap": "closed"}
    interfaces = units(data)
    assert {n: u.behaviour.name for n, u in interfaces.items()} == {"plate_block": "contact", "block_lid": "no_slip"}
    assert interfaces["block_lid"].geometry.gap == pytest.approx(0.0, abs=0.0)


def test_the_scene_completed_is_an_ordinary_one() -> None:
    """Written out and read again it has the same interfaces; variables of a session are named after them."""
    scene = latin_fmu.scene_from_dict(tables())
    whole = completed(scene)
    assert list(whole.interface) == ["plate_block", "block_lid"]
    assert latin_fmu.scene_from_dict(whole.tables()).interface == whole.interface
    assert completed(whole) is whole
    assert latin_fmu.scene_from_dict(scene.tables()) == scene
    assert any("block_lid" in name for name in Session(scene).outputs)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"except": [["plate", "blok"]]}, ["contact.all.except", "blok", "did you mean"]),
        ({"parts": ["lit"]}, ["contact.all.parts", "lit", "did you mean"]),
        ({"search": 0.0}, ["contact.all.search", "> 0"]),
        ({"behaviour": "perfect"}, ["contact.all.friction_coefficient", "has no effect"]),
        ({"gap": "shut"}, ["contact.all.gap", "closed"]),
        ({"serch": 1.0}, ["contact.all.serch", "unknown key", "search"]),
    ],
)
def test_mistakes_are_named(change: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        latin_fmu.scene_from_dict(tables(**change))
    for word in words:
        assert word in str(caught.value)


def test_overlap_beyond_the_search_is_refused() -> None:
    data = copy.deepcopy(tables())
    data["substructure"]["lid"]["box"]["origin"][2] = 0.03 - 1.5e-4
    with pytest.raises(SceneError) as caught:
        latin_fmu.check(latin_fmu.scene_from_dict(data))
    for word in ("contact.all.search", "block and lid overlap", "0.00015 m", "0.0001 m"):
        assert word in str(caught.value)


def test_overlap_within_the_search_is_refused_or_closed() -> None:
    data = tables(**{"except": [["plate", "block"]]})
    data["substructure"]["lid"]["box"]["origin"][2] = 0.03 - 5e-5
    with pytest.raises(SceneError, match="overlap at the start"):
        units(data)
    data["contact"]["all"]["gap"] = "closed"
    assert units(data)["block_lid"].geometry.gap == pytest.approx(0.0, abs=0.0)


@pytest.mark.parametrize("deep", [1.5e-4, 5e-4, 5e-3])
def test_overlap_far_beyond_the_search_is_refused(deep: float) -> None:
    """However deep, a body in another is found: the two would pass through each other."""
    data = copy.deepcopy(tables())
    data["substructure"]["lid"]["box"]["origin"][2] = 0.03 - deep
    with pytest.raises(SceneError, match=f"block and lid overlap.*{deep:.4g} m"):
        latin_fmu.check(latin_fmu.scene_from_dict(data))


def test_round_off_of_a_geometry_is_closed() -> None:
    """Overlap below a twentieth of the search: gap 0 and a remark; above, it is a press fit."""
    data = tables(**{"except": [["plate", "block"]]})
    data["substructure"]["lid"]["box"]["origin"][2] = 0.03 - 4e-6
    discretised = discretise(latin_fmu.scene_from_dict(data))
    assert discretised.units[0].geometry.gap == pytest.approx(0.0, abs=1e-15)
    remark = next(r for r in discretised.remarks if r.code == "overlap")
    assert "block_lid" in remark
    assert "4e-06 m" in remark
    data["substructure"]["lid"]["box"]["origin"][2] = 0.03 - 6e-6
    assert discretise(latin_fmu.scene_from_dict(data)).units[0].geometry.gap == pytest.approx(-6e-6)
