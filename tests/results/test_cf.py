"""Every group against a CF checker, where one is installed.

Checkers look at the root of a file only, so each group is written as a file of its own.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

from latin_fmu.results.files import write_netcdf
from latin_fmu.results.solution import Solution

_BESIDE = str(Path(sys.executable).parent)
CHECKER = os.environ.get("COMPLIANCE_CHECKER") or shutil.which(
    "compliance-checker", path=os.pathsep.join([_BESIDE, os.environ.get("PATH", "")])
)
VERSION = "cf:1.11"

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
    # A crash of the checker: it looks for a dimension called time in every group, convergence has none.
    f"{VERSION}.check_invalid_same_named_dimension_across_groups: 'time'",
)


def findings(file: Path) -> list[str]:
    """What the checker has against a file, warnings and its own crashes included, but for ``ACCEPTED``."""
    report = file.with_suffix(".json")
    command = [str(CHECKER), f"--test={VERSION}", "--criteria=strict", "--format=json", "-o", str(report), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert report.exists(), done.stderr
    checks = json.loads(report.read_text())[VERSION]
    crashes = [line for line in done.stderr.splitlines() if line.startswith(f"{VERSION}.")]
    messages = [
        text for level in ("high", "medium", "low") for check in checks[f"{level}_priorities"] for text in check["msgs"]
    ]
    return [text for text in messages + crashes if not text.startswith(ACCEPTED)]


@NEEDS_CHECKER
@pytest.mark.parametrize("kind", ["crushing", "stalled", "estimated"])
def test_every_group_follows_cf(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    tree = request.getfixturevalue(kind).to_datatree()
    violations = {}
    for node in tree.subtree:
        dataset = node.to_dataset()
        dataset.attrs = {**tree.attrs, **dataset.attrs}
        file = tmp_path / f"{node.path.strip('/').replace('/', '_') or 'root'}.nc"
        write_netcdf(xr.DataTree(dataset), file)
        violations[node.path] = findings(file)
    assert violations == {path: [] for path in violations}


@NEEDS_CHECKER
def test_the_file_itself_follows_cf(crushing: Solution, tmp_path: Path) -> None:
    crushing.save(tmp_path / "out.nc")
    assert findings(tmp_path / "out.nc") == []
