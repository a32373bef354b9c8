"""Laws learnt from a diagnosis, written as files of effects."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import yaml

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import written_whole

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis


def learn(diagnosis: Diagnosis, path: Path) -> dict[str, Any]:
    """Learn the law of what a diagnosis leaves; write it as effects of a file.

    Laws that explain the recording as well are written beside it, as `law.drag.yaml`.

    Args:
        diagnosis: of a held object.
        path: of the file; its stem names the law.

    Returns:
        Parts `law` (None if nothing is learnt) and `nothing_learnt` of the document.

    Raises:
        BadInputError: the model is of something else, or the stem is no free name of an effect.
    """
    from tactile_dynamics_ros.core.discrepancy.laws import Law, learn_law
    from tactile_dynamics_ros.core.effects.formula.file import read_effect
    from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
    from tactile_dynamics_ros.core.inertia.diagnosis.law_documents import law_document, law_entry
    from tactile_dynamics_ros.core.inertia.diagnosis.law_forms import HeldForm, held_forms

    if not isinstance(diagnosis.model, HeldObjectModel):
        raise BadInputError("--learn: laws are learnt of held objects only; leave it out")
    if path.suffix != ".yaml":
        raise BadInputError(f"--learn {path}: expected a name that ends in .yaml")
    forms = held_forms()
    read_effect(path.stem, forms[0].entry, str(path))
    found = learn_law(diagnosis, forms)
    if not isinstance(found, Law):
        return {"law": None, "nothing_learnt": found.reason}
    document = law_document(found, path.stem)
    _write(path, law_entry(cast(HeldForm, found.form), document["parameters"]))
    for other in found.others:
        beside = path.with_name(f"{path.stem}.{other.form.name}.yaml")
        table = other.model.parameters()[other.form.name]
        _write(beside, law_entry(cast(HeldForm, other.form), table))
    return {"law": document | {"file": str(path)}, "nothing_learnt": None}


def _write(path: Path, entry: dict[str, Any]) -> None:
    """Write one effect, named after the file."""
    with written_whole(path) as part:
        text = yaml.safe_dump({"effects": {path.name.split(".")[0]: entry}}, sort_keys=False)
        part.write_text(text)
