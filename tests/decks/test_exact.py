"""What the penalty of a deck costs: ``latin-fmu run DECK.inp --exact``."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from latin_fmu.cli import main
from latin_fmu.commands import BAD_INPUT
from latin_fmu.decks.exact import without_penalty

from .blocks import HELD, STEEL, contact, static, two_blocks

CONSTRAINED = 210e3 * (1 - 0.3) / ((1 + 0.3) * (1 - 2 * 0.3))
LINEAR = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1e6\n"
PRESSED = HELD + "*BOUNDARY\nNALL, 1, 2\n" + static("*DSLOAD\nHIGHUP, P, 100.\n*NODE PRINT, NSET=TOP\nU\n", "0.5, 1.")


def test_the_difference_is_the_shortening_of_the_layer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Guided blocks of 20 mm under a pressure p: p / K of the layer over 20 p / M; the force is the same."""
    monkeypatch.chdir(tmp_path)
    Path("soft.inp").write_text(two_blocks() + STEEL + contact(LINEAR) + PRESSED)
    assert main(["run", "soft.inp", "--exact"]) == 0
    said = capsys.readouterr().out
    found = {name: float(share) for name, share in re.findall(r"  (\w+ of \w+): ([\d.e+-]+) %", said)}
    assert found["U of TOP"] == pytest.approx(100.0 * CONSTRAINED / 1e6 / 20.0, rel=1e-2)
    assert found["force of JOINT"] < 1e-3


def test_decks_without_a_penalty_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hard contact has none, and a scene is no deck."""
    monkeypatch.chdir(tmp_path)
    Path("hard.inp").write_text(two_blocks() + STEEL + contact() + PRESSED)
    assert main(["run", "hard.inp", "--exact"]) == 0
    assert "no penalty" in capsys.readouterr().out
    assert main(["run", "hard.toml", "--exact"]) == BAD_INPUT
    assert "--exact" in capsys.readouterr().err


def test_layers_become_contacts_and_bonds() -> None:
    """Friction and gaps stay."""
    soft = {"behaviour": "soft_contact", "normal_stiffness": 1.0, "friction_coefficient": 0.2, "gap": 0.1}
    tied = {"behaviour": "elastic_layer", "normal_stiffness": 1.0, "tangential_stiffness": 1.0}
    other = {"sides": ["a", "b"]}
    found = without_penalty({"interface": {"soft": soft, "tied": tied, "other": other}})
    assert found is not None
    assert found["interface"]["soft"] == {"behaviour": "contact", "friction_coefficient": 0.2, "gap": 0.1}
    assert found["interface"]["tied"] == {"behaviour": "perfect"}
    assert found["interface"]["other"] == other
    assert without_penalty({"interface": {"other": other}}) is None
