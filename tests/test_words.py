"""The project's words: one for each thing, those of the field.

Each retired word names its successor. A word may stay where it has another meaning, which the
list of exceptions names by file.
"""

import io
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]

#: Retired words as regular expressions, and what to say instead.
RETIRED = {
    r"lattices?": "grid, trellis",
    r"quantum|quanta": "step",
    r"halvings?": "refinements",
    r"promis(?:e|es|ed|ing)": "error bound, state, guarantee",
    r"silences?|silent(?:ly)? (?:for|over)": "gap",
    r"ledgers?": "bit statistics",
    r"polish(?:es|ed|ing)?": "local search, improve",
    r"whereabouts": "position",
    r"mend(?:s|ed|ing)?": "clean, repair, enforce",
    r"unit(?:es|ed|ing)|unite": "merge",
    r"leaps?|leapt": "outlier",
    r"spikes?": "outlier",
    r"sewn|sew": "joined",
    r"excerpts?": "subsample",
    r"paced": "time-first",
    r"hops?": "traversal, connection",
    r"strung": "chained",
    r"despik\w*": "outlier",
    r"pour(?:s|ed|ing)": "write",
    r"house|houses": "package",
    r"rooms?": "capacity, space, package",
    r"lays?|laid|laying": "encode, place",
    r"sheets?": "table",
    r"desks?|bench(?:es)?": "workspace, state",
    r"unheeded": "ignored",
    r"stretch(?:es|ed)?": "slice, time range, path",
}

#: Files in which a word has another meaning.
EXCEPTIONS = {
    "spike": {"benchmarks/coreset.py", "docs/coreset.md"},
    # leap years and seconds, and the reason of a break
    "leap": {
        "docs/cli.md",
        "docs/matching.md",
        "src/gpszip/io/values/dates.py",
        "src/gpszip/matching/outliers.py",
        "src/gpszip/model/match.py",
    },
    # the option --stretches
    "stretch": {"docs/cli.md", "docs/prediction.md", "src/gpszip/cli/unusual.py"},
    "bench": {"CONTRIBUTING.md"},
    "house": {"docs/format.md"},
}

WORDS = {re.compile(rf"\b(?:{word})\b", re.IGNORECASE): new for word, new in RETIRED.items()}
ANY_WORD = re.compile(rf"\b(?:{'|'.join(RETIRED)})\b", re.IGNORECASE)
SOURCES = sorted((ROOT / "src").rglob("*.py"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def texts_of(path: Path):
    """Line and text of each comment, docstring and message, and of each name, of a module."""
    source = path.read_text()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in {tokenize.COMMENT, tokenize.STRING, tokenize.NAME}:
            yield token.start[0], token.string.replace("_", " ")


def offences(path: Path, lines):
    name = str(path.relative_to(ROOT))
    for number, text in lines:
        for word, new in WORDS.items():
            for match in word.finditer(text):
                excepted = any(
                    match.group().lower().startswith(stem) and name in files
                    for stem, files in EXCEPTIONS.items()
                )
                if not excepted:
                    yield f"{name}:{number}: {match.group()!r}; say {new}"


def test_code_speaks_the_words_of_the_field():
    found = []
    for path in SOURCES:
        # Only the few modules that hold a retired word somewhere are split into tokens.
        if ANY_WORD.search(path.read_text().replace("_", " ")):
            found += offences(path, texts_of(path))
    assert not found


def test_documentation_speaks_the_words_of_the_field():
    found = []
    for page in PAGES:
        found += offences(page, enumerate(page.read_text().splitlines(), 1))
    assert not found


def test_the_list_finds_a_retired_word():
    assert list(offences(ROOT / "README.md", [(1, "quanta of the lattice")]))
    assert ANY_WORD.search("the quanta of it")
