"""Files cut anywhere and files with pieces changed are refused as mesh errors or read, never anything else."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.reading import read_content

from .decks import instances_deck, nastran_deck, surfaces_deck
from .test_formats import exodus

SEEDS = 40
PIECES = (
    b"",
    b",",
    b"\n",
    b"*",
    b"-1",
    b"0",
    b"99999999999999999999",
    b"1e400",
    b"nan",
    b"S9",
    b"GENERATE",
    b"\xff\x00",
    b"*ELSET, ELSET=",
    b"*INSTANCE, NAME=x, PART=Bar\n",
    b"THRU",
    b"*END PART\n",
    b"CHEXA,",
    b"=",
    b'"',
)
FILES: dict[str, Callable[[Path], bytes]] = {
    "surfaces.inp": lambda _: surfaces_deck().encode(),
    "instances.inp": lambda _: instances_deck().encode(),
    "cube.bdf": lambda _: nastran_deck().encode(),
    "cube.e": lambda folder: exodus(folder / "whole.e").read_bytes(),
}


def used(path: Path) -> None:
    """Read a file as a scene does: its parts, each of them as a mesh."""
    message = path.stem
    try:
        content = read_content(path)
        for name in content.part_names(path.name):
            mesh_of(content, path.name, name)
    except MeshError as error:
        message = str(error)
    assert path.stem in message
    assert len(message) < 5000


@pytest.mark.parametrize("name", FILES)
def test_cut_files(tmp_path: Path, name: str) -> None:
    whole = FILES[name](tmp_path)
    path = tmp_path / name
    for end in np.linspace(0, len(whole) - 1, SEEDS).astype(int):
        path.write_bytes(whole[:end])
        used(path)


@pytest.mark.parametrize("name", FILES)
def test_changed_files(tmp_path: Path, name: str) -> None:
    whole = FILES[name](tmp_path)
    path = tmp_path / name
    start = time.process_time()
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(0, len(data)))
            piece = PIECES[int(rng.integers(0, len(PIECES)))] if rng.random() < 0.7 else rng.bytes(1)
            data[at : at + int(rng.integers(0, 6))] = piece
        path.write_bytes(data)
        used(path)
    assert time.process_time() - start < 10  # no file keeps the reader busy
