"""The reference run that an FMU carries: by the layered standard, and what fmpy gets from the FMU."""

from __future__ import annotations

import io
import os
import re
import zipfile
from pathlib import Path

import fmpy
import fmpy.ssp
import numpy as np
import pytest
from lxml import etree

from fmu_build import reference
from fmu_build.build import build_fmu
from fmu_build.reference import FOLDER, NOTE, reference_of
from latin_fmu import cli
from tests.cosim.scenes import bar, blocks

from .host import COMPILED

LS = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-"


def contents(fmu: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(fmu) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.startswith(FOLDER) or name == NOTE}


def columns(content: bytes) -> np.ndarray:
    table = np.genfromtxt(io.BytesIO(content), delimiter=",", names=None, skip_header=1)
    names = content.decode().splitlines()[0].split(",")
    return np.array([tuple(row) for row in table], dtype=[(name, float) for name in names])


@COMPILED
@pytest.mark.parametrize("compiled", [False, True])
def test_fmpy_gets_the_reference_that_the_fmu_carries(fmi, compiled, tmp_path):
    fmu = build_fmu(blocks(), tmp_path / "blocks.fmu", fmi, python=not compiled)
    files = contents(fmu)
    (experiment,) = etree.fromstring(files[f"{FOLDER}/blocks.exp"])
    children = {child.tag: f"{FOLDER}/{child.get('source')}" for child in experiment}
    wanted = columns(files[children["References"]])
    names = list(wanted.dtype.names[1:])
    got = fmpy.simulate_fmu(
        str(fmu),
        start_time=float(experiment.get("startTime")),
        stop_time=float(experiment.get("stopTime")),
        output_interval=float(experiment.get("stepSize")),
        relative_tolerance=None if compiled else float(experiment.get("tolerance")),
        input=columns(files[children["Stimuli"]]),
        output=names,
    )
    assert len(wanted) == 31
    assert np.abs(wanted["interface.crush.force[3]"]).max() > 100.0
    at = np.searchsorted(got["time"], wanted["time"] - 1e-12)
    for name in names:  # components of a vector have one scale, as energies: some are zero by symmetry
        kind = "energy." if name.startswith("energy.") else name.partition("[")[0]
        scale = max(np.abs(wanted[other]).max() for other in names if other.startswith(kind))
        assert got[name][at] == pytest.approx(wanted[name], rel=0.0, abs=1e-9 * scale), name


@COMPILED
def test_the_manifest_follows_the_layered_standard(tmp_path):
    files = contents(build_fmu(blocks(), tmp_path / "blocks.fmu", python=True))
    manifest = etree.fromstring(files[f"{FOLDER}/fmi-ls-manifest.xml"])
    assert manifest.tag == "fmiReferences"
    assert dict(manifest.attrib) == {
        f"{LS}name": "org.fmi-standard.fmi-ls-ref",
        f"{LS}version": "1.0.0-beta.1",
        f"{LS}description": "Layered Standard providing information on related files included in an FMU.",
    }
    assert {(r.get("source"), r.get("type"), r.get("role")) for r in manifest.iterfind("Related")} == {
        ("blocks.exp", "application/x-ma-hs-experiments", "experiment/smoke-test"),
        ("blocks.ssv", "application/x-ssp-parameter-set", "parameter"),
        ("blocks_in.csv", "text/csv", "other"),
        ("blocks_ref.csv", "text/csv", "result"),
    }
    assert {label.get("name") for label in manifest.iter("Label")} == {"experiment:default", "variant:scene"}
    assert all(len(related.findall("Label")) == 1 for related in manifest)
    sources = {f"{FOLDER}/{r.get('source')}" for r in manifest}
    assert sources | {f"{FOLDER}/fmi-ls-manifest.xml", NOTE} == set(files)


SCHEMAS = os.environ.get("FMI_LS_REF_SCHEMAS", "")
"""Folder ``schema`` of the repository modelica/fmi-ls-ref at 596a89d, with those of modelica/fmi-standard that it
imports; at v1.0.0-beta.1 it is the same but for an import that makes it no valid schema."""


@COMPILED
@pytest.mark.skipif(not SCHEMAS, reason="FMI_LS_REF_SCHEMAS names no folder with the schemas of FMI-LS-REF")
def test_the_schemas_of_the_layered_standard_find_nothing(tmp_path):
    files = contents(build_fmu(blocks(), tmp_path / "blocks.fmu", python=True))
    path = Path(SCHEMAS, "fmi3LayeredStandardReferenceManifest.xsd")
    text = re.sub(r'schemaLocation="http[^"]*/', f'schemaLocation="{Path(SCHEMAS).as_uri()}/', path.read_text())
    schema = etree.XMLSchema(etree.fromstring(text.encode()))
    schema.validate(etree.fromstring(files[f"{FOLDER}/fmi-ls-manifest.xml"]))
    assert list(schema.error_log) == []


