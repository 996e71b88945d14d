"""Quoting of external strings, with one function per output format.

A name in an untrusted data set, run, record, plan or answer may contain any characters. The required quoting depends on
the program that reads the output (a shell, a browser, a spreadsheet, LaTeX). For terminal lines and messages, use
:func:`betterbench.errors.printable` and :func:`betterbench.errors.one_line`. Quote Python source with ``repr``, YAML
strings with ``json.dumps``, and JSON for people with :func:`json_text`. Do not quote unsafe names of files to be read,
but reject them (``betterbench.records``).
"""

from __future__ import annotations

import hashlib
import html
import json
import re
import shlex
from collections.abc import Iterable, Sequence
from urllib.parse import quote

from betterbench.errors import UNPRINTABLE, InvalidInputError, one_line, printable

LONGEST_TEXT = 2000
"""Maximum number of characters of an external text in a page, a figure or a table, where it may be repeated a thousand
times.
"""


# -------------------------------------------------------------------------------------------------------------- shell
class ShellText(str):
    """Shell code written by betterbench itself, such as ``"$HERE/train.py"``. It is not quoted.

    Text from a file or a user must never become a ShellText. If a ShellText is concatenated with another string, the
    result is an ordinary string, which is quoted.
    """

    __slots__ = ()


def shell_word(value: object) -> str:
    r"""Quote a value as one word of a POSIX shell. A :class:`ShellText` is returned unchanged.

    Control characters are written as bytes (``$'\x1b'``, a form of bash), so that the command can be printed.

    Raises:
        InvalidInputError: If the value contains a null character, which a command cannot contain.
    """
    if isinstance(value, ShellText):
        return str(value)
    text = str(value)
    if "\0" in text:
        raise InvalidInputError(one_line(text, most=80), "contains a null character", "Remove it")
    if not _STEERING.search(text):
        return shlex.quote(text)
    return "$'" + "".join(map(_shell_letter, text)) + "'"


def shell_line(words: Iterable[object]) -> str:
    """Quote words as one shell command line."""
    return " ".join(map(shell_word, words))


_STEERING = re.compile(f"{UNPRINTABLE.pattern}|[\\t\\n]")


def _shell_letter(letter: str) -> str:
    if _STEERING.match(letter):
        return "".join(f"\\x{byte:02x}" for byte in letter.encode("utf-8", _encoding_of(letter)))
    return f"\\{letter}" if letter in "\\'" else letter


def _encoding_of(letter: str) -> str:
    """Return the error handler for encoding a raw byte of a file name that is not UTF-8, or a surrogate."""
    return "surrogateescape" if "\udc80" <= letter <= "\udcff" else "surrogatepass"


# -------------------------------------------------------------------------------------------------------------- files
LONGEST_NAME = 100
"""Maximum number of characters of a default name, including the digest.

File systems allow 255 bytes. The rest is left for suffixes and for the names of temporary files.
"""
_DIGEST_LETTERS = 8


def default_name(text: str, *, otherwise: str) -> str:
    """Derive a file or folder name from a string. If the string has no ASCII letter or digit, return ``otherwise``.

    The name consists of ASCII letters, digits, ``-`` and ``.``, and has at most :data:`LONGEST_NAME` characters. A
    longer name is truncated and ends with a digest of the string, so that long strings with the same beginning get
    different names.
    """
    name = re.sub(r"[^A-Za-z0-9.]+", "-", text).strip("-.") or otherwise
    if len(name) <= LONGEST_NAME:
        return name
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGEST_LETTERS]
    return f"{name[: LONGEST_NAME - _DIGEST_LETTERS - 1].strip('-.')}-{digest}"


# -------------------------------------------------------------------------------------------------------------- pages
def markup_text(text: str) -> str:
    """Escape a string for use as the content or an attribute of an HTML or XML element, and limit its length."""
    return html.escape(printable(text, most=LONGEST_TEXT), quote=True)


def script_json(value: object) -> str:
    """Return JSON that is safe inside a script element: no ``<``, ``>`` or ``&``, no unprintable characters, no NaN."""
    return _UNSAFE_IN_SCRIPT.sub(_escaped, json_text(value, separators=(",", ":"), allow_nan=False))


_UNSAFE_IN_SCRIPT = re.compile(r"[<>&]")


# --------------------------------------------------------------------------------------------------------------- JSON
def json_text(
    value: object,
    *,
    indent: int | None = None,
    separators: tuple[str, str] | None = None,
    sort_keys: bool = False,
    allow_nan: bool = True,
    ascii_only: bool = False,
) -> str:
    """Return JSON that people read in a terminal or in a file. The options are passed to ``json.dumps``.

    Letters stay readable. Characters that cannot be printed or encoded are escaped as in :func:`escaped_json`.
    """
    text = json.dumps(
        value, indent=indent, separators=separators, sort_keys=sort_keys, allow_nan=allow_nan, ensure_ascii=ascii_only
    )
    return escaped_json(text)


