"""The diagnosis on a model that has nothing to do with hands: a block that slides on an incline.

The balance reads the pull on the block, f = m g sin(a) + m acceleration + noise; hidden laws act.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy import diagnosis as diagnosis_module
from tactile_dynamics_ros.core.discrepancy.comparison import compare
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document, group_clause
from tactile_dynamics_ros.core.discrepancy.explanation import explain
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Family, Residuals
from tactile_dynamics_ros.core.discrepancy.screening import best_by_effect
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig, explained_share
from tactile_dynamics_ros.core.discrepancy.selection import exchange
from tactile_dynamics_ros.core.discrepancy.structure import find_line
from tactile_dynamics_ros.core.discrepancy.trials import try_effect
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import assess

NOISE = 0.05
LAWS = {
    "viscous_friction": lambda block: block.speed,
    "dry_friction": lambda block: np.sign(block.speed),
    "zero_error": lambda block: np.ones_like(block.time),
    "spring": lambda block: block.place,
    "stretched_spring": lambda block: 3.0 * block.place,
    "breaking_spring": lambda block: block.place * (block.time < 0.95 * block.time[-1]),
    "sticky_spring": lambda block: 0.08 * np.tanh(3.0 * block.speed) + 0.2 * block.place,
    "soft_friction": lambda block: np.tanh(20.0 * block.speed),
}
TERMS = {
    "v^3": lambda block: block.speed**3,
    "v/|v|": lambda block: np.sign(block.speed),
    "v": lambda block: block.speed,
    "x": lambda block: block.place,
}
TERM_EFFECTS = {"v": "viscous_friction", "x": "spring"}


@dataclass(frozen=True)
class Block:
    """One slide back and forth."""

    time: np.ndarray
    place: np.ndarray
    speed: np.ndarray
    regressor: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class SlidingBlock:
    """Mass of the block with effects, linear in all parameters."""

    block: Block
    effects: tuple[str, ...] = ()
    known: tuple[str, ...] = ("viscous_friction", "dry_friction", "zero_error", "spring")
    terms: tuple[str, ...] = ("v^3",)
    impossible: tuple[str, ...] = ()
    unreadable: str = ""
    too_short: str = ""
    remark: str = ""
    known_event: dict | None = None
    alike: tuple[str, ...] = ()

    def imitators(self, name: str) -> tuple[str, ...]:
        return self.alike if name == "spring" else ()

    def convention(self) -> None:
        return None

    @cached_property
    def jacobian(self) -> np.ndarray:
        columns = [self.block.regressor, *(LAWS[name](self.block) for name in self.effects)]
        return -np.stack(columns, axis=1) / NOISE

    @cached_property
    def solution(self) -> np.ndarray:
        return np.linalg.lstsq(-self.jacobian, self.block.force / NOISE, rcond=None)[0]

    @property
    def residual(self) -> np.ndarray:
        return self.block.force / NOISE + self.jacobian @ self.solution

    @property
    def time(self) -> np.ndarray:
        return self.block.time

    @property
    def effect_names(self) -> tuple[str, ...]:
        return self.effects

    @property
    def freedom(self) -> float:
        return float(len(self.effects))

    def conditions(self) -> Sequence[Condition]:
        return ()

    def families(self, names: Sequence[str] | None = None) -> list[Family]:
        wanted = [n for n in (names or self.known) if n not in self.effects]
        return [self._family(name) for name in wanted]

    def _family(self, name: str) -> Family:
        columns = LAWS[name](self.block)[:, None] / NOISE
        return Family(name, name, name, columns, (0,), symbols=(name,))

    def with_effect(self, family: Family, coefficients: np.ndarray) -> SlidingBlock:
        return replace(self, effects=(*self.effects, family.name))

    @property
    def noise_level(self) -> float:
        return float(np.log(NOISE))

    @property
    def lasting_freedom(self) -> float:
        return 12.0

    def is_possible(self, name: str) -> bool:
        return name not in self.impossible

    def moved_by(self, other: SlidingBlock) -> float:
        spread = np.sqrt(np.diag(np.linalg.inv(self.jacobian.T @ self.jacobian)))
        count = len(self.solution)
        return float(np.max(np.abs(other.solution[:count] - self.solution) / spread))

    def without_effect(self, name: str) -> SlidingBlock:
        left = tuple(effect for effect in self.effects if effect != name)
        return replace(self, effects=left)

    def refined(self) -> SlidingBlock:
        return self

    def parameters(self) -> dict[str, dict[str, dict[str, Any]]]:
        spread = np.sqrt(np.diag(np.linalg.inv(self.jacobian.T @ self.jacobian)))
        return {
            name: {"c": {"value": float(v), "std": float(s), "unit": "N"}}
            for name, v, s in zip(self.effects, self.solution[1:], spread[1:], strict=True)
        }

    def sentence(self, name: str) -> str:
        return f"the block feels {name.replace('_', ' ')}"

    def residuals(self) -> Residuals:
        white = self.residual[:, None]
        speed = Condition("speed", "m/s", np.abs(self.block.speed))
        return Residuals(self.time, white, NOISE * white, ("force",), ("N",), {}, (speed,))

    def library(self) -> list[Family]:
        return [self._term(name) for name in self.terms]

    def _term(self, name: str) -> Family:
        columns = TERMS[name](self.block)[:, None] / NOISE
        effect = TERM_EFFECTS.get(name, "")
        return Family(name, name, name, columns, (0,), symbols=(name,), effect=effect)

    def separating_motion(self, rivals: Sequence[Any]) -> dict[str, Any]:
        return {"description": f"do not stretch {rivals[0].effects[-1]}"}


def slide(seed: int, **hidden: float) -> Block:
    """A seeded slide with hidden laws; `cubic_drag` and `hum` are known to nobody."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 0.01)
    phase = rng.uniform(0, 2 * np.pi, 3)
    parts = [(0.3, 2.1), (0.2, 3.7), (0.1, 5.9)]
    waves = [(a, w, w * time + p) for (a, w), p in zip(parts, phase, strict=True)]
    place = sum(a * np.sin(x) for a, w, x in waves)
    speed = sum(a * w * np.cos(x) for a, w, x in waves)
    acceleration = sum(-a * w**2 * np.sin(x) for a, w, x in waves)
    regressor = acceleration + 9.81 * np.sin(0.3 + 0.2 * np.sin(0.8 * time))
    block = Block(time, place, speed, regressor, 0.4 * regressor + rng.normal(0, NOISE, len(time)))
    unknown = {
        "cubic_drag": speed**3,
        "hum": np.sin(2 * np.pi * 13.0 * time),
    }
    extra = sum(
        size * (unknown[name] if name in unknown else LAWS[name](block))
        for name, size in hidden.items()
    )
    return Block(time, place, speed, regressor, block.force + extra)


