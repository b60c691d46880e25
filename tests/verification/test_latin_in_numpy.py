"""The paper's equations in NumPy (``examples/latin_in_numpy.py``) and the package: the same fields to 1e-8.

Both iterate to 1e-11. The example has its own elements, march, local stage and loop and imports nothing from here.
"""

from __future__ import annotations

import importlib.util
import re
import sys
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.scenes import solved

PATH = Path(__file__).parents[2] / "examples" / "latin_in_numpy.py"
LONGEST = 300  # lines: it is to be read beside the paper


@pytest.fixture(scope="module")
def paper() -> ModuleType:
    """The example."""
    spec = importlib.util.spec_from_file_location(PATH.stem, PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[PATH.stem] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


def package(friction: float | None, alpha: float, whole: bool, scene) -> tuple[np.ndarray, np.ndarray]:
    """W_hat and F_hat (instant, side, point, 3) of the same scene, without t = 0."""
    law = "behaviour='perfect'" if friction is None else f"behaviour='contact',friction_coefficient={friction}"
    solution = solved(
        "two_specimen_crushing/scene",
        *(f"substructure.{name}.box.elements={[scene.cells] * 3}" for name in ("lower", "upper")),
        f"interface.crush={{sides=['lower.zmax','upper.zmin'],{law}}}",
        f"time={{end={scene.instants * scene.step},instants={scene.instants},scheme={{type='hht',alpha={alpha}}}}}",
        f"solver.window={repr('whole') if whole else 1}",
        "solver.tolerance=1e-11",
        "solver.force_tolerance=1e-10",
    )
    history = solution.interfaces["crush"]
    traction, velocity = history.traction[-scene.instants :], history.velocity[-scene.instants :]
    return velocity, np.stack([traction, -traction], axis=1)


@pytest.mark.parametrize(
    ("friction", "alpha", "whole", "instants"),
    [
        (0.1, -0.1, True, 60),
        (0.1, -0.1, False, 60),
        pytest.param(0.1, 0.0, True, 60, marks=pytest.mark.slow),
        (10.0, 0.0, False, 30),
        (0.0, -0.1, False, 30),
        (None, -0.1, True, 30),
    ],
)
def test_the_equations_in_numpy_give_the_fields_of_the_package(paper, friction, alpha, whole, instants):
    scene = paper.Scene(friction=friction, alpha=alpha, instants=instants)
    own = paper.solve(scene, scene.instants if whole else 1)
    assert all(errors[-1] <= 1e-11 for errors in own.errors)
    velocity, traction = package(friction, alpha, whole, scene)
    np.testing.assert_allclose(own.f_hat, traction, rtol=0, atol=1e-8 * np.abs(traction).max())
    np.testing.assert_allclose(own.w_hat, velocity, rtol=0, atol=1e-8 * np.abs(velocity).max())
    if friction == 0.1:  # points stick, slip and are open
        shear = np.linalg.norm(traction[:, 0, :, :2], axis=-1)
        pressure = -traction[:, 0, :, 2]
        slips = np.isclose(shear, friction * pressure, rtol=1e-6) & (pressure > 0)
        assert slips.any()
        assert (pressure == 0).any()
        assert ((pressure > 0) & ~slips & (shear > 0)).any()


def test_the_example_stands_alone_and_is_short():
    text = PATH.read_text()
    assert len(text.splitlines()) <= LONGEST
    assert set(re.findall(r"^\s*(?:from|import) (\w+)", text, re.M)) == {
        "__future__", "argparse", "dataclasses", "matplotlib", "numpy", "scipy", "typing",
    }  # fmt: skip
    for number in range(1, 25):
        in_range = any(int(a) <= number <= int(b) for a, b in re.findall(r"\((\d+)\)-\((\d+)\)", text))
        assert in_range or f"({number})" in text, f"Eq. ({number})"


def test_the_example_prints_its_table(paper, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(paper, "Scene", partial(paper.Scene, instants=30))
    paper.main(["--figure", str(tmp_path / "latin.png")])
    first, second = (line.split()[-2:] for line in capsys.readouterr().out.splitlines()[1:])
    assert [float(x) for x in first] == pytest.approx(
        [float(x) for x in second], rel=2e-2
    )  # their errors of time differ
    assert (tmp_path / "latin.png").stat().st_size > 10_000


@pytest.mark.parametrize("wrong", [("--friction", "-0.1"), ("--friction", "nan"), ("--alpha", "0.5")])
def test_wrong_numbers_are_refused(paper, wrong, capsys):
    with pytest.raises(SystemExit):
        paper.main(list(wrong))
    assert "--friction is at least 0 and finite, --alpha from -1/3 to 0" in capsys.readouterr().err


def test_a_window_that_does_not_converge_is_an_error(paper):
    with pytest.raises(RuntimeError, match=r"sqrt\(eta\) = .* > 1e-11 in the window from instant 1$"):
        paper.solve(paper.Scene(), 60, most=5)
