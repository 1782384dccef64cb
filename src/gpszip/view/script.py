"""The script of a page: its modules joined to one.

A page that opens from disk, offline, can't load modules: browsers refuse ``import`` there. So the
modules become one script, in the order of their imports. All names at the top of modules are
different, so that nothing needs to be renamed; a test checks that.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

__all__ = ["ENTRY", "join_modules"]

#: The module with which the script starts.
ENTRY = "main.js"

#: An import of names from another module: ``import { a, b } from "./c.js";``.
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+\.js)";\n', re.MULTILINE)

#: What a module exports: the word goes, the declaration stays.
_EXPORT = re.compile(r"^export (?=(?:async function|function|class|const) )", re.MULTILINE)

#: Comments on lines of their own: a third of the sources, of no use to a browser.
_COMMENT = re.compile(
    r"^[ \t]*(?:/\*\*(?:(?!\*/).)*\*/|//[^\n]*)[ \t]*\n", re.MULTILINE | re.DOTALL
)

#: What is left of ``import`` or ``export`` at the start of a line can't be joined.
_OTHER = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)


def join_modules(sources: Mapping[str, str], entry: str = ENTRY) -> str:
    r"""Join modules to one script.

    Parameters
    ----------
    sources : mapping of str to str
        Source of each module by its name.
    entry : str, default "main.js"
        The module that imports all others, directly or by way of others.

    Returns
    -------
    str
        The script; a module stands behind those that it imports.

    Raises
    ------
    ValueError
        If a module that is imported is missing, modules import each other in a circle, or a
        statement is of another form than ``import { a } from "./b.js";`` or ``export`` before a
        declaration.

    Examples
    --------
    >>> main = 'import { one } from "./one.js";\nconsole.log(one);\n'
    >>> join_modules({"main.js": main, "one.js": "export const one = 1;\n"})
    'const one = 1;\nconsole.log(one);\n'
    """
    # Find the modules that are needed, and what each imports.
    imports: dict[str, list[str]] = {}
    waiting = [entry]
    while waiting:
        name = waiting.pop()
        if name in imports:
            continue
        if name not in sources:
            raise ValueError(f"no module {name}")
        imports[name] = _IMPORT.findall(sources[name])
        waiting += imports[name]

    # Put them in order.
    try:
        order = list(TopologicalSorter(imports).static_order())
    except CycleError as error:
        raise ValueError(f"modules import each other: {', '.join(error.args[1])}") from error
    return "".join(_strip(name, sources[name]) for name in order)


def _strip(name: str, source: str) -> str:
    """Source of a module without comments and imports, and without the word export."""
    stripped = _EXPORT.sub("", _IMPORT.sub("", _COMMENT.sub("", source)))
    other = _OTHER.search(stripped)
    if other is not None:
        raise ValueError(f"{name}: can't join {other.group()!r}")
    return stripped
