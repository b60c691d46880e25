"""Runs distributed over processes by ``mpiexec``: the results of one process, and an end for all where one fails."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import InputError, load_scene, open_results, scene_from_dict
from latin_fmu.attempts import check_distributable
from latin_fmu.building import discretise
from latin_fmu.latin.processes import distributed
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, Description, column, half_sine, placed, rubbing

from .test_process import environment

pytest.importorskip("mpi4py", reason="mpi4py is not installed: pip install latin-fmu[mpi]")
MPIEXEC = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
started = pytest.mark.skipif(MPIEXEC is None, reason="there is no mpiexec: pip install latin-fmu[mpi]")

BLOCK = Box(STEEL, (0.01,) * 3, (2, 2, 2))


def row() -> Description:
    """Blocks alike (but the last) in a row, pushed at one end and pulled aside: friction, a gap that closes, an
    interface without friction, a bond, a sensor, a reaction."""
    blocks = {f"b{i}": (replace(BLOCK, elements=(3 if i == 4 else 2, 2, 2)), (0.01 * i, 0.0, 0.0)) for i in range(5)}
    keys: list[Description] = [{"friction_coefficient": 0.3}, {"friction_coefficient": 0.0}]
    keys += [{"gap": 1e-7, "friction_coefficient": 0.2}, {"behaviour": "perfect"}]
    return placed(
        blocks,
        {"end": 1.2e-5, "instants": 24},
        name="row",
        interface={f"i{i}": {"sides": [f"b{i}.xmax", f"b{i + 1}.xmin"], **k} for i, k in enumerate(keys)},
        boundary={"wall": {"type": "fixed", "face": "b4.xmax"}},
        load={"push": {"face": "b0.xmin", "traction": [1e8, 1e7, 3e6], "law": half_sine(1e-5)}},
        sensor={"tip": {"substructure": "b0", "point": [0.0, 0.005, 0.005]}},
        output={"energy": True, "fields": True, "reactions": True, "every": 7},
    )


def bonded() -> Description:
    """The same with perfect interfaces."""
    tables = row()
    for name, interface in tables["interface"].items():
        tables["interface"][name] = {"sides": interface["sides"], "behaviour": "perfect"}
    return tables


def pillars() -> Description:
    """Blocks that are one class, divided among the processes, under a plate."""
    plate = Box(STEEL, (0.06, 0.01, 0.005), (12, 2, 1))
    names = [f"b{i}" for i in range(6)]
    feet = {f"foot{n}": rubbing(f"{n}.zmin", "ground", 0.3) for n in names}
    return placed(
        {"plate": (plate, (0.0, 0.0, 0.01)), **{n: (BLOCK, (0.01 * i, 0.0, 0.0)) for i, n in enumerate(names)}},
        {"end": 1e-5, "instants": 20},
        name="pillars",
        interface=feet | {f"head{n}": rubbing(f"{n}.zmax", "plate.zmin", 0.2) for n in names},
        load={"push": {"face": "plate.xmin", "traction": [1e8, 5e6, -3e7], "law": half_sine(1e-5)}},
    )


def plates() -> Description:
    """Two plates in steps that a wave crosses within two elements: tables of Y leave defects that are corrected."""
    size, elements = (8e-3, 8e-3, 2e-3), (8, 8, 2)
    return column(
        {"lower": Box(ALUMINIUM, size, elements), "upper": Box(STEEL, size, elements)},
        {"crush": {"friction_coefficient": 0.3}},
        {"end": 5.4e-6, "instants": 12, "scheme": "hht"},
        boundary={"base": {"type": "symmetry", "face": "lower.zmin"}},
        load={"press": {"face": "upper.zmax", "pressure": 2e8, "law": half_sine(1e-5)}},
        output={"energy": True, "fields": True},
    )


MAIN = """
import json, sys
from latin_fmu.cli import main
print([main(words) for words in json.loads(sys.argv[1])], file=sys.stderr)
"""
VARIANTS = {
    "plain": (),
    "windows of 12": ("--set", "solver.window=12"),
    "one window": ("--set", 'solver.window="whole"', "--set", "solver.start=zero"),
    "explicit": ("--set", "solver.propagator.type=explicit", "--set", "time.scheme.type=central_difference"),
    "class": ("--set", "solver.tolerance=3e-2"),  # solves are reused often
    "class in windows": ("--set", "solver.window=10"),
    "bonded": (),
    "statics": (
        *("--set", "time.quasi_static=true", "--set", "time.instants=12", "--set", "load.push.law.duration=1e-4"),
        *("--set", "load.push.traction=[1e8, 1e6, 1e6]", "--set", "interface.i1.friction_coefficient=0.3"),
    ),
    "substitution": ("--set", 'solver.interface_operator="exact"'),
    "tables": ("--set", 'solver.interface_operator="sparse"'),
    "corrected tables": ("--set", 'solver.interface_operator="sparse"'),
    "class by tables": ("--set", 'solver.interface_operator="sparse"', "--set", "solver.tolerance=1e-2"),
    "long steps": (
        *("--set", "time.instants=6", "--set", "time.end=2.4e-4", "--set", "load.push.law.duration=2e-4"),
        *("--set", "solver.tolerance=1e-4"),
    ),
}
SCENES = {
    "class": "pillars.toml",
    "class by tables": "pillars.toml",
    "corrected tables": "plates.toml",
    "class in windows": "pillars.toml",
    "bonded": "bonded.toml",
}
TWO = ("plain", "one window", "class", "corrected tables")
QUICK = {1: TWO, 2: TWO, 3: ("class",)}  # by the number of processes
OTHERS = tuple(name for name in VARIANTS if name not in TWO)
SLOW = {1: OTHERS, 2: OTHERS, 3: ("class in windows", "class by tables", "long steps")}
SLOW[4] = ("plain", "windows of 12", "tables")
RESIDUES = ("passes", "force_mismatch", "error_indicator", "balance", "unbalanced_force", "unbalanced_moment")
LIMIT = 2e-10


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scene."""
    folder = tmp_path_factory.mktemp("row")
    for name, tables in (("scene", row()), ("bonded", bonded()), ("pillars", pillars()), ("plates", plates())):
        (folder / f"{name}.toml").write_text(scene_from_dict(tables).text())
    return folder


