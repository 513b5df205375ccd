// The page of one analysis: events as they come, with asking again as what is relied on.

import { $ } from "./say.js";
import { refresh } from "./rows.js";

const box = $("rows");
if (box?.dataset.events && "EventSource" in window) {
  const events = new EventSource(box.dataset.events);
  events.addEventListener("analysis", refresh);
  events.addEventListener("error", () => events.close());
}
