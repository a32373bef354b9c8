"""From records to rates: what was named, how well it was measured, where it begins to be seen."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from benchmarks.effects.cases import STRONG
from benchmarks.effects.parameters import parameter_errors
from benchmarks.effects.running import named_effects
from tactile_dynamics_ros.core.numerics.regime import split_label
from tactile_dynamics_ros.synthetic import CATALOGUE

Record = dict[str, Any]
HONEST_RATIO = 1.05
FLOOR_RATIO = 1.1
LITTLE = 0.05
"""Share of the excess of the squared error that an effect which stands for another may leave."""
FOUND_SHARE = 0.9
TOO_WEAK = 0.93
MAIN_CHANNEL = 0.5
CHANNELS = tuple(f"{kind}_{axis}" for kind in ("torque", "force") for axis in "xyz")
_NOTHING = {"verdict": "failed"}


def diagnosis_of(record: Record) -> dict[str, Any]:
    """The diagnosis, or one with the verdict "failed" where there is none."""
    return (record.get("diagnose") or {}).get("json") or _NOTHING


def label_of(record: Record) -> str:
    """What the product said in one word: an effect, "adequate", "unexplained", "failed"."""
    diagnosis = diagnosis_of(record)
    names = named_effects(diagnosis)
    if diagnosis["verdict"] == "ambiguous":
        hidden = record["effects"][0] if record["effects"] else ""
        return hidden if hidden in names else (names[0] if names else "ambiguous")
    return names[0] if diagnosis["verdict"] == "missing_effect" and names else diagnosis["verdict"]


def is_right_alone(record: Record) -> bool:
    """The right name and no other."""
    diagnosis = diagnosis_of(record)
    return diagnosis["verdict"] == "missing_effect" and named_effects(diagnosis)[:1] == list(
        record["effects"]
    )


def is_without_group(record: Record) -> bool:
    """The right name, and nothing else that could do the same."""
    return is_right_alone(record) and named_effects(diagnosis_of(record)) == list(record["effects"])


def is_in_group(record: Record) -> bool:
    """The right name alone, or in a group whose members fit about equally well."""
    if is_right_alone(record):
        return True
    diagnosis = diagnosis_of(record)
    named = record["effects"][0] in named_effects(diagnosis)
    return diagnosis["verdict"] == "ambiguous" and named and _group_is_honest(record)


def grade(records: Iterable[Record]) -> dict[str, Any]:
    """All rates of the benchmark, ready for JSON."""
    by_kind: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        by_kind["crash" if "crash" in record else record["kind"]].append(record)
    singles = [record for record in by_kind["single"] if not _is_too_weak(record)]
    calm = [record for record in by_kind["calm"] if not _is_too_weak(record)]
    strong = [record for record in singles if record["level"] >= STRONG]
    return {
        "clean": _grade_clean(by_kind["clean"]),
        "single": _grade_single(strong),
        "thresholds": find_thresholds(singles),
        "calm": {
            "count": len(calm),
            "right_alone": _share(calm, is_right_alone),
            "right_or_group": _share(calm, is_in_group),
        },
        "ambiguous": _grade_ambiguous([*by_kind["single"], *calm]),
        "pairs": _grade_pairs(by_kind["pair"]),
        "outside": _grade_outside(by_kind["outside"]),
        "seconds": _grade_time(by_kind),
        "crashes": [record["key"] for record in by_kind["crash"]],
        "out_of_reach": sum(map(_is_too_weak, by_kind["single"])),
    }


def find_thresholds(singles: Iterable[Record]) -> dict[str, float | None]:
    """Smallest level at which nine of ten recordings lead to the right name or group."""
    found: dict[str, dict[float, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for record in singles:
        found[record["effects"][0]][record["level"]].append(is_in_group(record))
    thresholds: dict[str, float | None] = {}
    for name in CATALOGUE:
        levels = sorted(found[name])
        seen = [np.mean(found[name][level]) >= FOUND_SHARE for level in levels]
        above = [level for k, level in enumerate(levels) if all(seen[k:])]
        thresholds[name] = above[0] if above else None
    return thresholds


def count_confusions(records: Iterable[Record]) -> dict[str, Counter[str]]:
    """How often each hidden thing was called what."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for record in records:
        if "crash" not in record and record["kind"] != "pair":
            hidden = record["effects"][0] if record["effects"] else "nothing"
            table[hidden][label_of(record)] += 1
    return table