def mpiexec(place: Path, n: int, *commands: tuple[str, ...], code: str = MAIN) -> subprocess.CompletedProcess[str]:
    """Command lines, one after the other, on n processes (one: without mpiexec)."""
    start = [] if n == 1 else [str(MPIEXEC), "-n", str(n)]
    command = [*start, sys.executable, "-c", code, json.dumps(commands)]
    return subprocess.run(command, cwd=place, env=environment(), capture_output=True, text=True, timeout=240)


def run(place: Path, n: int, variant: str) -> Path:
    """Results of a variant of the scene by n processes, which run all quick or all slow ones the first time."""
    if not (place / f"{n} {variant}.nc").exists():
        given = QUICK[n] if variant in QUICK.get(n, ()) else SLOW[n]
        words = [
            ("run", SCENES.get(name, "scene.toml"), "--quiet", "--no-estimate", "-o", f"{n} {name}.nc", *VARIANTS[name])
            for name in given
        ]
        done = mpiexec(place, n, *words)
        assert done.returncode == 0, done.stderr
        assert str([0] * len(given)) in done.stderr, done.stderr
    return place / f"{n} {variant}.nc"


def quantity(path: str, name: str, variable: Any) -> str:
    """What a variable is of: energies are one quantity, as some of them may be round-off of the others."""
    return "energy" if variable.attrs.get("units") == "J" else f"{path.split('/')[1]}.{name}"


