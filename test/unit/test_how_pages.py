"""Pages by question are short, and their links lead somewhere."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted((DOCS / "how").glob("*.md"))
MOST_LINES = 120


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_short_and_its_links_lead_somewhere(page):
    text = page.read_text()
    assert len(text.splitlines()) <= MOST_LINES
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", [*DOCS.glob("*.md"), *PAGES], ids=lambda page: page.stem)
def test_a_page_starts_with_the_question_that_it_answers(page):
    title = page.read_text().partition("\n")[0]
    assert title.startswith("# ") and title.endswith("?"), title


def test_the_first_page_and_the_glossary_stay_short():
    assert len((DOCS.parent / "README.md").read_text().splitlines()) <= 120
    words = re.findall(r"^\| \*\*(?!paper)", (DOCS / "glossary.md").read_text(), re.MULTILINE)
    assert 20 <= len(words) <= 30
