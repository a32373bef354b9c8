"""Writes docs/effects.md and its pictures from the classes of the catalogue.

python -m docs.effect_pages [DOCS]
"""

from __future__ import annotations

import io
import sys
import textwrap
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from docs.effect_signatures import ONE_FINGER, draw_signature
from docs.joint_signatures import draw_joint_signature
from tactile_dynamics_ros.core.effects import EFFECT_NAMES, create_effect
from tactile_dynamics_ros.core.effects.formula.expression import FUNCTIONS
from tactile_dynamics_ros.core.effects.formula.quantities import (
    CONTACT_SCALARS,
    CONTACT_VECTORS,
    SCALARS,
    VECTORS,
)
from tactile_dynamics_ros.core.effects.registry import (
    CatalogueEntry,
    describe_effect,
    group_parameters,
)
from tactile_dynamics_ros.core.joints.effects import JOINT_EFFECT_NAMES, describe_joint_effect
from tactile_dynamics_ros.core.planar.effects.registry import (
    PUSHED_EFFECT_NAMES,
    describe_pushed_effect,
)
from tactile_dynamics_ros.report.style import house_style, to_png

PAGE = "effects.md"
PICTURES = "figures/effects"
_COLOURS = 32
_TITLES = {
    "drag": "The surroundings resist the motion",
    "elastic": "Something of the world pulls",
    "contact": "Contacts are not what they seem",
    "internal": "Something moves inside",
    "gravity": "Mass and gravity",
    "sensor": "Force sensors err",
    "timing": "Time is off",
    "event": "Something changes at one time",
}

_OPENING = """\
# Which effects can be missing from the model?

What can be missing from the model of a rigid body in a hand, and from that of [an object that is
pushed](#effects-of-a-pushed-object). Every effect is one class in
[`core/effects`](../tactile_dynamics_ros/core/effects) or
[`core/planar/effects`](../tactile_dynamics_ros/core/planar/effects); this page is made from them by
`./dev docs`. The same in a terminal: `tactile-dynamics effects`, or `tactile-dynamics effects NAME`
for one.

**Meaning.** The model says `sum of the contact wrenches = Y phi`, with the Newton-Euler regressor
`Y` of the motion and ten inertial parameters `phi`. With an effect it says

    sum of the contact wrenches + Delta(theta) = Y phi

`Delta` is what an outside force does to the object, or how a measurement has to be corrected;
`theta = 0` means that the effect is absent. Wrenches are about the origin of the object's frame.

**Use.** `tactile-dynamics diagnose BAG` ranks all of them; `tactile-dynamics estimate BAG
--effects viscous_drag,force_bias:thumb` puts some into the model; the parameter `effects` of the
node `inertial_estimator` does so live. Where a name leaves something open (in which frame, which
finger), it has *readings*, written after a colon; without one, the most usual is meant.

**Pictures.** A hand holds a 0.3 kg load still, moves it, turns it, squeezes it. Each picture
shows the wrench that is missing in the balance when the effect is there at a typical size and the
ten inertial parameters have already explained as much of it as they can: left the force, in the
middle the torque, right the relation that gives the effect away. Finger effects are at the thumb.
What a page or a report calls a residual is measured minus predicted: the missing wrench with the
opposite sign. Texts here speak of the missing wrench.
"""

_PUSHED = """\
## Effects of a pushed object

An object on a support resists with its friction and its inertia, of which [pushing.md](pushing.md)
has the model. An effect changes what acts on it (gravity, the force that a sensor reports, the
point where it is reported), changes friction, or adds a wrench; again zero parameters mean that it
is absent. `tactile-dynamics diagnose BAG --model pushed` ranks all of them, `tactile-dynamics
estimate BAG --effects support_tilt` puts some into the model, the parameter `effects` of
`property_estimator` does so live. Some names are also in the table above: the cause is the same,
the law is that of a push. `tactile-dynamics effects --model pushed` prints the same.
"""

_TITLES_PUSHED = {
    "support": "The table and its friction",
    "load": "The load",
    "joint": "The joint of two parts",
    "environment": "Something else pulls or touches",
    "sensor": "Sensors of pushes err",
}

_JOINTS = """\
## Effects of an arm's joints

The torques of an arm's drives are those of its links and its payload, plus Coulomb friction,
viscous friction and an offset of each joint; [joints.md](joints.md) has the model. An effect adds
torques; zero parameters mean that it is absent. Most act on single joints: `name:joint_2`,
`name:joint_2+joint_4`, or `name:all`; without a reading the one that fits best is taken. Parameters
of an arm carry the names of its joints. `tactile-dynamics diagnose BAG --model joints` ranks all
of them, `tactile-dynamics effects --model joints` prints the same.
"""

