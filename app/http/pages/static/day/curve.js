// Draw the visible part of the curve, with the bands behind it. A view of half an hour or more shows the
// minutes of the report; a closer view shows the lowest and highest values per screen column, from the
// server.

/* global Plotly */

const MARGIN = { l: 46, r: 12, t: 10, b: 30 };
const DEGREES = [0, 30, 60, 90, 120, 150, 180];
const GUIDES_DEG = [30, 60, 90];
const POINTS = 1000;
const TOP_DEG = 180;
const LABEL_PX = 12; // font size of names and flags
const [LABEL_ROW_PX, FLAG_ROW_PX] = [17, 19];
const ROWS = 3;
const FONT = '"Open Sans", verdana, arial, sans-serif';
const pen = document.createElement("canvas").getContext("2d");
const MINUTES_FROM_S = 1800;

export class Curve {
  // beside: the address of a second line's values; "" for none.
  constructor(place, address, clock, view, minutes, beside = "") {
    Object.assign(this, { place, clock, view, addresses: [address, beside].filter(Boolean) });
    this.minutes = minutes.length ? trace(minutes) : null; // null: draw samples at any zoom
    this.asked = 0;
    this.values = { x: [], y: [] };
    this.others = [];
  }

  // Fetch the visible part and its surroundings; late responses are dropped.
  async load() {
    const ticket = ++this.asked;
    const around = this.view.spanS / 2;
    const from = Math.max(0, this.view.fromS - around);
    const query = new URLSearchParams({ from_s: from, to_s: Math.max(0, this.view.toS + around), points: 2 * POINTS });
    const [values, ...others] = await Promise.all(this.addresses.map((address) => read(address, query)));
    if (ticket === this.asked) Object.assign(this, { values, others });
    return ticket === this.asked;
  }

  // Update only the layout, which is fast enough for every step of a drag. The place gives the size, so that
  // curves above one another are equally wide; marks are the labels of their common time axis.
  draw(bands, chosen, points = [], marks = this.marks()) {
    const axis = { zeroline: false, color: ink("--soft"), gridcolor: ink("--line"), fixedrange: true };
    const layout = {
      width: this.place.clientWidth, height: this.place.clientHeight, margin: { ...MARGIN, b: marks.some(([, text]) => text) ? MARGIN.b : 8 }, showlegend: false, dragmode: false, hovermode: false,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { family: FONT, size: 13, color: ink("--soft") },
      xaxis: { ...axis, range: [this.view.fromS, this.view.toS], tickvals: marks.map((m) => m[0]), ticktext: marks.map((m) => m[1]), showgrid: false, tickangle: 0, ticks: "outside", ticklen: 6, tickcolor: "rgba(0,0,0,0)" },
      yaxis: { ...axis, range: [0, points.length ? this.topDeg() : TOP_DEG], tickvals: DEGREES, ticktext: DEGREES.map((degrees) => `${degrees}°`) },
      shapes: [...GUIDES_DEG.map(guide), ...bands.map((band) => area(band, band.row === chosen))],
      annotations: [...this.label(bands, chosen), ...this.point(points)],
    };
    return Plotly.react(this.place, this.lines(), layout, { displayModeBar: false, doubleClick: false });
  }

  // The upper end of the scale that leaves room for the flags, so that they cover no name.
  topDeg() {
    const heightPx = this.place.clientHeight - MARGIN.t - MARGIN.b;
    return (TOP_DEG * heightPx) / Math.max(heightPx - ROWS * FLAG_ROW_PX, 1);
  }

  marks() {
    return this.clock.marks(this.view.fromS, this.view.toS, this.widthPx());
  }

  get showsMinutes() {
    return this.minutes !== null && this.view.spanS >= MINUTES_FROM_S;
  }

  lines() {
    const line = { type: "scatter", mode: "lines", hoverinfo: "skip" };
    const others = this.others.map((values) => ({ ...values, ...line, line: { width: 3, color: ink("--beside") } }));
    const own = { width: 1, color: ink(others.length ? "--median" : "--accent") };
    if (!this.showsMinutes) return [...others, { ...this.values, ...line, line: own }];
    const { band, median } = this.minutes;
    return [
      { ...band, ...line, fill: "toself", fillcolor: ink("--minutes"), line: { width: 0 } },
      { ...median, ...line, line: { width: 1, color: ink("--median") } },
    ];
  }

