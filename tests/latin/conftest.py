"""Small scenes: bars in a row and rubbing blocks, as dictionaries to be changed, and their operators."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from latin_fmu.assembly.problem import SolverReadyProblem
from latin_fmu.building import build
from latin_fmu.latin.outcome import Timings
from latin_fmu.latin.recorder import Recorder
from latin_fmu.latin.windows import Run
from latin_fmu.reader import scene_from_dict
from latin_fmu.stability.scenes import Box, Material, column, half_sine

Tables = dict[str, Any]
SECTION, LENGTH, ELEMENTS = 0.5, 1.0, 6


def box(z: float, length: float = LENGTH, n: int = ELEMENTS, across: int = 1, size: float = SECTION) -> Tables:
    """A bar along z."""
    return {"origin": [0.0, 0.0, z], "size": [size, size, length], "elements": [across, across, n]}


def bars(behaviour: str = "contact", gap: float = 0.0, **others: Any) -> Tables:
    """Three bars a, b, c along z: a and b joined, b meets c with ``behaviour``; c held, a pushed by a half sine.

    E = 4, nu = 0, rho = 1 (c = 2); the front needs 0.5 s per bar.
    """
    bar = Box(Material(4.0), (SECTION, SECTION, LENGTH), (1, 1, ELEMENTS))
    tables = column(
        dict.fromkeys("abc", bar),
        {"joint": {"behaviour": "perfect"}, "meet": {"behaviour": behaviour}},
        {"end": 2.4, "instants": 48},
        name="bars",
        boundary={"held": {"type": "fixed", "face": "c.zmax"}},
        load={"push": {"face": "a.zmin", "pressure": 1.0, "law": half_sine(1.0)}},
        solver={},
        output={"fields": True, "energy": True},
    )
    tables["substructure"]["c"]["box"]["origin"][2] += gap
    return tables | others


def blocks(**others: Any) -> Tables:
    """Two blocks with friction, the upper one thrown obliquely on the lower one, which stands on the ground."""
    hard, soft = Material(4.0, 1.0, 0.3), Material(2.0, 2.0, 0.2, "soft")
    tables = column(
        {"low": Box(hard, elements=(2, 2, 2)), "high": Box(soft, elements=(2, 2, 2), velocity=(0.05, 0.02, -0.1))},
        {"rub": {"friction_coefficient": 0.2}},
        {"end": 1.2, "instants": 12},
        name="blocks",
        solver={},
        output={"fields": True, "energy": True},
    )
    floor = {"sides": ["low.zmin", "ground"], "friction_coefficient": 0.5}
    tables["interface"] = {"floor": floor, **tables["interface"]}
    return tables | others


def make(tables: Tables) -> SolverReadyProblem:
    """Operators of a scene."""
    return build(scene_from_dict(tables))


def make_run(built: SolverReadyProblem) -> Run:
    """A run at t = 0."""
    return Run(built.assembly, built.settings, Recorder(built.assembly, built.output, built.info), Timings())


@pytest.fixture
def python_driver(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Lets the runs that follow take the stages one by one from Python."""
    return lambda: monkeypatch.setattr(Run, "marches", property(lambda _: False))


@pytest.fixture
def bars_scene() -> Callable[..., Tables]:
    """See ``bars``."""
    return bars


@pytest.fixture(scope="session")
def blocks_scene() -> Callable[..., Tables]:
    """See ``blocks``."""
    return blocks


@pytest.fixture
def bar_box() -> Callable[..., Tables]:
    """See ``box``."""
    return box


@pytest.fixture
def made() -> Callable[[Tables], SolverReadyProblem]:
    """See ``make``."""
    return make


@pytest.fixture
def begun() -> Callable[[SolverReadyProblem], Run]:
    """See ``make_run``."""
    return make_run
