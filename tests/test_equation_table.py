"""The table of equations and modules in the package's docstring: what it names is what a default run computes with."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import latin_fmu

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "latin_fmu"

TRACED = """
import json, sys
import latin_fmu

entered = set()


def trace(frame, event, argument):
    entered.add(frame.f_code.co_filename)


box = {"size": [1.0, 1.0, 1.0], "elements": [1, 1, 1]}
tables = {
    "name": "tiny",
    "material": {"m": {"young_modulus": 4.0, "poisson_ratio": 0.3, "density": 1.0}},
    "substructure": {
        name: {"material": "m", "box": {"origin": [0.0, 0.0, float(i)], **box}} for i, name in enumerate("abc")
    },
    "interface": {
        "glued": {"sides": ["a.zmax", "b.zmin"], "behaviour": "perfect"},
        "meet": {"sides": ["b.zmax", "c.zmin"], "friction_coefficient": 0.3},
    },
    "boundary": {"held": {"type": "fixed", "face": "a.zmin"}},
    "load": {"push": {"face": "c.zmax", "traction": [0.3, 0.0, -1.0]}},
    "time": {"end": 0.6, "instants": 3},
    "solver": {"tolerance": 1e-4},
}
sys.settrace(trace)
for window in (1, 3):
    tables["solver"]["window"] = window
    tables["output"] = {"energy": window == 1}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert solution.converged, solution.status
sys.settrace(None)
print(json.dumps(sorted(entered)))
"""

FORCES = """
import json, sys
import latin_fmu

scene = latin_fmu.load_scene(sys.argv[1], ["time.end=6e-6", "solver.max_iterations=60"])
outcome = latin_fmu.solve(scene).outcome
print(json.dumps([outcome.interfaces["crush"].force().tolist(), [w.iterations for w in outcome.windows]]))
"""

# module of the table, an expression in it, and the same in a mutant
MUTATIONS = {
    "traction of the local stage halved": (
        "kernels.local_stage",
        "f_hat[j] = sign * traction[j]\n",
        "f_hat[j] = 0.5 * sign * traction[j]\n",
    ),
    "pressure of the law halved": (
        "laws.contact",
        "pressure = max(0.0, -(point.jump[0] + point.reach[0])) / point.z[0] if",
        "pressure = 0.5 * max(0.0, -(point.jump[0] + point.reach[0])) / point.z[0] if",
    ),
    "sign of K u": (
        "kernels.substructure",
        "add_product(pools, c, STIFFNESS, -1.0, u_free, load)",
        "add_product(pools, c, STIFFNESS, 1.0, u_free, load)",
    ),
    "(24) times 1e6": (
        "kernels.indicator",
        "np.sqrt(totals[0] / window / measure[2])",
        "np.sqrt(1e6 * totals[0] / window / measure[2])",
    ),
}


def modules() -> list[tuple[str, str]]:
    """Equations and module of each row of the table, one module each."""
    assert latin_fmu.__doc__ is not None
    table = latin_fmu.__doc__.split("=" * 69 + "  " + "=" * 42 + "\n")[2]
    rows = []
    for line in table.splitlines():
        rows += [(line[:69].strip(), name.strip()) for name in line[69:].split(",") if name.strip()]
    return rows


def test_modules_of_the_table_exist() -> None:
    assert len(modules()) > 15
    for equations, name in modules():
        assert re.fullmatch(r"[a-z_]+\.[a-z_]+", name), (equations, name)
        assert (PACKAGE / f"{name.replace('.', '/')}.py").is_file(), name
    named = {name for _, name in modules()}
    assert {module for module, _, _ in MUTATIONS.values()} <= named


@pytest.mark.parametrize("document", ["CONTRIBUTING.md", "docs/notation.md", "docs/processes.md"])
def test_documents_name_what_exists(document: str) -> None:
    """Files, folders and identifiers between backticks, and the tests of commands."""
    text = (ROOT / document).read_text(encoding="utf-8")
    files = re.findall(r"`((?:\w+/)+(?:\w+\.\w+)?)`", text) + re.findall(r"(?<=\s)(tests/[\w/]+(?:\.\w+)?)", text)
    made = {"build/"}  # by a command
    for name in {name for name in files if "NAME" not in name} - made:
        assert (ROOT / name).exists() or (PACKAGE / name).exists(), name
    sources = [path for top in (PACKAGE, ROOT / "tests") for path in top.rglob("*.py")] + [ROOT / "pyproject.toml"]
    words = {word for path in sources for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    assert set(re.findall(r"`([A-Za-z_]\w*)`", text)) <= words


def test_a_default_run_enters_every_module_of_the_table() -> None:
    """With the kernels as plain Python: functions of the file are called, not only its names imported."""
    done = subprocess.run(
        [sys.executable, "-c", TRACED],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "LATIN_FMU_COMPILE": "setup"},
    )
    assert done.returncode == 0, done.stderr
    entered = {Path(name) for name in json.loads(done.stdout)}
    missing = [name for _, name in modules() if PACKAGE / f"{name.replace('.', '/')}.py" not in entered]
    assert missing == []


def test_the_expressions_of_the_mutants_are_there_once() -> None:
    for module, own, _ in MUTATIONS.values():
        assert (PACKAGE / f"{module.replace('.', '/')}.py").read_text().count(own) == 1, module


def forces_of(folder: Path, mutation: str | None) -> list[object]:
    """Forces and iterations of the crushing, with the kernels of a copy of the package compiled from that copy."""
    for package in (PACKAGE, ROOT / "fmu_build"):  # whose C files are linked into the library
        shutil.copytree(package, folder / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    if mutation is not None:
        module, own, changed = MUTATIONS[mutation]
        path = folder / "latin_fmu" / f"{module.replace('.', '/')}.py"
        path.write_text(path.read_text().replace(own, changed))
    away = {**os.environ, "PYTHONPATH": str(folder)}
    build = [sys.executable, "-m", "latin_fmu.aot"]
    subprocess.run(build, check=True, cwd=folder, env=away)
    done = subprocess.run(
        [sys.executable, "-c", FORCES, str(ROOT / "models" / "two_specimen_crushing" / "scene.toml")],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=away,
    )
    assert done.returncode == 0, done.stderr
    forces: list[object] = json.loads(done.stdout)
    return forces


@pytest.mark.slow
def test_a_mutation_of_what_the_table_names_changes_the_result(tmp_path: Path) -> None:
    """Halved tractions, a wrong sign of K u and another indicator; a copy that is not mutated changes nothing."""
    pytest.importorskip("ziglang")
    first, second = (forces_of(tmp_path / name, None) for name in ("first", "second"))
    assert first == second
    for number, mutation in enumerate(MUTATIONS):
        assert forces_of(tmp_path / str(number), mutation) != first, mutation