  // The names of the bands in view. The chosen band and those of the form come before candidates.
  label(bands, chosen) {
    const { fromS, toS } = this.view, rank = (band) => (band.row === chosen ? 0 : band.kind === "candidate" ? 2 : 1);
    const inView = bands.filter((band) => band.startS < toS && band.endS > fromS).sort((one, other) => rank(one) - rank(other));
    const labels = inView.map(({ name, startS }) => ({ text: safe(name), atPx: (this.pixelOf(Math.max(startS, fromS)) ?? MARGIN.l) - MARGIN.l }));
    return this.stagger(labels, LABEL_ROW_PX, { y: TOP_DEG - 2, font: { size: LABEL_PX, color: ink("--ink") }, bgcolor: ink("--card"), opacity: 0.9 });
  }

  // The flags of moments in view, above the names, each centred at its time. Earlier points come first.
  point(points) {
    const inView = points.filter(({ atS }) => atS >= this.view.fromS && atS <= this.view.toS);
    const flags = inView.map(({ text, atS }) => ({ text: safe(text), atPx: this.pixelOf(atS) - MARGIN.l - measure(text) / 2 }));
    return this.stagger(flags, FLAG_ROW_PX, { yref: "paper", y: 1, font: { size: LABEL_PX, color: ink("--card") }, bgcolor: ink("--accent") });
  }

  // Place labels in three rows, so that none covers another or leaves the view. A label without room is left out.
  stagger(labels, rowPx, style) {
    const rows = Array.from({ length: ROWS }, () => []);
    return labels.flatMap(({ text, atPx }) => {
      const width = measure(text), left = Math.max(0, Math.min(atPx, this.widthPx() - width));
      const row = rows.findIndex((taken) => taken.every(([start, end]) => left >= end || left + width <= start));
      if (row < 0) return [];
      rows[row].push([left, left + width]);
      const x = this.view.fromS + (left / this.widthPx()) * this.view.spanS;
      return [{ ...style, x, text, xanchor: "left", yanchor: "top", yshift: -rowPx * row, showarrow: false, borderpad: 1 }];
    });
  }

  widthPx() {
    return this.place.clientWidth - MARGIN.l - MARGIN.r;
  }

  secondAt(clientX) {
    const left = this.place.getBoundingClientRect().left + MARGIN.l;
    return this.view.fromS + ((clientX - left) / this.widthPx()) * this.view.spanS;
  }

  // Return the position of a time, in px from the left of the box; null outside the view.
  pixelOf(second) {
    const part = (second - this.view.fromS) / this.view.spanS;
    return part < -1e-9 || part > 1 + 1e-9 ? null : MARGIN.l + part * this.widthPx();
  }
}

async function read(address, query) {
  const answer = await fetch(`${address}${address.includes("?") ? "&" : "?"}${query}`);
  if (!answer.ok) throw new Error(String(answer.status));
  return join((await answer.json()).stretches);
}

function join(stretches) {
  const x = [], y = [];
  for (const { start_s: start, step_s: step, low, high } of stretches) {
    low.forEach((value, place) => {
      const at = start + place * step;
      x.push(at);
      y.push(value);
      if (value !== high[place]) x.push(at), y.push(high[place]);
    });
    x.push(start + low.length * step);
    y.push(null);
  }
  return { x, y };
}

// Return the P10 to P90 band and the median of uninterrupted runs, with a step for each minute.
function trace(runs) {
  const band = { x: [], y: [] }, median = { x: [], y: [] };
  for (const run of runs) {
    const there = run.flatMap(([start, end, , , high]) => [[start, high], [end, high]]);
    const back = run.flatMap(([start, end, low]) => [[start, low], [end, low]]).reverse();
    for (const [x, y] of [...there, ...back, there[0], [null, null]]) band.x.push(x), band.y.push(y);
    for (const [start, end, , middle] of run) median.x.push(start, end), median.y.push(middle, middle);
    median.x.push(null), median.y.push(null);
  }
  return { band, median };
}

const FILLS = { calibration: "--band-calibration", candidate: "--band-calibration", break: "--band-out", not_worn: "--band-out", outside: "--band-out" };

function area(band, isChosen) {
  const colour = ink(FILLS[band.kind] || "--band-work");
  const edge = { width: isChosen ? 3 : 1, color: ink("--accent"), dash: band.kind === "calibration" ? "solid" : "dot" };
  return { type: "rect", xref: "x", yref: "paper", x0: band.startS, x1: band.endS, y0: 0, y1: 1, fillcolor: colour, line: edge, layer: "below" };
}

function guide(degrees) {
  const line = { width: 1, dash: "dot", color: ink("--field") };
  return { type: "line", xref: "paper", x0: 0, x1: 1, y0: degrees, y1: degrees, line, layer: "below" };
}

// Return the width of a label in px, its edge included.
function measure(text) {
  pen.font = `${LABEL_PX}px ${FONT}`;
  return pen.measureText(text).width + 8;
}

export function ink(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Escape text, because Plotly interprets markup.
function safe(text) {
  return text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
}
