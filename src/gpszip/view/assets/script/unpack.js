/**
 * The packed script of the page: it is unpacked and run.
 */

import { unpackText } from "./blocks.js";

try {
  const script = document.createElement("script");
  script.type = "module";
  script.textContent = await unpackText(document.getElementById("packed")?.textContent ?? "");
  document.body.append(script);
} catch (error) {
  const message = /** @type {HTMLElement} */ (document.getElementById("message"));
  message.textContent = `This page needs a newer browser: ${error}`;
  message.hidden = false;
  throw error;
}
