"""Seal of states: header and checksum are refused by name of what differs, whatever was changed."""

from __future__ import annotations

import random

import pytest

from latin_fmu.errors import SolverError
from latin_fmu.latin import state_serialization
from latin_fmu.latin.state_serialization import opened, sealed

PAYLOAD = bytes(range(256)) * 3
GIVEN = ("FMU state", "digest of a scene", "machine A")
STATE = sealed(PAYLOAD, *GIVEN)


def test_the_payload_comes_back() -> None:
    assert opened(STATE, *GIVEN) == PAYLOAD
    assert opened(sealed(b"", "kind", ""), "kind", "") == b""


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        (0, "another kind of state ('FMU state', here 'other')"),
        (1, "another scene or of other settings"),
        (2, "another kind of machine ('machine A', here 'other')"),
    ],
)
def test_another_origin_is_named(place: int, sentence: str) -> None:
    expected = [*GIVEN[:place], "other", *GIVEN[place + 1 :]]
    with pytest.raises(SolverError) as caught:
        opened(STATE, *expected)
    assert sentence in str(caught.value)


def test_another_version_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_serialization, "package_version", lambda: "0.0")
    with pytest.raises(SolverError, match="another version of latin_fmu"):
        opened(STATE, *GIVEN)


def test_another_format_is_named() -> None:
    assert STATE[15] == 1
    with pytest.raises(SolverError, match="its format is another one"):
        opened(STATE[:15] + b"\x02" + STATE[16:], *GIVEN)


def test_any_flipped_bit_cut_or_longer_state_is_refused() -> None:
    draw = random.Random(16)
    damaged = [STATE[: draw.randrange(len(STATE))] for _ in range(200)]
    for _ in range(1000):
        at, bit = draw.randrange(len(STATE)), 1 << draw.randrange(8)
        damaged.append(STATE[:at] + bytes([STATE[at] ^ bit]) + STATE[at + 1 :])
    for state in (*damaged, b"", b"garbage" * 20, STATE + b"\0", STATE + STATE):
        with pytest.raises(SolverError, match="the state cannot be used"):
            opened(state, *GIVEN)
