"""Collect the pages of the documentation in a folder, for mkdocs.

    python scripts/collect_docs.py build/docs

Pages of docs/ are copied. Pages about commands, public names and errors are written from the code,
and files beside docs/, such as the changelog, become pages.
"""

import ast
import inspect
import json
import re
import shutil
import sys
from pathlib import Path

import click

import gpszip
from gpszip.cli.main import ERROR_CODES, ExitCode, cli
from gpszip.cli.schemas import ERROR, EVENT, SCHEMAS

ROOT = Path(__file__).parents[1]

#: Files beside docs/ that are pages, by the names of the pages.
FILES = {
    "CHANGELOG.md": "changes.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}

#: Examples in the order of the gallery.
GALLERY = ("patrol", "fleet", "error_bound", "segment_mean", "matching", "gaps")

#: Width of help texts in columns.
WIDTH = 100


def main() -> None:
    """Fill the folder that the command line names."""
    target = Path(sys.argv[1])
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(ROOT / "docs", target)
    for page in target.rglob("*.md"):
        page.write_text(link_to_pages(page.read_text()))
    for name, page in FILES.items():
        (target / page).write_text(link_from_root((ROOT / name).read_text()))
    (target / "commands.md").write_text(commands_page())
    (target / "reference.md").write_text(reference_page())
    (target / "errors.md").write_text(errors_page())
    (target / "gallery.md").write_text(gallery_page())
    write_schemas(target)


def link_to_pages(text: str) -> str:
    """Let links to files beside docs/ lead to their pages."""
    for name, page in FILES.items():
        text = text.replace(f"](../{name}", f"]({page}")
    return text


def link_from_root(text: str) -> str:
    """Let links of a file beside docs/ lead to pages."""
    for name, page in FILES.items():
        text = text.replace(f"]({name}", f"]({page}")
    text = text.replace("](docs/", "](")
    # Sources are no pages: their names stay, without a link.
    return re.sub(r"\[([^\]]*)\]\((?!https?:|[\w/-]+\.md)[^)]*\)", r"\1", text)


def commands_page() -> str:
    """Help of every command."""
    parts = [
        "# Commands\n\nWhat `gpszip COMMAND --help` prints. [The command line](cli.md) explains.\n"
    ]
    for name in cli.list_commands(click.Context(cli)):
        command = cli.get_command(click.Context(cli), name)
        context = click.Context(command, info_name=f"gpszip {name}", max_content_width=WIDTH)
        context.terminal_width = WIDTH
        parts.append(f"## {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def gallery_page() -> str:
    """Picture, explanation and code of every example, in the order of GALLERY."""
    lines = [
        "# Gallery",
        "",
        "Each picture is made by the script below it, which runs in seconds on a generated log.",
        "`python examples/NAME.py FOLDER` writes it to a folder.",
        "",
    ]
    for name in GALLERY:
        source = (ROOT / "examples" / f"{name}.py").read_text()
        tree = ast.parse(source)
        title, _, text = (ast.get_docstring(tree) or "").partition("\n\n")
        code = source.splitlines()[tree.body[0].end_lineno :]
        lines += [f"## {title.rstrip('.')}", "", text, "", f"![{title}](gallery/{name}.png)", ""]
        lines += [f'??? example "examples/{name}.py"', "    ```python"]
        lines += [f"    {line}".rstrip() for line in "\n".join(code).strip().splitlines()]
        lines += ["    ```", ""]
    return "\n".join(lines)


def write_schemas(target: Path) -> None:
    """Write the schemas of all outputs with --json, and a page that lists their fields."""
    folder = target / "schemas"
    folder.mkdir()
    lines = [
        "# JSON",
        "",
        "What commands print with `--json`: one object in one line, on standard output, or on",
        "standard error if the result itself is on standard output. Lengths are in metres, times",
        "in seconds, sizes in bytes. Numbers that are not finite are null. There are no other",
        "fields than these; a later version may add some.",
        "",
    ]
    for name, schema in {**SCHEMAS, "an event": EVENT, "an error": ERROR}.items():
        file = folder / f"{re.sub(r'[^a-z]+', '-', name)}.json"
        file.write_text(json.dumps(schema, indent=2) + "\n")
        lines += [f"## {name}", "", f"[JSON schema](schemas/{file.name})", ""]
        lines += ["| field | type | |", "|---|---|---|", *field_rows(schema), ""]
    (target / "json.md").write_text("\n".join(lines))


def field_rows(schema: dict, prefix: str = "") -> list[str]:
    """Rows of a table for the fields of an object, and for those of objects in it."""
    rows = []
    for name, field in schema["properties"].items():
        types = field.get("type", "constant" if "const" in field else "text")
        kind = types if isinstance(types, str) else " or ".join(types)
        missing = "" if name in schema["required"] else " (may be missing)"
        about = field.get("description", "")
        rows.append(f"| `{prefix}{name}` | {kind} | {about}{missing} |")
        inner = field.get("items", field)
        if "properties" in inner:
            ending = "[]." if "items" in field else "."
            rows += field_rows(inner, f"{prefix}{name}{ending}")
    return rows


def reference_page() -> str:
    """Docstrings of all public functions, then of all public types."""
    names = [name for name in gpszip.__all__ if name != "__version__"]
    errors = {name for name in names if is_error(name)}
    functions = [name for name in names if name[0].islower()]
    types = [name for name in names if not name[0].islower() and name not in errors]
    lines = ["# Python reference", "", "[Python](python.md) is the introduction.", ""]
    lines += [entry_of(name) for name in [*functions, *types]]
    return "\n".join(lines)


def errors_page() -> str:
    """Docstrings of all errors."""
    lines = [
        "# Errors",
        "",
        "All errors are kinds of `GPSZipError`. On the command line they end with an",
        "[exit code](cli.md#exit-codes) and one line; in Python they carry fields.",
        "",
    ]
    names = [name for name in gpszip.__all__ if name != "__version__" and is_error(name)]
    lines += ["| error | exit code | |", "|---|---|---|"]
    for name in names:
        error = getattr(gpszip, name)
        codes = (code for kind, code in ERROR_CODES.items() if issubclass(error, kind))
        code = str(int(next(codes, ExitCode.FAILED)))
        if issubclass(error, Warning):
            code = ""
        about = (error.__doc__ or "").splitlines()[0]
        lines.append(f"| [`{name}`](#{home_of(name)}) | {code} | {about} |")
    lines.append("")
    return "\n".join([*lines, *(f"::: {home_of(name)}\n" for name in names)])


def is_error(name: str) -> bool:
    """Whether a public name is an error."""
    value = getattr(gpszip, name)
    return isinstance(value, type) and issubclass(value, Exception)


def entry_of(name: str) -> str:
    """Entry of a public name: its docstring, or what it stands for."""
    value = getattr(gpszip, name)
    if isinstance(value, type) or inspect.isfunction(value):
        return f"::: {home_of(name)}\n"
    return f"## {name}\n\n`{value}`\n"


def home_of(name: str) -> str:
    """Full name of a public function or type, where it is defined."""
    value = getattr(gpszip, name)
    return f"{value.__module__}.{value.__qualname__}"


if __name__ == "__main__":
    main()
