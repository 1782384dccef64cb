"""Every example runs, prints its results, and makes the picture that the gallery shows."""

import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(path, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path)])
    runpy.run_path(str(path), run_name="__main__")
    out, err = capfd.readouterr()
    assert out.strip()
    assert err == ""
    assert (tmp_path / f"{path.stem}.png").read_bytes().startswith(b"\x89PNG")


def test_the_gallery_has_the_pictures_of_all_examples():
    # make docs draws them.
    pictures = {path.stem for path in (ROOT / "docs" / "gallery").glob("*.png")}
    assert pictures == {path.stem for path in EXAMPLES}
    collect_docs = runpy.run_path(str(ROOT / "scripts" / "collect_docs.py"))
    assert sorted(collect_docs["GALLERY"]) == sorted(pictures)
    page = collect_docs["gallery_page"]()
    for path in EXAMPLES:
        assert f"gallery/{path.stem}.png" in page
        assert path.read_text().splitlines()[-1] in page
