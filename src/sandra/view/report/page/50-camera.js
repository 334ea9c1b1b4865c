// From metres (y up) to pixels (y down): what part of the road is seen.

class Camera {
  constructor() {
    this.x = 0;
    this.y = 0;
    this.scale = 6; // pixels for a metre
    this.wide = 1;
    this.high = 1;
    this.touched = false; // whether the user has moved it
  }

  resize(wide, high) {
    this.wide = Math.max(1, wide);
    this.high = Math.max(1, high);
  }

  // Show a window (x_low, x_high, y_low, y_high).
  fit([xLow, xHigh, yLow, yHigh]) {
    this.x = (xLow + xHigh) / 2;
    this.y = (yLow + yHigh) / 2;
    const scale = Math.min(this.wide / (xHigh - xLow), this.high / (yHigh - yLow));
    this.scale = Math.min(Math.max(scale, 0.2), 16); // nearer is of no use
  }

  look(x, y) {
    this.x = x;
    this.y = y;
  }

  zoom(factor, px = this.wide / 2, py = this.high / 2) {
    const [x, y] = this.world(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, 0.2), 120);
    const [nx, ny] = this.world(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  world(px, py) {
    return [this.x + (px - this.wide / 2) / this.scale, this.y - (py - this.high / 2) / this.scale];
  }

  screen(x, y) {
    return [this.wide / 2 + (x - this.x) * this.scale, this.high / 2 - (y - this.y) * this.scale];
  }

  sees(x, y, margin = 20) {
    return (
      Math.abs(x - this.x) < this.wide / 2 / this.scale + margin &&
      Math.abs(y - this.y) < this.high / 2 / this.scale + margin
    );
  }

  apply(context, ratio) {
    const k = this.scale * ratio;
    context.setTransform(
      k,
      0,
      0,
      -k,
      (this.wide / 2) * ratio - this.x * k,
      (this.high / 2) * ratio + this.y * k,
    );
  }
}

// Drag, pinch and wheel on the map; `moved` is called after each change.
function steer(canvas, camera, moved) {
  const fingers = new Map();
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return {
      long: Math.hypot(a[0] - b[0], a[1] - b[1]),
      x: (a[0] + b[0]) / 2,
      y: (a[1] + b[1]) / 2,
    };
  };
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, place(event));
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = fingers.size === 2 ? spread() : null;
    const [x, y] = fingers.get(event.pointerId);
    const now = place(event);
    fingers.set(event.pointerId, now);
    if (before) {
      const after = spread();
      camera.zoom(after.long / Math.max(before.long, 1), after.x, after.y);
    } else camera.pan(now[0] - x, now[1] - y);
    moved();
  });
  const lift = (event) => fingers.delete(event.pointerId);
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener(
    "wheel",
    (event) => {
      // Only with the control key: the page must still scroll over the map.
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      camera.zoom(Math.exp(-event.deltaY / 300), ...place(event));
      moved();
    },
    { passive: false },
  );
}
