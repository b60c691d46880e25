"""The reference of a study: quantities declared with a model, exact or from refined runs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import Problem, SceneError
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.quantities_of_interest import Force
from ..scene.schema import Scene
from .quantities import Quantities, of_force
from .resolution import Resolution

FILE: Final = "reference.json"
"""Name of the file with reference quantities, beside the scene file."""

_PHYSICS: Final = ("material", "substructure", "interface", "boundary", "load", "sensor")


@dataclass(frozen=True)
class Reference:
    """Reference of the errors of a study.

    Attributes
    ----------
    quantities : of the reference. exact : closed form, else a run. text : its source.
    own_error : estimated error of a reference that is not exact. resolution : of a run of the study taken as reference.
    """

    quantities: Quantities
    exact: bool
    text: str
    own_error: ErrorEstimate | None = None
    resolution: Resolution | None = None


def physics_of(scene: Scene) -> str:
    """Hash of all settings of an exact solution: everything but meshes, time steps, schemes and solver settings.

    Settings left at their defaults do not count, so that a new key of the scene file changes no hash.
    """
    data = scene.model_dump(exclude_defaults=True, mode="json")
    kept: dict[str, Any] = {key: data.get(key, {}) for key in _PHYSICS}
    for body in kept["substructure"].values():
        body.get("box", {}).pop("elements", None)
    kept["end"] = scene.time.end
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:16]


def declared(scene: Scene) -> Reference | None:
    """The quantities declared beside a scene; None where there are none for this physics.

    The file has ``scene`` (name), ``source`` (text), ``holds_for`` (see ``physics_of``), ``values`` (quantities by
    name) and ``force`` by interface with ``time`` and ``value`` (N): linear pieces, a time met twice is a jump.
    Quantities that are not exact have their relative errors by name in ``errors``, all of them.

    Raises
    ------
    SceneError : a file for this scene that cannot be read or lacks something.
    """
    file = scene.base_dir / FILE
    if not file.is_file():
        return None
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        if data["scene"] != scene.name or data["holds_for"] != physics_of(scene):
            return None
        quantities = _quantities(data, scene.time.end)
        own = _own_error(quantities, data["errors"]) if "errors" in data else None
        text = f"{'exact' if own is None else 'refined runs'}: {data['source']}"
        return Reference(quantities, own is None, text, own)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SceneError([_unusable(file, error)], "the reference cannot be used") from error


def _quantities(data: dict[str, Any], end: float) -> Quantities:
    quantities = Quantities()
    for interface, table in data.get("force", {}).items():
        force = Force(np.asarray(table["time"], dtype=float), np.asarray(table["value"], dtype=float))
        quantities.forces[interface] = force
        quantities.add(interface, of_force(force, end, opens=True))
    for quantity, value in data.get("values", {}).items():
        quantities.values[quantity] = quantities.scales[quantity] = float(value)
    return quantities


def _own_error(quantities: Quantities, errors: dict[str, float]) -> ErrorEstimate:
    """The declared errors, one for every quantity (KeyError where one is missing)."""
    estimates = []
    for quantity, value in quantities.values.items():
        error = float(errors[quantity])
        if not 0.0 < error < 1.0:
            raise ValueError(f"error of {quantity} is {error:g}, not between 0 and 1")
        estimates.append(QuantityEstimate(quantity, value, error))
    return ErrorEstimate(tuple(estimates))


def _unusable(file: Path, error: Exception) -> Problem:
    allowed = "JSON with scene, source, holds_for, values, force (NAME: time, value), errors where not exact"
    return Problem(str(file), f"not a usable reference: {type(error).__name__}: {error}", allowed=allowed)