def test_nothing_is_missing_on_clean_slides() -> None:
    verdicts = [diagnose(SlidingBlock(slide(seed))).verdict for seed in range(20)]
    assert verdicts.count("adequate") >= 19


@pytest.mark.parametrize("name", ["viscous_friction", "dry_friction", "zero_error", "spring"])
def test_each_law_is_named_with_its_size(name: str) -> None:
    model = SlidingBlock(slide(1, **{name: 0.1}))
    diagnosis = diagnose(model)
    assert (diagnosis.verdict, diagnosis.effect) == ("missing_effect", name)
    found = diagnosis.explained_model.parameters()[name]["c"]
    assert found["value"] == pytest.approx(0.1, abs=4 * found["std"])
    assert diagnosis.after.rms < 1.05 < diagnosis.before.rms


def test_what_cannot_be_is_no_explanation() -> None:
    block = slide(6, spring=0.1)
    possible = diagnose(SlidingBlock(block, known=("spring", "stretched_spring", "dry_friction")))
    assert possible.effect in ("spring", "stretched_spring")
    known = ("spring", "dry_friction")
    diagnosis = diagnose(SlidingBlock(block, known=known, impossible=("spring",)))
    assert (diagnosis.verdict, diagnosis.effect) == ("unexplained", None)


def test_what_imitates_a_law_that_cannot_be_is_not_named() -> None:
    known = ("soft_friction", "viscous_friction", "spring")
    block = slide(11, dry_friction=0.5)
    ignorant = diagnose(SlidingBlock(block, known=known))
    assert (ignorant.verdict, ignorant.effect) == ("missing_effect", "soft_friction")
    both = SlidingBlock(block, known=("dry_friction", *known), impossible=("dry_friction",))
    assert (diagnose(both).verdict, diagnose(both).effect) == ("unexplained", None)


