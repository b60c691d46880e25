"""Saved states of the FMU."""

from __future__ import annotations

import ctypes
import random
import struct

import numpy as np
import pytest

from .test_compiled import resealed

H = 0.6e-6


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


def given(host, block: bytes) -> int:
    """Status with which the host can restore these bytes: that of the call that fails, or 0."""
    states = []
    status = host.status(lambda: states.append(host.from_bytes(block)))
    return status or host.status(host.restore, states[0])


def on(host) -> np.ndarray:
    """Outputs after one more step from 2 H."""
    assert host.step(2 * H, 0.7 * H)
    return host.read()


@pytest.fixture
def running(opened, fmi):
    """Two equal instances after a step from 0 to 2 H, and the bytes of a state at H."""
    hosts = opened(fmi), opened(fmi)
    blocks = []
    for host in hosts:
        host.start()
        host.set(load__press__value=0.7)
        assert host.step(0.0, H)
        blocks.append(host.to_bytes(host.save()))
        assert host.step(H, H)
    return *hosts, blocks[0]


def test_damaged_bytes_are_refused_and_nothing_changes(running):
    """Bits flipped, bytes cut, added, doubled, or of something else: none of 1000 is taken for a state."""
    host, other, block = running
    rng, n = np.random.default_rng(16), len(block)
    for i in range(1000):
        damaged = bytearray(block)
        if i % 4 == 0:
            del damaged[int(rng.integers(n)) :]
        elif i % 4 == 1:
            damaged += rng.bytes(int(rng.integers(1, 100)))
        else:
            for at in rng.integers(n, size=1 + i % 3):
                damaged[at] ^= 1 << int(rng.integers(8))
        if bytes(damaged) == block:
            continue
        host.messages.clear()
        assert given(host, bytes(damaged)) == 3
        assert host.messages[-1][0] == 3
        assert "state" in host.messages[-1][2]
    for other_bytes in (b"", b"no state", (2**63 - 1).to_bytes(8, "little") * 20):
        assert given(host, other_bytes) == 3
    assert np.array_equal(on(host), on(other))
    assert host.to_bytes(host.save()) == other.to_bytes(other.save())
    assert given(host, block) == 0


def test_forged_states_are_refused_and_nothing_changes(running):
    """Sizes and numbers that cannot be, under a checksum that fits."""
    host, other, block = running
    generator = random.Random(3)
    for at in [*range(3, 9), *range(12, 60), *generator.sample(range(60, len(block) // 8), 40)]:
        for bits in (struct.pack("<d", np.nan), struct.pack("<q", -1)):
            forged = resealed(block[: 8 * at] + bits + block[8 * at + 8 :])
            if forged == resealed(block):
                continue
            host.messages.clear()
            assert given(host, forged) == 3, at
            assert "the state cannot be used: " in host.messages[-1][2]
    assert np.array_equal(on(host), on(other))
    assert host.to_bytes(host.save()) == other.to_bytes(other.save())


def test_handles_that_are_none_are_refused(running):
    """A handle that was freed, that was never given, or of another instance that is gone."""
    host, other, _ = running
    freed, kept = host.save(), host.save()
    number = freed.value if hasattr(freed, "value") else freed
    (host.fmu.freeFMUState if host.three else host.fmu.freeFMUstate)(freed)
    for wrong in (number, 12345, 2**62, None):
        host.messages.clear()
        assert host.status(host.restore, ctypes.c_void_p(wrong)) == 3
        assert "does not belong to this instance, or was freed" in host.messages[-1][2]
        assert host.status(host.to_bytes, ctypes.c_void_p(wrong)) == 3
    assert host.status(host.restore, kept) == 0
    assert np.array_equal(on(host), on(other))


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