@COMPILED
def test_the_parameter_set_has_the_values_of_the_scene(tmp_path):
    """Valid by the schema of SSP; applied as it is, as the standard says, it changes nothing."""
    names = ("interface.crush.friction_coefficient", "material.steel.young_modulus", "material.steel.density")
    for scene in (blocks(), blocks(fmu={"parameters": names})):
        fmu = build_fmu(scene, tmp_path / "blocks.fmu", "3", python=bool(scene.fmu.parameters))
        content = contents(fmu)[f"{FOLDER}/blocks.ssv"]
        tree = etree.fromstring(content)
        schema = Path(fmpy.ssp.__file__).parent / "schema" / "SystemStructureParameterValues.xsd"
        etree.XMLSchema(etree.parse(str(schema))).assertValid(tree)
        values = {e.get("name"): (e[0].get("value"), e[0].get("unit")) for e in tree[0]}
        wanted = {"mode": ("0", None), "inputInterpolation": ("3", None), "endTime": ("6e-06", "s")}
        if not scene.fmu.parameters:
            wanted |= {names[0]: ("0.2", "1")}
        else:
            wanted |= dict(zip(names, [("0.2", "1"), ("210000000000.0", "Pa"), ("7800.0", None)], strict=True))
        assert values == wanted
        assert {unit.get("name") for unit in tree.iter("{*}Unit")} == {u for _, u in values.values() if u}
        starts = {name: float(value) for name, (value, _) in values.items()}
        ends = [fmpy.simulate_fmu(str(fmu), stop_time=1e-6, start_values=s)[-1] for s in ({}, starts)]
        assert ends[0].tobytes() == ends[1].tobytes()


@COMPILED
def test_a_long_experiment_is_cut_and_large_results_are_thinned(monkeypatch):
    monkeypatch.setattr(reference, "_within", lambda _cost, n: n // 3)
    monkeypatch.setattr(reference, "MOST_NUMBERS", 200)
    short = reference_of(blocks())
    assert "10 steps of 2e-07 s to 2e-06 s, the beginning of the default experiment of 6e-06 s" in short.said
    rows, whole = (
        columns(made.files[f"{FOLDER}/blocks_ref.csv"]) for made in (short, reference_of(blocks(), whole=True))
    )
    assert len(whole) == 31
    assert len(rows) < 11
    assert rows["time"][-1] == pytest.approx(2e-6)
    for row in rows:
        assert row in whole


def test_steps_within_the_limit_by_prediction():
    class Cost:
        operators, march = 4.0, 24.0

    assert reference._within(Cost(), 40) == 10  # 6 s are left for steps of 0.6 s
    Cost.operators = 11.0
    assert reference._within(Cost(), 40) == 1


@COMPILED
def test_a_step_without_convergence_ends_the_reference_run():
    made = reference_of(blocks(solver={"max_iterations": 1, "tolerance": 1e-9}))
    assert made.files == {}
    assert "no convergence" in made.said


def test_time_steps_are_solved_one_by_one_whatever_the_window():
    """As an FMU solves them; a run may have them solved at once, to its tolerance."""
    time = {"end": 24e-6, "step": 0.2e-6}  # three of them in a communication step
    scenes = [blocks(solver={"window": window, "tolerance": 1e-3}, time=time) for window in ("whole", 1)]
    one, other = (reference_of(scene).files[f"{FOLDER}/blocks_ref.csv"] for scene in scenes)
    assert one == other


@COMPILED
def test_without_inputs_there_are_no_stimuli():
    files = reference_of(bar()).files
    assert f"{FOLDER}/thrown_bar_in.csv" not in files
    assert b"Stimuli" not in files[f"{FOLDER}/thrown_bar.exp"]


@COMPILED
def test_the_command_says_what_the_run_took_and_leaves_it_out(tmp_path, capsys):
    scene, target = tmp_path / "blocks.toml", tmp_path / "blocks.fmu"
    scene.write_text(blocks().text())
    assert cli.main(["fmu", str(scene), "-o", str(target)]) == 0
    assert re.search(r"reference run: 30 steps .* s of CPU time; --reference none", capsys.readouterr().out)
    assert contents(target)
    assert cli.main(["fmu", str(scene), "-o", str(target), "--reference", "none"]) == 0
    assert "reference run" not in capsys.readouterr().out
    assert not contents(target)