def test_what_fits_as_well_as_a_law_that_cannot_be_is_named() -> None:
    twins = ("stretched_spring", "spring", "dry_friction")
    for impossible, named in (((), "stretched_spring"), (("stretched_spring",), "spring")):
        diagnosis = diagnose(SlidingBlock(slide(6, spring=0.1), known=twins, impossible=impossible))
        assert diagnosis.effect == named


def test_two_laws_are_added_one_after_the_other() -> None:
    model = SlidingBlock(slide(2, dry_friction=0.08, spring=0.2))
    explanation = explain(model)
    assert set(explanation.effects) == {"dry_friction", "spring"}
    assert explanation.verdict == "adequate"
    errors = [explanation.before.rms, *(step.error for step in explanation.steps)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1.05


def test_a_law_that_two_others_better_together_is_exchanged() -> None:
    known = ("sticky_spring", "viscous_friction", "dry_friction", "spring")
    block = slide(8, dry_friction=0.08, spring=0.2)
    first = assess(SlidingBlock(block, known=known))
    assert best_by_effect(first.scores)[0].family.name == "sticky_spring"
    explanation = explain(SlidingBlock(block, known=known))
    assert (set(explanation.effects), explanation.verdict) == (
        {"dry_friction", "spring"},
        "adequate",
    )


def test_an_effect_that_others_make_needless_is_removed() -> None:
    model = SlidingBlock(slide(9, dry_friction=0.08, spring=0.2))
    added = []
    for name in ("viscous_friction", "dry_friction", "spring"):
        trial = try_effect(model, assess(model).scores, name, 1.0)
        model, added = trial.model, [*added, trial]
    _, choices = exchange(model, added, 1.0, 10.0)
    assert {choice.best.name for choice in choices} == {"dry_friction", "spring"}
    assert all(choice.without > choice.best.criterion + 10.0 for choice in choices)


def test_laws_that_explain_nearly_all_are_named_although_the_rest_follows_another() -> None:
    block = slide(10, zero_error=1.0, spring=3.0, cubic_drag=0.01)
    diagnosis = diagnose(SlidingBlock(block, known=("dry_friction", "zero_error", "spring")))
    assert {step.name for step in diagnosis.steps} == {"zero_error", "spring"}
    assert diagnosis.verdict == "missing_effect"


def test_a_law_that_dominates_is_named_although_something_unknown_remains() -> None:
    model = SlidingBlock(slide(3, zero_error=2.0, hum=0.08))
    diagnosis = diagnose(model)
    assert diagnosis.effect == "zero_error"
    assert "what remains is" in diagnosis_document(diagnosis)["sentence"]
    explanation = explain(model)
    assert (explanation.verdict, explanation.effects) == ("unexplained", ("zero_error",))
    assert explanation.signature is not None
    assert explanation.signature.frequency_hz == pytest.approx(13.0, rel=0.02)


def test_an_unknown_law_is_not_given_a_known_name_but_a_formula() -> None:
    diagnosis = diagnose(SlidingBlock(slide(4, cubic_drag=0.05)))
    assert (diagnosis.verdict, diagnosis.effect) == ("unexplained", None)
    assert diagnosis.signature is not None
    assert diagnosis.signature.formula is not None
    assert "v^3" in diagnosis.signature.formula


def test_what_a_simpler_law_does_better_is_not_put_down_to_known_ones() -> None:
    block = slide(11, dry_friction=0.5)
    known = ("viscous_friction", "soft_friction", "spring")
    ignorant = diagnose(SlidingBlock(block, known=known))
    assert (ignorant.verdict, ignorant.effect) == ("missing_effect", "soft_friction")
    diagnosis = diagnose(SlidingBlock(block, known=known, terms=("v^3", "v/|v|")))
    assert (diagnosis.verdict, diagnosis.effect) == ("unexplained", None)
    [lead, *_] = diagnosis.steps
    assert explained_share(diagnosis.assessment.rms, lead.after.rms, diagnosis.floor) > 0.9
    assert diagnosis.signature is not None
    assert diagnosis.signature.formula is not None
    assert diagnosis.signature.formula.endswith("v/|v|")


def test_what_explains_nine_tenths_is_named_and_the_rest_described() -> None:
    model = SlidingBlock(slide(3, spring=1.0, hum=0.1))
    diagnosis = diagnose(model)
    share = explained_share(diagnosis.before.rms, diagnosis.after.rms, diagnosis.floor)
    assert 0.9 < share < 0.99
    assert (diagnosis.verdict, diagnosis.effect) == ("missing_effect", "spring")
    document = diagnosis_document(diagnosis)
    assert document["unexplained"]["frequency_hz"] == pytest.approx(13.0, rel=0.02)
    assert "what remains is in force, oscillates at 13 Hz" in document["sentence"]
    strict = replace(DiagnosisConfig(), mostly=0.99)
    assert diagnose(model, strict).verdict == "unexplained"


def test_a_law_whose_terms_are_known_effects_is_these_effects() -> None:
    block = slide(12, viscous_friction=0.3, spring=0.9)
    shallow = replace(DiagnosisConfig(), depth=1)
    blind = diagnose(SlidingBlock(block), shallow)
    assert blind.verdict == "unexplained"
    diagnosis = diagnose(SlidingBlock(block, terms=("v^3", "v", "x")), shallow)
    assert diagnosis.verdict == "missing_effect"
    assert {step.name for step in diagnosis.steps} == {"viscous_friction", "spring"}
    found = diagnosis.steps[-1].choice.model.parameters()
    assert found["spring"]["c"]["value"] == pytest.approx(0.9, abs=4 * found["spring"]["c"]["std"])


def test_what_is_significant_and_moves_nothing_is_a_trace() -> None:
    model = SlidingBlock(slide(13, viscous_friction=0.0085))
    diagnosis = diagnose(model)
    assert (diagnosis.verdict, diagnosis.effect) == ("adequate", None)
    assert diagnosis.trace is not None
    assert (diagnosis.trace.name, diagnosis.assessment.adequate) == (
        "viscous_friction",
        False,
    )
    assert diagnosis.trace.p_value < 1e-6
    assert (
        "It looks most like viscous_friction (c = 0.0" in diagnosis_document(diagnosis)["sentence"]
    )
    comparison = compare(model)
    assert (comparison.adequate, comparison.assessment.adequate) == (True, False)


def test_what_moves_an_estimate_is_missing_however_little_it_explains() -> None:
    diagnosis = diagnose(SlidingBlock(slide(13, zero_error=0.012)))
    assert diagnosis.before.rms < 1.02 * diagnosis.floor
    assert (diagnosis.verdict, diagnosis.effect) == ("missing_effect", "zero_error")


def test_what_explains_only_what_it_was_fitted_to_is_a_trace_however_much_it_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = SlidingBlock(slide(13, zero_error=0.012))
    same = diagnose(model).before
    monkeypatch.setattr("tactile_dynamics_ros.core.discrepancy.diagnosis.held_out", lambda _: same)
    diagnosis = diagnose(model)
    assert (diagnosis.verdict, diagnosis.effect) == ("adequate", None)
    assert diagnosis.trace is not None
    assert diagnosis.trace.name == "zero_error"
    assert "predicts nothing of the samples" in diagnosis_document(diagnosis)["sentence"]


def test_a_hum_is_reported_with_its_frequency() -> None:
    diagnosis = diagnose(SlidingBlock(slide(5, hum=0.1)))
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.signature is not None
    assert diagnosis.signature.frequency_hz == pytest.approx(13.0, rel=0.02)


def test_a_hum_is_found_between_lost_samples() -> None:
    whole = slide(5, hum=0.1)
    sample = np.arange(len(whole.time))
    lost_of_each_half_second = np.random.default_rng(5).integers(5, 45, len(sample) // 50)
    kept = sample % 50 >= lost_of_each_half_second[sample // 50]
    parts = {f.name: getattr(whole, f.name)[kept] for f in fields(whole)}
    diagnosis = diagnose(SlidingBlock(Block(**parts)))
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.signature is not None
    assert diagnosis.signature.frequency_hz == pytest.approx(13.0, rel=0.02)


def test_a_hum_is_found_in_stretches_that_lie_minutes_apart() -> None:
    whole = slide(5, hum=0.1)
    apart = replace(whole, time=whole.time + 240.0 * (np.arange(len(whole.time)) // 1000))
    line = find_line(SlidingBlock(apart).residuals())
    assert line is not None
    assert line.hz == pytest.approx(13.0, rel=0.02)
    assert line.share > 0.8


def test_a_misfit_whose_weight_beats_is_no_hum() -> None:
    clean = SlidingBlock(slide(5)).residuals()
    beat = 1.0 + 0.5 * np.cos(2.0 * np.pi * 31.0 * clean.time[:, None])
    misfit = replace(clean, white=beat * (3.0 + clean.white), physical=3.0 + clean.white)
    assert find_line(misfit) is None
    assert find_line(replace(misfit, physical=misfit.white)) is not None


def test_twins_come_as_a_group_with_what_would_separate_them() -> None:
    known = ("viscous_friction", "spring", "stretched_spring")
    diagnosis = diagnose(SlidingBlock(slide(6, spring=0.1), known=known))
    assert diagnosis.verdict == "ambiguous"
    assert set(diagnosis.group) == {"spring", "stretched_spring"}
    assert diagnosis.separating_motion is not None
    sentence = diagnosis_document(diagnosis)["sentence"]
    assert "do not stretch" in sentence and "apart" in sentence
    assert group_clause("missing_effect", ("cable", "spring", "drag"), None) == (
        "the same could be done here, with more parameters, by spring or drag, "
        "and no motion was found that separates them"
    )
    assert group_clause("ambiguous", ("cable", "spring"), None).endswith(
        "apart, and no motion was found that separates them"
    )
    assert group_clause("missing_effect", ("cable",), None) == ""
    some = {"description": "pull", "separates_from": ["spring"]}
    assert group_clause("ambiguous", ("cable", "spring", "drag"), some).endswith(
        "apart: pull; that does not separate cable from drag"
    )


def test_what_imitates_an_effect_and_is_none_is_named_with_it() -> None:
    known = ("viscous_friction", "spring")
    alone = diagnose(SlidingBlock(slide(6, spring=0.1), known=known))
    assert (alone.verdict, alone.effect, alone.group) == ("missing_effect", "spring", ())
    alike = diagnose(SlidingBlock(slide(6, spring=0.1), known=known, alike=("slope",)))
    assert (alike.verdict, alike.effect, alike.group) == (
        "ambiguous",
        "spring",
        ("spring", "slope"),
    )
    clean = diagnose(SlidingBlock(slide(3), known=known, remark="It is cold."))
    assert clean.verdict == "adequate"
    assert diagnosis_document(clean)["sentence"].endswith(" It is cold.")


def test_what_fails_only_for_a_while_is_told_from_the_effect() -> None:
    """One block of time refutes the rival, however well it fits all others."""
    known = ("viscous_friction", "spring", "breaking_spring")
    diagnosis = diagnose(SlidingBlock(slide(6, spring=0.3), known=known))
    assert (diagnosis.verdict, diagnosis.effect) == ("missing_effect", "spring")
    assert diagnosis.group == ()


def test_where_it_fails_is_where_the_law_acts() -> None:
    comparison = compare(SlidingBlock(slide(7, cubic_drag=0.08)))
    assert not comparison.assessment.adequate
    assert any("speed" in place.condition for place in comparison.places)


def test_a_rival_that_leaves_no_more_than_sensors_state_is_not_excluded(monkeypatch):
    """Effects of many sensors take up the sensors' own errors too, and so fit better."""
    model = SimpleNamespace(is_possible=lambda name: True, imitators=lambda name: ())
    family = SimpleNamespace(contains=None)

    def trial(name, criterion, rms):
        held = SimpleNamespace(rms=rms)
        source = SimpleNamespace(family=family)
        return SimpleNamespace(
            name=name, criterion=criterion, held_out=held, model=model, source=source
        )

    best, rival = trial("force_drift", 0.0, 0.7), trial("mass_change", 900.0, 1.1)
    choice = SimpleNamespace(
        best=best, rivals=(rival,), model=model, equals=(), dispersion=50.0, without=2000.0
    )
    after = SimpleNamespace(structure=SimpleNamespace(floor=0.5))
    step = SimpleNamespace(choice=choice, after=after)
    monkeypatch.setattr(diagnosis_module, "fits_equally", lambda *_: False)
    for stated, before, group in (
        (True, False, ("force_drift", "mass_change")),
        (False, False, ()),
        (True, True, ()),  # the body alone leaves no more either: that tells nothing
    ):
        monkeypatch.setattr(diagnosis_module, "is_within_stated", lambda *_, s=stated: s)
        found = diagnosis_module.find_group(step, DiagnosisConfig(), before)
        assert found == (group, bool(group))
