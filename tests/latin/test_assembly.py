"""The flat vector of interface channels: every number has one place, and everyone finds it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.interface import Behaviour, Contact, InterfaceGeometry, Perfect
from latin_fmu.interface.geometry import local_frames
from latin_fmu.latin.assembly import InterfaceUnit, Layout


def unit(name: str, behaviour: Behaviour, n: int, seed: int, preload: float = 0.0) -> InterfaceUnit:
    rng = np.random.default_rng(seed)
    geometry = InterfaceGeometry(
        rng.normal(size=(n, 3)),
        rng.uniform(1.0, 2.0, n),
        local_frames(rng.normal(size=(n, 3))),
        rng.uniform(0.0, 1.0, n),
        (None, None),  # type: ignore[arg-type]
    )
    return InterfaceUnit(name, ("a.x", "b.x"), behaviour, geometry, preload)


@pytest.fixture
def units() -> list[InterfaceUnit]:
    """Three kinds, two of one kind, in mixed order."""
    return [
        unit("slide", Contact(0.3), 4, 0, 2.0),
        unit("bond", Perfect(), 2, 1),
        unit("press", Contact(), 3, 2),
        unit("slide2", Contact(0.6), 5, 3),
    ]


def test_channels_of_all_interfaces_and_sides_partition_the_vector(units: list[InterfaceUnit]) -> None:
    layout = Layout(units)
    picked = [layout.channels(i, side) for i in range(4) for side in (0, 1)]
    assert [p.shape for p in picked[::2]] == [(4, 3), (2, 3), (3, 1), (5, 3)]
    every = np.concatenate([p.ravel() for p in picked])
    np.testing.assert_array_equal(np.sort(every), np.arange(layout.n_flat))
    assert layout.n_flat == 2 * (3 * (4 + 2 + 5) + 3)


def test_interfaces_of_one_kind_form_one_group(units: list[InterfaceUnit]) -> None:
    layout = Layout(units)
    assert len(layout.groups) == 3
    assert layout.group(0) is layout.group(3)
    group = layout.group(0)
    assert (group.n_point, group.n_component) == (9, 3)
    np.testing.assert_array_equal(group.parameters[:, 0], [0.3] * 4 + [0.6] * 5)
    np.testing.assert_array_equal(group.preload, [2.0] * 4 + [0.0] * 5)
    np.testing.assert_array_equal(group.gap, np.concatenate([units[0].geometry.gap, units[3].geometry.gap]))


def test_blocks_and_channels_agree(units: list[InterfaceUnit]) -> None:
    layout = Layout(units)
    flat = np.random.default_rng(5).normal(size=(6, layout.n_flat))
    for i in range(4):
        group = layout.group(i)
        for side in (0, 1):
            np.testing.assert_array_equal(
                group.block(flat)[:, side, group.members[i]], flat[:, layout.channels(i, side)]
            )
    view = layout.group(2).block(flat[0])
    view[...] = 7.0
    assert (flat[0] == 7.0).sum() == 6  # a view, not a copy


def test_areas_and_normals(units: list[InterfaceUnit]) -> None:
    layout = Layout(units)
    for i, u in enumerate(units):
        for side in (0, 1):
            channels = layout.channels(i, side)
            np.testing.assert_array_equal(
                layout.area[channels], np.repeat(u.geometry.areas[:, None], channels.shape[1], axis=1)
            )
            assert layout.normal[channels[:, 0]].all()
            assert not layout.normal[channels[:, 1:]].any()


def test_gather_and_scatter_round_trip(blocks_scene: Any, made: Any) -> None:
    """Substructures use the flat vector through (channel, member) arrays; ground channels belong to none."""
    assembly = made(blocks_scene()).assembly
    rng = np.random.default_rng(6)
    values = [rng.normal(size=c.shape) for c in assembly.channels]
    flat = assembly.gather(values)
    for channels, v in zip(assembly.channels, values, strict=True):
        np.testing.assert_array_equal(flat[channels], v)
    owned = np.concatenate([c.ravel() for c in assembly.channels])
    assert len(np.unique(owned)) == len(owned)
    ground = assembly.layout.channels(0, 1).ravel()
    np.testing.assert_array_equal(np.setdiff1d(np.arange(assembly.layout.n_flat), owned), np.sort(ground))
    assert not flat[ground].any()


def test_members_of_one_class_have_their_own_channels(bars_scene: Any, made: Any) -> None:
    """a and b are equal boxes, but not equal substructures: their interfaces differ; two equal joints are."""
    tables = bars_scene()
    tables["interface"] = {
        "one": {"sides": ["a.zmax", "ground"], "gap": 1.0},
        "two": {"sides": ["b.zmax", "ground"], "gap": 1.0},
    }
    assembly = made(tables).assembly
    assert [p.names for p in assembly.propagators] == [["a", "b"], ["c"]]
    for member in range(2):
        np.testing.assert_array_equal(assembly.channels[0][:, member], assembly.layout.channels(member, 0).ravel())
