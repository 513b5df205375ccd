// Time above 60 deg of each task, computed by the server while the task is drawn.

const KINDS = ["task", "seated", "upright", "supported"];

export class Tasks {
  constructor(place, bands) {
    Object.assign(this, { place, bands });
    this.asked = 0;
  }

  async draw() {
    const ticket = ++this.asked;
    const named = new Map();
    for (const { kind, name, startS, endS } of this.bands.periods()) {
      if (KINDS.includes(kind) && endS > startS) named.set(name, [...(named.get(name) || []), `${startS},${endS}`]);
    }
    const rows = await Promise.all([...named].map(([name, spans]) => this.ask(name, spans)));
    if (ticket !== this.asked) return; // redrawn meanwhile
    const shown = rows.filter(Boolean).sort((one, other) => other.percent - one.percent);
    this.place.querySelector("ol").replaceChildren(...shown.map(bar));
    this.place.hidden = !shown.length;
  }

  async ask(name, spans) {
    const query = new URLSearchParams(spans.map((span) => ["span", span]));
    const answer = await fetch(`${this.place.dataset.share}?${query}`).catch(() => null); // offline: show no bar
    return answer?.ok ? { name, ...(await answer.json()) } : null;
  }
}

function bar({ name, percent, words }) {
  const row = document.createElement("li");
  const parts = [name, "", words].map((textContent) => Object.assign(document.createElement("span"), { textContent }));
  parts[1].className = "share";
  parts[1].style.setProperty("--share", `${percent || 0}%`);
  row.append(...parts);
  return row;
}
