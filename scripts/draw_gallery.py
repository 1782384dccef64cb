"""Run all examples, and keep the pictures that they make.

    python scripts/draw_gallery.py docs/gallery

Each file of examples/ writes NAME.png into the folder that it is given. The gallery page and the
pages that explain the algorithms show these pictures.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"


def main() -> None:
    """Draw the pictures of all examples into the folder that the command line names."""
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    for example in sorted(EXAMPLES.glob("*.py")):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, example, folder], check=True, stdout=subprocess.DEVNULL)
            picture = f"{example.stem}.png"
            shutil.copy(Path(folder) / picture, target / picture)


if __name__ == "__main__":
    main()
