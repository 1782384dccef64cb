import re
from importlib.resources import files
from pathlib import Path

import pytest

from gpszip.view.script import join_modules

#: A name that a module declares at its top.
DECLARED = re.compile(r"^(?:async )?(?:function|class|const|let)\*? (\w+)", re.MULTILINE)


def test_modules_stand_behind_those_that_they_import():
    sources = {
        "main.js": 'import { a } from "./a.js";\nimport { b } from "./b.js";\na(b);\n',
        "a.js": 'import {\n  b,\n} from "./b.js";\nexport function a() { b; }\n',
        "b.js": "export const b = 1;\n",
        "unused.js": "export const c = 2;\n",
    }
    assert join_modules(sources) == "const b = 1;\nfunction a() { b; }\na(b);\n"


def test_comments_on_lines_of_their_own_stay_behind():
    source = """/**
 * The page.
 */
// Begin.
  /** @type {number} */
const a = "http://x"; // an address

  // End.
const b =
  /** @type {number} */ (6) / 3;

/** The end. */
"""
    joined = join_modules({"main.js": source})
    assert (
        joined
        == 'const a = "http://x"; // an address\n\nconst b =\n  /** @type {number} */ (6) / 3;\n\n'
    )


@pytest.mark.parametrize(
    ("sources", "says"),
    [
        ({}, "no module main.js"),
        ({"main.js": 'import { a } from "./a.js";\n'}, "no module a.js"),
        ({"main.js": 'import { main } from "./main.js";\n'}, "import each other"),
        ({"main.js": 'import * as a from "./a.js";\n'}, "can't join 'import"),
        ({"main.js": "export default 1;\n"}, "can't join 'export default 1;'"),
    ],
)
def test_what_cannot_be_joined_is_refused(sources, says):
    with pytest.raises(ValueError, match=says):
        join_modules(sources)


def test_the_names_of_all_modules_of_the_page_are_different():
    folder = files("gpszip.view") / "assets" / "script"
    sources = {file.name: file.read_text() for file in folder.iterdir()}
    declared = [name for source in sources.values() for name in DECLARED.findall(source)]
    assert "join" not in declared  # the pattern finds names, not words
    assert sorted(set(declared)) == sorted(declared)
    assert len(declared) > 20

    # All modules are in one of the pages, and none can end the element that holds it.
    script = join_modules(sources) + join_modules(sources, "live.js")
    assert all(name in script for name in declared)
    assert "</script" not in script.lower()


def test_the_documentation_lists_all_layers_with_their_keys():
    source = (files("gpszip.view") / "assets" / "script" / "layers.js").read_text()
    layers = re.findall(r'\bkey: "(.)",\s*label: "([^"]+)"', source)
    documentation = (Path(__file__).parents[2] / "docs" / "view.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| ([a-z, ]+) \| (\w) \|", documentation, re.MULTILINE)
    assert [(label.lower(), key) for key, label in layers] == listed
    assert len(layers) > 10
