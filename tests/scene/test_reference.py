"""The reference describes every key, and its example works."""

from __future__ import annotations

import json
import tomllib
from typing import get_args

import pytest
from pydantic import BaseModel

from latin_fmu.interface import BEHAVIOURS
from latin_fmu.reader import scene_from_dict
from latin_fmu.scene.describe import kind_of, tables_in, tags_of, unit_of
from latin_fmu.scene.interfaces import BEHAVIOUR_NAMES, TAKES
from latin_fmu.scene.reference import EXAMPLE, reference_schema, reference_text
from latin_fmu.scene.schema import Scene
from latin_fmu.scene.settings import Time
from latin_fmu.time_scheme import SCHEMES


def all_tables() -> list[type[BaseModel]]:
    classes: list[type[BaseModel]] = [Scene]
    for table in classes:
        for field in table.model_fields.values():
            classes += [inner for inner in tables_in(field.annotation) if inner not in classes]
    return classes


@pytest.mark.parametrize("table", all_tables(), ids=lambda table: table.__name__)
def test_every_key_is_described(table: type[BaseModel]) -> None:
    text = " ".join(reference_text().split())
    assert table.__doc__
    for name, field in table.model_fields.items():
        if name == "type":
            assert get_args(field.annotation)[0] in text
            continue
        assert field.description, name
        assert f" {name}: {kind_of(field)}" in text or f"[{name}" in text
        assert (unit_of(field) is not None) == any(kind in kind_of(field) for kind in ("number", "integer")), (
            f"{name} has no unit"
        )


def test_reference_is_readable() -> None:
    text = reference_text()
    for part in (
        "[interface.NAME] (optional)",
        "law = {...}",
        "Jumps",
        "xmin xmax ymin ymax zmin zmax",
        "[Pa s m-1]",
        "required",
    ):
        assert part in text
    assert "  law: table, type = constant | step" in text
    assert "PydanticUndefined" not in text
    assert "annotation" not in text
    assert max(map(len, text.splitlines())) <= 120


def test_the_example_is_valid() -> None:
    scene = scene_from_dict(tomllib.loads(EXAMPLE))
    assert scene.time.n_step == 200
    assert EXAMPLE in reference_text()


def test_names_are_those_of_the_registries() -> None:
    assert set(BEHAVIOUR_NAMES) == set(BEHAVIOURS)
    with_gap = {name for name, keys in TAKES.items() if "gap" in keys}
    assert with_gap == {name for name, behaviour in BEHAVIOURS.items() if behaviour.opens}
    assert set(tags_of(tables_in(Time.model_fields["scheme"].annotation))) == {"automatic", *SCHEMES}


def test_schema_is_plain_data_with_units() -> None:
    schema = reference_schema()
    assert json.loads(json.dumps(schema)) == schema
    assert schema["$defs"]["Material"]["properties"]["young_modulus"]["unit"] == "Pa"
    assert schema["$defs"]["Material"]["additionalProperties"] is False
    assert set(schema["required"]) == {"name", "material", "substructure", "time"}


def test_schema_accepts_the_example() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator
    validator.check_schema(reference_schema())
    assert list(validator(reference_schema()).iter_errors(tomllib.loads(EXAMPLE))) == []
