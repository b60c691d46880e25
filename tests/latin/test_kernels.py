"""Compiled passes against their NumPy twins."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from latin_fmu.latin import kernels

DRAW = np.random.default_rng(7)


def field(n: int = 3, n_flat: int = 40) -> np.ndarray:
    return DRAW.normal(size=(n, n_flat))


def weights(rows: int | None = None) -> np.ndarray:
    drawn = DRAW.uniform(0.1, 2.0, size=40 if rows is None else (rows, 40))
    drawn[..., ::7] = 0.0  # ground
    return drawn


@pytest.mark.parametrize("members", [1, 4])
def test_respond(members):
    channels = DRAW.permutation(40)[: 8 * members].reshape(8, members)
    response, w_0, q = DRAW.normal(size=(8, 8)), DRAW.normal(size=(8, members)), field()[0]
    found, expected = np.zeros(40), np.zeros(40)
    kernels.respond(response, w_0, channels, q, found)
    kernels.respond_numpy(response, w_0, channels, q, expected)
    assert np.allclose(found, expected, rtol=1e-13, atol=1e-13)
    assert expected[channels].all()


def test_outgoing():
    q, w, k = field(), field(), weights()
    z = np.divide(1.0, k, out=np.zeros_like(k), where=k > 0)
    found, expected = [np.empty_like(q) for _ in range(2)], [np.empty_like(q) for _ in range(2)]
    kernels.outgoing(q, w, k, z, *found)
    kernels.outgoing_numpy(q, w, k, z, *expected)
    assert np.allclose(found, expected, rtol=1e-13, atol=1e-14)


def test_close():
    q, f_hat, w_hat, f, w = (field() for _ in range(5))
    k, three = weights(), weights(3)
    found, expected = np.empty_like(q), np.empty_like(q)
    sums = kernels.close(q, k, f_hat, w_hat, f, w, three, found)
    assert sums == pytest.approx(kernels.close_numpy(q, k, f_hat, w_hat, f, w, three, expected), rel=1e-12)
    assert np.allclose(found, expected, rtol=1e-13, atol=1e-14)


def test_anderson():
    weight, states = weights(), []
    for step in (kernels.anderson, kernels.anderson_numpy):
        ring, gram, out = (np.zeros((3, 3, 40)), np.zeros((3, 3, 40))), np.zeros((3, 3)), np.empty((3, 40))
        draw = np.random.default_rng(3)
        last = draw.normal(size=(2, 3, 40))
        for count in range(5):
            now = draw.normal(size=(2, 3, 40))
            step(weight, *now, *last, *ring, gram, count, 0.7, 1e-12, out)
            last = now
        states.append((out.copy(), gram.copy()))
    for found, expected in zip(*states, strict=True):
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-11)


def test_a_run_without_compilation_gives_the_same_answer():
    """The twins and SciPy's factor: another process, the same numbers to round-off."""
    code = (
        "import latin_fmu, numpy as np, sys;"
        "s = latin_fmu.load_scene(sys.argv[1], ['time.end=6e-6', 'solver.tolerance=1e-8', 'output.energy=false']);"
        "print(repr(latin_fmu.solve(s).interfaces['crush'].force()[-1].tolist()), 'numba' in sys.modules)"
    )
    root = Path(__file__).parents[2]
    outputs = []
    for switch in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-c", code, "models/two_specimen_crushing/scene.toml"],
            capture_output=True, text=True, check=True, cwd=root, env={**os.environ, "LATIN_FMU_COMPILE": switch},
        )  # fmt: skip
        force, numba = done.stdout.rsplit(" ", 1)
        assert (numba.strip() == "True") == (switch == "1")
        outputs.append(np.array(eval(force)))
    assert np.allclose(*outputs, rtol=1e-6)
    assert np.abs(outputs[0]).max() > 1e3
