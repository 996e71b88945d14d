"""What a stranger wrote into a data set stands in ``shortcuts.md`` and on the terminal as text."""

from __future__ import annotations

import sys
from pathlib import Path

from markdown_it import MarkdownIt
from tests.looping import each

sys.path.insert(0, str(Path(__file__).parents[2] / "quoting"))
from hostile import HOSTILE

from betterbench.demonstrations.shortcuts.examine import Finding, GroupAudit, ShortcutAudit
from betterbench.demonstrations.shortcuts.page import audit_lines
from betterbench.errors import UNPRINTABLE

PLANTED = [text for text in HOSTILE if text.strip() and "\0" not in text and len(text) < 200]


@each("text", PLANTED, name=lambda t: ascii(t[:24]))
def test_names_of_groups_notes_and_findings(text):
    finding = Finding(
        text, text, text, 1.0, 1.0, 0.001, 0.001, 9, "shortcut", (text,), {text: {text: 9}}, separating=((text, text),)
    )
    group = GroupAudit(text, 9, (finding,), (text,))
    page = "\n".join(audit_lines(ShortcutAudit(text, "0" * 64, (group,))))
    assert not UNPRINTABLE.search(page)
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(page)
    kinds = {token.type for token in tokens} | {c.type for t in tokens for c in t.children or ()}
    assert not kinds & {"html_block", "html_inline", "link_open", "image", "fence", "code_inline", "code_block"}
    assert [t.tag for t in tokens if t.type == "heading_open"] == ["h3"]
    assert sum(t.type == "tr_open" for t in tokens) == 2
    assert sum(t.type == "td_open" for t in tokens) == 7
