// Mouse, fingers and keys on the picture: what they turn.

/// How far a drag over the whole picture turns, radians, and a key.
const TURN = Math.PI;
const KEY = Math.PI / 36;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/// `turn(what, across, down)` in radians, `what` "light" or "camera"; `zoom(factor)`; `rest()` once nothing is held any more. `held()` says what a plain
/// drag turns; with Shift or another button than the first it turns the other. Where `near(x)` is true, x from 0 on the left to 1, a drag is no turn but `draw(x)`.
export function hands(canvas, { turn, zoom, rest, held, near, draw }) {
  const down = new Map();
  const across = (event) => (event.clientX - canvas.getBoundingClientRect().left) / canvas.clientWidth;
  let drawing = false;
  const other = () => (held() === "light" ? "camera" : "light");
  let spread = 0;
  const apart = () => {
    const [a, b] = [...down.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    drawing = down.size === 1 && event.button === 0 && !event.shiftKey && near(across(event));
    if (down.size === 2) spread = apart();
  };
  canvas.onpointermove = (event) => {
    const was = down.get(event.pointerId);
    if (!was) {
      canvas.style.cursor = near(across(event)) ? "ew-resize" : "";
      return;
    }
    const [x, y] = [event.clientX, event.clientY];
    down.set(event.pointerId, { x, y });
    if (down.size === 2) {
      const now = apart();
      zoom(spread / (now || 1));
      spread = now;
    } else if (drawing) {
      draw(Math.max(0, Math.min(1, across(event))));
    } else if (down.size === 1) {
      const size = Math.min(canvas.clientWidth, canvas.clientHeight);
      turn(event.shiftKey || event.buttons > 1 ? other() : held(), (TURN * (x - was.x)) / size, (TURN * (y - was.y)) / size);
    }
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => {
    if (down.delete(event.pointerId) && !down.size) rest();
  };
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.onkeydown = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) turn(event.shiftKey ? other() : held(), KEY * arrow[0], KEY * arrow[1]);
    else if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 1 / 1.1 : 1.1);
    else return;
    event.preventDefault();
    rest();
  };
  // The page itself must still scroll over the picture, but for those who zoom on purpose.
  canvas.onwheel = (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(0.002 * event.deltaY));
    rest();
  };
}
