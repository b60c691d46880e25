"""Compressed mesh files that unpack to absurdly much, and damaged ones."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from latin_fmu.errors import MeshError
from latin_fmu.mesh_files import reading


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """400 kB of blanks, packed a thousand times smaller."""
    monkeypatch.setattr(reading, "_SMALL", 10_000)
    path = tmp_path / "mesh.post.gz"
    path.write_bytes(gzip.compress(b" " * 400_000))
    with pytest.raises(MeshError, match="too large when unpacked"):
        reading.read_content(path)


@pytest.mark.parametrize("kept", [5, 15, 40])
def test_a_torn_archive_is_refused(kept: int, tmp_path: Path) -> None:
    path = tmp_path / "mesh.post.gz"
    path.write_bytes(gzip.compress(bytes(range(256)) * 4)[:kept])
    with pytest.raises(MeshError, match="damaged"):
        reading.read_content(path)
