// The chart of the last minute, and the arm.

const SECONDS = 60, TOP_DEG = 180, FOOT_DEG = -6, LINES_DEG = [30, 60, 90];
const LONGEST_STEP_S = 0.2;

export class Strip {
  constructor(canvas) {
    this.canvas = canvas;
    this.points = [];
  }

  clear() {
    this.points = [];
  }

  add(points) {
    this.points.push(...points);
    const endS = this.points.at(-1)?.[0] ?? 0;
    const first = this.points.findIndex(([timeS]) => timeS > endS - SECONDS - 1);
    if (first > 0) this.points.splice(0, first);
  }

  draw() {
    const { canvas } = this, scale = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
    if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
    const pen = canvas.getContext("2d"), style = getComputedStyle(canvas);
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    const y = (deg) => height - ((deg - FOOT_DEG) / (TOP_DEG - FOOT_DEG)) * height;
    this.drawLevels(pen, style, width, y);
    const endS = this.points.at(-1)?.[0] ?? 0;
    this.drawCurve(pen, style, (timeS) => width - ((endS - timeS) / SECONDS) * width, y);
  }

  drawLevels(pen, style, width, y) {
    const edges = [...LINES_DEG, TOP_DEG];
    pen.font = `${style.fontSize} system-ui, sans-serif`;
    LINES_DEG.forEach((deg, place) => {
      pen.fillStyle = style.getPropertyValue(`--level-${place + 1}`);
      pen.fillRect(0, y(edges[place + 1]), width, y(deg) - y(edges[place + 1]));
      pen.fillStyle = style.getPropertyValue("--soft");
      pen.fillText(`${deg}°`, 5, y(deg) - 3);
    });
  }

  // Draw the curve; gaps stay empty.
  drawCurve(pen, style, x, y) {
    pen.strokeStyle = style.getPropertyValue("--curve");
    pen.lineWidth = 2.5;
    pen.beginPath();
    let before = null;
    for (const [timeS, deg] of this.points) {
      if (deg !== null) {
        if (before !== null && timeS - before <= LONGEST_STEP_S) pen.lineTo(x(timeS), y(deg));
        else pen.moveTo(x(timeS), y(deg));
      }
      before = deg === null ? null : timeS;
    }
    pen.stroke();
  }
}

// The upper arm, raised from hanging (0) over level (90) to overhead (180).
export function turnArm(limb, deg) {
  limb.setAttribute("transform", `rotate(${deg === null ? 0 : -deg} 0 -24)`);
  limb.setAttribute("visibility", deg === null ? "hidden" : "visible");
}