_TITLES_JOINTS = {
    "friction": "Friction of the joints",
    "drive": "Motors and gears",
    "outside": "Gravity and cables",
    "sensor": "Torques that err",
}

_OWN = """\
## Effects of your own

An effect is an object with parameters, a wrench and a Jacobian. There are three ways to make one
known; afterwards it is estimated, ranked and explained like those above.

**A formula in yaml.** Units are checked, derivatives are made from the formula.

```yaml wind.yaml
effects:
  wind:
    sentence: the object moves through wind          # for the verdict
    looks_like: A force that depends on the velocity and does not vanish at rest.
    remedy: Close the window, or keep it in the model.
    parameters:
      c: {unit: N s^2/m^2, prior_std: 20, typical: 3, description: drag coefficient}
      w: {unit: m/s, prior_std: 1, typical: 0.5, vector: true, description: wind}
    definitions:
      u: v - w                                       # velocity relative to the air
    wrench: {axes: world, at: com, force: -c*norm(u)*u}
```

```bash
tactile-dynamics effects wind --effect-file wind.yaml
tactile-dynamics estimate run.mcap --effect-file wind.yaml --effects wind
```

- `parameters`: `unit` and `prior_std` (a weak scale of plausible values) are needed; `typical` is
  a value at which the effect is plainly there; `vector: true` makes three components `w_x, w_y,
  w_z`, constant in the axes of the wrench. `constants: {name: {value, unit}}` are fixed numbers
  with a unit.
- `wrench` has `force`, `torque` or both: one vector expression, or a list of three. `axes`:
  `body` (default), `world` or `contact`. `at` is where the force acts: `origin` (default), `com`,
  a vector in body axes such as `b` or `r_thumb`, or `contacts`: then the wrench is summed over
  all contacts that touch, at their points, and `f`, `grip`, `n`, `r`, `spin` are those of each
  contact. A list of wrenches adds up.
- The wrench has to vanish where all parameters are zero.
- `external: false` says that it is an error of what sensors read, `true` that it is a wrench on the
  object, which late sensors show late. By default it is one if no force, torque or grip occurs.
- `tactile-dynamics effects --quantities` prints what a formula can name:

{quantities}

Vectors without suffix are in the axes of the wrench; `v_x_world` and `v_x_body` say otherwise.
Quantities of a contact carry its name (`grip_thumb`, `f_x_thumb`) unless the wrench is `at:
contacts`. Functions: {functions}; `pi`, `+ - * / ^`.

**A class in a Python file**, for what no formula says (filters, memory, tables): subclass
`Effect` or `LinearEffect`, decorate it with `@register_effect`, pass the file as `--effect-file
my_effect.py`. [`examples/33_write_your_own_effect.py`](../examples/33_write_your_own_effect.py)
is one, [`examples/34_effect_from_a_formula.py`](../examples/34_effect_from_a_formula.py) fits one
from yaml. Say `external = False` in the class if it is an error of what sensors read, and not a
wrench on the object: the latter is shown late by sensors that are late.

Effects of pushes are classes only: subclass `PushEffect`, decorate it with `@PUSHED.register`
(`effect.py` and `registry.py` of `core/planar/effects`);
[how/effect.md](how/effect.md#an-effect-of-pushes) has one.

**A class in a package of yours**: name it in the entry-point group and it is known wherever the
package is installed, in nodes too:

```toml
[project.entry-points."tactile_dynamics_ros.effects"]
my_effect = "my_package.my_module:MyEffect"
```

`check_effect` (in `core/effects/check.py`) tests an effect: shapes, absence at zero, derivatives
against finite differences, a screening family that contains it, independence of the choice of
axes.
"""


def write_effect_page(docs: Path) -> None:
    """Write the page and one picture per effect.

    Args:
        docs: folder of the documentation.
    """
    (docs / PICTURES).mkdir(parents=True, exist_ok=True)
    for name in EFFECT_NAMES:
        (docs / PICTURES / f"{name}.png").write_bytes(make_picture(name))
    for name in JOINT_EFFECT_NAMES:
        picture = few_colours(draw_joint_signature(name))
        (docs / PICTURES / f"joints_{name}.png").write_bytes(picture)
    (docs / PAGE).write_text(make_effect_page(), encoding="utf-8")


def make_picture(name: str) -> bytes:
    """Return the picture of an effect as PNG of few colours."""
    with house_style():
        return few_colours(draw_signature(name))


