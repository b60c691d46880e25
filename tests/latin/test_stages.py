"""Local stage over points and instants, and global stage over a window."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.latin.global_stage import GlobalStage
from latin_fmu.latin.local_stage import LocalStage, read_opening

Array = np.ndarray


@pytest.fixture
def run_(blocks_scene: Any, made: Any, begun: Any) -> Any:
    """Blocks with friction at t = 0, search direction of one-instant windows bound."""
    tables = blocks_scene()
    tables["interface"]["rub"]["gap"] = 0.03
    tables["interface"]["floor"]["ground_velocity"] = {
        "direction": [1.0, 0.0, 1.0], "amplitude": 0.3, "law": {"type": "half_sine", "duration": 2.0},
    }  # fmt: skip
    run = begun(made(tables))
    run.direction(1).bind()
    return run


def incoming(run_: Any, n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=(n, run_.assembly.layout.n_flat))


def test_search_direction_action_and_reaction_at_every_channel(run_: Any) -> None:
    """E+: F_hat - F = k (W_hat - W); F_hat' = -F_hat; the ground keeps its velocity."""
    assembly, direction = run_.assembly, run_.direction(1)
    rng = np.random.default_rng(1)
    f, w = rng.normal(size=(2, assembly.layout.n_flat))
    f[assembly.rigid] = 0.0
    s = w - direction.local.z * f
    f_hat, w_hat = direction.local.instant(s, read_opening(assembly).gap)
    np.testing.assert_allclose(
        np.delete(f_hat - f - direction.k * (w_hat - w), assembly.rigid), 0.0, atol=1e-12
    )
    np.testing.assert_array_equal(w_hat[assembly.rigid], w[assembly.rigid])
    for i in (0, 1):
        one, two = (f_hat[assembly.layout.channels(i, side)] for side in (0, 1))
        np.testing.assert_array_equal(one, -two)
        assert one[:, 0].max() <= 0
        assert one.any()


def test_gap_of_the_scene_is_the_opening_at_the_start(run_: Any) -> None:
    opening = read_opening(run_.assembly)
    group = run_.assembly.layout.group(1)
    np.testing.assert_array_equal(opening.gap[0][group.members[0]], 0.0)
    np.testing.assert_allclose(opening.gap[0][group.members[1]], 0.03)
    np.testing.assert_allclose(opening.velocity[0][group.members[1]], -0.1)


def test_signorini_holds_at_every_instant_of_a_window(run_: Any) -> None:
    """0 <= max(G, 0)/dt + d perp P >= 0 with the opening G at the start of each instant."""
    assembly, local = run_.assembly, run_.direction(1).local
    opening = read_opening(assembly)
    s = 0.3 * incoming(run_, 8)
    f_hat, w_hat, followed = local.window(s, opening)
    group = assembly.layout.groups[0]
    before = np.concatenate([opening.gap[0][None], followed[0][:-1]])
    jump = group.block(w_hat)[:, 1, :, 0] - group.block(w_hat)[:, 0, :, 0]
    room = np.maximum(before, 0.0) / assembly.dt + jump
    pressure = -group.block(f_hat)[:, 0, :, 0]
    assert pressure.min() >= 0
    assert room.min() >= -1e-12
    assert np.abs(room * pressure).max() < 1e-12
    assert (pressure > 0).mean() > 0.1
    assert (room > 1e-9).mean() > 0.1


def test_opening_follows_the_displacement_recursion_of_the_scheme(run_: Any) -> None:
    """G_{n+1} = G + dt d + dt^2 ((1/2 - beta) a + beta a_{n+1}), a from the velocities, as the substructures move."""
    assembly, scheme, dt = run_.assembly, run_.assembly.scheme, run_.assembly.dt
    opening = read_opening(assembly)
    f_hat, w_hat, followed = run_.direction(1).local.window(0.3 * incoming(run_, 6), opening)
    group = assembly.layout.groups[0]
    jump = group.block(w_hat)[:, 1, :, 0] - group.block(w_hat)[:, 0, :, 0]
    gap, d, a = opening.gap[0], opening.velocity[0], opening.acceleration[0]
    for i in range(6):
        new = ((jump[i] - d) / dt - (1 - scheme.gamma) * a) / scheme.gamma
        gap = gap + dt * d + dt**2 * ((0.5 - scheme.beta) * a + scheme.beta * new)
        d, a = jump[i], new
        np.testing.assert_allclose(followed[0][i], gap, atol=1e-13)
    assert f_hat.shape == (6, assembly.layout.n_flat)


