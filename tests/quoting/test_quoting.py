"""What a stranger planted is read back as the text it is by each program that reads what we write."""

from __future__ import annotations

import csv
import html.parser
import io
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from tests.looping import each

from betterbench.errors import UNPRINTABLE, InvalidInputError, one_line, printable
from betterbench.json_form import dump_json
from betterbench.quoting import (
    LONGEST_TEXT,
    ShellText,
    csv_text,
    json_line,
    json_text,
    latex_text,
    markdown_code,
    markdown_table,
    markdown_text,
    markup_text,
    script_json,
    shell_line,
    shell_word,
)
from betterbench.report.tables.latex import table_to_latex
from betterbench.report.tables.table import Table, to_csv

sys.path.insert(0, str(Path(__file__).parent))
from hostile import CANARY, HOSTILE

WORDS = tuple(text for text in HOSTILE if "\0" not in text)
SHOWN = each("text", HOSTILE, ascii)


def test_bash_reads_the_words_that_were_given(tmp_path):
    script = tmp_path / "line.sh"
    line = shell_line(["printf", "%s\\0", *WORDS])
    assert "\n" not in line
    assert not UNPRINTABLE.search(line)
    script.write_text(line, encoding="utf-8")
    for locale in ("C", "C.UTF-8"):
        done = subprocess.run(
            ["/usr/bin/bash", str(script)],
            cwd=tmp_path,
            capture_output=True,
            check=True,
            env={"PATH": "/bin:/usr/bin", "LC_ALL": locale},
        )
        assert done.stdout.split(b"\0")[:-1] == [
            word.encode("utf-8", "surrogateescape" if "\udcff" in word else "surrogatepass") for word in WORDS
        ]
    assert not (tmp_path / CANARY).exists()


def test_a_null_character_is_no_part_of_a_command():
    for text in ("\0", "a\0b"):
        with pytest.raises(InvalidInputError, match="null character"):
            shell_word(text)


def test_only_our_own_type_is_left_to_the_shell():
    ours = ShellText('"$HERE/x.py"')
    assert shell_line(["python", ours]) == 'python "$HERE/x.py"'
    assert shell_word(f"{ours}") == "'\"$HERE/x.py\"'"
    assert shell_word(ours + "$(id)") == "'\"$HERE/x.py\"$(id)'"
    assert shell_word(json.loads(json.dumps({"x": ours}))["x"]) == "'\"$HERE/x.py\"'"


class _Read(html.parser.HTMLParser):
    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.tags, self.text = [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, attrs))

    def handle_data(self, data):
        self.text += data


@SHOWN
def test_markup(text):
    shown = printable(text, most=LONGEST_TEXT)
    page = _Read()
    page.feed(f'<p title="{markup_text(text)}">{markup_text(text)}</p>')
    page.close()
    assert page.tags == [("p", [("title", shown)])]
    assert page.text == shown
    tree = ET.fromstring(f'<p title="{markup_text(text)}">{markup_text(text)}</p>')  # noqa: S314 - our own
    assert (tree.text or "") == shown
    assert len(tree) == 0


@SHOWN
def test_script(text):
    source = script_json({"name": text, text: [text]})
    assert not re.search(r"[<>&\u2028\u2029]", source)
    assert not UNPRINTABLE.search(source)
    source.encode("utf-8")
    assert json.loads(source) == {"name": text, text: [text]}


STEERING = tuple("".join(UNPRINTABLE.findall("".join(map(chr, range(0x110000))))))


@pytest.mark.parametrize("indent", [None, 1])
def test_json_holds_no_character_that_steers_and_says_the_same(indent):
    value = {" ".join(STEERING): list(STEERING), "letters": "caf\u00e9 \u673a \U0001f600", "n": [1, 2.5, None]}
    source = json_text(value, indent=indent)
    assert not UNPRINTABLE.search(source)
    source.encode("utf-8")
    assert json.loads(source) == value
    assert "caf\u00e9 \u673a \U0001f600" in source
    assert json_text(value, ascii_only=True).isascii()


