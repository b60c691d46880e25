"""Operators kept on disk: the bits that would be computed, nothing factorised twice, damaged entries made anew."""

from __future__ import annotations

import copy
import json
import os
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import scene_files
from latin_fmu import operator_store
from latin_fmu.assembly.initial_state import InitialState, TightBolts, state_arrays, state_of
from latin_fmu.building import build
from latin_fmu.cholesky import factor as factors
from latin_fmu.cholesky.symbolic import shared_analysis
from latin_fmu.errors import ResultsError
from latin_fmu.operator_store import OperatorStore
from latin_fmu.statics import statics
from tests.scenes import MODELS

STEEL = {"young_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0}
BODY = {"material": "steel"}
FIELDS = ((("a", "b"), 12), (("ab", "foot"), (4, 3)), (("ab",), 4))
MATRIX = np.arange(40_000.0).reshape(200, 200)


def kept(store: OperatorStore, matrix: np.ndarray = MATRIX) -> np.ndarray:
    """The double of a matrix, by way of the store."""
    return store.remember(store.name("double", matrix), lambda: {"x": 2.0 * matrix}, "x")["x"]


def test_an_entry_has_the_bits_that_would_be_computed(tmp_path: Path):
    first, second = OperatorStore(tmp_path), OperatorStore(tmp_path)
    made, known = kept(first), kept(second)
    assert (first.written, first.read, second.written, second.read) == (1, 0, 0, 1)
    assert type(known) is np.ndarray  # as kernels take it
    assert isinstance(known.base, np.memmap)
    assert np.array_equal(made, known)
    known[0, 0] = -1.0  # compiled functions may write; the file stays
    assert kept(second)[0, 0] == 0.0


def test_other_numbers_have_another_name(tmp_path: Path):
    store = OperatorStore(tmp_path)
    other = MATRIX.copy()
    other[3, 4] = np.nextafter(other[3, 4], 1e9)
    assert (
        len({store.name("a", MATRIX), store.name("b", MATRIX), store.name("a", other), store.name("a", MATRIX.T)}) == 4
    )
    assert store.name("a", MATRIX, 1.0) != store.name("a", MATRIX, 1)
    assert store.name("a", MATRIX, None) == store.name("a", MATRIX.copy(), None)


def flipped(entry: Path) -> None:
    content = bytearray((entry / "x.npy").read_bytes())
    content[-5] ^= 1
    (entry / "x.npy").write_bytes(content)


def cut(entry: Path) -> None:
    (entry / "x.npy").write_bytes((entry / "x.npy").read_bytes()[:-100])


def pickled(entry: Path) -> None:
    """An array of objects, whose reading would run code."""
    np.save(entry / "x.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    relisted(entry)


def relisted(entry: Path) -> None:
    """The list with the checksum of the file as it is."""
    (entry / "arrays.json").write_text(json.dumps({"x": zlib.crc32((entry / "x.npy").read_bytes())}))


def of_another_header(entry: Path) -> None:
    """A header that no parser of Python takes."""
    content = bytearray((entry / "x.npy").read_bytes())
    content[10:12] = b"(("
    (entry / "x.npy").write_bytes(content)


def without_array(entry: Path) -> None:
    (entry / "x.npy").unlink()


def no_list(entry: Path) -> None:
    (entry / "arrays.json").write_text("[1, 2")


def another_list(entry: Path) -> None:
    (entry / "arrays.json").write_text("[1, 2]")


@pytest.mark.parametrize("damage", [flipped, cut, pickled, of_another_header, without_array, no_list, another_list])
def test_a_damaged_entry_is_made_anew(tmp_path: Path, damage: Any):
    kept(OperatorStore(tmp_path))
    (entry,) = tmp_path.iterdir()
    damage(entry)
    store = OperatorStore(tmp_path)
    assert np.array_equal(kept(store), 2.0 * MATRIX)
    assert (store.read, store.written, store.removed) == (0, 1, 1)
    assert np.array_equal(kept(store), 2.0 * MATRIX)
    assert store.read == 1


def test_the_entries_used_longest_ago_go_first(tmp_path: Path):
    store = OperatorStore(tmp_path, limit=2.5 * MATRIX.nbytes)
    for n in range(3):
        kept(store, MATRIX + n)
        for age, entry in enumerate(sorted(tmp_path.iterdir(), key=lambda e: (e / "arrays.json").stat().st_mtime)):
            time = 1e9 + age
            os.utime(entry / "arrays.json", (time, time))
        if n == 1:
            kept(store, MATRIX)  # used again: the second one is the oldest now
    again = OperatorStore(tmp_path)
    kept(again, MATRIX)
    kept(again, MATRIX + 2)
    assert again.read == 2
    kept(again, MATRIX + 1)
    assert again.read == 2
    assert not [entry for entry in tmp_path.iterdir() if entry.name.startswith(".")]


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultsError, match=r"solver.operators.folder: operators cannot be written.*allowed"):
        kept(OperatorStore(tmp_path / "file"))


def scene(tmp_path: Path, friction: float = 0.2, modulus: float = 2.1e11, **solver: Any) -> latin_fmu.Scene:
    """Two blocks, pressed in equilibrium and then hit."""
    made = {
        "name": "kept",
        "time": {"end": 1e-5, "instants": 10, "start": "static"},
        "material": {"steel": STEEL | {"young_modulus": modulus}},
        "substructure": {
            name: BODY | {"box": {"origin": [0, 0, z], "size": [0.1, 0.1, 0.03], "elements": [n, n, 2]}}
            for name, z, n in (("a", 0.0, 5), ("b", 0.03, 6))
        },
        "interface": {"ab": {"sides": ["a.zmax", "b.zmin"], "friction_coefficient": friction}},
        "boundary": {"base": {"type": "fixed", "face": "a.zmin"}},
        "load": {
            "press": {"face": "b.zmax", "pressure": 1e6},
            "hit": {"face": "b.xmax", "pressure": 5e6, "law": {"type": "half_sine", "duration": 1e-5}},
        },
        "output": {"fields": True},
        "solver": solver,
    }
    return latin_fmu.scene_from_dict(copy.deepcopy(made), tmp_path)


def test_a_start_by_a_law_of_the_caller_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Its code has no digest: the friction that it has is not that of the state in the folder."""
    kept_here = {"operators": {"folder": "kept"}}
    first = latin_fmu.solve(scene(tmp_path, **kept_here))
    law = next(unit.behaviour for unit in build(scene(tmp_path)).assembly.interfaces)
    own = type("Own", (type(law),), {})(**vars(law))
    monkeypatch.setattr(statics, "equilibrium", lambda *_: pytest.fail("an equilibrium"))
    assert latin_fmu.solve(scene(tmp_path, **kept_here)).converged == first.converged
    with pytest.raises(pytest.fail.Exception, match="an equilibrium"):
        latin_fmu.solve(scene(tmp_path, **kept_here), behaviours={"ab": own})


@pytest.mark.parametrize("form", ["dense", "exact", "sparse"])
def test_the_second_run_factorises_nothing_and_gives_the_same_bits(
    tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(operator_store, "_SMALLEST", 0)
    kept_here = {"operators": {"folder": "kept"}, "interface_operator": form}
    plain = latin_fmu.solve(scene(tmp_path, interface_operator=form))
    shared_analysis.cache_clear()
    first = latin_fmu.solve(scene(tmp_path, **kept_here))
    assert "0 read" in first.outcome.settings["operators"]
    shared_analysis.cache_clear()

    def refuse(*_: Any) -> int:
        raise AssertionError("a factorisation")

    with monkeypatch.context() as patch:
        patch.setattr(factors, "factorise", refuse)
        second = latin_fmu.solve(scene(tmp_path, **kept_here))
        other = latin_fmu.solve(scene(tmp_path, friction=0.3, **kept_here))
    assert "0 written" in second.outcome.settings["operators"]
    assert "read, 0 written" in second.summary(details=True)
    assert other.converged
    for name in "ab":
        for solution in (first, second):
            assert np.array_equal(solution.substructures[name].displacement, plain.substructures[name].displacement)
    stiffer = latin_fmu.solve(scene(tmp_path, modulus=2e11, **kept_here))
    alone = latin_fmu.solve(scene(tmp_path, modulus=2e11, interface_operator=form))
    assert np.array_equal(stiffer.substructures["b"].displacement, alone.substructures["b"].displacement)


def test_a_state_has_all_its_parts_behind_its_arrays(tmp_path: Path):
    rng = np.random.default_rng(0)
    fields = [{name: rng.standard_normal(shape) for name in names} for names, shape in FIELDS]
    bolts = TightBolts({"m6": 1.0 / 3.0}, (1, 3), {"m6": (4e3, 5e3)})
    state = InitialState(*fields, {"press": 0.1}, "solved", ("a remark",), bolts)
    store = OperatorStore(tmp_path)
    for _ in range(2):
        made = state_of(store.remember("start-0", lambda: state_arrays(state), smallest=0))
        assert made is not None
        np.testing.assert_equal(asdict(made), asdict(state))
    assert (store.written, store.read) == (1, 1)
    assert state_of(state_arrays(None)) is None


@pytest.mark.slow
def test_the_tightened_state_is_read_where_nothing_that_it_depends_on_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """By another run, by its modes and with a blow of another size, which begins with 0; with the bits of a run
    without the folder."""

    def refuse(*_: Any) -> Any:
        raise AssertionError("an equilibrium")

    plain = latin_fmu.load_scene(MODELS / "lap_joint" / "shock.toml").replace("time.end", 5e-6)
    scene = plain.replace("solver.operators", {"folder": str(tmp_path)})
    first = latin_fmu.solve(scene)
    with monkeypatch.context() as patch:
        patch.setattr(statics, "equilibrium", refuse)
        second = latin_fmu.solve(scene)
        stronger = latin_fmu.solve(scene.replace("load.shock.traction", [-80e6, 0.0, 0.0]))
        frequency = latin_fmu.vibration_modes(scene, count=2).frequency
        for changed in (("bolt.m6.force", 9e3), ("contact.all.friction_coefficient", 0.4)):
            with pytest.raises(AssertionError, match="an equilibrium"):
                latin_fmu.solve(scene.replace(*changed))
    alone = latin_fmu.solve(plain)
    for solution in (first, second):
        for name, bolt in alone.bolts.items():
            assert np.array_equal(solution.bolts[name].force, bolt.force)
            assert solution.bolts[name].tightening == bolt.tightening
    assert not np.array_equal(stronger.bolts["m6"].force, alone.bolts["m6"].force)
    assert np.array_equal(frequency, latin_fmu.vibration_modes(plain, count=2).frequency)


@pytest.mark.parametrize("folder", ["..", "../beside", "/tmp/anywhere", "below/../../out"])
def test_a_scene_of_others_writes_below_its_own_folder_alone(folder: str, tmp_path: Path) -> None:
    """Who runs it names any folder on the command line."""
    place = tmp_path / "scenes"
    place.mkdir()
    text = (MODELS / "impact_bar/scene.toml").read_text()
    (place / "scene.toml").write_text(f'{text}\n[solver.operators]\nfolder = "{folder}"\n')
    said = r"operators.folder: a folder outside that of the scene file.*line \d+"
    with pytest.raises(latin_fmu.SceneError, match=said):
        latin_fmu.load_scene(place / "scene.toml")
    scene = latin_fmu.load_scene(place / "scene.toml", [f"solver.operators.folder={folder}"])
    assert scene.solver.operators is not None
    (place / "scene.toml").write_text(f'{text}\n[solver.operators]\nfolder = "kept/here"\n')
    assert latin_fmu.load_scene(place / "scene.toml").solver.operators is not None


def test_an_fmu_takes_no_folder_along(tmp_path: Path) -> None:
    """It would write where the scene was, on whatever machine it runs."""
    made = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", [f"solver.operators.folder={tmp_path}"])
    assert str(tmp_path) in made.text()
    inside = scene_files(made)["scene.toml"].decode()
    assert "operators" not in inside
    assert str(tmp_path) not in inside
