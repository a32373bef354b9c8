"""Benchmarks of clean recordings and of recordings asked together: grades are honest."""

from benchmarks import clean, several
from benchmarks.page_section import replace_section


def outcome(kind, verdict="adequate", effect=None, furthest=1.0):
    return clean.Outcome(kind, verdict, effect, verdict == "adequate", furthest)


def test_a_clean_recording_counts_where_it_belongs():
    found = [
        outcome("a"),
        outcome("a", "missing_effect", "contact_offset", 9.0),
        outcome("b", "unexplained"),
    ]
    rows = clean.table(found)[2:]
    assert rows == [
        "| a | 1 of 2 | 1 of 2 | 1 | contact_offset |",
        "| b | 0 of 1 | 0 of 1 | 0 | unexplained |",
    ]


def test_clean_recordings_are_of_all_sizes_and_answered():
    carried = list(clean.carried_recordings(70, 1, carried=True))
    own = list(clean.carried_recordings(80, 1, carried=False))
    assert (len(carried), len(own)) == (10, 20)
    assert {recording.kind for recording in carried} == {
        "carried by the pose, 3 contacts",
        "carried by the pose, 4 contacts",
    }
    answer = clean.ask(carried[0])
    assert answer.verdict == "adequate"
    assert answer.furthest < clean.WIDE


def test_the_right_name_alone_is_right_and_a_group_is_told():
    found = [
        several.Outcome(
            "added_mass", ("added_mass",), "motion", "missing_effect", "added_mass", ()
        ),
        several.Outcome(
            "force_bias", ("force_bias",), "regrasp", "ambiguous", "force_bias", ("x",)
        ),
        several.Outcome(
            "force_bias", ("force_bias",), "regrasp", "missing_effect", "force_bias", ("x",)
        ),
    ]
    rows = several.table(found)[2:]
    assert rows == [
        "| `added_mass` | 1 | 1 | 1 | - |",
        "| `force_bias` | 2 | 1 | 0 | force_bias |",
        "| all | 3 | 2 | 1 |  |",
    ]
    section = several.section(found, "./dev bench several")
    page = replace_section("# Benchmarks\n", section)
    assert "1 motions" in page and "2 re-grasps" in page.replace("\n", " ")
    assert replace_section(page, section) == page
