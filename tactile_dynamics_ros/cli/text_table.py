"""Plain aligned text for terminals."""

from __future__ import annotations

from collections.abc import Sequence


def align_rows(rows: Sequence[Sequence[str]], indent: int = 2) -> str:
    """Return rows of cells as lines with aligned columns; the first column to the left."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = [first.ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        lines.append((" " * indent + "  ".join(cells)).rstrip())
    return "\n".join(lines)


def with_uncertainty(value: float, std: float) -> tuple[str, str]:
    """Return a value and its standard deviation with two significant digits of the latter."""
    if not std > 0.0:
        return f"{value:.6g}", "0"
    digits = max(0, 1 - _exponent(std))
    if digits > 6 or abs(value) >= 1e6:
        return f"{value:.4e}", f"{std:.1e}"
    return f"{value:.{digits}f}", f"{std:.{digits}f}"


def _exponent(value: float) -> int:
    """Return the decimal exponent of a positive number after rounding to two digits."""
    return int(f"{value:.1e}".partition("e")[2])
