"""Unique display names of runs that are shown together."""

from __future__ import annotations

import functools
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from betterbench.errors import InvalidInputError
from betterbench.records.run import RunFolder

_KINDS = Path(__file__).parents[1] / "policies" / "kinds"
_REGISTERS = re.compile(r"^\w+ = register(_privileged)?\(", re.MULTILINE)
_EXTERNAL = re.compile(r"\b(OWN_PROCESS|SERVER|thread=True)\b")
_SCHEME = re.compile(r'\bscheme="([\w.+-]+)"')
_BARE = re.compile(r'\btarget="(none|optional)"')


@functools.cache
def built_in_names() -> re.Pattern[str]:
    """Return the pattern of the names that are reserved for built-in policies.

    If a user's policy declares a reserved name, the policy's address is shown instead. The names are read from the
    source text of the files in ``policies/kinds``, because reading records must not import the policy kinds. The scheme
    of a kind is the literal ``scheme="NAME"`` or, if there is none, the name of the file. A test compares the names
    with the registered kinds.
    """
    names = []
    for file in sorted(_KINDS.glob("*.py")):
        text = file.read_text(encoding="utf-8")
        if _REGISTERS.search(text) and not _EXTERNAL.search(text):
            literal = _SCHEME.findall(text)
            schemes = [re.escape(scheme) for scheme in literal or [file.stem]]
            names += [f"{scheme}:.*" for scheme in schemes]
            names += schemes if not literal or _BARE.search(text) else []
    return re.compile("|".join(names), re.IGNORECASE)


MOST_CHARACTERS = 80
"""Maximum number of characters in the name of a run. Longer names are truncated to keep pages and tables readable."""


def require_each_once(paths: Sequence[Path]) -> None:
    """Raise InvalidInputError if two paths lead to the same run."""
    places = [os.path.realpath(path) for path in paths]
    twice = next((paths[i] for i, place in enumerate(places) if place in places[:i]), None)
    if twice is not None:
        raise InvalidInputError("runs", f"{twice} is given twice", "List every run only once")


def run_names(runs: Sequence[RunFolder], given: Sequence[str] = ()) -> tuple[str, ...]:
    """Return a unique display name for each run.

    If no names are ``given``, a run gets the name that its policy declares. If several policies declare the same name,
    their runs get the addresses of the policies instead. If the addresses are the same too, the folder of each run is
    added in parentheses.

    Raises:
        InvalidInputError: If the number of given names differs from the number of runs, or if a name is empty, too long
            or repeated.
    """
    if given:
        return _checked(given, len(runs))
    declared, addresses = [_declared(run) for run in runs], [_shown(run.plan.get("policy", "policy")) for run in runs]
    shared = {name for name, n in Counter(declared).items() if n > 1}
    differ = {name for name in shared if len({a for d, a in zip(declared, addresses, strict=True) if d == name}) > 1}
    names = [a if d in differ else d for d, a in zip(declared, addresses, strict=True)]
    return told_apart(names, [run.path for run in runs])


def told_apart(names: Sequence[str], places: Sequence[Path | str]) -> tuple[str, ...]:
    """Make the display names of runs unique.

    If several runs have the same name, the name of the run's folder is appended to each of these names. If the names
    are still equal, a number is appended.
    """
    counts = Counter(names)
    named = [
        name if counts[name] == 1 else f"{name} ({Path(place).resolve().name if str(place) else number})"
        for number, (name, place) in enumerate(zip(names, places, strict=True), 1)
    ]
    again = Counter(named)
    return tuple(name if again[name] == 1 else f"{name} #{number}" for number, name in enumerate(named, 1))


def _declared(run: RunFolder) -> str:
    """Return the name that a run's policy declares, or else the address of the policy."""
    policy, address = run.context.get("policy"), _shown(run.plan.get("policy", "policy"))
    name = _shown(policy.get("name")) if isinstance(policy, dict) else ""
    return address if not name or name == address or built_in_names().fullmatch(name) else name


def _shown(name: object) -> str:
    """Return an untrusted name as one line of limited length. The result is empty if the name is not a string."""
    line = "".join(c if c.isprintable() else " " for c in name).strip() if isinstance(name, str) else ""
    return line if len(line) <= MOST_CHARACTERS else f"{line[: MOST_CHARACTERS - 1]}…"


def _checked(given: Sequence[str], runs: int) -> tuple[str, ...]:
    if len(given) != runs:
        problem = f"got {'1 name' if len(given) == 1 else f'{len(given)} names'} for {runs} run(s)"
        raise InvalidInputError("--name", problem, "Pass one name per run, in the same order")
    for name in given:
        if not name.strip() or _shown(name) != name:
            cure = f"Use a name of 1 to {MOST_CHARACTERS} printable characters"
            raise InvalidInputError("--name", f"{name[:MOST_CHARACTERS]!r} cannot be the name of a run", cure)
        if given.count(name) > 1:
            raise InvalidInputError("--name", f"{name!r} is given twice", "Use a different name for each run")
    return tuple(given)
