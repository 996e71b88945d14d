"""Draw the imports between packages and the calls of typical commands, and write docs/architecture.md.

The imports are read from the source. The calls are traced. The script runs a trial, diagnoses it, asks questions about
it and records a demonstration. It notes the first call from each package into another.

Example:
    MUJOCO_GL=egl python tools/architecture_page.py
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from betterbench.cli.main import main as better
from code_measures import Package, imported, measure, read_files, read_layers

ROOT = Path(__file__).parents[1]
HOME = ROOT / "src" / "betterbench"
INK, SOFT, RULE, FILL, ACCENT, UPWARD = "#1c1e21", "#5c6066", "#dedad2", "#e9f0f6", "#1d5a8a", "#bf4a14"
COMMON = frozenset(
    {
        *("argument_types", "errors", "geometry", "installation", "interface", "json_form", "lazy_names"),
        *("ordinary_file", "quoting", "statistics", "wording"),
    }
)
"""Small modules that every package uses; calls into them are not shown."""


@dataclass(frozen=True)
class Call:
    """First call from one package into a module of another package.

    Attributes:
        caller: Calling package.
        callee: Called package.
        module: Called module, relative to its package; "" for the package itself.
        name: Called function, or class and method.
        purpose: First line of its docstring, or "".
    """

    caller: str
    callee: str
    module: str
    name: str
    purpose: str


@dataclass
class Tracer:
    """Profile function of a thread (:func:`sys.setprofile`) that records first calls between packages below a folder.

    Calls during an import, private and nested functions and special methods other than ``__init__`` are left out. A
    call is recorded if it is the first from the caller's package into the callee's subpackage.
    """

    home: Path = HOME
    calls: dict[tuple[str, ...], Call] = field(default_factory=dict)
    _modules: dict[CodeType, tuple[str, ...]] = field(default_factory=dict)

    def __call__(self, frame: FrameType, event: str, _argument: object) -> None:
        """Handle an event of the interpreter."""
        code = frame.f_code
        names = code.co_qualname.split(".")
        if event != "call" or any(part.startswith(("_", "<")) and part != "__init__" for part in names):
            return
        callee = self._module(code)
        back = frame.f_back
        # A decorator that checks arguments stands between the caller and the callee.
        while back is not None and self._module(back.f_code) in ((), ("argument_types",)):
            back = back.f_back
        if back is None or not callee or back.f_code.co_name == "<module>":
            return
        caller = self._module(back.f_code)[0]
        if caller == callee[0] or {caller, callee[0]} & COMMON:
            return
        name = code.co_qualname.removesuffix(".__init__")
        call = Call(caller, callee[0], ".".join(callee[1:]), name, _purpose(frame))
        self.calls.setdefault((caller, *callee[:2]) if len(callee) > 2 else (caller, callee[0]), call)

    def _module(self, code: CodeType) -> tuple[str, ...]:
        """Return the parts of the name of the module that contains some code, below the root package; () outside it."""
        known = self._modules.get(code)
        if known is None:
            path = Path(code.co_filename)
            parts = path.relative_to(self.home).with_suffix("").parts if path.is_relative_to(self.home) else ()
            known = self._modules[code] = tuple(part for part in parts if part != "__init__")
        return known


def _purpose(frame: FrameType) -> str:
    """Return the first line of the docstring of a frame's code; for ``__init__``, of its class."""
    this = frame.f_locals.get("self")
    constants = frame.f_code.co_consts
    text = type(this).__doc__ if frame.f_code.co_name == "__init__" else constants[0] if constants else ""
    return text.strip().partition("\n")[0] if isinstance(text, str) else ""


def traced(*arguments: str) -> list[Call]:
    """Run a command line in this process and return the first calls between packages, in their order.

    Raises:
        RuntimeError: If the command fails.
    """
    tracer = Tracer()
    threading.setprofile(tracer)
    sys.setprofile(tracer)
    try:
        status = better(list(arguments))
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    if status:
        raise RuntimeError(f"better {' '.join(arguments)} ended with {status}")
    return list(tracer.calls.values())


@dataclass(frozen=True)
class Way:
    """Calls between packages during a command.

    Attributes:
        slug: Part of the picture's file name.
        title: Heading of its section.
        command: The command line for the page.
        calls: First calls between packages.
    """

    slug: str
    title: str
    command: str
    calls: list[Call]


def ways(folder: Path) -> Iterator[Way]:
    """Run the commands that the page shows, with their output in a folder, and yield their calls."""
    run, shown, asked = (str(folder / name) for name in ("run", "shown", "asked"))
    one = ("--tasks", "fast_food", "--workers", "1")
    yield Way(
        "trial",
        "The path of a trial",
        "better eval --tasks fast_food --policy zoo:lexical --trials 1",
        traced("eval", *one, "--policy", "zoo:lexical", "--trials", "1", "--out", run),
    )
    yield Way("verdict", "The path of a verdict", "better diagnose RUN", traced("diagnose", run))
    yield Way(
        "demonstration",
        "The path of a demonstration",
        "better collect --tasks fast_food --demos 1",
        traced("collect", *one, "--demos", "1", "--no-films", "--out", shown),
    )
    yield Way(
        "question",
        "The path of a question",
        "better vqa RUN --questions 10",
        traced("vqa", run, "--questions", "10", "--workers", "1", "--out", asked),
    )


# -------------------------------------------------------------------------------------------------------- pictures


