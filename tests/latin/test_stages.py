"""Local stage over points and instants, and linear stage over a window, on the image of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels import entries, local_stage
from latin_fmu.kernels.instants import OPENINGS
from latin_fmu.kernels.linear_stage import linear_stage
from latin_fmu.latin.run_image import Stages
from latin_fmu.propagator.base import full_velocity
from latin_fmu.propagator.image import take_marched
from tests.plain_kernels import call

Array = np.ndarray
WINDOW = 8


@pytest.fixture
def run_(blocks_scene: Any, made: Any, begun: Any) -> Any:
    """Blocks with friction at t = 0, search direction of one-instant windows bound; every solution anew."""
    tables = blocks_scene(solver={"window": WINDOW, "skip_unchanged": False, "skip_at_rest": "off"})
    tables["interface"]["rub"]["gap"] = 0.03
    tables["interface"]["floor"]["ground_velocity"] = {
        "direction": [1.0, 0.0, 1.0],
        "amplitude": 0.3,
        "law": {"type": "half_sine", "duration": 2.0},
    }
    return begun(made(tables))


def incoming(run_: Any, n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=(n, run_.assembly.layout.n_flat))


def fields(run_: Any, name: str, n: int) -> Array:
    """A field (n, n_flat) of the image, a view."""
    field: Array = run_.image.field(name, n, run_.image.n_flat)
    return field


def openings(run_: Any, n: int) -> Array:
    """Gap, its velocity, its acceleration, and the start of the next instant, (4, n_point); n instants to come."""
    if n:
        run_.image.call(entries.BEGIN, n, 1, OPENINGS)
    group = run_.assembly.layout.groups[0]
    opening: Array = run_.image.group_field(0, "opened", 4, group.n_point)
    return opening


def points(run_: Any, i: int, n: int) -> None:
    """The local stage of instant i."""
    count = run_.assembly.layout.groups[0].n_point
    call(local_stage.prepare, run_.image, 0, i, 0, count)
    call(local_stage.solve_points, run_.image, 0, 0, count)
    call(local_stage.finish, run_.image, 0, i, n, 0, count)


def local(run_: Any, s: Array) -> tuple[Array, Array, Array]:
    """F_hat, W_hat (n, n_flat) and gaps (n, n_point) of a window for the velocities s."""
    n = len(s)
    opened, followed = openings(run_, n), []
    opening = run_.image.group_field(0, "opening", *opened.shape)
    fields(run_, "s", n)[:] = s
    for i in range(n):
        points(run_, i, n)
        followed.append(opening[0].copy())
    return fields(run_, "local_f", n).copy(), fields(run_, "local_w", n).copy(), np.array(followed)


def linear(run_: Any, q: Array, first: int = 1) -> Array:
    """W (n, n_flat) of the linear stage over a window from the present state."""
    n, image = len(q), run_.image
    image.call(entries.BEGIN, n, first, OPENINGS)
    fields(run_, "q", n)[:] = q
    call(linear_stage, image, n, first, 0)
    return fields(run_, "w", n).copy()


def commit(run_: Any, f_hat: Array, instant: int) -> None:
    """End an instant with tractions."""
    fields(run_, "local_f", 1)[0] = f_hat
    run_.image.set({"first_row": instant})
    run_.image.call(entries.END, instant, 0, 1)
    run_._set_instant(instant)


def test_outgoing_quantities_of_the_linear_stage(run_: Any) -> None:
    """F = q - k W and s = W - F / k; the ground has no traction to give and keeps its velocity."""
    direction, k = run_.direction(1), run_.direction(1).k
    q, w = incoming(run_, 3, 1), incoming(run_, 3, 2)
    fields(run_, "q", 3)[:], fields(run_, "w", 3)[:] = q, w
    for i in range(3):
        call(local_stage.outgoing, run_.image, 0, i, 0, run_.assembly.layout.groups[0].n_point)
    np.testing.assert_allclose(fields(run_, "f", 3), q - k * w, rtol=1e-14, atol=1e-14)
    expected = np.where(k > 0, w - direction.z * (q - k * w), w)
    np.testing.assert_allclose(fields(run_, "s", 3), expected, rtol=1e-13, atol=1e-13)


def test_search_direction_action_and_reaction_at_every_channel(run_: Any) -> None:
    """E+: F_hat - F = k (W_hat - W); F_hat' = -F_hat; the ground keeps its velocity."""
    assembly, direction = run_.assembly, run_.direction(1)
    rng = np.random.default_rng(1)
    f, w = rng.normal(size=(2, assembly.layout.n_flat))
    f[assembly.rigid] = 0.0
    f_hat, w_hat, _ = (x[0] for x in local(run_, (w - direction.z * f)[None]))
    np.testing.assert_allclose(np.delete(f_hat - f - direction.k * (w_hat - w), assembly.rigid), 0.0, atol=1e-12)
    np.testing.assert_array_equal(w_hat[assembly.rigid], w[assembly.rigid])
    for i in (0, 1):
        one, two = (f_hat[assembly.layout.channels(i, side)] for side in (0, 1))
        np.testing.assert_array_equal(one, -two)
        assert one[:, 0].max() <= 0
        assert one.any()


