"""A page in a browser: what a user does with it, and what one sees."""

import json
import time
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gpszip.view.script import join_modules

try:
    from selenium.webdriver import ActionChains, Keys
    from selenium.webdriver.remote.webdriver import WebDriver
except ImportError:  # this skips each module of tests, as all import this one
    pytest.skip("no selenium to drive a browser with", allow_module_level=True)

#: Seconds to wait for anything that takes a frame or a few.
PATIENCE = 20.0

#: Background of the map in light colours.
PAPER = "#fbfbf9"

#: Pixels of a colour on the map or on what moves above it.
COUNT = """
const [index, colours] = arguments;
const canvas = document.querySelectorAll(".pane canvas")[index];
const image = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
const wanted = colours.map((hex) => {
  const [red, green, blue] = [1, 3, 5].map((start) => parseInt(hex.slice(start, start + 2), 16));
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
});
let count = 0;
for (const pixel of new Uint32Array(image.data.buffer)) if (wanted.includes(pixel)) count++;
return count;
"""

#: Red, green and blue of the pixels of the map that have another colour.
OTHERS = """
const canvas = document.querySelector(".pane canvas");
const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
const wanted = [1, 3, 5].map((start) => parseInt(arguments[0].slice(start, start + 2), 16));
const others = [];
for (let i = 0; i < data.length; i += 4) {
  if (wanted.some((value, c) => data[i + c] !== value)) others.push([...data.slice(i, i + 3)]);
}
return others;
"""

#: A number that stands for a picture: another one if any pixel changes (FNV).
HASH = """
const canvas = document.querySelectorAll(arguments[0])[arguments[1]];
const image = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
let hash = 2166136261;
for (const pixel of new Uint32Array(image.data.buffer)) hash = Math.imul(hash ^ pixel, 16777619);
return hash;
"""

#: Two frames: what was changed is drawn.
FRAMES = "const d = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => d()));"


@dataclass
class Page:
    """A page that is open."""

    driver: WebDriver
    path: Path

    def open(self) -> "Page":
        self.errors(), self.requests()  # forget those of other pages
        self.driver.get(self.path.as_uri())
        self.until(lambda: self.run("return document.documentElement.dataset.ready"))
        self.settle()
        return self

    def run(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def settle(self) -> None:
        self.driver.execute_async_script(FRAMES)

    def until(self, holds) -> None:
        end = time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < end, "nothing happened"
            time.sleep(0.02)

    def element(self, id: str):
        return self.driver.find_element("id", id)

    def text(self, id: str) -> str:
        """Text of an element, with plain blanks."""
        text = self.run("return document.getElementById(arguments[0]).textContent", id)
        return text.replace("\u202f", " ").replace("\u2212", "-")

    def shown(self, id: str) -> bool:
        return self.element(id).is_displayed()

    def press(self, *keys: str) -> None:
        ActionChains(self.driver).send_keys(*keys).perform()
        self.settle()

    def press_with_shift(self, key: str) -> None:
        actions = ActionChains(self.driver).key_down(Keys.SHIFT).send_keys(key)
        actions.key_up(Keys.SHIFT).perform()
        self.settle()

    def choose(self, id: str, value: str) -> None:
        """Choose an option of a select."""
        self.run(
            "const s = document.getElementById(arguments[0]); s.value = arguments[1];"
            "s.dispatchEvent(new Event('change'));",
            id,
            value,
        )
        self.settle()

    def click(self, id: str) -> None:
        self.run("document.getElementById(arguments[0]).click()", id)
        self.settle()

    def click_all(self, selector: str, number: int) -> None:
        self.run("document.querySelectorAll(arguments[0])[arguments[1]].click()", selector, number)
        self.settle()

    def fill(self, id: str, text: str) -> None:
        """Write into a field, and press Enter."""
        field = self.element(id)
        field.clear()
        field.send_keys(text, Keys.ENTER)
        self.settle()

    def point(self, selector: str, x: float, y: float) -> None:
        """Move the mouse to a share of the width and height of a canvas."""
        self.actions_at(selector, x, y).perform()
        self.settle()

    def actions_at(self, selector: str, x: float, y: float) -> ActionChains:
        canvas = self.driver.find_elements("css selector", f"{selector} canvas")[-1]
        size = canvas.size
        dx, dy = (x - 0.5) * size["width"], (y - 0.5) * size["height"]
        return ActionChains(self.driver).move_to_element_with_offset(canvas, int(dx), int(dy))

    def drag(self, selector: str, x: float, y: float, dx: int, dy: int) -> None:
        actions = self.actions_at(selector, x, y).click_and_hold()
        actions.move_by_offset(dx // 2, dy // 2).move_by_offset(dx - dx // 2, dy - dy // 2)
        actions.release().perform()
        self.settle()

    def pixels(self, *colours: str, overlay: bool = False, pane: int = 0) -> int:
        """Pixels of the map, or above it, in any of these colours."""
        return self.run(COUNT, 2 * pane + overlay, list(colours))

    def pixels_but(self, colour: str) -> NDArray[np.int64]:
        """Red, green and blue of the pixels of the map that don't have a colour, shape (n, 3)."""
        return np.array(self.run(OTHERS, colour), np.int64).reshape(-1, 3)

    def picture(self, selector: str = ".pane", *, number: int = 0) -> int:
        """A number that stands for what a canvas shows."""
        return self.run(HASH, f"{selector} canvas", number)

    def table(self, id: str) -> dict[str, str]:
        """Labels and values of the tables in an element."""
        rows = self.run(
            "return [...document.querySelectorAll(`#${arguments[0]} tr`)]"
            ".map((row) => [...row.children].map((cell) => cell.textContent))",
            id,
        )
        return {label: value.replace("\u202f", " ") for label, value in rows}

    def errors(self) -> list[str]:
        """What the console says since this was last asked."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Addresses that were asked for since this was last asked, but for the page itself."""
        messages = [
            json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")
        ]
        sent = [each for each in messages if each["method"] == "Network.requestWillBeSent"]
        addresses = [each["params"]["request"]["url"] for each in sent]
        return [each for each in addresses if each != self.path.as_uri() and each[:5] != "data:"]


def module(name: str) -> str:
    """Source of a module of the page's script with all that it imports."""
    folder = files("gpszip.view") / "assets" / "script"
    sources = {
        file.name: file.read_text(encoding="utf-8")
        for file in folder.iterdir()
        if file.name.endswith(".js")
    }
    return join_modules(sources, name)