def draw_imports(packages: Sequence[Package], layers: Sequence[Sequence[str]], out: Path) -> None:
    """Draw the matrix of imports between packages, top layer first; the dot size shows the number of modules."""
    names = [p.name for p in packages]
    modules = Counter((f.package, target) for f in read_files(ROOT) for target in imported(f) if target != f.package)
    figure = Figure(figsize=(9.2, 7.4), layout="constrained")
    axes = figure.add_subplot()
    for row, name in enumerate(names):
        axes.axhline(row, color=RULE, lw=0.7, zorder=0)
        axes.axvline(row, color=RULE, lw=0.7, zorder=0)
        box = FancyBboxPatch((row - 0.3, row - 0.3), 0.6, 0.6, boxstyle="round,pad=0.1", fc=FILL, ec=ACCENT, lw=0.8)
        axes.add_patch(box)
        for column, other in enumerate(names):
            if number := modules[name, other]:
                color = ACCENT if column > row else UPWARD
                axes.scatter(column, row, s=14 + 7 * min(number, 40), color=color, zorder=3)
    level = {name: number for number, line in enumerate(layers) for name in line}
    for row in range(1, len(names)):
        if level.get(names[row]) != level.get(names[row - 1]):
            axes.axhline(row - 0.5, color=SOFT, lw=0.5, ls=(0, (1, 3)), zorder=0)
    axes.set_yticks(range(len(names)), [f"{p.name}  ({p.lines:,})" for p in packages], fontsize=9, color=INK)
    axes.set_xticks(range(len(names)), names, rotation=55, ha="left", fontsize=9, color=INK)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.set_ylabel("package (lines of code) imports …", color=SOFT, fontsize=9)
    axes.set_title("… this package", color=SOFT, fontsize=9, loc="left")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.spines[:].set_visible(False)
    figure.savefig(out, dpi=150)


def draw_way(calls: Sequence[Call], order: Sequence[str], out: Path) -> None:
    """Draw calls from top to bottom as arrows from caller to callee, with one column per package in the given order."""
    used = [name for name in order if any(name in (c.caller, c.callee) for c in calls)]
    column = {name: i for i, name in enumerate(used)}
    figure = Figure(figsize=(0.78 * len(used) + 1.0, 0.3 * len(calls) + 0.9), layout="constrained")
    axes = figure.add_subplot()
    for name, x in column.items():
        axes.plot([x, x], [-0.4, len(calls)], color=RULE, lw=1, zorder=0)
        axes.text(x, -0.7, name, ha="left", va="bottom", fontsize=9.5, color=INK, rotation=35)
    for y, call in enumerate(calls):
        start, end = column[call.caller], column[call.callee]
        down = end > start
        color = ACCENT if down else SOFT
        arrow = {"arrowstyle": "-|>", "color": color, "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (end, y), (start, y), arrowprops=arrow)
        axes.scatter(start, y, s=10, color=color, zorder=3)
        text = axes.text(end + (0.08 if down else -0.08), y, call.name, ha="left" if down else "right", va="center")
        text.set(fontsize=9.5, color=INK, bbox={"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.85})
    axes.set_xlim(-0.9, len(used) + 0.6)
    axes.set_ylim(len(calls) + 0.2, -3.0)
    axes.axis("off")
    figure.savefig(out, dpi=150)


# ------------------------------------------------------------------------------------------------------------ page

INTRODUCTION = """\
# Architecture

`tools/architecture_page.py` makes this page and its pictures from the code. [Contributing](contributing.md)
describes the purpose of the packages and the rules for their imports.

## Packages

Each row is a package, from the command line at the top to plain values at the bottom. A dot means that this package
imports the package of the column; a larger dot means that more of its modules do. All dots are to the right of the
diagonal, because packages import downward only. Dotted lines separate layers; packages of one layer do not import each
other.

![Matrix of imports between the packages](pictures/packages.png)
"""
ABOUT_ARROWS = "Each arrow is the first call from one package into a module of another package, in chronological order."


def page(shown: Sequence[Way]) -> str:
    """Return the page in Markdown."""
    parts = [INTRODUCTION]
    for way in shown:
        rows = [f"| {c.caller} | `{_place(c)}` | {c.purpose.replace('|', chr(92) + '|')} |" for c in way.calls]
        parts.append(
            f"## {way.title}\n\n"
            f"`{way.command}`. {ABOUT_ARROWS}\n\n"
            f"![First calls between packages]({Path('pictures') / _picture(way)})\n\n"
            f'<details markdown="1"><summary>The {len(rows)} calls and their targets</summary>\n\n'
            "| from | calls | description |\n|---|---|---|\n" + "\n".join(rows) + "\n\n</details>\n"
        )
    return "\n".join(parts)


def _place(call: Call) -> str:
    return ".".join(filter(None, (call.callee, call.module, call.name)))


def _picture(way: Way) -> str:
    return f"way_{way.slug}.png"


def main() -> None:
    """Write the page and its pictures below the folder given by ``--out``."""
    parser = argparse.ArgumentParser(description="Draw the imports between packages and the calls of typical commands.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of the documentation")
    out = parser.parse_args().out
    mpl.rcParams["font.family"] = "DejaVu Sans"
    packages = [p for p in measure(ROOT).packages if (HOME / p.name).is_dir()]
    draw_imports(packages, read_layers(ROOT), out / "pictures" / "packages.png")
    with tempfile.TemporaryDirectory() as folder:
        shown = list(ways(Path(folder)))
    for way in shown:
        draw_way(way.calls, [p.name for p in packages], out / "pictures" / _picture(way))
    (out / "architecture.md").write_text(page(shown), encoding="utf-8")


if __name__ == "__main__":
    main()