def test_a_window_is_its_instants_one_by_one(run_: Any) -> None:
    local = run_.direction(1).local
    s = 0.3 * incoming(run_, 5)
    opening = read_opening(run_.assembly)
    whole = local.window(s, opening)
    gaps = [opening.gap, *([g[i] for g in whole[2]] for i in range(4))]
    for i in range(5):
        f_hat, w_hat = local.instant(s[i], gaps[i])
        np.testing.assert_array_equal(f_hat, whole[0][i])
        np.testing.assert_array_equal(w_hat, whole[1][i])


def test_arguments_of_the_local_stage_are_unchanged(run_: Any) -> None:
    local = LocalStage(run_.assembly, run_.direction(1).k)
    s, opening = incoming(run_, 4), read_opening(run_.assembly)
    before = s.copy(), opening.gap[0].copy(), opening.velocity[0].copy()
    local.window(s, opening)
    for now, then in zip((s, opening.gap[0], opening.velocity[0]), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_condensed_and_marched_windows_agree(run_: Any) -> None:
    """Instant by instant with Y, or marched: the same velocities for the same q."""
    assembly, direction = run_.assembly, run_.direction(1)
    q = incoming(run_, 4)
    start = assembly.snapshot()
    together = GlobalStage(assembly, direction.k, 4)(q)
    assembly.restore(start)
    for i in range(4):
        stage = GlobalStage(assembly, direction.k, 1)
        w = stage(q[i : i + 1])
        np.testing.assert_allclose(w[0], together[i], atol=1e-11)
        stage.commit(q[i : i + 1], q[i : i + 1] - direction.k * w, lambda _: None)


def test_global_stage_is_affine_and_repeats(run_: Any) -> None:
    assembly, direction = run_.assembly, run_.direction(1)
    for n in (1, 3):
        stage = GlobalStage(assembly, direction.k, n)
        a, b = incoming(run_, n, 1), incoming(run_, n, 2)
        w_a, w_b = stage(a), stage(b)
        np.testing.assert_allclose(stage(0.3 * a + 0.7 * b), 0.3 * w_a + 0.7 * w_b, atol=1e-11)
        np.testing.assert_array_equal(stage(a), w_a)
        stage.rewind()
        assert assembly.propagators[0].state.instant == 0
        ground = assembly.layout.channels(0, 1)
        expected = 0.3 * np.sin(np.pi * 0.1 / 2.0) / np.sqrt(2)  # of a half sine of 2 s at 0.1 s
        np.testing.assert_allclose(
            w_a[0, ground], np.tile([-expected, expected, 0.0], (9, 1)) @ frame(assembly)
        )


def frame(assembly: Any) -> Array:
    """Components (normal -z, x, y) of side floor to its local frame."""
    local = assembly.interfaces[0].geometry.frames[0]
    return np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ local.T


def test_one_instant_is_committed_with_the_hat_tractions(run_: Any) -> None:
    """Momentum: what the interface gives to one side it takes from the other, to round-off."""
    assembly, direction = run_.assembly, run_.direction(1)
    stage = GlobalStage(assembly, direction.k, 1)
    q = 30.0 * incoming(run_, 1)  # large enough to close the gap somewhere
    w = stage(q)
    s = w[0] - direction.local.z * (q[0] - direction.k * w[0])
    f_hat, _ = direction.local.instant(s, read_opening(assembly).gap)
    f_hat[assembly.layout.channels(0, 0)] = 0.0  # no floor: the two blocks are alone
    f_hat[assembly.layout.channels(0, 1)] = 0.0

    def momentum() -> Array:
        total = np.zeros(3)
        for p in assembly.propagators:
            for j, m in enumerate(p.members):
                total += (m.mass @ p.full_velocity(j).ravel()).reshape(-1, 3).sum(axis=0)
        return total

    before = momentum()
    stage.commit(q, f_hat[None], lambda _: None)
    np.testing.assert_allclose(momentum(), before, atol=1e-14)
    assert np.abs(f_hat).max() > 0.1


def test_a_trial_has_no_consequences(run_: Any) -> None:
    assembly, direction = run_.assembly, run_.direction(1)
    for n in (1, 3):
        stage = GlobalStage(assembly, direction.k, n)
        q = incoming(run_, n)
        w, marched = stage(q), stage.marched
        seen: list[int] = []
        stage.trial(q, np.zeros_like(q), lambda i, seen=seen: seen.append(i))  # type: ignore[misc]
        assert seen == list(range(n))
        assert stage.marched == marched
        np.testing.assert_array_equal(stage(q), w)
        stage.rewind()
        assert all(p.state.instant == 0 for p in assembly.propagators)


def test_marched_substructure_instants_are_counted(run_: Any) -> None:
    for n in (1, 3):
        stage = GlobalStage(run_.assembly, run_.direction(1).k, n)
        stage(incoming(run_, n))
        stage(incoming(run_, n))
        assert stage.marched + stage.condensed == 2 * n * 2
        assert (stage.marched == 0) == (n == 1)
        stage.rewind()