def few_colours(figure: Figure) -> bytes:
    """Return a figure as a small PNG."""
    png = to_png(figure)
    small = Image.open(io.BytesIO(png)).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    small.save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def make_effect_page() -> str:
    """Return the page as markdown."""
    entries = [describe_effect(create_effect(name)) for name in EFFECT_NAMES]
    order = list(_TITLES)
    entries.sort(key=lambda entry: order.index(entry.family))
    parts = [_OPENING, _write_overview(entries)]
    for family, members in groupby(entries, key=lambda entry: entry.family):
        parts.append(f"## {_TITLES[family]}\n")
        parts += [_write_entry(entry) for entry in members]
    parts += _write_pushed()
    parts += _write_joints()
    own = _OWN.replace("{quantities}", _write_quantities())
    parts.append(own.replace("{functions}", textwrap.fill(_code(FUNCTIONS), 98)))
    return "\n".join(parts)


def _write_pushed() -> list[str]:
    """The part on pushed objects: overview, then each effect below the title of its kind."""
    entries = [describe_pushed_effect(name) for name in PUSHED_EFFECT_NAMES]
    order = list(_TITLES_PUSHED)
    entries.sort(key=lambda entry: order.index(entry.family))
    parts = [_PUSHED, _write_overview(entries, "pushed-")]
    for family, members in groupby(entries, key=lambda entry: entry.family):
        parts.append(f"### {_TITLES_PUSHED[family]}\n")
        parts += [_write_pushed_entry(entry) for entry in members]
    return parts


def _write_joints() -> list[str]:
    order = list(_TITLES_JOINTS)
    entries = [describe_joint_effect(name) for name in JOINT_EFFECT_NAMES]
    entries.sort(key=lambda entry: order.index(entry.family))
    parts = [_JOINTS, _write_overview(entries, "joints-")]
    for family, members in groupby(entries, key=lambda entry: entry.family):
        parts.append(f"### {_TITLES_JOINTS[family]}\n")
        parts += [_write_pushed_entry(entry, "joints") for entry in members]
    return parts


def _write_pushed_entry(entry: CatalogueEntry, model: str = "pushed") -> str:
    parts = [
        f"#### {model}: {entry.name}\n",
        f"    {entry.formula}\n",
        f"{entry.meaning}\n",
        textwrap.fill(entry.looks_like, 100) + "\n",
        *([_joint_picture(entry.name)] if model == "joints" else []),
        _write_parameters(entry),
        textwrap.fill(f"**Remedy.** {entry.remedy}", 100) + "\n",
    ]
    return "\n".join(parts)


def _joint_picture(name: str) -> str:
    return f"![Torque that is missing with {name}]({PICTURES}/joints_{name}.png)\n"


def _write_overview(entries: Sequence[CatalogueEntry], prefix: str = "") -> str:
    rows = [f"| [`{e.name}`](#{prefix}{e.name}) | {e.sentence} |" for e in entries]
    return "\n".join(["| name | what it says |", "|---|---|", *rows, ""])


def _write_entry(entry: CatalogueEntry) -> str:
    where = " at the thumb" if entry.name in ONE_FINGER else ""
    parts = [
        f"### {entry.name}\n",
        f"    {entry.formula}\n",
        textwrap.fill(entry.looks_like, 100) + "\n",
        f"![Missing force and torque of {entry.name}{where}]({PICTURES}/{entry.name}.png)\n",
        _write_parameters(entry),
        f"{entry.meaning}\n",
        textwrap.fill(f"**Remedy.** {entry.remedy}", 100) + "\n",
    ]
    if len(entry.readings) > 1:
        parts.append(textwrap.fill(f"Readings: {_code(entry.readings)}.", 100) + "\n")
    return "\n".join(parts)


def _write_parameters(entry: CatalogueEntry) -> str:
    rows = [
        f"| {_code(symbols.split(', '))} | {unit or '1'} | {text} |"
        for symbols, unit, text in group_parameters(entry.parameters)
    ]
    whose = ", of every finger" if entry.per_finger else ""
    return "\n".join([f"| parameter{whose} | unit | |", "|---|---|---|", *rows]) + "\n"


def _write_quantities() -> str:
    rows = []
    tables = ((SCALARS, ""), (VECTORS, "vector"), (CONTACT_SCALARS, "of a contact"),
              (CONTACT_VECTORS, "vector, of a contact"))  # fmt: skip
    for table, kind in tables:
        rows += [f"| `{name}` | {unit} | {text} | {kind} |" for name, (unit, text) in table.items()]
    return "\n".join(["| name | unit | | |", "|---|---|---|---|", *rows])


def _code(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


if __name__ == "__main__":
    write_effect_page(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