def _grade_clean(records: list[Record]) -> dict[str, Any]:
    return {
        "count": len(records),
        "adequate": _share(records, lambda r: diagnosis_of(r)["verdict"] == "adequate"),
        "compare_adequate": _share(
            records, lambda r: bool(((r["compare"] or {}).get("json") or {}).get("adequate"))
        ),
    }


def _grade_single(records: list[Record]) -> dict[str, Any]:
    right = [record for record in records if is_in_group(record)]
    errors = [diagnosis_of(record)["error"] for record in right]
    per_effect = {
        name: _grade_effect([record for record in records if record["effects"][0] == name])
        for name in CATALOGUE
    }
    covered = [share for entry in per_effect.values() for share in entry["covered"]]
    return {
        "count": len(records),
        "right_alone": _share(records, is_right_alone),
        "right_without_group": _share(records, is_without_group),
        "right_or_group": _share(records, is_in_group),
        "worst_effect_right_or_group": min(
            (entry["right_or_group"] for entry in per_effect.values() if entry["count"]),
            default=None,
        ),
        "error_at_floor": _mean(
            [error["after"] <= FLOOR_RATIO * error["noise_floor"] for error in errors]
        ),
        "coverage": _mean(covered),
        "effects": per_effect,
    }


def _grade_effect(records: list[Record]) -> dict[str, Any]:
    within, relative = [], []
    for record in records:
        effect = record["effects"][0]
        estimate = ((record.get("estimates") or {}).get(effect) or {}).get("json")
        if estimate:
            errors = parameter_errors(
                effect, record["truth"], estimate, record.get("axes_told", True)
            )
            within += [abs(error) <= 1.96 * std for error, std in errors.values()]
            relative += [abs(error) / std for error, std in errors.values()]
    befores = [diagnosis_of(r).get("error", {}).get("before") for r in records]
    return {
        "count": len(records),
        "right_alone": _share(records, is_right_alone),
        "right_or_group": _share(records, is_in_group),
        "coverage": _mean(within),
        "covered": within,
        "median_error_in_std": float(np.median(relative)) if relative else None,
        "median_error_before": _median(befores),
        "called": dict(Counter(label_of(record) for record in records)),
    }


def _grade_ambiguous(records: list[Record]) -> dict[str, Any]:
    """Of the groups with the right name: how many the proposed motion resolves."""
    named = [r for r in records if r["effects"][0] in named_effects(diagnosis_of(r))]
    groups = [r for r in named if diagnosis_of(r).get("group")]
    planned = [r for r in groups if r.get("separated")]
    return {
        "count": len(groups),
        "said_ambiguous": _share(groups, lambda r: diagnosis_of(r)["verdict"] == "ambiguous"),
        "planned": len(planned),
        "resolved": _share(planned, _is_resolved),
    }


def _is_resolved(record: Record) -> bool:
    """The right name after the motion, and none of those that it was to refute."""
    refuted = diagnosis_of(record)["separating_motion"]["separates_from"]
    after = (record["separated"] or {}).get("json") or _NOTHING
    remaining = set(named_effects(after)) - {after.get("effect")}
    right = after["verdict"] == "missing_effect" and after["effect"] == record["effects"][0]
    return right and not remaining & {*refuted, diagnosis_of(record)["effect"]}


def _grade_pairs(records: list[Record]) -> dict[str, Any]:
    def both_within(steps: int) -> Callable[[Record], bool]:
        return lambda record: set(record["effects"]) <= set().union(*_added(record)[:steps])

    return {
        "count": len(records),
        "both_within_two": _share(records, both_within(2)),
        "both_within_three": _share(records, both_within(3)),
    }


