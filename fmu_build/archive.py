"""A deflated zip whose bytes depend on its contents only."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

_FIRST = ("modelDescription.xml",)
_DATE = (1980, 1, 1, 0, 0, 0)


def archive(files: Mapping[str, bytes]) -> bytes:
    """The zip: modelDescription.xml first, then by name; no dates, plain permissions."""
    buffer = io.BytesIO()
    names = [*(n for n in _FIRST if n in files), *sorted(n for n in files if n not in _FIRST)]
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as target:
        for name in names:
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # the same bytes on every system
            entry.external_attr = 0o644 << 16
            target.writestr(entry, files[name])
    return buffer.getvalue()
