"""Finish the site that mkdocs has built, and check it.

    python scripts/finish_site.py build/site

Roles of Sphinx in docstrings, such as :func:`compress`, become links to the reference. The run ends
with 1 if a link of a page leads nowhere, or if a page loads anything from elsewhere.
"""

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

#: A role, as mkdocstrings leaves it in a page or in the index of the search.
ROLE = re.compile(r":(?:func|class|meth|mod|attr|data|exc):<code>~?([\w.]+)</code>")

#: Pages whose headings are public names.
REFERENCE = ("reference.html", "errors.html")


def main() -> int:
    """Finish and check the site in the folder that the command line names."""
    site = Path(sys.argv[1])
    pages = {page: page.read_text() for page in sorted(site.rglob("*.html"))}

    # Link roles to public names.
    homes = find_homes({name: pages[site / name] for name in REFERENCE})
    for page, text in pages.items():
        up = "../" * (len(page.relative_to(site).parts) - 1)
        pages[page] = link_roles(text, homes, up)
        page.write_text(pages[page])
    index = site / "search/search_index.json"
    index.write_text(ROLE.sub(r"<code>\1</code>", index.read_text()))

    # Check all links.
    problems = list(find_problems(pages))
    for problem in problems:
        print(problem, file=sys.stderr)  # noqa: T201
    return 1 if problems else 0


def find_homes(pages: dict[str, str]) -> dict[str, str]:
    """Find where each public name is explained, by its name without modules."""
    homes: dict[str, str] = {}
    for page, text in pages.items():
        for anchor in re.findall(r'id="(gpszip\.[\w.]+)"', text):
            # Modules are in lower case, and so are functions: take the last part, and that of a
            # class before it.
            *before, last = anchor.split(".")
            homes.setdefault(last, f"{page}#{anchor}")
            homes.setdefault(f"{before[-1]}.{last}", f"{page}#{anchor}")
    return homes


def link_roles(text: str, homes: dict[str, str], up: str) -> str:
    """Turn the roles of a page into links; of other names, the code stays."""

    def link(match: re.Match[str]) -> str:
        name = match.group(1)
        home = homes.get(name) or homes.get(name.rpartition(".")[2] if "gpszip." in name else name)
        code = f"<code>{name.removeprefix('gpszip.')}</code>"
        return code if home is None else f'<a href="{up}{home}">{code}</a>'

    return ROLE.sub(link, text)


class _Page(HTMLParser):
    """The anchors of a page, its links, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.anchors |= {found[name] for name in ("id", "name") if found.get(name)}
        for target in (found.get("href"), found.get("src")):
            if target:
                (self.links if tag == "a" else self.loads).append(target)


def find_problems(pages: dict[Path, str]) -> Iterator[str]:
    """Yield a line for each dead link, and for each file that is loaded from elsewhere."""
    parsed = {page.resolve(): _Page(text) for page, text in pages.items()}
    for page, found in parsed.items():
        # Links of the page for missing pages begin at the root of a server.
        if page.name == "404.html":
            continue
        for target in (*found.links, *found.loads):
            if re.match(r"\w+:|//", target):
                if target in found.loads and not target.startswith("data:"):
                    yield f"{page.name}: loads {target} from elsewhere"
                continue
            name, _, anchor = target.partition("#")
            path = (page.parent / name).resolve() if name else page
            path = path / "index.html" if path.is_dir() else path
            if not path.exists():
                yield f"{page.name}: {target} leads nowhere"
            elif anchor and path in parsed and anchor not in parsed[path].anchors:
                yield f"{page.name}: {target}: no such anchor"


if __name__ == "__main__":
    sys.exit(main())
