"""The variable table as JSON, so that a participant can be opened without reading the scene."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

from .variable import Variable


def table_text(table: Sequence[Variable]) -> str:
    """One variable a line, facts that are not given left out."""
    plain = Variable("", "output", "fixed", "real", "")
    lines = []
    for variable in table:
        facts = {
            k: v
            for k, v in asdict(variable).items()
            if v != getattr(plain, k) or k in ("causality", "kind", "variability")
        }
        lines.append(json.dumps(facts))
    return "[\n" + ",\n".join(lines) + "\n]\n"


def table_from(text: str) -> tuple[Variable, ...]:
    """The table of ``table_text``."""
    rows = []
    for facts in json.loads(text):
        for key in ("dimensions", "initial_dependencies"):
            facts[key] = tuple(facts.get(key, ()))
        rows.append(Variable(**facts))
    return tuple(rows)
