// The page of one analysis: server-sent events, with polling as a fallback.

import { $ } from "./say.js";
import { refresh } from "./rows.js";

const box = $("rows");
if (box?.dataset.events && "EventSource" in window) {
  const events = new EventSource(box.dataset.events);
  events.addEventListener("analysis", refresh);
  events.addEventListener("error", () => events.close());
}
