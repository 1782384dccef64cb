"""Draw the packages of GPSZip and their imports as an SVG picture.

    python scripts/draw_architecture.py docs/architecture.svg

Rows are the layers of pyproject.toml, from which import-linter checks the direction of imports.
Arrows are imports read from the code. An arrow is left out where a longer chain of arrows says
the same: if A imports B and B imports C, the arrow from A to C adds nothing. Packages that most
others import stand below, without arrows.
"""

from __future__ import annotations

import ast
import sys
import textwrap
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "gpszip"

#: Size of a box in pixels.
WIDTH = 190
HEIGHT = 62

#: Space between boxes in pixels.
GAP_X = 24
GAP_Y = 40

#: Space around the picture in pixels.
MARGIN = 24

#: Characters of a description that fit into one of the two lines of a box.
CHARACTERS = 36

#: A package that so many others import has no arrows: everything may use it.
COMMON = 9

STYLE = """
  text { font-family: Helvetica, Arial, sans-serif; fill: #1f2933; }
  .name { font-size: 14px; font-weight: bold; }
  .text { font-size: 10px; fill: #52606d; }
  rect { fill: #f5f7fa; stroke: #7b8794; }
  path { fill: none; stroke: #9aa5b1; stroke-width: 1.2; marker-end: url(#head); }
"""


def read_layers() -> list[list[str]]:
    """Names of packages, layer by layer, the highest first."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    (contract,) = settings["tool"]["importlinter"]["contracts"]
    return [
        [name.strip().removeprefix("gpszip.") for name in layer.split("|")]
        for layer in contract["layers"]
    ]


def read_imports(packages: set[str]) -> dict[str, set[str]]:
    """Packages that each package imports."""
    imports: dict[str, set[str]] = {name: set() for name in packages}
    for path in sorted(PACKAGE.rglob("*.py")):
        owner = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if owner not in packages:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gpszip."):
                target = str(node.module).split(".")[1]
                if target in packages and target != owner:
                    imports[owner].add(target)
    return imports


def reduce_arrows(imports: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Arrows that no longer chain of arrows replaces."""

    def reachable(start: str) -> set[str]:
        found: set[str] = set()
        stack = [start]
        while stack:
            for target in imports[stack.pop()] - found:
                found.add(target)
                stack.append(target)
        return found

    below = {name: reachable(name) for name in imports}
    return [
        (owner, target)
        for owner in sorted(imports)
        for target in sorted(imports[owner])
        if not any(target in below[other] for other in imports[owner] - {target})
    ]


def describe(package: str) -> list[str]:
    """First line of the package's docstring, in two lines."""
    path = PACKAGE / package / "__init__.py"
    path = path if path.exists() else PACKAGE / f"{package}.py"
    text = (ast.get_docstring(ast.parse(path.read_text())) or "").split("\n")[0].rstrip(".")
    return textwrap.wrap(text, CHARACTERS, max_lines=2, placeholder=" …")


def place_boxes(layers: list[list[str]]) -> tuple[dict[str, tuple[float, float]], float, float]:
    """Left upper corner of each box, and the size of the picture."""
    widest = max(len(layer) for layer in layers)
    width = 2 * MARGIN + widest * WIDTH + (widest - 1) * GAP_X
    corners = {}
    for row, layer in enumerate(layers):
        taken = len(layer) * WIDTH + (len(layer) - 1) * GAP_X
        left = (width - taken) / 2
        for column, name in enumerate(layer):
            x = left + column * (WIDTH + GAP_X)
            corners[name] = (x, MARGIN + row * (HEIGHT + GAP_Y))
    return corners, width, 2 * MARGIN + len(layers) * (HEIGHT + GAP_Y) - GAP_Y


def draw() -> str:
    """The picture as SVG."""
    layers = read_layers()
    imports = read_imports({name for layer in layers for name in layer})

    # packages that most others import stand in one row below
    common = {
        name for name in imports if sum(name in targets for targets in imports.values()) >= COMMON
    }
    rows = [[name for name in layer if name not in common] for layer in layers]
    bottom = [name for layer in layers for name in layer if name in common]
    corners, width, height = place_boxes([row for row in rows if row] + [bottom])
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0,0 L8,4 L0,8 z" '
        'style="fill:#9aa5b1;stroke:none"/></marker></defs>',
        f'<rect width="{width:g}" height="{height:g}" style="fill:white;stroke:none"/>',
    ]

    # arrows first, so that boxes cover their ends
    arrows = reduce_arrows(
        {name: targets - common for name, targets in imports.items() if name not in common}
    )
    for owner, target in arrows:
        (x1, y1), (x2, y2) = corners[owner], corners[target]
        start, end = (x1 + WIDTH / 2, y1 + HEIGHT), (x2 + WIDTH / 2, y2)
        bend = (end[1] - start[1]) / 2

        # a straight line over other rows passes beside their boxes
        is_hidden = start[0] == end[0] and end[1] - start[1] > GAP_Y
        aside = 0.8 * WIDTH if is_hidden else 0.0
        lines.append(
            f'<path d="M{start[0]:g},{start[1]:g} C{start[0] + aside:g},{start[1] + bend:g} '
            f'{end[0] + aside:g},{end[1] - bend:g} {end[0]:g},{end[1]:g}"/>'
        )

    for name, (x, y) in corners.items():
        middle = x + WIDTH / 2
        lines += [
            f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="5"/>',
            f'<text class="name" x="{middle:g}" y="{y + 19:g}" text-anchor="middle">{name}</text>',
            *(
                f'<text class="text" x="{middle:g}" y="{y + 36 + 13 * number:g}" '
                f'text-anchor="middle">{escape(line)}</text>'
                for number, line in enumerate(describe(name))
            ),
        ]
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(draw(), encoding="utf-8")
