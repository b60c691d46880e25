"""Laws written in NumPy, in the place of the compiled ones: called from Python, the same result to round-off."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import build
from latin_fmu.errors import SceneError
from latin_fmu.interface import BEHAVIOURS
from latin_fmu.latin.run_image import law_of

TIGHT = {"tolerance": 1e-11, "force_tolerance": 1e-10, "max_iterations": 400}
ROOT = Path(__file__).parents[2]


def module(path: Path) -> ModuleType:
    """A file of another folder."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = loaded
    spec.loader.exec_module(loaded)
    return loaded


PLAIN_LAWS = module(ROOT / "tests" / "interface" / "plain_laws.py")


def in_numpy(behaviour: Any) -> Any:
    """The same behaviour with its law in NumPy."""
    own = {"compiled": False, "local": staticmethod(getattr(PLAIN_LAWS, behaviour.name))}
    kind = type("InNumPy", (type(behaviour),), own)
    copy = object.__new__(kind)
    copy.__dict__.update(behaviour.__dict__)
    return copy


def rubbing(behaviour: str, blocks_scene: Any) -> Any:
    """Two blocks that meet in some way, the lower one on rough ground."""
    keys = {
        "perfect": {},
        "contact": {"friction_coefficient": 0.2},
        "no_slip": {},
        "elastic_layer": {"normal_stiffness": 30.0, "tangential_stiffness": 10.0},
        "soft_contact": {"normal_stiffness": 40.0, "friction_coefficient": 0.2},
        "viscous_joint": {"normal_viscosity": 3.0, "tangential_viscosity": 1.0},
        "maxwell_joint": {"normal_stiffness": 30.0, "tangential_stiffness": 10.0, "relaxation_time": 0.5},
    }[behaviour]
    tables = blocks_scene(solver=TIGHT)
    tables["interface"]["rub"] = {"sides": ["low.zmax", "high.zmin"], "behaviour": behaviour, **keys}
    return tables


@pytest.mark.parametrize("behaviour", sorted(BEHAVIOURS))
@pytest.mark.parametrize("window", [1, 4])
def test_a_law_in_numpy_gives_the_answer_of_the_compiled_one(behaviour: str, window: int, blocks_scene: Any) -> None:
    tables = rubbing(behaviour, blocks_scene)
    tables["solver"]["window"] = 1 if behaviour == "maxwell_joint" else window  # the only window that it takes
    scene = latin_fmu.scene_from_dict(tables)
    compiled = latin_fmu.solve(scene)
    units = build(scene).assembly.interfaces
    own = {unit.name: in_numpy(unit.behaviour) for unit in units}
    assert [law_of(law) for law in own.values()] == [-1, -1]
    called: list[int] = []
    law = own["rub"]
    plain = type(law).local

    def local(*arguments: Any) -> Any:
        called.append(1)
        return plain(*arguments)

    type(law).local = staticmethod(local)
    solution = latin_fmu.solve(scene, behaviours=own)
    assert len(called) >= 12
    assert compiled.converged
    assert solution.converged
    for name, history in compiled.outcome.interfaces.items():
        for field in ("traction", "velocity"):
            expected, its = getattr(history, field), getattr(solution.outcome.interfaces[name], field)
            assert np.abs(its - expected).max() <= 1e-9 * np.abs(expected).max(), (name, field)
    terms = compiled.outcome.energy
    for term, values in terms.items():
        scale = max(np.abs(v).max() for v in terms.values())
        assert np.abs(solution.outcome.energy[term] - values).max() <= 1e-9 * scale, term


@pytest.mark.parametrize("error", [ValueError("no traction here"), KeyboardInterrupt()])
@pytest.mark.parametrize("window", [1, 4])
def test_an_error_in_a_law_ends_the_run(error: BaseException, window: int, blocks_scene: Any) -> None:
    """It is called from within the kernels, which end their loops; the caller receives it, and the next run works."""
    tables = rubbing("contact", blocks_scene)
    tables["solver"]["window"] = window
    scene = latin_fmu.scene_from_dict(tables)
    own = {unit.name: in_numpy(unit.behaviour) for unit in build(scene).assembly.interfaces}
    law, calls = type(own["rub"]), [0]
    plain = law.local

    def failing(*arguments: Any) -> Any:
        calls[0] += 1
        if calls[0] == 20:
            raise error
        return plain(*arguments)

    law.local = staticmethod(failing)
    with pytest.raises(type(error)):
        latin_fmu.solve(scene, behaviours=own)
    assert calls[0] == 20  # nothing was called after it
    assert latin_fmu.solve(scene, behaviours=own).converged


def test_compiled_laws_are_those_of_the_registry() -> None:
    for name in BEHAVIOURS:
        assert law_of(BEHAVIOURS[name]()) >= 0, name


def test_laws_without_an_interface_are_refused(blocks_scene: Any) -> None:
    scene = latin_fmu.scene_from_dict(blocks_scene())
    law = build(scene).assembly.interfaces[0].behaviour
    with pytest.raises(SceneError, match=r"behaviours\.flor: no interface of this name.*did you mean 'floor'"):
        latin_fmu.solve(scene, behaviours={"flor": law})


def test_the_example_runs() -> None:
    """A strength that is never met changes nothing, to the tolerance; one that is met bounds the shear."""
    largest = module(ROOT / "examples" / "own_law.py").main()
    coulomb, free, capped = largest.values()
    assert free == pytest.approx(coulomb, rel=1e-3)
    assert capped == pytest.approx(40e6, rel=1e-12)
    assert coulomb > 60e6
