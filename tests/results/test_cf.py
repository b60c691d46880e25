"""Every group against a CF checker, where one is installed.

Checkers read the root of a file only, so each group is written as a file of its own.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray as xr

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.cosim import Session
from latin_fmu.modal.modes import vibration_modes
from latin_fmu.parametric.point import QUANTITIES
from latin_fmu.parametric.study import sweep
from latin_fmu.results import views
from latin_fmu.results.files import write_netcdf
from latin_fmu.results.solution import Solution

from .test_sensors import pressed

_BESIDE = str(Path(sys.executable).parent)
CHECKER = os.environ.get("COMPLIANCE_CHECKER") or shutil.which(
    "compliance-checker", path=os.pathsep.join([_BESIDE, os.environ.get("PATH", "")])
)
VERSION = "cf:1.11"
PARAMETERS = "interface.crush.friction_coefficient", "load.press.pressure"
OF_STUDIES = *(quantity.name for quantity in QUANTITIES), "force", "normal_force"

NEEDS_CHECKER = pytest.mark.skipif(
    CHECKER is None, reason="compliance-checker is not installed (COMPLIANCE_CHECKER may name it)"
)

ACCEPTED = (
    # The checker takes every dimension called time for a date. CF asks for a reference date of dates only
    # (section 4.4); ours is the time since the start of the run, and standard_name is optional (3.3).
    "Coordinate variable 'time' should have standard_name='time'",
    # CF 1.11 has cf_role of UGRID meshes (section 5.9, appendix K), the checker only knows those of section 9.5.
    "There may only be one variable containing the cf_role attribute",
    "mesh_topology is not a valid cf_role value",
    "volume_node_connectivity is not a valid cf_role value",
    "face_node_connectivity is not a valid cf_role value",
    # A parameter of a study in Pa is taken for a height in the atmosphere, which should come earlier.
    *(f"{name}'s spatio-temporal dimensions are not in the recommended order" for name in OF_STUDIES),
    # A crash of the checker: it looks for a dimension called time in every group, convergence has none.
    f"{VERSION}.check_invalid_same_named_dimension_across_groups: 'time'",
)


def findings(*files: Path) -> list[str]:
    """What the checker has against files, by their names, warnings and its own crashes included, but for
    ``ACCEPTED``."""
    report, names = files[0].with_suffix(".json"), [str(file) for file in files]
    command = [str(CHECKER), f"--test={VERSION}", "--criteria=strict", "--format=json_new", "-o", str(report), *names]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert report.exists(), done.stderr
    checks = json.loads(report.read_text())
    messages = [("", line) for line in done.stderr.splitlines() if line.startswith(f"{VERSION}.")]
    messages += [
        (f"{file.stem}: ", text)
        for file in files
        for level in ("high", "medium", "low")
        for check in checks[str(file)][VERSION][f"{level}_priorities"]
        for text in check["msgs"]
    ]
    return [f"{where}{text}" for where, text in messages if not text.startswith(ACCEPTED)]


def findings_by_group(tree: xr.DataTree, folder: Path) -> list[str]:
    """Findings in each group that has variables, as a file of its own."""
    files = []
    for node in tree.subtree:
        dataset = node.to_dataset()
        dataset.attrs = {**tree.attrs, **dataset.attrs}
        files.append(folder / f"{node.path.strip('/').replace('/', '_') or 'root'}.nc")
        write_netcdf(xr.DataTree(dataset), files[-1])
    return findings(*files)


@NEEDS_CHECKER
@pytest.mark.parametrize(
    "kind", ["crushing", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("stalled", "estimated"))]
)
def test_every_group_follows_cf(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    assert findings_by_group(request.getfixturevalue(kind).to_datatree(), tmp_path) == []


def made_study(folder: Path) -> xr.DataTree:
    """Study of two parameters, with histories."""
    vary = [f"{PARAMETERS[0]}=0:0.2:2", f"{PARAMETERS[1]}=5e7,1e8"]
    (folder / "pressed.toml").write_text(pressed().text(), encoding="utf-8")
    sweep(folder / "pressed.toml", vary, folder / "s.nc", jobs=1, histories=True)
    return latin_fmu.open_results(folder / "s.nc").load()


def made_samples(folder: Path) -> xr.DataTree:
    """Samples of numbers that scatter, with bands and derivatives."""
    scatter = {PARAMETERS[0]: 0.01, PARAMETERS[1]: "5 %"}
    latin_fmu.sample(pressed(spread=scatter), 8, folder / "samples.nc")
    return latin_fmu.open_results(folder / "samples.nc").load()


def texts_among_data(tree: xr.DataTree) -> list[str]:
    """Variables with texts that are no coordinates."""
    return [
        f"{node.path}/{name}" for node in tree.subtree for name, v in node.data_vars.items() if v.dtype.kind in "OSUT"
    ]


def made_spectra(folder: Path) -> xr.DataTree:
    """What ``srs`` writes."""
    latin_fmu.solve(pressed()).save(folder / "out.nc")
    options = ["--sensor", "top", "--lowest", "5e4", "--highest", "2e5", "-o", str(folder / "top")]
    assert main(["srs", str(folder / "out.nc"), *options]) == 0
    return latin_fmu.open_results(folder / "top.nc")


def made_modes(folder: Path) -> xr.DataTree:
    """What ``modes -o`` writes."""
    vibration_modes(pressed(), "sticking", 3).save(folder / "modes.nc")
    return latin_fmu.open_results(folder / "modes.nc")


def made_session(folder: Path) -> xr.DataTree:
    """Results of a session, as an FMU writes them."""
    del folder
    session = Session(pressed())
    session.initialize()
    assert session.step(0.0, 4e-7)
    return session.dataset(estimate=False)


def made_surfaces(folder: Path) -> xr.DataTree:
    """Results with the fields on interfaces and in bodies, and what the views make of them."""
    del folder
    fields = dict.fromkeys(("surfaces", "fields", "stress", "strain", "nodal_stress", "principal_stress"), True)
    tree = latin_fmu.solve(pressed(output=fields | {"energy": True, "reactions": True})).to_datatree()
    tree["views/resultant"] = views.resultant(tree, "crush")
    tree["views/pressure_map"] = views.pressure_map(tree, "crush")
    tree["views/skin"] = views.skin(tree, "upper")
    tree["views/sensor_spectrum"] = views.sensor_spectrum(tree, "top", [1e5, 2e5])
    tree["views/amplitude_spectrum"] = views.amplitude_spectrum(tree, "top").to_dataset(name="amplitude")
    return tree


@NEEDS_CHECKER
@pytest.mark.parametrize(
    "make",
    [
        made_study,
        pytest.param(made_samples, marks=pytest.mark.slow),
        *(pytest.param(m, marks=pytest.mark.slow) for m in (made_spectra, made_modes, made_session, made_surfaces)),
    ],
)
def test_other_files_follow_cf(make: Callable[[Path], xr.DataTree], tmp_path: Path) -> None:
    tree = make(tmp_path)
    assert findings_by_group(tree, tmp_path) == []
    # two files can be subtracted: texts are labels
    assert texts_among_data(tree) == []
    assert isinstance(tree - tree, xr.DataTree)


@NEEDS_CHECKER
def test_the_file_itself_follows_cf(crushing: Solution, tmp_path: Path) -> None:
    crushing.save(tmp_path / "out.nc")
    assert findings(tmp_path / "out.nc") == []
