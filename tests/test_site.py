"""The script that finishes the site links roles, and finds dead links."""

import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "finish_site.py"


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(SCRIPT))


def test_roles_become_links_to_public_names(script):
    page = '<h2 id="gpszip.api.compress"></h2><h3 id="gpszip.model.track.Track.at"></h3>'
    homes = script["find_homes"]({"reference.html": page})
    text = "see :func:<code>compress</code>, :meth:<code>Track.at</code>, :func:<code>inner</code>"
    assert script["link_roles"](text, homes, "../") == (
        'see <a href="../reference.html#gpszip.api.compress"><code>compress</code></a>, '
        '<a href="../reference.html#gpszip.model.track.Track.at"><code>Track.at</code></a>, '
        "<code>inner</code>"
    )


@pytest.mark.parametrize(
    ("link", "problem"),
    [
        ('<a href="b.html">', None),
        ('<a href="b.html#there">', None),
        ('<a href="#here">', None),
        ('<a href="https://example.org/">', None),
        ('<img src="data:image/png;base64,AA==">', None),
        ('<a href="c.html">', "leads nowhere"),
        ('<a href="b.html#gone">', "no such anchor"),
        ('<img src="no.png">', "leads nowhere"),
        ('<script src="https://example.org/a.js">', "from elsewhere"),
    ],
)
def test_dead_links_and_foreign_files_are_found(script, tmp_path, link, problem):
    pages = {"a.html": f'<p id="here">{link}', "b.html": '<p id="there">'}
    for name, text in pages.items():
        (tmp_path / name).write_text(text)
    found = list(script["find_problems"]({tmp_path / name: pages[name] for name in pages}))
    assert [problem in line for line in found] == ([True] if problem else [])
