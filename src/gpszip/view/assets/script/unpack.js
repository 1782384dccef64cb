/**
 * The only script that the page of an archive holds as text: it unpacks the other one and runs it.
 *
 * The other one is `main.js` with all that it imports, which `gpszip.view.page` joins and packs.
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
