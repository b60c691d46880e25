"""Assemblies from CAD: size, time, and what a finer mesh changes; needs gmsh.

A bracket with a screw, a flange with eight screws and a gasket, an electronics box with a lid (``tests.cad.assemblies``
writes them), or STEP files. Each is meshed by ``latin-fmu mesh`` as it comes, and with edges smaller by 1.5 at screws
and contacts: it may have 2.25 times the unknowns there, as the edges of the first mesh follow from the 4,000 that it is
allowed. Its support is shaken by a half-sine of 100 g and 1 ms along each axis, after its screws have been tightened.
The table has

unknowns   of contacts, as ``mesh`` states them; memory as ``latin-fmu check`` states it, GB; CPU times, s,
tension    change of the tension of a screw by the shock, largest and mean over the last tenth, N,
modes      the first three of the tightened assembly with sticking joints, Hz,

and how far these of the two meshes are apart: tensions of each screw over the largest change of all.

    python examples/benchmarks/cad_assemblies.py [bracket flange box FILE.step ...] [--folder FOLDER] [--coarse-alone]
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import latin_fmu

ROOT = Path(__file__).resolve().parents[2]
ASSEMBLIES = ("bracket", "flange", "box")
FINER = 1.5
SHOCK, DURATION, END, STEP, TOLERANCE = 100 * 9.80665, 1e-3, 4e-3, 1e-5, 1e-4
_MODES = 3


@dataclass(frozen=True)
class OneMesh:
    """What one mesh gives: changes of tension (largest, last) and modes are arrays."""

    unknowns: int
    memory: str
    meshing: float
    run: float
    trusted: bool
    largest: np.ndarray
    last: np.ndarray
    modes: np.ndarray


def meshed(step: Path, stem: Path, unknowns: int | None) -> tuple[int, float]:
    """Mesh a STEP file, finer than the mesh with these ``unknowns`` where there is one; unknowns of contacts and
    processor time, s."""
    command = [sys.executable, "-m", "latin_fmu", "mesh", str(step), "-o", str(stem)]
    if unknowns is not None:
        command += ["--finer", str(FINER), "--contacts", str(round(FINER**2 * unknowns))]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = re.search(r"some ([\d,]+) unknowns", printed)
    seconds = re.findall(r"(?:reading|splitting|meshing) ([\d.]+) s", printed)
    assert found is not None
    return int(found[1].replace(",", "")), sum(map(float, seconds))


def shaken(scene: Path) -> Path:
    """The scene with a shock at its proposed support, along all axes at once."""
    text = scene.read_text(encoding="utf-8")
    support = re.search(r'\[boundary\.base\].*?\nface = "(\S+)"', text, re.DOTALL)
    assert support is not None
    value = [SHOCK] * 3
    lines = [
        text[: text.index("[boundary.base]")] + "[boundary.base]",
        'type = "acceleration"',
        f'face = "{support[1]}"',
        'components = ["x", "y", "z"]',
        f"value = {value}",
        f'law = {{type = "half_sine", duration = {DURATION}}}',
        "",
        "[time]",
        f"end = {END}",
        f"step = {STEP}",
        "",
        "[solver]",
        f"tolerance = {TOLERANCE}",
    ]
    target = scene.with_name(f"{scene.stem}_shock.toml")
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return target


def memory_of(scene: Path) -> str:
    """Memory that ``check`` states."""
    command = [sys.executable, "-m", "latin_fmu", "check", str(scene)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = re.search(r"memory: about ([\d.]+ [MG]B)", printed)
    assert found is not None
    return found[1]


def figures(step: Path, stem: Path, coarse: OneMesh | None = None) -> OneMesh:
    """Mesh, finer than a ``coarse`` one, tighten, shake, and the modes."""
    unknowns, meshing = meshed(step, stem, None if coarse is None else coarse.unknowns)
    file = shaken(stem.with_suffix(".toml"))
    scene = latin_fmu.load_scene(file)
    start = time.process_time()
    solution = latin_fmu.solve(scene)
    run = time.process_time() - start
    changes = np.array([bolt.force - bolt.force[0] for bolt in solution.bolts.values()])
    tail = max(1, changes.shape[1] // 10)
    modes = latin_fmu.vibration_modes(scene, count=_MODES).frequency[:_MODES]
    return OneMesh(
        unknowns,
        memory_of(file),
        meshing,
        run,
        solution.trustworthy,
        np.abs(changes).max(axis=1),
        changes[:, -tail:].mean(axis=1),
        np.asarray(modes),
    )


def show(name: str, label: str, one: OneMesh) -> OneMesh:
    """Print the figures of one mesh, which are long in coming."""
    trust = "" if one.trusted else ", NOT TRUSTWORTHY"
    print(
        f"{name}, {label}: {one.unknowns:,} unknowns of contacts, {one.memory}, meshing {one.meshing:.0f} s, "
        f"run {one.run:.0f} s{trust}"
    )
    print(f"  tension: largest change {_list(one.largest)} N, at the end {_list(one.last)} N")
    print(f"  modes: {_list(one.modes)} Hz", flush=True)
    return one


def compare(coarse: OneMesh, fine: OneMesh) -> None:
    """Print how far the figures of two meshes are apart."""
    scale = fine.largest.max()
    print(
        f"  apart: largest change {np.abs(coarse.largest - fine.largest).max() / scale:.1%}, end "
        f"{np.abs(coarse.last - fine.last).max() / scale:.1%} of the largest change; modes "
        f"{np.abs(coarse.modes / fine.modes - 1.0).max():.2%}",
        flush=True,
    )


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{x:.4g}" for x in values)


def main() -> None:
    """Read the command line, and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(ASSEMBLIES), help=f"{', '.join(ASSEMBLIES)} or STEP files")
    parser.add_argument("--folder", type=Path, help="for meshes and scenes, which stay (default: a temporary one)")
    parser.add_argument("--coarse-alone", action="store_true", help="leave out the finer mesh")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name in options.names:
            step = Path(name)
            if name in ASSEMBLIES:
                step = folder / f"{name}.step"
                command = [sys.executable, "-m", "tests.cad.assemblies", name, str(step)]
                subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
            coarse = show(step.stem, "as it comes", figures(step, folder / f"{step.stem}_1"))
            if not options.coarse_alone:
                fine = figures(step, folder / f"{step.stem}_2", coarse)
                compare(coarse, show(step.stem, f"finer by {FINER}", fine))


if __name__ == "__main__":
    main()