def sizes_of(tree: Any) -> dict[str, float]:
    """Largest size of each quantity over the groups of one kind, by which its differences are measured."""
    sizes: dict[str, float] = {}
    for node in tree.subtree:
        for name, variable in node.to_dataset(inherit=False).variables.items():
            if variable.dtype.kind == "f":
                key = quantity(node.path, name, variable)
                sizes[key] = max(sizes.get(key, 0.0), float(np.nanmax(np.abs(variable.values), initial=0.0)))
    return sizes


def assert_equal(one: Path, several: Path) -> None:
    """The same variables, equal counts of iterations, and numbers within LIMIT of their size."""
    a, b = open_results(one), open_results(several)
    assert {node.path for node in a.subtree} == {node.path for node in b.subtree}
    sizes, compared = sizes_of(a), 0
    for node in a.subtree:
        first, second = node.to_dataset(inherit=False), b[node.path].to_dataset(inherit=False)
        assert set(first.variables) == set(second.variables)
        for name, variable in first.variables.items():
            values, others = variable.values, second.variables[name].values
            assert values.shape == others.shape, name
            if values.dtype.kind != "f":
                assert (values == others).all(), (node.path, name)
            elif name not in RESIDUES:
                size = sizes[quantity(node.path, name, variable)]
                if variable.attrs.get("units") == "W":  # where all points stick their power is round-off
                    size = max(size, sizes.get("energy", 0.0) / 1.2e-5)
                single = values.dtype == np.float32
                np.testing.assert_allclose(
                    others, values, rtol=0.0, atol=(1e-6 if single else LIMIT) * size, err_msg=f"{node.path} {name}"
                )
                compared += 1
    assert compared > 40
    a.close(), b.close()


def test_shares_of_the_cost() -> None:
    """Successive substructures together, none without any, costs as equal as whole ones allow."""
    assert distributed([1.0] * 6, 3) == [0, 0, 1, 1, 2, 2]
    assert distributed([10.0, 1.0, 1.0, 10.0], 2) == [0, 0, 1, 1]
    assert distributed([1.0, 1.0, 1000.0], 3) == [0, 1, 2]
    assert distributed([1000.0, 1.0, 1.0], 3) == [0, 1, 2]
    draw = np.random.default_rng(3)
    for n in range(2, 30):
        costs = draw.uniform(0.5, 2.0, n)
        for size in range(1, n + 1):
            ranks = distributed(costs.tolist(), size)
            assert ranks == sorted(ranks)
            assert set(ranks) == set(range(size))
            shares = np.bincount(ranks, costs)
            assert shares.max() <= costs.sum() / size + 2.0 * costs.max()


@started
@pytest.mark.parametrize(
    ("n", "variant"),
    [
        *((n, v) for n in (2, 3) for v in QUICK[n]),
        *(pytest.param(n, v, marks=pytest.mark.slow) for n in (2, 3, 4) for v in SLOW[n]),
    ],
)
def test_results_of_one_process(place: Path, n: int, variant: str) -> None:
    assert_equal(run(place, 1, variant), run(place, n, variant))  # on one process: quick or slow as on two


@started
def test_instants_by_tables_are_corrected(place: Path) -> None:
    """What the variant is for: some instants take corrections, on one process and on two."""
    for n in (1, 2):
        tree = open_results(run(place, n, "corrected tables"))
        assert int(tree["convergence/corrections"].sum()) > 3


FAILS = """
import sys
from latin_fmu.latin.exchange import Exchange
neighbours, calls = Exchange.neighbours, []

def failing(self, n):
    calls.append(n)
    if len(calls) == 100 and self.processes.rank == 1:
        raise OverflowError("numbers of substructure b3 overflow")
    neighbours(self, n)

Exchange.neighbours = failing
from latin_fmu.cli import main
sys.exit(main(["run", "scene.toml", "-o", "failed.nc"]))
"""