def _grade_outside(records: list[Record]) -> dict[str, Any]:
    tones = [record for record in records if _tone(record)]
    silent = [record for record in tones if _is_unexplained(record)]
    called: dict[str, Counter[str]] = defaultdict(Counter)
    for record in records:
        called[record["effects"][0]][label_of(record)] += 1
    return {
        "count": len(records),
        "unexplained": _share(records, _is_unexplained),
        "wrong_name": _share(records, _is_named),
        "honest": _share(records, lambda r: _is_unexplained(r) or _leaves_little(r)),
        "frequency_within_two_percent": _share(silent, _has_right_tone),
        "right_channel": _share([r for r in records if _is_unexplained(r)], _has_right_channel),
        "effects": {name: dict(labels) for name, labels in called.items()},
    }


def _grade_time(by_kind: dict[str, list[Record]]) -> dict[str, Any]:
    asked = [
        record[verb]["seconds"]
        for kind in ("clean", "single", "outside")
        for record in by_kind[kind]
        for verb in ("diagnose",)
        if record["duration"] >= 30.0
    ]
    compared = [r["compare"]["seconds"] for r in by_kind["clean"] if r["duration"] >= 30.0]
    return {
        "diagnose_median": _median(asked),
        "diagnose_max": max(asked, default=None),
        "compare_median": _median(compared),
    }


def _group_is_honest(record: Record) -> bool:
    """Every member of the group, added alone, fits about as well as the best."""
    fits = [
        entry["json"]["error"]["whitened_rms"]
        for entry in record["estimates"].values()
        if entry["json"]
    ]
    return bool(fits) and max(fits) <= HONEST_RATIO * min(fits)


def _added(record: Record) -> list[set[str]]:
    """Effects in the order in which they were added; a group counts as each of its members."""
    answer = (record.get("explain") or {}).get("json") or {}
    groups = answer.get("groups") or {}
    names = [step["added"] for step in answer.get("steps", []) if step.get("added")]
    return [{name, *groups.get(name, [])} for name in names]


def _is_unexplained(record: Record) -> bool:
    return diagnosis_of(record)["verdict"] == "unexplained"


def _is_named(record: Record) -> bool:
    """Whether an effect of the catalogue is named, in a regime or everywhere."""
    return split_label(label_of(record))[0] in CATALOGUE


def _leaves_little(record: Record) -> bool:
    """Whether a named effect leaves less than a twentieth of the excess error."""
    error = diagnosis_of(record).get("error")
    if not error or not _is_named(record):
        return False
    floor = error["noise_floor"] ** 2
    return bool(error["after"] ** 2 - floor < LITTLE * (error["before"] ** 2 - floor))


def _tone(record: Record) -> float | None:
    signature = record["truth"]["effects"][split_label(record["effects"][0])[0]]["signature"]
    return signature.get("frequency_hz")


def _has_right_tone(record: Record) -> bool:
    said = (diagnosis_of(record).get("unexplained") or {}).get("frequency_hz")
    values = np.atleast_1d(np.asarray(said if said else np.nan, dtype=float))
    tone = _tone(record)
    return tone is not None and bool(np.any(np.abs(values - tone) <= 0.02 * tone))


def _has_right_channel(record: Record) -> bool:
    """The channel that is named first carries at least half as much as any, in the frame named."""
    said = diagnosis_of(record)["unexplained"]
    carried = record["carried"].get(said["frame"], record["carried"]["body"])
    named = carried[CHANNELS.index(said["channels"][0])]
    return bool(named >= MAIN_CHANNEL * max(carried))


def _is_too_weak(record: Record) -> bool:
    """The effect could not be made large enough to reach its level on this object."""
    if "crash" in record or record["kind"] not in ("single", "calm"):
        return False
    return record["reached"][0] < TOO_WEAK * record["level"]


def _share(records: list[Record], test: Callable[[Record], bool]) -> float | None:
    return _mean([test(record) for record in records])


def _mean(values: list[bool]) -> float | None:
    return float(np.mean(values)) if values else None


def _median(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
