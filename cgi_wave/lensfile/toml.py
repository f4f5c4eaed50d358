"""Writing an instrument document as TOML."""

from __future__ import annotations

import json
from typing import Any


def to_toml(document: dict[str, Any]) -> str:
    """The text of a document: plain tables, a blank line before each, short tables inline."""
    lines: list[str] = []
    for key, value in document.items():
        if not isinstance(value, dict) and key != "frame":
            lines.append(f"{key} = {_value(value)}")
    for key in ("glass", "space", "coating", "entrance", "detector"):
        lines += ["", f"[{key}]", *(f"{_key(name)} = {_value(value)}" for name, value in document[key].items())]
    for frame in document["frame"]:
        lines += ["", "[[frame]]", *(f"{k} = {_value(v)}" for k, v in frame.items() if k != "surface")]
        for surface in frame["surface"]:
            lines += ["[[frame.surface]]", *(f"{k} = {_value(v)}" for k, v in surface.items())]
    for name, band in document["band"].items():
        lines += ["", f"[band.{_key(name)}]", *(f"{k} = {_value(v)}" for k, v in band.items())]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, dict):
        inner = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        if value and all(isinstance(item, str) for item in value) and sum(map(len, value)) > 80:
            return "[\n" + "".join(f"  {_value(item)},\n" for item in value) + "]"
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, str):
        # JSON and TOML agree on basic strings but for the delete character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)