def escaped_json(text: str) -> str:
    """Return JSON in which the characters in :data:`betterbench.errors.UNPRINTABLE` are escaped.

    Parsing the result gives the same value.
    """
    return UNPRINTABLE.sub(_escaped, text)


def json_line(canonical: bytes) -> bytes:
    """Return a canonical JSON value as one line of a JSON lines file."""
    return escaped_json(canonical.decode("utf-8")).encode("utf-8") + b"\n"


def _escaped(found: re.Match[str]) -> str:
    """Return the JSON escape of a character. It is a surrogate pair if the character is beyond U+FFFF."""
    units = found[0].encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[at : at + 4]}" for at in range(0, len(units), 4))


# ----------------------------------------------------------------------------------------------------------- markdown
def markdown_text(text: object) -> str:
    """Escape a string as one line of Markdown, for a paragraph, a list, a heading or a table cell.

    Only characters that CommonMark or GitHub would interpret are escaped. An underscore between letters, brackets
    without an address, and a single ampersand stay unchanged.
    """
    line = _MARKDOWN.sub(r"\\\g<0>", one_line(text, most=LONGEST_TEXT))
    return re.sub(r"^(\d+)([.)])(?=\s|$)", r"\1\\\2", line)


_MARKDOWN = re.compile(
    r"[\\`|~]|\*(?!\s)|(?<=\S)\*|^\*"
    r"|(?<![^\W_])_|_(?![^\W_])"  # emphasis
    r"|\](?=[(\[:])"  # links, images and link definitions
    r"|<(?=[A-Za-z/!?])|&(?=[#\w])"  # elements and entities
    r"|^[#>]|#(?=#*$)|^[+-](?=\s|$)|^[=-](?=[=-]*$)"  # headings, quotations, lists and rules
)


def markdown_code(text: object) -> str:
    """Return a string as one line of inline code in Markdown, which is also valid in a table cell."""
    line = one_line(text, most=LONGEST_TEXT).replace("|", "\\|")
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", line)), default=0))
    room = " " if line.startswith("`") or line.endswith("`") or not line.strip() else ""
    return f"{fence}{room}{line}{room}{fence}"


def markdown_address(address: str) -> str:
    """Quote a relative address for use as the target of a Markdown link."""
    return quote(address, safe="/.-_~")


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table.

    The cells must already be escaped with :func:`markdown_text` or :func:`markdown_code`.
    """
    return [_row(head), "|" + "---|" * len(head), *map(_row, rows)]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


# ------------------------------------------------------------------------------------------------------------- tables
def csv_text(text: str) -> str:
    """Return a string for a CSV cell. It is shortened if it is too long, and spreadsheets do not read it as a formula.

    A string that would be read as a formula gets a leading apostrophe (OWASP, "CSV Injection").
    """
    text = printable(text, most=LONGEST_TEXT)
    return f"'{text}" if text.lstrip(" \N{NO-BREAK SPACE}").startswith(_FORMULA_STARTS) else text


_FORMULA_STARTS = tuple("=+-@\t\r\n\N{FULLWIDTH EQUALS SIGN}\N{FULLWIDTH PLUS SIGN}") + tuple(
    "\N{FULLWIDTH HYPHEN-MINUS}\N{FULLWIDTH COMMERCIAL AT}"
)


def latex_text(text: str) -> str:
    """Escape a string for LaTeX. Control characters become spaces."""
    escaped = printable(text, most=LONGEST_TEXT).translate(_LATEX)
    return escaped if escaped.isprintable() else "".join(c if c.isprintable() else " " for c in escaped)


_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "$": r"\$",
        "&": r"\&",
        "#": r"\#",
        "%": r"\%",
        "_": r"\_",
        "^": r"\textasciicircum{}",
        "~": r"\textasciitilde{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': r"\char34{}",  # \textquotedbl is not defined in the default font encoding
        "\N{REPLACEMENT CHARACTER}": "?",
        "→": r"$\rightarrow$",
        "−": r"$-$",
        "Δ": r"$\Delta$",
        "π": r"$\pi$",
        "×": r"$\times$",
        "≥": r"$\geq$",
        "≤": r"$\leq$",
        "–": "--",
        "…": r"\dots{}",
        "\N{NARROW NO-BREAK SPACE}": r"\,",
        "\N{NO-BREAK SPACE}": "~",
    }
)