@SHOWN
def test_a_line_of_json(text):
    if re.search("[\ud800-\udfff]", text):
        with pytest.raises(InvalidInputError, match="a lone surrogate"):
            dump_json({"name": text})
        return
    line = json_line(dump_json({"name": text}))
    assert not UNPRINTABLE.search(line.decode("utf-8"))
    assert json.loads(line) == {"name": text}
    if not UNPRINTABLE.search(text):
        assert line == dump_json({"name": text}) + b"\n"


def _texts(source):
    """Returns what Markdown shows: the types of its blocks, and the text of the first paragraph and its parts."""
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(source)
    inline = [token for token in tokens if token.type == "inline"]
    return [t.type for t in tokens], inline


@SHOWN
def test_markdown(text):
    shown = one_line(text, most=LONGEST_TEXT)
    for before, kinds in (
        ("", ["paragraph_open", "inline", "paragraph_close"]),
        ("# ", ["heading_open", "inline", "heading_close"]),
        ("Of ", ["paragraph_open", "inline", "paragraph_close"]),
    ):
        found, inline = _texts(before + markdown_text(text))
        if not shown:
            continue
        assert found == kinds
        assert {child.type for child in inline[0].children} <= {"text", "text_special"}
        assert "".join(child.content for child in inline[0].children) == before.removeprefix("# ") + shown
    rows = [(markdown_text(text), markdown_code(text), "x")]
    found, inline = _texts("\n".join(markdown_table(("a", "b", "c"), rows)))
    assert found.count("td_open") == 3
    cells = [inline[i] for i in range(3, 6)]
    assert "".join(child.content for child in cells[0].children) == shown
    assert [child.type for child in cells[1].children] == ["code_inline"]
    assert cells[1].children[0].content.strip() == shown.strip()
    assert [child.content for child in cells[2].children] == ["x"]


@SHOWN
def test_cells_of_a_spreadsheet(text):
    rows = list(csv.reader(io.StringIO(to_csv(Table("t", "c", (text, "n"), ((text, -1.5),))))))
    assert [len(row) for row in rows] == [2, 2]
    for cell in (rows[0][0], rows[1][0]):
        assert not cell.strip(" \xa0").startswith(("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d"))
        assert cell.removeprefix("'") == printable(text, most=LONGEST_TEXT).removeprefix("'")
    assert rows[1][1] == "-1.5"
    assert csv_text("put the mug") == "put the mug"


@SHOWN
def test_latex(text):
    source = latex_text(text)
    commands = re.findall(r"\\([A-Za-z]+|.)", source)
    ours = {"textbackslash", "textasciicircum", "textasciitilde", "textless", "textgreater", "textbar", "char"}
    assert set(commands) <= ours | {"dots", "rightarrow", "Delta", "pi", "times", "geq", "leq"} | set("{}$&#%_,")
    bare = re.sub(r"\\([A-Za-z]+\d*\{\}|[^A-Za-z])", "", source)
    assert not re.search(r"[\\{}#%&_^]", bare)
    assert not re.search("[\n\ufffd]", source)  # pdflatex has no letter for the second


@pytest.mark.parametrize("text", ["[1cm] x", "[", "*x", " [x", "\xa0[x"])
def test_no_row_of_a_latex_table_begins_as_an_argument_of_what_ends_the_row_before(text):
    for count in (2, 50):
        lines = table_to_latex(Table("t", "c", (text, "n"), ((text, text),) * count)).splitlines()
        rows = [line for line in lines if line.endswith(r"\\") and "&" in line]
        assert len(rows) >= count + 1
        assert not [row for row in rows if row.lstrip(" ~")[0] in "[*"]
        assert sum(latex_text(text).strip(" ~") in row for row in rows) >= count + 1


def test_ordinary_names_stay_as_they_are():
    for text in ("fast_food/T1", "position x [m]", "a < b & c", "openpi://localhost:8000?preset=x", "0.5 (3/6)"):
        assert markdown_text(text) == text
    for text in ("runs/demos", "--out", "openpi_libero", "T1"):
        assert shell_word(text) == text
