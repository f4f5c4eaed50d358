"""Replace values in an instrument file, line by line, so that its comments and its order stay."""

from __future__ import annotations

import re
from collections.abc import Mapping

_KEY = re.compile(r'^(?P<key>"[^"]+"|[A-Za-z_]+)\s*=\s*(?P<value>.*)$')


def literal(value: object) -> str:
    """A TOML value: number, list of numbers, or inline table of these."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {literal(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(literal(item) for item in value) + "]"
    return repr(float(value))  # type: ignore[arg-type]


def edit(text: str, values: Mapping[str, Mapping[str, object]]) -> str:
    """The text with new values: ``values[""]["surface.field"]`` in the frames, ``values[band]`` in ``[band.X.set]``.

    A frame's or surface's missing key is added below its name; a missing ``set`` table below its band.
    """
    todo = {("", dotted): value for dotted, value in values.get("", {}).items()}
    todo |= {(band, dotted): value for band, items in values.items() if band for dotted, value in items.items()}
    for band in values:
        if band and f"[band.{band}.set]" not in text:
            text = re.sub(rf"(?ms)^(\[band\.{band}\]\n.*?)(?=\n\[|\Z)", rf"\1\n[band.{band}.set]\n", text)
    out: list[str] = []
    place: dict[str, int] = {}  # where a missing key of a name or table may be put
    name, band = "", ""
    for line in text.splitlines():
        if line.startswith("["):
            found = re.fullmatch(r"\[band\.([\w-]+)\.set\]", line.strip())
            name, band = "", found[1] if found else ""
            out.append(line)
            if band:
                place[f"[{band}]"] = len(out)
            continue
        key = _KEY.match(line)
        if key and key["key"] == "name":
            name = key["value"].strip('"')
        target = (band, key["key"].strip('"') if band else f"{name}.{key['key']}") if key else None
        if key and target in todo:
            line = f"{key['key']} = {literal(todo.pop(target))}"
        out.append(line)
        if key and key["key"] == "name":
            place[name] = len(out)
        if key and band:
            place[f"[{band}]"] = len(out)
    # From the end of the file backwards, so that the places noted stay right.
    for (band, dotted), value in sorted(todo.items(), key=lambda item: -place[_owner(*item[0])]):
        key_text = f'"{dotted}"' if band else dotted.partition(".")[2]
        out.insert(place[_owner(band, dotted)], f"{key_text} = {literal(value)}")
    return "\n".join(out) + "\n"


def _owner(band: str, dotted: str) -> str:
    return f"[{band}]" if band else dotted.partition(".")[0]
