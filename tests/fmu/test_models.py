"""Every shipped model as an FMU: validators find nothing, and its reference run is what a host gets."""

from __future__ import annotations

import csv
import io
import shutil
import subprocess
from contextlib import closing
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.checks import validate, with_inputs
from fmu_build.drive import Drive
from fmu_build.reference import FOLDER, reference_of
from latin_fmu.cosim.input_table import given_of
from latin_fmu.errors import InputError
from latin_fmu.scene.laws import InputLaw
from tests.scenes import MINUTES, MODELS

from .host import hosts_folder

SCENES = sorted(p for p in MODELS.glob("*/*.toml") if p.parent.name not in MINUTES)


def names(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


LONG = ("lap_joint", "pressed_plates", "punched_plates")


def pair(path: Path, fmi: str, whole: bool = False):
    """A test of a model and a version of the FMI, ``whole`` : of its whole run; the quick tests leave out what takes
    seconds more."""
    quick = {
        "2": [p for p in SCENES if p.stem in ("n16", "scene") and not (whole and p.parent.name in LONG)],
        "3": [p for p in SCENES if p.parent.name in ("impact_bar", "shear_interface") or p.stem in ("n02", "ground")],
    }
    marks = [] if path in quick[fmi] else [pytest.mark.slow]
    return pytest.param(path, fmi, id=f"{names(path)}-{fmi}", marks=marks)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """FMU of a model as it is, built once."""
    folder = tmp_path_factory.mktemp("models")

    def build(path: Path, fmi: str) -> Path:
        target = folder / f"{path.parent.name}_{path.stem}_{fmi}.fmu"
        return target if target.exists() else build_fmu(latin_fmu.load_scene(path), target, fmi, python=True)

    return build


@pytest.mark.parametrize(("path", "fmi"), [pair(path, fmi) for path in SCENES for fmi in ("2", "3")])
def test_valid(path, fmi, plain):
    """fmpy and the schemas of the standard."""
    assert validate(plain(path, fmi)) == []


def columns(content: bytes) -> dict[str, list[float]]:
    rows = list(csv.reader(io.StringIO(content.decode())))
    return {name: [float(row[i]) for row in rows[1:]] for i, name in enumerate(rows[0])}


@pytest.fixture(scope="module")
def prepared():
    """Scene with every load an input, and the files of its whole reference run, by model; solved once."""
    made: dict[Path, tuple[latin_fmu.Scene, dict[str, bytes]]] = {}

    def prepare(path: Path) -> tuple[latin_fmu.Scene, dict[str, bytes]]:
        if path not in made:
            inputs = with_inputs(latin_fmu.load_scene(path), ["all"])
            made[path] = inputs.scene, reference_of(inputs.scene, inputs.laws, whole=True).files
        return made[path]

    return prepare


@pytest.mark.parametrize(("path", "fmi"), [pair(path, fmi, whole=True) for path in SCENES for fmi in ("2", "3")])
def test_equal_to_the_reference(path, fmi, prepared, tmp_path):
    """The reference comes from a session; the FMU, driven with X_in.csv over X.exp, gives it to the last digit."""
    scene, files = prepared(path)
    driven = bool(given_of(scene))
    assert (f"{FOLDER}/{scene.name}_in.csv" in files) == driven
    fmu = build_fmu(scene, tmp_path / "model.fmu", fmi, files, python=True)
    reference = columns(files[f"{FOLDER}/{scene.name}_ref.csv"])
    given = columns(files[f"{FOLDER}/{scene.name}_in.csv"]) if driven else None
    (experiment,) = fromstring(files[f"{FOLDER}/{scene.name}.exp"])
    with closing(Drive(fmu, None, given)) as drive:
        rows = list(drive.run(float(experiment.attrib["stepSize"]), float(experiment.attrib["stopTime"])))
        recorded = {name: [row[i] for row in rows] for i, name in enumerate(["time", *drive.outputs])}
    assert drive.complaint == ""
    assert {name.split(".")[0] for name in set(recorded) - set(reference) - {"energy.balance"}} <= {"solver", "window"}
    for name, column in reference.items():
        assert recorded[name] == column, name


@pytest.mark.parametrize("path", SCENES, ids=names)
def test_fmutool_finds_nothing(path, fmi, plain):
    folder = hosts_folder()
    tool = shutil.which("fmutool" if folder is None else folder / "common" / "bin" / "fmutool")
    if tool is None:
        pytest.skip("fmutool is not installed: see tests/fmu/install_hosts.sh")
    command = [tool, "-input", str(plain(path, fmi)), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    said = done.stdout + done.stderr
    assert "seems to be compliant" in said
    assert "No semantic error" in said
    assert "ERROR" not in said


def test_the_reference_follows_the_law_of_the_scene(prepared):
    """Driven by the samples of its own load at 51 points, the crushing gives the impulse of the plain run."""
    path = MODELS / "two_specimen_crushing" / "scene.toml"
    _, files = prepared(path)
    reference = columns(files[f"{FOLDER}/two_specimen_crushing_ref.csv"])
    history = latin_fmu.solve(latin_fmu.load_scene(path)).interfaces["crush"]
    impulse = history.impulse(np.linspace(0.0, reference["time"][-1], len(history.force())))[-1, 2]
    assert reference["interface.crush.impulse[3]"][-1] == pytest.approx(impulse, rel=2e-3)


def test_inputs_by_name():
    scene = latin_fmu.load_scene(MODELS / "two_specimen_crushing" / "scene.toml")
    assert with_inputs(scene, []).scene == scene
    assert with_inputs(scene, ["press"]).scene.load["press"].law.type == "input"
    with pytest.raises(InputError, match=r"no such load.*did you mean 'press'"):
        with_inputs(scene, ["pres"])


def test_a_driven_face_becomes_an_input_by_its_name():
    """Its history is the law that it had, and the input starts at the value of that at t = 0."""
    law = "{type='half_sine',start=-1e-3,duration=2e-3}"
    shaken = f"boundary.shaker={{type='acceleration',face='lower.xmax',components=['z'],value=[9.0],law={law}}}"
    scene = latin_fmu.load_scene(MODELS / "two_specimen_crushing" / "scene.toml", [shaken])
    made = with_inputs(scene, ["boundary.shaker"])
    assert made.laws == {"boundary.shaker": scene.boundary["shaker"].law}
    assert made.scene.boundary["shaker"].law == InputLaw(start_value=1.0)
    assert made.scene.load == scene.load
    with pytest.raises(InputError, match=r"did you mean 'boundary\.shaker'"):
        with_inputs(scene, ["shaker"])
