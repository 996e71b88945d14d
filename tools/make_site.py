"""Build the documentation site, and check that links, anchors and documented public names exist.

Examples:
    python tools/make_site.py                    into site/
    python tools/make_site.py --out /tmp/site    elsewhere
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
_LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src"}
"""Attribute with the address, by HTML element that a browser loads automatically."""


@dataclass(slots=True)
class Page(HTMLParser):
    """Outgoing links and link targets of a site page.

    Attributes:
        anchors: Its ids.
        links: Targets of its links, as written.
        loaded: Targets that a browser fetches with the page.
    """

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Initialize the parser for one page."""
        HTMLParser.__init__(self)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Process the start of an element."""
        values = {name: value for name, value in attrs if value is not None}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and "href" in values and values.get("rel") != "canonical":
            self.loaded.append(values["href"])
        if tag in _LOADED and _LOADED[tag] in values:
            self.loaded.append(values[_LOADED[tag]])


def write_index_script(site: Path) -> None:
    """Write the search index as a script too: a page opened from disk cannot fetch a file."""
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    (site / "search" / "search_index.js").write_text(f"var __index = {index}", encoding="utf-8")


def read_pages(site: Path) -> dict[Path, Page]:
    """Return all pages of a site by path."""
    pages = {}
    for path in sorted(site.rglob("*.html")):
        page = Page()
        page.feed(path.read_text(encoding="utf-8"))
        pages[path] = page
    return pages


def link_problems(site: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Yield a sentence for every broken link, and for everything that is loaded from another host."""
    for path, page in pages.items():
        if path.name == "404.html":  # links of this page are absolute
            continue
        where = path.relative_to(site)
        for target in (*page.links, *page.loaded):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                if target in page.loaded and parts.scheme != "data":
                    yield f"{where}: loads {target}"
                continue
            aim = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not aim.exists():
                yield f"{where}: links to {target}, which does not exist"
            elif parts.fragment and aim in pages and unquote(parts.fragment) not in pages[aim].anchors:
                yield f"{where}: links to {target}, which has no such anchor"


def module_file(name: str) -> Path:
    """Return a module's source by its full name; if the name is not a module, return a file that does not exist."""
    package = name.partition(".")[0]
    source = ROOT / "src" if package == "betterbench" else ROOT / "packages" / package.replace("_", "-") / "src"
    place = source / name.replace(".", "/")
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def documented_modules(page: Path) -> list[str]:
    """Return the modules that a reference page documents completely."""
    names = re.findall(r"^::: (\S+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [name for name in names if module_file(name).exists()]


def public_names(file: Path) -> set[str]:
    """Return the names in a module's ``__all__``; if it has none, its public functions and classes."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__":
            return set(ast.literal_eval(node.value))
    defined = (node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return {name for name in defined if not name.startswith("_")}


def name_problems(site: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Yield a sentence for every public name of a documented module that its page does not show."""
    for path in sorted((ROOT / "docs" / "reference").glob("*.md")):
        shown = pages[site / "reference" / f"{path.stem}.html"].anchors
        for module in documented_modules(path):
            file = module_file(module)
            for name in sorted(public_names(file)):
                full = f"{module}.{name}"
                # If a function and a module have the same name, the page names the module that defines the function.
                hidden = file.name == "__init__.py" and (file.parent / f"{name}.py").exists()
                is_package = file.name == "__init__.py" and (file.parent / name).is_dir()
                elsewhere = hidden and any(re.fullmatch(rf"{module}\.\w+\.{name}", anchor) for anchor in shown)
                if full not in shown and not is_package and not elsewhere:
                    yield f"reference/{path.stem}.html: {full} is missing; give it a docstring"


def main() -> int:
    """Build and check the site; return 0, or 1 if there is a problem."""
    parser = argparse.ArgumentParser(description="Build the documentation as a site, and check it.")
    parser.add_argument("--out", type=Path, default=ROOT / "site", help="folder of the site")
    site: Path = parser.parse_args().out.resolve()
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--clean", "--site-dir", str(site)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}  # hides an advertisement for another program
    if subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode != 0:
        return 1
    write_index_script(site)
    pages = read_pages(site)
    problems = [*link_problems(site, pages), *name_problems(site, pages)]
    for problem in problems:
        print(problem, file=sys.stderr)
    links = sum(len(page.links) for page in pages.values())
    print(f"{site}: {len(pages)} pages, {links} links, {len(problems)} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
