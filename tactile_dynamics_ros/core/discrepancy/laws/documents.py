"""A learnt law as a file of effects, as a document, and in words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import yaml

from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis
from tactile_dynamics_ros.core.discrepancy.laws.learning import Law, learn_law
from tactile_dynamics_ros.core.discrepancy.laws.search import FittableModel, LawForm
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ParameterTable
from tactile_dynamics_ros.core.discrepancy.verdict.wording import (
    join_names,
    write_fall,
    write_interval,
    write_value,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import written_whole

Document = dict[str, Any]


def learn_file(diagnosis: Diagnosis, path: Path) -> Document:
    """Learn the law of what a diagnosis leaves; write it as effects of a file.

    A law of two terms is two effects. Laws that explain the recording as well are written beside
    it, as `law.drag.yaml`.

    Args:
        diagnosis: of a fitted model.
        path: of the file; its stem names the law.

    Returns:
        Parts `law` (None if nothing is learnt) and `nothing_learnt` of the document.

    Raises:
        BadInputError: no laws are known of such a model, or the name is no effect's.
    """
    forms = cast(FittableModel, diagnosis.model).law_forms()
    if not forms:
        raise BadInputError("--learn: no laws are known of such recordings; leave it out")
    if path.suffix != ".yaml":
        raise BadInputError(f"--learn {path}: expected a name that ends in .yaml")
    forms[0].require_name(path.stem, str(path))
    found = learn_law(diagnosis, forms)
    if not isinstance(found, Law):
        return {"law": None, "nothing_learnt": found.reason}
    _write(path, path.stem, found.forms, found.model.parameters())
    others = []
    for other in found.others:
        beside, table = path.with_name(f"{path.stem}.{other.form.name}.yaml"), other.model
        _write(beside, path.stem, (*found.forms[:-1], other.form), table.parameters())
        words = write_law(other.form, table.parameters()[other.form.name])
        others.append({"form": other.form.name, "sentence": words, "file": str(beside)})
    document = law_document(found, path.stem) | {"file": str(path), "others": others}
    return {"law": document, "nothing_learnt": None}


def _write(path: Path, name: str, forms: Sequence[LawForm], found: ParameterTable) -> None:
    """Write the terms of a law as effects; the first has the name of the law."""
    entries = {_name_of(name, k): form.entry_of(found[form.name]) for k, form in enumerate(forms)}
    with written_whole(path) as part:
        part.write_text(yaml.safe_dump({"effects": entries}, sort_keys=False))


def _name_of(name: str, place: int) -> str:
    """Name of the effect that is a term of a law."""
    return f"{name}_{place + 1}" if place else name


def write_law(form: LawForm, found: Mapping[str, Mapping[str, Any]]) -> str:
    """What the law is, with numbers; scalars with their standard deviations."""

    def number(match: re.Match[str]) -> str:
        name = match[1]
        if name in found:
            return write_interval(float(found[name]["value"]), float(found[name]["std"]))
        rows = [found[key] for axis in "xyz" if (key := f"{name}_{axis}") in found]
        values = [f"{float(row['value']):.3f}" for row in rows]
        return f"({', '.join(values)})"

    return re.sub(r"\{(\w+)\}", number, form.words)


def law_document(law: Law, name: str) -> Document:
    """The law for programs.

    Args:
        law: that was learnt.
        name: of its effect.
    """
    tables, motion = law.model.parameters(), law.separating_motion
    terms = [_term(form, tables[form.name], _name_of(name, k)) for k, form in enumerate(law.forms)]
    return {
        "name": name,
        "form": law.forms[0].name,
        "terms": terms,
        "parameters": terms[0]["parameters"],
        "beside": list(law.beside),
        "regime": None,
        "p_value": law.p_value,
        "close_to": _close_to(law),
        "separating_motion": motion,
        "error": {"before": law.before.rms, "after": law.after.rms, "noise_floor": law.floor},
        "sentence": _sentence(law, motion),
    }


def _term(form: LawForm, found: Mapping[str, Mapping[str, Any]], name: str) -> Document:
    """Formula with its coefficient, a vector where it has components."""
    rows = [found[row] for row in form.linear]
    many = len(rows) > 1
    return {
        "name": name,
        "form": form.name,
        **form.term_of(found),
        "coefficient": [row["value"] for row in rows] if many else rows[0]["value"],
        "std": [row["std"] for row in rows] if many else rows[0]["std"],
        "unit": rows[0]["unit"],
        "parameters": found,
    }


def _close_to(law: Law) -> Document | None:
    """The known effect next to the law, and why it is not the cause."""
    if law.close_to is None:
        return None
    error = law.close_to.held_out.rms
    reason = f"leaves a held-out error of {error:.2f} where the law leaves {law.after.rms:.2f}"
    return {"name": law.close_to.name, "error": error, "why_not": reason}


def _sentence(law: Law, motion: Document | None) -> str:
    """Words, size, fall of the error, chance, and what else may be the cause."""
    tables = law.model.parameters()
    words = [_with_size(form, tables[form.name]) for form in law.forms]
    text = f"Learnt: {join_names([*words, *law.beside], 'and')}. The held-out error "
    text += f"{write_fall(law.before.rms, law.after.rms)}; floor {law.floor:.2f}. "
    text += f"Noise alone gives such a law in less than {100.0 * law.p_value:.0f} % of recordings."
    if close := _close_to(law):
        text += f" Closest in the catalogue: {close['name']}, which {close['why_not']}."
    if law.others:
        names = ", ".join(other.form.name for other in law.others)
        told = motion["description"] if motion else "no motion was found that tells them apart"
        text += f" As good: {names}; {told}."
    return text


def _with_size(form: LawForm, found: Mapping[str, Mapping[str, Any]]) -> str:
    """A term in words, with the size at its reference."""
    if len(form.linear) > 1 or "{size}" in form.words:
        return write_law(form, found)
    at = " at {:g} {}".format(*form.reference) if form.reference else ""
    return f"{write_law(form, found)} ({write_value(found[form.linear[0]])}{at})"
