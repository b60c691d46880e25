"""Reading the points of a time law from a text file of two columns."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from .fields import refusal

MAX_FILE_BYTES = 500_000_000
_TWO_COLUMNS = "two columns, time and value, separated by a comma, semicolon, tab or blank"


def base_dir_of(context: Any) -> Path:
    """Folder that relative file names start from: that of the scene file, else the current one."""
    base_dir = context.get("base_dir") if isinstance(context, dict) else None
    return base_dir if isinstance(base_dir, Path) else Path()


def read_law_file(base_dir: Path, name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Times and values of a file; blank lines and lines starting with # are skipped, one header is allowed.

    Raises the refusal of the field that names the file.
    """
    rows: list[tuple[float, float]] = []
    seen_text = False
    for number, line in enumerate(_text(base_dir, name).splitlines(), 1):
        stripped = line.strip()
        if not stripped or stripped.startswith("#"):
            continue
        row = _row(stripped)
        if row is None and not seen_text:
            seen_text = True  # the header
            continue
        seen_text = True
        if row is None or not all(map(math.isfinite, row)):
            raise refusal(f"line {number} is not two finite numbers", value=stripped[:60], allowed=_TWO_COLUMNS)
        rows.append(row)
    return tuple(row[0] for row in rows), tuple(row[1] for row in rows)


def _text(base_dir: Path, name: str) -> str:
    try:
        path = base_dir / name
        if path.stat().st_size > MAX_FILE_BYTES:
            raise refusal("the file is too large", value=name, allowed=f"at most {MAX_FILE_BYTES} bytes")
        return path.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        raise refusal(
            "the file does not exist", value=name, remedy="file names are relative to the scene file"
        ) from None
    except UnicodeDecodeError:
        raise refusal("not a text file", value=name, allowed=_TWO_COLUMNS) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise refusal(f"the file cannot be read ({reason})", value=name) from None


def _row(line: str) -> tuple[float, float] | None:
    cells = [cell for cell in re.split(r"\s*[,;\t]\s*|\s+", line) if cell]
    if len(cells) != 2:
        return None
    try:
        return float(cells[0]), float(cells[1])
    except ValueError:
        return None
