"""Pages by question are short, and their links lead somewhere."""

import re
from pathlib import Path

import pytest

PAGES = sorted((Path(__file__).resolve().parents[2] / "docs" / "how").glob("*.md"))
MOST_LINES = 120


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_short_and_its_links_lead_somewhere(page):
    text = page.read_text()
    assert len(text.splitlines()) <= MOST_LINES
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (page.parent / target).exists(), target