def test_gap_of_the_scene_is_the_opening_at_the_start(run_: Any) -> None:
    gap, velocity, _, start = openings(run_, 2)
    group = run_.assembly.layout.group(1)
    np.testing.assert_array_equal(gap[group.members[0]], 0.0)
    np.testing.assert_allclose(gap[group.members[1]], 0.03)
    np.testing.assert_allclose(velocity[group.members[1]], -0.1)
    np.testing.assert_array_equal(start, gap)
    np.testing.assert_array_equal(openings(run_, 1)[3], gap)
    np.testing.assert_array_equal(run_.gaps()[0], gap)


def test_signorini_holds_at_every_instant_of_a_window(run_: Any) -> None:
    """0 <= max(G, 0)/dt + d perp P >= 0 with the opening G at the start of each instant."""
    assembly = run_.assembly
    first = openings(run_, 8)[0].copy()
    f_hat, w_hat, followed = local(run_, 0.3 * incoming(run_, 8))
    group = assembly.layout.groups[0]
    before = np.concatenate([first[None], followed[:-1]])
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
    gap, d, a = (x.copy() for x in openings(run_, 6)[:3])
    f_hat, w_hat, followed = local(run_, 0.3 * incoming(run_, 6))
    group = assembly.layout.groups[0]
    jump = group.block(w_hat)[:, 1, :, 0] - group.block(w_hat)[:, 0, :, 0]
    for i in range(6):
        new = ((jump[i] - d) / dt - (1 - scheme.gamma) * a) / scheme.gamma
        gap = gap + dt * d + dt**2 * ((0.5 - scheme.beta) * a + scheme.beta * new)
        d, a = jump[i], new
        np.testing.assert_allclose(followed[i], gap, atol=1e-13)
    assert f_hat.shape == (6, assembly.layout.n_flat)


def test_a_window_is_its_instants_one_by_one(run_: Any) -> None:
    s = 0.3 * incoming(run_, 5)
    starts = [openings(run_, 5)[0].copy()]
    f_hat, w_hat, followed = local(run_, s)
    starts += list(followed[:-1])
    for i in range(5):
        openings(run_, 0)[3] = starts[i]
        fields(run_, "s", 1)[0] = s[i]
        points(run_, 0, 1)
        np.testing.assert_array_equal(fields(run_, "local_f", 1)[0], f_hat[i])
        np.testing.assert_array_equal(fields(run_, "local_w", 1)[0], w_hat[i])


def test_the_local_stage_changes_no_state_and_no_input(run_: Any) -> None:
    s, before = incoming(run_, 4), run_.image.state.copy()
    first = local(run_, s)
    np.testing.assert_array_equal(fields(run_, "s", 4), s)
    np.testing.assert_array_equal(run_.image.state, before)
    for one, two in zip(first, local(run_, s), strict=True):
        np.testing.assert_array_equal(one, two)


