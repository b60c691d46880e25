"""Another method with constant operators: its contact law, and its result on the same matrices."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture(autouse=True)
def _examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


def _library():
    contact = importlib.import_module("siconos_contact")
    siconos = contact.library()
    if siconos is None:
        pytest.skip(contact.MISSING)
    return siconos


def test_contact_law_of_the_rival() -> None:
    """Signorini and Coulomb at every point, the first components being normal."""
    siconos = _library()
    random = np.random.default_rng(1)
    n, mu = 12, 0.3
    half = random.normal(size=(3 * n, 3 * n))
    w = half @ half.T + np.eye(3 * n)
    points = importlib.import_module("siconos_contact").Contacts(siconos, w, np.full(n, mu), 1e-12)
    points.q[:] = random.normal(size=3 * n)
    points.solve()
    p, u = points.impulse.reshape(-1, 3), (w @ points.impulse + points.q).reshape(-1, 3)
    scale = np.abs(points.q).max()
    assert (p[:, 0] >= 0.0).all()
    assert u[:, 0].min() > -1e-9 * scale
    assert np.abs(p[:, 0] * u[:, 0]).max() < 1e-9 * scale * p.max()
    pressed = p[:, 0] > 0.0
    assert 0 < pressed.sum() < n
    friction, slip = np.linalg.norm(p[pressed, 1:], axis=1), u[pressed, 1:]
    assert (friction <= mu * p[pressed, 0] * (1 + 1e-9)).all()
    # what slips is at the cone, and pulled against its motion
    speed = np.linalg.norm(slip, axis=1)
    work = np.einsum("ij,ij->i", slip, p[pressed, 1:])
    assert work == pytest.approx(-speed * mu * p[pressed, 0], abs=1e-9 * scale)


def test_answer_of_the_rival() -> None:
    """Moreau-Jean on the same matrices: the same normal forces within the error of the schemes."""
    siconos = _library()
    problems, timing = (importlib.import_module(n) for n in ("benchmark_problems", "benchmark_timing"))
    march = importlib.import_module("siconos_march")
    ready = timing.prepared(problems.tower(3, 3), {"propagator": "direct", "share_identical": False})
    outcome = timing.contact_run(ready)
    here = np.stack([outcome.interfaces[u.name].normal_resultant() for u in ready.units], axis=1)
    there = march.MoreauJean(ready, siconos, 1e-6).run()
    assert np.linalg.norm(there - here) < 0.04 * np.linalg.norm(here)
    assert there.sum(axis=0) == pytest.approx(here.sum(axis=0), rel=2e-3)


def test_says_when_there_is_no_siconos(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    example = importlib.import_module("against_siconos")
    monkeypatch.setattr(example, "library", lambda: None)
    assert example.main([]) == 0
    assert "not installed" in capsys.readouterr().out
