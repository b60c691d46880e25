"""Compiled FMUs on AArch64 Linux and on Windows give the outputs that they give on Linux x86-64."""

from __future__ import annotations

import pytest

from latin_fmu.compiled import library

from .platforms import ELSEWHERE, HERE, LIMIT, PORTABLE, SCENES, compared

pytestmark = [
    pytest.mark.slow,  # zig makes the C library of Windows first
    pytest.mark.skipif(
        library.target() != HERE.target or library.loaded() is None, reason="no library of kernels here"
    ),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """FMUs, hosts and the Windows of this module."""
    return tmp_path_factory.mktemp("platforms")


@pytest.mark.parametrize(
    ("platform", "fmi"), [pytest.param(p, fmi, id=f"{p.name}-{fmi}") for p in (*ELSEWHERE, PORTABLE) for fmi in p.fmi]
)
def test_outputs_are_those_of_linux(platform, fmi, folder):
    reason = platform.lacks()
    if reason is not None:
        pytest.skip(reason)
    found = {name: (error, output) for name, error, output in compared(platform, fmi, folder)}
    assert found.keys() == SCENES.keys()
    assert max(found.values())[0] <= LIMIT, found
