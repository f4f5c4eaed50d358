"""The flux ledger for reading."""

from __future__ import annotations

from cgi_wave.rays.ledger import SUMS, Flux, Share

#: Lines of the ledger and paths that are printed; a file holds them all.
LINES, PATHS = 25, 25


def flux_text(found: Flux) -> str:
    """Sums, the largest entries, and the strongest paths, each with its standard error and number of rays."""
    choice = f"branches above {found.split:g} followed" if found.split <= 1.0 else "analog"
    head = f"{found.band}: {found.rays} rays, seed {found.seed}, {found.source}, {choice}; shares of the input"
    lines = [head, "", *(f"{name:12}{found.sum(name):.12f}" for name in SUMS)]
    whole = "to the last unit" if found.imbalance == 0 else f"but for {found.imbalance} units"
    lines += [f"{'sum':12}{sum(found.sum(name) for name in SUMS):.12f}, closes {whole}", "", "arrived on the detector"]
    lines += [f"  {_share(one)}  {name}" for name, one in found.arrived.items()]
    lines += ["", "where it went"]
    lines += [f"  {_share(entry)}  {entry.kind} {entry.where}".rstrip() for entry in found.entries[:LINES]]
    rest = found.entries[LINES:]
    if rest:
        lines.append(f"  {sum(entry.share for entry in rest):.6e}{'':25}  in {len(rest)} smaller entries")
    lines += ["", "by which path it came"]
    lines += [f"  {_share(path)}  {path.label}" for path in found.paths[:PATHS]]
    if found.total_reflections:
        lines += ["", f"{found.total_reflections} total reflections at coated faces"]
    return "\n".join(lines)


def _share(one: Share) -> str:
    return f"{one.share:.6e} ± {one.error:.1e}  {one.count:9d}"