def test_condensed_and_marched_windows_agree(run_: Any) -> None:
    """Instant by instant with Y, or marched: the same velocities for the same q."""
    q, k = incoming(run_, 4), run_.direction(1).k
    together = linear(run_, q)
    run_.image.call(entries.LEAVE)
    for i in range(4):
        w = linear(run_, q[i : i + 1], i + 1)
        np.testing.assert_allclose(w[0], together[i], atol=1e-11)
        commit(run_, q[i] - k * w[0], i + 1)


def test_linear_stage_is_affine_and_repeats(run_: Any) -> None:
    assembly, before = run_.assembly, run_.image.state.copy()
    for n in (1, 3):
        a, b = incoming(run_, n, 1), incoming(run_, n, 2)
        velocities = []
        for q in (a, b, 0.3 * a + 0.7 * b, a):
            velocities.append(linear(run_, q))
            run_.image.call(entries.LEAVE)
            np.testing.assert_array_equal(run_.image.state, before)
        w_a, w_b, mixed, again = velocities
        np.testing.assert_allclose(mixed, 0.3 * w_a + 0.7 * w_b, atol=1e-11)
        np.testing.assert_array_equal(again, w_a)
        assert assembly.propagators[0].instant == 0
        ground = assembly.layout.channels(0, 1)
        expected = 0.3 * np.sin(np.pi * 0.1 / 2.0) / np.sqrt(2)  # of a half sine of 2 s at 0.1 s
        np.testing.assert_allclose(w_a[0, ground], np.tile([-expected, expected, 0.0], (9, 1)) @ frame(assembly))


def frame(assembly: Any) -> Array:
    """Components (normal -z, x, y) of side floor to its local frame."""
    own = assembly.interfaces[0].geometry.frames[0]
    return np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ own.T


def test_one_instant_is_ended_with_the_hat_tractions(run_: Any) -> None:
    """Momentum: what the interface gives to one side it takes from the other, to round-off."""
    assembly, direction = run_.assembly, run_.direction(1)
    q = 30.0 * incoming(run_, 1)  # large enough to close the gap somewhere
    w = linear(run_, q)
    f_hat = local(run_, w - direction.z * (q - direction.k * w))[0][0]
    f_hat[assembly.layout.channels(0, 0)] = 0.0  # no floor: the two blocks are alone
    f_hat[assembly.layout.channels(0, 1)] = 0.0

    def momentum() -> Array:
        total = np.zeros(3)
        for p in assembly.propagators:
            for j, m in enumerate(p.members):
                total += (m.mass @ full_velocity(p, j).ravel()).reshape(-1, 3).sum(axis=0)
        return total

    before = momentum()
    commit(run_, f_hat, 1)
    np.testing.assert_allclose(momentum(), before, atol=1e-14)
    assert np.abs(f_hat).max() > 0.1


def test_a_trial_has_no_consequences(run_: Any) -> None:
    """Neither on the motion and its energies nor on counts and the last iterate."""
    for n in (1, 3):
        stages, q = Stages(run_.image, run_.direction(1), n, 1), incoming(run_, n)
        linear(run_, q)
        stages.iterations((0, 0, 0, 1), lambda *_: None)
        before = run_.image.moving.copy()
        seen: list[tuple[int, float]] = []

        def look(i: int, seen: list[Any] = seen) -> None:
            seen.append((i, float(np.abs(full_velocity(run_.assembly.propagators[0], 0)).max())))

        run_._trial(stages, look)
        assert [i for i, _ in seen] == list(range(n))
        assert seen[-1][1] > 0.0
        np.testing.assert_array_equal(run_.image.moving, before)
        assert all(p.instant == 0 for p in run_.assembly.propagators)
        run_.image.call(entries.LEAVE)


def test_marched_substructure_instants_are_counted(run_: Any) -> None:
    take_marched(run_.image)
    for n in (1, 3):
        for _ in range(2):
            linear(run_, incoming(run_, n))
            run_.image.call(entries.LEAVE)
        marched, condensed = take_marched(run_.image)
        assert marched + condensed == 2 * n * 2
        assert (marched == 0) == (n == 1)
