"""Saved states of the FMU."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

H = 0.6e-6
ACTIONS = st.lists(
    st.tuples(st.sampled_from(["step", "stray", "discard", "through bytes"]), st.floats(0.1, 2.5)),
    min_size=2,
    max_size=8,
)


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(actions=ACTIONS)
def test_any_sequence_of_rollbacks_is_the_straight_run(opened, fmi, actions):
    """Steps of random sizes; between them steps taken back, discarded steps, states that went through bytes."""
    straight, other = opened(fmi), opened(fmi)
    for host in (straight, other):
        host.start()
    t = 0.0
    for i, (action, size) in enumerate(actions):
        if action == "step":
            for host in (straight, other):
                host.set(load__press__value=0.1 * i, load__press__rate=size * 1e4)
                assert host.step(t, size * H)
            t += size * H
            assert np.array_equal(straight.read(), other.read())
            continue
        state = other.save()
        if action == "discard":
            assert not other.step(t, -size)
        else:
            other.set(load__press__value=size, load__press__rate=1e5)
            assert other.step(t, 1.3 * size * H)
        other.restore(other.from_bytes(other.to_bytes(state)) if action == "through bytes" else state)
    assert other.to_bytes(other.save()) == straight.to_bytes(straight.save())


def test_rollback_and_serialized_states(opened, fmi):
    host = opened(fmi)
    host.start()
    host.set(load__press__value=0.7)
    assert host.step(0.0, H)
    state = host.save()
    block = host.to_bytes(state)
    assert host.step(H, 2 * H)
    wanted = host.read()
    for _ in range(2):
        host.restore(state)
        assert host.step(H, 2 * H)
        assert np.array_equal(host.read(), wanted)
    other = opened(fmi)  # a fresh instance, never initialized
    other.restore(other.from_bytes(block))
    assert other.step(H, 2 * H)
    assert np.array_equal(other.read(), wanted)
    assert other.to_bytes(other.save()) == host.to_bytes(host.save())


def test_a_state_holds_outputs_inputs_and_arrays(opened, fmi):
    host = opened(fmi)
    host.start()
    host.set(load__press__value=0.7)
    host.step(0.0, H)
    state, row = host.save(), host.read()
    field = host.array("interface.crush.points.traction", 27) if fmi == "3" else None
    host.set(load__press__value=0.1)
    host.step(H, H)
    host.restore(state)
    assert np.array_equal(host.read(), row)
    assert host.read(["load.press.value"]) == 0.7
    if field is not None:
        assert np.array_equal(host.array("interface.crush.points.traction", 27), field)


def test_bytes_that_are_no_state_are_refused(opened, fmi):
    host = opened(fmi)
    host.start()
    host.step(0.0, H)
    row = host.read()
    host.restore(host.from_bytes(b"no state"))
    assert host.messages[-1][0] == 3
    assert "state" in host.messages[-1][2]
    assert np.array_equal(host.read(), row)
    assert host.step(H, H)


def test_reset_and_again(opened, fmi):
    host = opened(fmi)
    rows = []
    for _ in range(2):
        host.set(load__press__value=0.7)
        host.start()
        assert host.step(0.0, H)
        rows.append(host.read())
        host.fmu.terminate()
        host.fmu.reset()
    assert np.array_equal(*rows)
