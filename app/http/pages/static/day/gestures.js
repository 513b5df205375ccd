// Navigation of a curve: buttons, keys, wheel, drag and two fingers.

const STILL_PX = 4;

// The buttons above one or several curves.
export function listenToView(view) {
  const acts = list(view);
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", acts[button.dataset.view]);
}

// onPoint(second) is called for a click or tap without a drag; a pen that is down draws instead of moving.
export function listenToMoves(curve, onPoint = () => {}, pen = null) {
  listenToKeys(curve);
  listenToPointer(curve, onPoint, pen);
}

function list(view) {
  return { zoom_in: () => view.zoom(0.5), zoom_out: () => view.zoom(2), earlier: () => view.shift(-0.5), later: () => view.shift(0.5), whole: () => view.whole() };
}

function listenToKeys({ place, view }) {
  const acts = list(view);
  const keys = { ArrowLeft: () => view.shift(-0.1), ArrowRight: () => view.shift(0.1), "+": acts.zoom_in, "=": acts.zoom_in, "-": acts.zoom_out, Home: acts.whole };
  place.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
}

function listenToPointer(curve, onPoint, pen) {
  const { place, view } = curve;
  const fingers = new Map(); // position of each finger; two fingers pinch
  let grabbed = null;
  place.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.zoom(event.deltaY > 0 ? 1.25 : 0.8, curve.secondAt(event.clientX));
  }, { passive: false });
  place.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, event.clientX);
    if (fingers.size > 1) pen?.lift(false);
    grabbed = fingers.size > 1 ? null : { x: event.clientX, fromS: view.fromS, toS: view.toS };
    place.setPointerCapture(event.pointerId);
  });
  const isMoved = (event) => pen?.row || Math.abs(event.clientX - grabbed.x) >= STILL_PX;
  for (const end of ["pointerup", "pointercancel"]) place.addEventListener(end, (event) => fingers.delete(event.pointerId));
  place.addEventListener("pointercancel", () => pen?.lift(false));
  place.addEventListener("pointermove", (event) => {
    if (fingers.size === 2 && fingers.has(event.pointerId)) return pinch(curve, fingers, event);
    if (!grabbed || !event.buttons) return;
    if (pen?.isDown) return isMoved(event) && pen.draw(curve.secondAt(grabbed.x), curve.secondAt(event.clientX));
    const by = ((grabbed.x - event.clientX) / curve.widthPx()) * (grabbed.toS - grabbed.fromS);
    view.set(grabbed.fromS + by, grabbed.toS + by);
  });
  place.addEventListener("pointerup", (event) => {
    if (grabbed && !isMoved(event)) onPoint(curve.secondAt(event.clientX));
    pen?.lift();
    grabbed = null;
  });
}

// Zoom so that the time range between the two fingers stays between them.
function pinch(curve, fingers, event) {
  const spread = () => Math.max(10, Math.abs([...fingers.values()][0] - [...fingers.values()][1]));
  const before = spread();
  fingers.set(event.pointerId, event.clientX);
  const [one, other] = fingers.values();
  curve.view.zoom(before / spread(), curve.secondAt((one + other) / 2));
}
