"""What the page says in words and numbers, as HTML."""

from __future__ import annotations

import html

from tactile_dynamics_ros.view.state import Quantity, State


def write_verdict(state: State) -> str:
    """The two sentences that matter most, as HTML."""
    colour = "#2e9e77" if state.good and state.fits else "#c8423b"
    told = (state.verdict, state.remark, state.plan)
    lines = [text for text in told if text] or ["waiting for an estimate"]
    paragraphs = "".join(f"<p style='margin:.2em 0'>{html.escape(line)}</p>" for line in lines)
    style = f"border-left:5px solid {colour};padding:.3em .7em;margin:.4em"
    return f"<div id='verdict' style='{style}'>{paragraphs}</div>"


def write_numbers(state: State) -> str:
    """The numbers with their standard deviations, as HTML."""
    rows: list[tuple[str, str]] = []
    if state.body is not None:
        mass = state.body.mass
        rows.append(("mass", f"{1e3 * mass.value:.1f} ± {1e3 * mass.std:.1f} g"))
        for axis, value, std in zip("xyz", state.body.com, state.body.com_std, strict=True):
            rows.append((f"centre of mass {axis}", f"{1e3 * value:.1f} ± {1e3 * std:.1f} mm"))
    rows += state.numbers.items()
    if state.friction is not None:
        rows.append(("friction", _plain(state.friction)))
    if state.error is not None:
        rows.append(("error", f"{state.error:.2f} × the noise (floor {state.floor:.2f})"))
    if state.without is not None:
        rows.append(("error without the effects", f"{state.without:.2f} × the noise"))
    if state.effects:
        rows.append(("effects of the model", html.escape(", ".join(state.effects))))
    rows += [("it fails", html.escape(place)) for place in state.fails]
    cells = "".join(
        f"<tr><td style='padding-right:1.2em'>{name}</td><td>{value}</td></tr>"
        for name, value in rows
    )
    return f"<table id='numbers' style='margin:.4em 1em'>{cells}</table>"


def _plain(quantity: Quantity) -> str:
    return f"{quantity.value:.3f} ± {quantity.std:.3f}"