@started
def test_a_process_that_fails_ends_all(place: Path) -> None:
    """The others wait for its W at that moment."""
    begun = time.monotonic()
    done = mpiexec(place, 3, code=FAILS)
    assert time.monotonic() - begun < 60.0
    assert done.returncode != 0
    assert "process 1 of 3: arithmetic overflow or underflow" in done.stderr
    assert done.stderr.count("latin-fmu: ") == 1
    assert not (place / "failed.nc").exists()


REFUSED = {
    ("--set", "interface.i0.friction_coefficient=-1"): "interface.i0.friction_coefficient",
    ("--set", "solver.threads=2"): "solver.threads: threads and processes cannot be combined",
    ("--set", "solver.skip_at_rest=tolerance"): "solver.skip_at_rest: substructures of a class are skipped at rest",
    ("--checkpoint", "10"): "--checkpoint: requires a single process; run it without mpiexec",
    ("-o", "nowhere/out.nc"): "the folder does not exist",
}


@started
def test_what_cannot_be_done_is_reported_once(place: Path) -> None:
    """By process 0, and the run after it starts again."""
    words = [("run", "scene.toml", "--quiet", *options) for options in REFUSED]
    done = mpiexec(place, 2, *words, ("run", "scene.toml", "-o", "estimated.nc"))
    assert done.stderr.count(str([*[2] * len(REFUSED), 0])) == 2, done.stderr
    for text in REFUSED.values():
        assert done.stderr.count(text) == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout.count("row: converged") == 1
    assert done.stdout.count("results: estimated.nc") == 1
    # several processes iterate bonds
    mpiexec(place, 1, ("run", "scene.toml", "--quiet", "--set", "solver.bonds=iterate", "-o", "alone.nc"))
    errors = [open_results(place / name)["accuracy"]["relative_error"].values for name in ("estimated.nc", "alone.nc")]
    np.testing.assert_allclose(errors[0], errors[1], rtol=1e-6)


NEVER = ("--set", "solver.tolerance=1e-17", "--set", "solver.force_tolerance=1e-17")
LONG = ("--set", "time.end=2.4e-2", "--set", "time.instants=48000", "--set", "output.every=48000")


@started
@pytest.mark.parametrize(
    ("options", "whole"),  # what is limited, and the variant that has the same steps
    [
        pytest.param((), "plain", id="one"),
        pytest.param(VARIANTS["windows of 12"], "windows of 12", id="windows", marks=pytest.mark.slow),
        pytest.param(NEVER, None, id="failing", marks=pytest.mark.slow),
    ],
)
def test_a_limit_of_cpu_time_stops_all_before_one_instant(
    place: Path, options: tuple[str, ...], whole: str | None
) -> None:
    """Exit code 7 on both, results marked; until then they are those of one process."""
    words = ("run", "scene.toml", "--quiet", *LONG, *options, "--max-cpu")
    done = mpiexec(place, 2, (*words, "0.7", "-o", "limited.nc"), (*words, "1e-6", "-o", "at once.nc"))
    assert done.stderr.count("[7, 7]") == 2, done.stderr
    both, none = (open_results(place / f"{name}.nc") for name in ("limited", "at once"))
    assert both.attrs["interrupted"] == "stopped by its limit of 0.7 s of CPU time"
    assert (both.attrs["converged"], both.attrs["complete"]) == (0, 0)
    assert "instant 0 of 48000" in none.attrs["status"]
    if whole is None:
        mpiexec(place, 1, (*words, "3", "-o", "limited alone.nc"))
    alone = open_results(place / "limited alone.nc" if whole is None else run(place, 1, whole))
    forces = [tree["interfaces/i0"]["force"].values for tree in (alone, both)]
    n = min(map(len, forces))
    assert n > 5
    np.testing.assert_allclose(forces[1][:n], forces[0][:n], rtol=0.0, atol=LIMIT * np.abs(forces[0]).max())


def test_more_processes_than_substructures(place: Path) -> None:
    with pytest.raises(InputError, match=r"more processes than substructures \(value: 6\); allowed: at most 5"):
        check_distributable(discretise(load_scene(place / "scene.toml")), 6)
