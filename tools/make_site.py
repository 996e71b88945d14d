"""Build the documentation as a site, and check that every link, anchor and public name of it exists.

Examples:
    python tools/make_site.py                    into site/
    python tools/make_site.py --out /tmp/site    elsewhere
"""

from __future__ import annotations

import argparse
import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
_LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src"}
"""Attribute of each element that a browser fetches by itself."""


@dataclass(slots=True)
class Page(HTMLParser):
    """What a page of the site links to, and what it can be linked at.

    Attributes:
        anchors: Its ids.
        links: Targets of its links, as they are written.
        loaded: Targets that a browser fetches with the page.
    """

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Begin with an empty page."""
        HTMLParser.__init__(self)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take in one element."""
        values = {name: value for name, value in attrs if value is not None}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and "href" in values and values.get("rel") != "canonical":
            self.loaded.append(values["href"])
        if tag in _LOADED and _LOADED[tag] in values:
            self.loaded.append(values[_LOADED[tag]])


def write_index_script(site: Path) -> None:
    """Write the index of the search as a script too: a page that is opened from the disk cannot fetch a file."""
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    (site / "search" / "search_index.js").write_text(f"var __index = {index}", encoding="utf-8")


def read_pages(site: Path) -> dict[Path, Page]:
    """Return every page of a site by its place."""
    pages = {}
    for path in sorted(site.rglob("*.html")):
        page = Page()
        page.feed(path.read_text(encoding="utf-8"))
        pages[path] = page
    return pages


def link_problems(site: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Yield a sentence for every link that leads nowhere, and for everything that is loaded from another host."""
    for path, page in pages.items():
        if path.name == "404.html":  # its links begin with the address of the site
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


def public_names(package: Path) -> set[str]:
    """Return the names in ``__all__`` of a package that has one; of a module, its public functions and classes."""
    tree = ast.parse((package / "__init__.py" if package.is_dir() else package.with_suffix(".py")).read_text())
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__":
            return set(ast.literal_eval(node.value))
    defined = (node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return {name for name in defined if not name.startswith("_")}


def name_problems(site: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Yield a sentence for every public name that the reference of its package does not show."""
    for path in sorted((ROOT / "docs" / "reference").glob("*.md")):
        if path.stem == "index":
            continue
        shown = pages[site / "reference" / f"{path.stem}.html"].anchors
        for name in sorted(public_names(ROOT / "src" / "betterbench" / path.stem)):
            full = f"betterbench.{path.stem}.{name}"
            is_package = (ROOT / "src" / "betterbench" / path.stem / name).is_dir()
            # A function whose module has the same name is shown as part of the module.
            if not is_package and not shown & {full, f"{full}.{name}"}:
                yield f"reference/{path.stem}.html: {full} is missing; give it a docstring"


def main() -> int:
    """Build and check; return 0, or 1 where something is wrong."""
    parser = argparse.ArgumentParser(description="Build the documentation as a site, and check it.")
    parser.add_argument("--out", type=Path, default=ROOT / "site", help="folder of the site")
    site: Path = parser.parse_args().out.resolve()
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--clean", "--site-dir", str(site)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}  # an advertisement of another program
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
