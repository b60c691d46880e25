"""Reading a scene: a TOML file, or a dictionary of the same shape."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import Problem, SceneError
from .overrides import apply_overrides
from .schema import Scene

MAX_SCENE_BYTES = 100_000_000


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read and check a scene file.

    path : TOML file.
    overrides : settings such as ``"interface.crush.friction_coefficient=0.1"``, applied in order.

    Raises SceneError with every problem found, whatever the file holds.
    """
    file = Path(path)
    data = _parsed(file)
    return scene_from_dict(apply_overrides(data, overrides), file.parent)


def scene_from_dict(data: Any, base_dir: str | Path | None = None) -> Scene:
    """Check a scene given as a dictionary of the shape of the file.

    base_dir : folder that the files named in the scene are relative to; the current one where None.

    Raises SceneError with every problem found.
    """
    if not isinstance(data, dict):
        raise SceneError([Problem("scene", "a scene must be a table", type(data).__name__)], "the scene cannot be used")
    try:
        return Scene.model_validate(data, context={"base_dir": Path(base_dir) if base_dir is not None else Path()})
    except RecursionError:
        raise SceneError([Problem("scene", "nested too deeply")], "the scene cannot be used") from None


def _parsed(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(_text(file))
    except tomllib.TOMLDecodeError as error:
        remedy = "strings need quotes, names of tables and keys must not repeat"
        raise _unreadable(file, f"not valid TOML: {error}", remedy) from None
    except RecursionError:
        raise _unreadable(file, "not usable: nested too deeply") from None
    except ValueError:  # tomllib lets the limit on the digits of an integer through
        raise _unreadable(file, "not usable: a number has too many digits") from None


def _text(file: Path) -> str:
    try:
        if file.is_dir():
            raise _unreadable(file, "this is a folder", f"name the scene file, e.g. {(file / 'scene.toml').as_posix()}")
        if file.stat().st_size > MAX_SCENE_BYTES:
            raise _unreadable(file, f"larger than {MAX_SCENE_BYTES} bytes", "put long tables into CSV files")
        return file.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        raise _unreadable(file, "no such file") from None
    except UnicodeDecodeError as error:
        raise _unreadable(file, f"not a text file in UTF-8 (byte {error.start})", "is it a scene file?") from None
    except OSError as error:
        raise _unreadable(file, f"cannot be read ({error.strerror or type(error).__name__})") from None
    except ValueError as error:
        raise _unreadable(file, f"not a file name ({error})") from None


def _unreadable(file: Path, what: str, remedy: str | None = None) -> SceneError:
    return SceneError([Problem(repr(str(file))[1:-1], what, None, None, remedy)], "the scene cannot be read")
