"""Whatever is written into a scene, the outcome is a scene or a SceneError; damaged texts: ``tests/fuzz``."""

from __future__ import annotations

import copy
import datetime
import math
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from latin_fmu.errors import SceneError
from latin_fmu.reader import load_scene, scene_from_dict
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import MINUTES, MODELS

LARGE = {"n08", "n16", *MINUTES}
PATHS = [path for path in sorted(MODELS.glob("*/*.toml")) if not {path.stem, path.parent.name} & LARGE]
SOURCES = [(path.parent, tomllib.loads(path.read_text(encoding="utf-8"))) for path in PATHS]
BOLTED = column(
    {"bar": Box(replace(STEEL, keys={"yield_stress": 1e9}), (0.01, 0.01, 0.05), (2, 2, 7))},
    {},
    {"end": 1.0, "instants": 2, "quasi_static": True},
    boundary={end: {"type": "fixed", "face": f"bar.{end}"} for end in ("zmin", "zmax")},
    bolt={
        "b": {"substructure": "bar", "axis": [0, 0, 1], "force": 1e3, "point": [0.005, 0.005, 0.02], "order": 2},
        "c": {"substructure": "bar", "axis": [0, 0, 1], "shortening": 1e-5},
    },
)
SOURCES.append((MODELS, BOLTED))
WORDS = [
    "steel",
    "ground",
    "bar.zmin",
    "a.b.c",
    "whole",
    "perfect",
    "contact",
    "table",
    "type",
    "csv",
    "half_sine",
    "periodic",
    "velocity",
    "",
    "x",
    "nan",
    "1e3",
    ".",
    "..",
    "/",
    "a\0b",
    "\ud800",
    "\U0001f600",
    "[key]",
]
KEYS = [
    "type",
    "law",
    "box",
    "mesh",
    "sides",
    "faces",
    "face",
    "times",
    "values",
    "file",
    "gap",
    "preload",
    "behaviour",
    "value",
    "components",
    "step",
    "instants",
    "scheme",
    "window",
    "start",
    "ground_velocity",
    "direction",
    "factor",
]

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.just(5000).map(lambda digits: 10**digits),
    st.sampled_from([10**30, 10**400, -(10**400)]),
    st.floats(),
    st.sampled_from([0, 1, -1, 1e308, 5e-324, math.nan, math.inf]),
    st.sampled_from(WORDS),
    st.text(max_size=8),
    st.binary(max_size=3),
    st.just(datetime.date(2000, 1, 1)),
)
values = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.one_of(st.sampled_from(KEYS), st.text(max_size=5)), inner, max_size=4),
    ),
    max_leaves=6,
)
SMALL_TIME = settings(max_examples=250, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) of a nested scene."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, item in list(items):
        yield data, key
        if isinstance(item, (dict, list)):
            yield from places(item)


def check_message(error: SceneError) -> None:
    assert error.problems
    assert str(error).encode("utf-8")
    assert len(str(error)) < 400 * len(error.problems) + 100


def check(data: Any, base_dir: Path) -> None:
    try:
        scene = scene_from_dict(data, base_dir)
    except SceneError as error:
        check_message(error)
        return
    assert scene_from_dict(tomllib.loads(scene.text()), base_dir) == scene


@SMALL_TIME
@given(st.data())
def test_changed_models(data: st.DataObject) -> None:
    """Replace, remove, rename, double a few items anywhere."""
    base_dir, source = data.draw(st.sampled_from(SOURCES))
    scene = copy.deepcopy(source)
    for _ in range(data.draw(st.integers(1, 3))):
        spots = list(places(scene))
        container, key = spots[data.draw(st.integers(0, len(spots) - 1))]
        change = data.draw(st.sampled_from(["replace", "replace", "swap", "remove", "rename"]))
        if change == "replace":
            container[key] = data.draw(values)
        elif change == "swap":
            other, other_key = spots[data.draw(st.integers(0, len(spots) - 1))]
            container[key] = copy.deepcopy(other[other_key])
        elif change == "remove":
            del container[key]
        elif isinstance(container, dict):
            container[data.draw(st.one_of(st.sampled_from(KEYS), st.text(max_size=6)))] = container.pop(key)
    check(scene, base_dir)


@SMALL_TIME
@given(st.dictionaries(st.one_of(st.sampled_from(list(Scene.model_fields)), st.text(max_size=5)), values, max_size=6))
def test_any_dictionary(data: dict[str, Any]) -> None:
    check(data, MODELS)


@SMALL_TIME
@given(st.text(max_size=40), st.sampled_from(PATHS))
def test_any_setting(setting: str, path: Path) -> None:
    try:
        load_scene(path, [setting, f"time.{setting}", f"interface.{setting}=1"])
    except SceneError as error:
        check_message(error)
